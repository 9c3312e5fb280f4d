"""Problems among spheres, drawn from seeds, each with a path that solves it.

First a path is drawn, the witness: of the planner's own polynomial family, within the limits of
joint positions and velocities and away from singularities. Then spheres are drawn that the witness
clears and the straight path (xi = 0) hits. Nothing here knows how the planner searches.

Every scenario has a twin, the same physics seen from another inertial frame. The paper's Euler
angles, and with them the straight path's rotation, depend on that frame; the spheres are drawn so
that the properties of a class hold in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound
from ff_planner_ros.planning.distance.clearance import arm_points, segments
from ff_planner_ros.planning.paths.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    Target,
)
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound, state
from ff_planner_ros.problems.paths import (
    STRAIGHT,
    clearance_along,
    clearance_of,
    sweep_of,
    within_limits,
)
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.twin import same_path, seen_back, seen_from
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import generalised_jacobian

# Largest twist of the chaser at the start [m/s, rad/s].
LARGEST_CHASER_VELOCITY, LARGEST_CHASER_RATE = 0.06, np.deg2rad(3.0)
# The witness keeps the smallest singular value of the generalised Jacobian above.
SINGULAR_VALUE_BOUND = 0.05

# Enough to reject most of the paths that leave the limits, in a quarter of the time.
_SCREENING_POINTS = 13
# Spheres that are drawn at once to choose from, and their radii in lengths of the stretched arm.
_CANDIDATES = 200
_SMALLEST_SPHERE, _LARGEST_SPHERE = 0.025, 0.08
# Certified clearance is lower than sampled clearance by this at most [m], nearly always.
_CERTIFICATE_ALLOWANCE = 1e-3
# If none of so many draws is sound, none will be: the arm has no free path, say.
_MOST_DRAWS = 10_000


@dataclass(frozen=True)
class Kind:
    """A class of scenarios."""

    spheres: tuple[int, int]  # fewest and most
    clearance: float  # least distance of the witness to the spheres [m]
    blocking: int  # fewest spheres that the straight path hits
    depth: float  # least penetration of the straight path into these [m]
    winding: float  # spread of the witness's position coefficients, in lengths of the stretched arm
    turning: float  # spread of its angle coefficients [rad]


KINDS = {
    "ordinary": Kind((3, 6), 0.02, 1, 0.005, 0.06, 0.2),
    "cluttered": Kind((9, 14), 0.01, 2, 0.04, 0.10, 0.35),
}


def scenario(kind: str, robot: str, number: int, *, turned: bool) -> Drawn[Array]:
    """Return a scenario of one of `KINDS` for a `bench_robot`; the arguments seed the draw.

    Its witness is the coefficients of the path's free terms, shape (6, 3), as the problem reads the
    orientation.

    Args:
        turned: Whether it is the twin in a rotated and shifted inertial frame.

    Raises:
        InvalidInput: None of the problems drawn for this robot has a plan.
    """
    return _twins(kind, robot, number)[turned]


@cache
def _twins(kind: str, robot: str, number: int) -> tuple[Drawn[Array], Drawn[Array]]:
    rng = np.random.default_rng([*f"{kind} {robot}".encode(), number])
    return first_sound(
        kind, robot, lambda: _draw(KINDS[kind], bench_robot(robot), rng), _MOST_DRAWS
    )


def _draw(
    kind: Kind, robot: Robot, rng: np.random.Generator
) -> tuple[Drawn[Array], Drawn[Array]] | None:
    """Draw twins; None if what was drawn is not sound."""
    reach = stretched_length(robot)
    try:
        problem = draw_motion(robot, reach, rng)
    except InvalidInput:  # a singular posture
        return None
    witness = _draw_coefficients(kind, reach, rng)
    if not within_limits(problem, witness, SINGULAR_VALUE_BOUND, _SCREENING_POINTS):
        return None
    frame = pin.SE3(pin.Quaternion(_unit(rng, 4)).toRotationMatrix(), rng.uniform(-5.0, 5.0, 3))
    twin = seen_from(problem, frame)
    twin_witness = same_path(problem, witness, twin, frame)
    witnesses = ((problem, witness), (twin, twin_witness))
    if not all(within_limits(*pair, SINGULAR_VALUE_BOUND) for pair in witnesses):
        return None
    try:
        cleared, hit = (
            (sweep_of(problem, first), seen_back(sweep_of(twin, second), frame))
            for first, second in ((witness, twin_witness), (STRAIGHT, STRAIGHT))
        )
    except NoPlanFound:  # the straight path meets a singularity
        return None
    spheres = _draw_spheres(kind, reach, cleared, hit, rng)
    if spheres is None:
        return None
    problem = replace(problem, obstacles=spheres)
    first, second = Drawn(problem, witness), Drawn(seen_from(problem, frame), twin_witness)
    for drawn in (first, second):
        if clearance_along(drawn.problem, drawn.witness) < kind.clearance:
            return None
    return first, second


def draw_motion(robot: Robot, reach: float, rng: np.random.Generator) -> PlanningProblem:
    """Draw start, target and duration; the chaser frame is the inertial frame at the start.

    Raises:
        InvalidInput: The posture that was drawn is singular.
    """
    drift = _unit(rng) * rng.uniform(0.0, LARGEST_CHASER_VELOCITY)
    spin = _unit(rng) * rng.uniform(0.0, LARGEST_CHASER_RATE)
    joints = rng.uniform(robot.lower_position_limits, robot.upper_position_limits)
    start = state(joints, np.zeros(robot.joints), drift, spin)
    q, _ = configuration(robot, start)
    data = robot.model.createData()
    # Rates in the row space of J_D are those that Eq. (31) gives, whatever the end effector does.
    own = generalised_jacobian(robot, data, q).T @ rng.normal(size=6)
    own *= rng.uniform(0.0, 0.02) / np.linalg.norm(own)
    start = replace(start, joint_velocities=joint_rates_with_ee_at_rest(robot, start) + own)
    pin.forwardKinematics(robot.model, data, q)
    ee = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    turn = pin.exp3(_unit(rng) * np.deg2rad(rng.uniform(10.0, 75.0)))
    there = ee.translation + _unit(rng) * reach * rng.uniform(0.15, 0.35)
    target = Target(there, eigen_quaternion(ee.rotation @ turn))
    return asked(robot, start, target, rng.uniform(8.0, 15.0))


def _draw_coefficients(kind: Kind, reach: float, rng: np.random.Generator) -> Array:
    spread = np.repeat([kind.winding * reach, kind.turning], 3)
    coefficients: Array = rng.normal(size=(COMPONENTS, FREE_TERMS)) * spread[:, None]
    return coefficients


def _draw_spheres(
    kind: Kind,
    reach: float,
    cleared: Sequence[Array],
    hit: Sequence[Array],
    rng: np.random.Generator,
) -> tuple[Obstacle, ...] | None:
    """Draw spheres that some sweeps clear and others hit; None if too few fit."""
    wanted = int(rng.integers(*kind.spheres, endpoint=True))
    chosen: list[Obstacle] = []
    for near, needed, depth in (
        (hit[0], kind.blocking, kind.depth),
        (cleared[0], wanted, -np.inf),
    ):
        candidates = draw_near(near, reach, rng)
        clear = np.min([clearance_of(sweep, candidates) for sweep in cleared], axis=0)
        shrink = np.maximum(0.0, kind.clearance + _CERTIFICATE_ALLOWANCE - clear)
        inside = -np.max([clearance_of(sweep, candidates) for sweep in hit], axis=0) - shrink
        for sphere, less, deep in zip(candidates, shrink, inside, strict=True):
            radius = sphere.radius - less
            apart = all(
                np.linalg.norm(sphere.center - other.center) > max(radius, other.radius)
                for other in chosen
            )
            if radius >= _SMALLEST_SPHERE * reach and deep >= depth and apart:
                chosen.append(Obstacle.sphere(f"s{len(chosen) + 1}", sphere.center, radius))
            if len(chosen) == needed:
                break
        else:
            return None
    return tuple(chosen)


def draw_near(sweep: Array, reach: float, rng: np.random.Generator) -> list[Obstacle]:
    """Draw candidate spheres around the arm of `sweep_of`; reach: of the stretched arm [m]."""
    starts = segments(sweep)
    times, links = rng.integers(len(sweep), size=_CANDIDATES), rng.choice(starts, _CANDIDATES)
    along = rng.uniform(size=(_CANDIDATES, 1))
    on_arm = (1.0 - along) * sweep[times, links] + along * sweep[times, links + 1]
    radii = reach * rng.uniform(_SMALLEST_SPHERE, _LARGEST_SPHERE, _CANDIDATES)
    offsets = rng.uniform(0.0, 2.0, _CANDIDATES) * radii
    return [
        Obstacle.sphere("candidate", point + _unit(rng) * offset, radius)
        for point, offset, radius in zip(on_arm, offsets, radii, strict=True)
    ]


def stretched_length(robot: Robot) -> float:
    """Return the length of the stretched arm, from the first joint to the end effector."""
    neutral = pin.neutral(robot.model)
    along = np.diff(arm_points(robot, neutral[None])[0], axis=0)
    return float(np.linalg.norm(along, axis=1).sum())


def _unit(rng: np.random.Generator, size: int = 3) -> Array:
    vector = rng.normal(size=size)
    unit: Array = vector / np.linalg.norm(vector)
    return unit
