"""Problems whose target is a tumbling body, each with a motion that solves it, the witness.

The witness ends with the end effector at rest in the grasp; from there the body's motion is
integrated back to the start. Spheres on the body, and others that move freely, stay clear of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import islice

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems.tumbling_witness import (
    Grip,
    Witness,
    tip,
    witness_along_corridor,
    witness_to_grip,
)
from ff_planner_benchmark.problems.witnessed import random_state, spheres_beside
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.obstacles import RigidMotion
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.problems.bodies import APART, Swept, own_gap, sphere_gap
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound
from ff_planner_ros.problems.robots import ROBOTS, bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Base, Robot


@dataclass(frozen=True)
class Kind:
    """A class of problems."""

    rates: tuple[float, float]  # least and largest angular rate of bodies at capture [deg/s]
    robots: tuple[str, ...] = ROBOTS  # in turn
    geometry: Geometry = Geometry.LINES
    # Least and largest distance of the grasp from the body's centre of mass [m]
    lever: tuple[float, float] = (0.3, 0.8)
    intermediate: bool = False  # whether bodies rotate nearly about their intermediate axis
    approach: bool = False  # whether the problem has an approach corridor
    passing: int = 0  # largest number of freely moving spheres


KINDS = {
    "tumbling": Kind((1.0, 5.0)),
    "fast tumbling": Kind((10.0, 10.0)),
    "corridor": Kind((1.0, 5.0), approach=True),
    "passing spheres": Kind((1.0, 5.0), passing=3),
    "long lever": Kind((1.0, 5.0), lever=(1.3, 1.7)),
    "turning over": Kind((5.0, 10.0), intermediate=True),
    "with shapes": Kind((1.0, 5.0), geometry=Geometry.SHAPES),
    "on a table": Kind((1.0, 5.0), robots=("planar3", "planar4")),
}

# How far each joint turns at most [rad], and how fast it and the chaser begin [rad/s, m/s, rad/s].
_TURN, _MOVING, _DRIFT, _SPIN = 0.9, 0.03, 0.01, 0.01
# The body's centre of mass drifts so fast [m/s].
_BODY_DRIFT = 0.01
# Second moments of its mass along the principal axes [kg m2]: a moment of inertia sums two of them.
_LOWEST_SPREAD, _HIGHEST_SPREAD = (0.2, 0.5, 0.8), (0.4, 0.8, 1.2)
_ASIDE = 0.4  # so far is the direction there from that of the arm's end, as a tangent
_NEARLY = 0.01  # so far is its turn from the intermediate axis, as a tangent
# A corridor is so long [m]; its direction is so far from that of the arm's end, as a tangent.
_SHORTEST, _LONGEST, _OFF = 0.1, 0.3, 0.3
# Attached spheres: how many, how large [m], how far from the witness [m] and from the chaser [m],
# and half the edge of the cube that the body is [m].
_FEWEST, _MOST, _SMALLEST, _LARGEST = 6, 14, 0.06, 0.3
_CLEAR, _FROM_CHASER, _EXTENT = 0.02, 0.8, 0.5
_AROUND = 0.2  # so far beyond the grasp there are some, too [m]
# How fast spheres move by themselves, each way [m/s]. So many times as many are drawn beside the
# arm's lines, where bodies leave no room for some of them.
_PASSING, _TO_CHOOSE_FROM = 0.03, 4
_CANDIDATES = 80


def problem(kind: str, number: int) -> PlanningProblem:
    """Return a problem of one of `KINDS`, without its witness."""
    return drawn(kind, number).problem


@cache
def drawn(kind: str, number: int) -> Drawn[Witness]:
    """Return a problem of one of `KINDS`; kind and number seed the draw."""
    of_kind = KINDS[kind]
    name = of_kind.robots[number % len(of_kind.robots)]
    robot, rng = (
        bench_robot(name, of_kind.geometry),
        np.random.default_rng([*kind.encode(), number]),
    )
    return first_sound(kind, name, lambda: drawn_capture(robot, of_kind, rng))


def drawn_capture(robot: Robot, kind: Kind, rng: np.random.Generator) -> Drawn[Witness] | None:
    """Draw a system, a body and a motion; None: the motion violates a constraint."""
    drift, spin = _DRIFT * rng.normal(size=3), _SPIN * rng.normal(size=3)
    start = random_state(robot, drift, spin, _MOVING, rng)
    duration = float(rng.uniform(8.0, 15.0))
    end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
    ahead = _ahead(robot, end)
    grip = _grip(robot, kind, ahead, rng)
    approach = _approach(robot, ahead, rng) if kind.approach else None
    if approach is None:
        witness = witness_to_grip(robot, start, end, grip, duration)
    else:
        corridor = approach.distance * approach.direction
        witness = witness_along_corridor(robot, start, end, grip, duration, corridor)
    if witness is None or (approach and not _keeps(robot, approach, witness)):
        return None
    swept = Swept(robot, witness.way) if robot.bodies else None
    if swept and own_gap(swept, APART) < APART:
        return None
    spheres = _attached(robot, witness, swept, kind.lever[1], rng)
    if len(spheres) < _FEWEST:
        return None
    wanted = _TO_CHOOSE_FROM * kind.passing if swept else kind.passing
    passing = spheres_beside(robot, witness.way, witness.times, wanted, _PASSING, rng)
    if swept:
        beside = (_beside_bodies(swept, one, witness.times) for one in passing)
        passing = tuple(islice((one for one in beside if one is not None), kind.passing))
    target = witness.body.target(duration)
    problem = asked(robot, start, target, duration, obstacles=passing, approach=approach)
    return Drawn(with_capture_target(replace(witness.body, obstacles=spheres), problem), witness)


def _beside_bodies(swept: Swept, passing: Obstacle, times: Array) -> Obstacle | None:
    """Return a moving sphere, shrunk to stay clear of the robot's bodies; None: too small."""
    centers = passing.center + times[:, None] * passing.motion.velocity
    room = sphere_gap(swept, passing, _CLEAR, centers) - _CLEAR
    radius = passing.radius + min(room, 0.0)
    if radius < _SMALLEST:
        return None
    return Obstacle.sphere(passing.id, passing.center, radius, passing.motion.velocity)


