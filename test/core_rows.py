"""Rows of the compiled core at configurations that a test chooses.

The core has rows of paths alone. Joints that rest have derivatives drawn at random, those of the
base follow, and the path is corrected to the configurations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, obstacles_of
from ff_planner_ros.planning.distance.search_certificate import CERTIFICATE_GAP
from ff_planner_ros.planning.optimisation.program import _motion_of
from ff_planner_ros.planning.paths.path_family import Motion, PathFamily, Sensitivity
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot

EACH = 2  # variables of a joint
NO_OBJECTIVE = compiled.PathObjective(0.0, 0.0, 0.0, np.empty(0), 0.0, np.eye(3), 0.0)


class CoreRows(NamedTuple):
    """Rows, and the configurations that they are of."""

    values: Array
    jacobian: Array
    names: Indices
    q: Array  # at all points but the first, then half-way; shape (configurations, 7 + joints)
    q_by_x: Array  # shape (configurations, 6 + joints, variables)


def resting_paths(robot: Robot, points: int, lasting: bool) -> compiled.PathsOnGrid:
    """Return paths of joints that rest at zero for x = 0; lasting: the duration is a variable."""
    rng, half = np.random.default_rng(points), 2 * points - 1
    still = np.zeros((half, robot.joints))
    moved = still if lasting else np.empty(0)
    free = rng.normal(size=(2, half, EACH))
    positions, rates = (compiled.SplineRows(rows, still, moved) for rows in free)
    # Without points that bound a joint, it has rows at points and where it turns between them.
    hull = positions if lasting else compiled.SplineRows(free[0, :0], still[:0])
    zero, turn = np.zeros(3), np.eye(3)
    start = compiled.Start(zero, turn, zero, np.zeros(6), str(robot.base))
    target = compiled.Target(
        zero, turn, np.zeros(6), np.zeros(6), "free", np.eye(3)[0], np.eye(3)[1:]
    )
    by_duration = np.zeros((3, 6)) if lasting else np.empty(0)
    rows = positions, rates, rates, hull, hull
    return compiled.joint_splines(
        chain_of(robot), start, target, False, 1.0, *rows, target_by_duration=by_duration
    )


def rows_along(
    robot: Robot,
    requirements: Sequence[compiled.PathRequirement],
    q: Array,
    q_half_way: Array,
    v: Array | None = None,
    lasting: bool = False,
    step: float = 1.0,
    aside: Array | None = None,
) -> CoreRows:
    """Return the rows of one or more requirements of a motion.

    Args:
        q: At the points. Shape (points, 7 + joints).
        q_half_way: Between them. Shape (points - 1, 7 + joints).
        v: Tangent velocities at the points; None: it rests.
        lasting: Whether the last variable is the duration, by which no configuration changes.
        step: Time from point to point [s].
        aside: By what the variables are aside of those of the motion; None: nothing.
    """
    paths = resting_paths(robot, len(q), lasting)
    x = np.zeros(EACH * robot.joints)
    begun = compiled.PathProgram(paths, 1.0, NO_OBJECTIVE, []).at(x)
    steps, half_way = (
        np.array([pin.difference(robot.model, *at) for at in zip(of, to, strict=True)])
        for of, to in ((begun.q, q), (begun.q_half_way, q_half_way))
    )
    correction = compiled.Correction(
        steps, np.zeros(steps.shape) if v is None else v - begun.v, half_way
    )
    seen = list[tuple[Array, Array]]()

    def look(motion: compiled.MotionOfPath) -> None:
        of_q, of_half_way = motion.q_by_x[1:], motion.q_half_way_by_x
        where = np.concatenate([motion.q[1:], motion.q_half_way])
        seen.append((where, np.concatenate([of_q, of_half_way])))

    asked = [*((0, one) for one in requirements), (1, look)]
    found = compiled.PathProgram(paths, step, NO_OBJECTIVE, asked, correction).at(
        x if aside is None else aside
    )
    names = found.names - compiled.NAMES_EACH // 2
    return CoreRows(found.constraints, found.constraints_jacobian, names, *seen[0])


def rows_of_motion(
    robot: Robot,
    requirements: Sequence[compiled.PathRequirement],
    motion: Motion,
    lasting: bool = False,
) -> CoreRows:
    """Return likewise those of a motion that the planner might have."""
    return rows_along(robot, requirements, motion.q, motion.q_half_way, motion.v, lasting)


def sensitivity_of(family: PathFamily, motion: Motion, damping: float = 0.0) -> Sensitivity:
    """Return the derivatives of a motion of a family, as a plug-in sees them."""
    seen = list[Sensitivity]()

    def look(of: compiled.MotionOfPath) -> None:
        seen.append(_motion_of.__wrapped__(of, family.goal_motion)[1])

    paths = family.on_grid(len(motion.q), damping)
    compiled.PathProgram(paths, 1.0, NO_OBJECTIVE, [(0, look)]).at(motion.x)
    return seen[0]


def pair_distances_of_core(robot: Robot, q: Array, interest: float) -> CoreRows:
    """Return distances of pairs of bodies that are below the interest [m]; q: in order of time."""
    asked = compiled.pairs_apart(
        bodies_of(robot), np.zeros(len(robot.pairs)), interest, False, None
    )
    return _in_order_of_time(robot, asked, q, len(robot.pairs))


def distances_of_core(
    robot: Robot,
    q: Array,
    times: Array,
    obstacles: Sequence[Obstacle],
    interest: float,
    lasting: bool = False,
) -> CoreRows:
    """Return likewise those of bodies, or lines, from obstacles; lasting: as of `rows_along`."""
    whole, pairs = with_bodies(robot), len(with_bodies(robot).bodies) * len(obstacles)
    asked = compiled.bodies_clear(
        bodies_of(whole),
        obstacles_of(obstacles, float(times.max())),
        margin=0.0,
        room=np.zeros(pairs),
        times=_even(times),
        interest=interest,
        quarter_way=False,
        allowed=None,
    )
    return _in_order_of_time(robot, asked, q, pairs, lasting)


def certified_by_core(
    robot: Robot,
    q: Array,
    v: Array,
    times: Array,
    obstacles: Sequence[Obstacle],
    gap: float = CERTIFICATE_GAP,
) -> float:
    """Return what the search certifies of all bodies, or lines, along a motion [m]."""
    whole = with_bodies(robot)
    return compiled.certified_obstacles(
        compiled.CubicMotion(chain_of(robot), q, v, times),
        bodies_of(whole),
        obstacles_of(obstacles, float(times[-1])),
        np.arange(len(whole.bodies) * len(obstacles)),
        len(times) - 1,
        gap,
        0.0,
    )


def _even(rows: Array) -> Array:
    """Return rows for points and what is half-way before each: one more if there is an odd one."""
    return np.concatenate([rows, rows[-1:]]) if len(rows) % 2 else rows


def _in_order_of_time(
    robot: Robot,
    asked: compiled.PathRequirement,
    q: Array,
    pairs: int,
    lasting: bool = False,
) -> CoreRows:
    every = _even(q)
    half_way, points = every[::2], every[1::2]
    at_points = np.concatenate([points[:1], points])
    found = rows_along(robot, [asked], at_points, half_way, lasting=lasting)
    # Points came first there.
    order = np.argsort(np.append(np.arange(len(points)) + 0.5, np.arange(len(points))))
    chosen = found.names < len(q) * pairs
    rows = (part[chosen] for part in found[:3])
    return CoreRows(*rows, *(part[order][: len(q)] for part in found[3:]))