def _grip(robot: Robot, kind: Kind, ahead: Array, rng: np.random.Generator) -> Grip:
    """Draw a body that rotates about no principal axis, or nearly about the intermediate one.

    On a planar base it rotates about the table's normal, a principal axis.

    Args:
        ahead: Direction in which the arm ends, a unit vector in end-effector axes. Shape (3,).
    """
    rate = np.deg2rad(rng.uniform(*kind.rates))
    a, b, c = rng.uniform(_LOWEST_SPREAD, _HIGHEST_SPREAD)
    axes = Rotation.random(rng=rng).as_matrix()
    out = ahead + _ASIDE * rng.normal(size=3)
    turn = rng.normal(size=3)
    if kind.intermediate:
        turn = axes[:, 1] + _NEARLY * turn
    to_ee, lever = Rotation.random(rng=rng).as_matrix(), rng.uniform(*kind.lever)
    drift = _BODY_DRIFT * rng.normal(size=3)
    if robot.base is Base.PLANAR:
        axes, turn = np.eye(3), np.array([0.0, 0.0, turn[2]])
        to_ee = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        out[2] = drift[2] = 0.0
    return Grip(
        to_ee=to_ee,
        center=lever * out / np.linalg.norm(out),
        inertia=axes @ np.diag([b + c, a + c, a + b]) @ axes.T,
        rate=rate * turn / np.linalg.norm(turn),
        drift=drift,
    )


def _ahead(robot: Robot, joints: Array) -> Array:
    """Return the direction in which the arm ends, in axes of the end effector. Shape (3,)."""
    q = np.concatenate([np.zeros(6), [1.0], joints])
    points = arm_points(robot, q[None])
    last = int(segments(points)[-1])
    along = points[0, last + 1] - points[0, last]
    ahead: Array = tip(robot, q).rotation.T @ along / np.linalg.norm(along)
    return ahead


def _approach(robot: Robot, ahead: Array, rng: np.random.Generator) -> Approach:
    """Draw a corridor roughly along the last link, with the default cone angle."""
    direction = ahead + _OFF * rng.normal(size=3)
    if robot.base is Base.PLANAR:
        direction[2] = 0.0
    return Approach(direction, float(rng.uniform(_SHORTEST, _LONGEST)))


def _keeps(robot: Robot, approach: Approach, witness: Witness) -> bool:
    """Tell whether the witness keeps the approach corridor."""
    grasp = witness.body.grasp(witness.times)
    tips = np.array([tip(robot, q).translation for q in witness.way])
    seen = ((tips - grasp.positions)[:, None] @ grasp.rotations)[:, 0]
    return bool(approach.margins(seen).values.min() > 0.0)


def _attached(
    robot: Robot,
    witness: Witness,
    swept: Swept | None,
    lever: float,
    rng: np.random.Generator,
) -> tuple[AttachedObstacle, ...]:
    """Draw spheres of a body that stay away from the arm and the chaser.

    Half of them are beside the arm's path in the body's frame, the others anywhere in the body.

    Args:
        swept: The robot's bodies along the witness; None: it has none.
        lever: Largest distance of the grasp from the centre of mass [m]; limits where the path
            counts.
    """
    way, times, body = witness.way, witness.times, witness.body
    points = arm_points(robot, way)
    starts, count = segments(points), int(rng.integers(_FEWEST, _MOST + 1))
    motion = body.motion(np.zeros(3), times)
    seen = (points - motion.positions[:, None]) @ motion.rotations
    seen = np.linspace(seen[:, starts], seen[:, starts + 1], 9).reshape(-1, 3)
    seen = seen[np.linalg.norm(seen, axis=1) < lever + _AROUND]
    chosen = list[AttachedObstacle]()
    for number in range(_CANDIDATES):
        center, radius = _EXTENT * rng.uniform(-1.0, 1.0, 3), rng.uniform(_SMALLEST, _LARGEST)
        if number % 2 and len(seen):
            aside = rng.normal(size=3)
            center = seen[rng.integers(len(seen))]
            center = center + (radius + _CLEAR) * aside / np.linalg.norm(aside)
        if robot.base is Base.PLANAR:
            center[2] = 0.0
        places = body.places(center[None], times)[:, 0]
        fixed = RigidMotion.fixed_to(body, pin.SE3(np.eye(3), center))
        sphere = Obstacle("drawn", Solid("sphere", np.array([radius])), fixed)
        if swept:
            clear = sphere_gap(swept, sphere, _CLEAR, places) - _CLEAR
        else:
            clear = float(clearances(points, times, starts, [sphere]).distance.min()) - _CLEAR
        away = float(np.linalg.norm(places - way[:, :3], axis=1).min()) - radius - _FROM_CHASER
        radius += min(clear, away, 0.0)
        if radius < _SMALLEST:
            continue
        chosen.append(AttachedObstacle.sphere(f"part_{len(chosen) + 1}", center, radius))
        if len(chosen) == count:
            break
    return tuple(chosen)
