"""Problems for joint splines: singular starts, partial goals, many joints, planar bases.

A motion was drawn, the witness, with a quintic for each joint; its end is the goal, and the
obstacles stay clear of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Obstacle,
    Orientation,
    PlanningProblem,
    Posture,
    Target,
)
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound, state
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import (
    generalised_jacobian,
    smallest_singular_values,
    total_momentum,
)
from ff_planner_ros.robot.state import SystemState

# Smallest singular value of a singular start at most; the planner's threshold is 0.02.
SINGULAR = 1e-3
# At the goal that of the conditions is more, so that the end effector can rest there.
_REGULAR = 0.08
# How far each joint turns at most [rad], and how fast it and the chaser begin [rad/s, m/s, rad/s].
_TURN, _MOVING, _DRIFT, _SPIN = 0.9, 0.03, 0.01, 0.01
# Joints stay away from their limits [rad], and the witness's mean rates below so much of theirs.
FROM_LIMITS, _OF_RATES = 0.1, 0.3
# From the witness's way the obstacles are so far away [m], and no smaller; they move slowly [m/s].
_CLEAR, _SMALLEST, _LARGEST, _SLOW = 0.02, 0.04, 0.15, 0.005
_CANDIDATES = 60
# Stops take so long [s]; how much more than the witness's accelerations is allowed, and from when
# to when the planner may choose, in parts of the witness's duration.
STOPS_IN, _SPARE, _WINDOW = (3.0, 6.0), 1.05, (0.2, 2.0)
_STEPS = 100


@dataclass(frozen=True)
class Kind:
    """A class of problems."""

    robots: tuple[str, ...]  # in turn
    orientations: tuple[Orientation, ...]  # in turn
    spheres: int = 0  # largest number
    singular: bool = False  # whether the initial posture is singular


KINDS = {
    "singular starts": Kind(("lemur", "arm6", "arm7"), (Orientation.FIXED,), singular=True),
    "partial goals": Kind(
        ("lemur", "arm6", "arm10"), (Orientation.FREE, Orientation.ABOUT_AXIS), spheres=3
    ),
    "many joints": Kind(("arm10", "arm14"), (Orientation.FIXED,), spheres=3),
    "planar": Kind(
        ("planar2", "planar3", "planar4", "planar3"),
        (Orientation.FREE, Orientation.FIXED, Orientation.FIXED, Orientation.FREE),
        spheres=2,
    ),
}


@cache
def drawn(kind: str, number: int) -> Drawn[JointMotion]:
    """Return a problem of one of `KINDS`; kind and number seed the draw."""
    of_kind = KINDS[kind]
    name = of_kind.robots[number % len(of_kind.robots)]
    orientation = of_kind.orientations[number % len(of_kind.orientations)]
    robot, rng = bench_robot(name), np.random.default_rng([*kind.encode(), number])

    def draw() -> Drawn[JointMotion] | None:
        posture = random_posture(robot, of_kind.singular, rng)
        if posture is None:
            return None
        return drawn_problem(robot, posture, orientation, of_kind.spheres, rng)

    return first_sound(kind, name, draw)


def drawn_problem(
    robot: Robot,
    posture: Array,
    orientation: Orientation,
    spheres: int,
    rng: np.random.Generator,
) -> Drawn[JointMotion] | None:
    """Draw a problem that starts in a posture, with a goal that a drawn motion reaches.

    None: the motion violates joint limits, or its end is singular.

    Args:
        posture: Joint positions at the start. Shape (joints,) [rad].
        spheres: Largest number of spheres.
    """
    planar, joints = robot.base is Base.PLANAR, robot.joints
    drift, spin = _DRIFT * rng.normal(size=3), _SPIN * rng.normal(size=3)
    if planar:
        drift[2] = spin[0] = spin[1] = 0.0
    if robot.wheels is not None:
        spin[:] = 0.0
    start = state(posture, _MOVING * rng.uniform(-1.0, 1.0, joints), drift, spin)
    duration = float(rng.uniform(8.0, 15.0))
    end = posture + rng.uniform(-_TURN, _TURN, joints)
    lowest = robot.lower_position_limits + FROM_LIMITS
    highest = robot.upper_position_limits - FROM_LIMITS
    too_fast = np.abs(end - posture) / duration > _OF_RATES * robot.velocity_limits
    if (end < lowest).any() or (end > highest).any() or too_fast.any():
        return None
    witness = quintic(posture, end, start.joint_velocities, duration)
    times, way, *_ = way_of(robot, start, witness, _STEPS)
    if _least_at_goal(robot, way[-1], orientation) < _REGULAR:
        return None
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, way[-1])
    goal = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    axis = rng.normal(size=3)
    target = Target(
        position=goal.translation.copy(),
        quaternion_xyzw=eigen_quaternion(goal.rotation),
        orientation=orientation,
        free_axis_in_ee=axis if orientation is Orientation.ABOUT_AXIS else None,
    )
    obstacles = spheres_beside(robot, way, times, spheres, _SLOW, rng)
    return Drawn(asked(robot, start, target, duration, obstacles=obstacles), witness)


def random_posture(robot: Robot, singular: bool, rng: np.random.Generator) -> Array | None:
    """Draw joint positions inside the limits; None: no singular ones were found near the draw.

    A joint without limits is drawn from -pi to pi.

    Args:
        singular: Whether the generalised Jacobian must be singular there.
    """
    lowest, highest = joint_range(robot)
    drawn = rng.uniform(lowest, highest)
    if not singular:
        return np.asarray(drawn, np.float64)
    base = np.concatenate([np.zeros(6), [1.0]])

    def smallest(joints: Array) -> float:
        return float(smallest_singular_values(robot, np.append(base, joints)[None])[0])

    bounds = list(zip(lowest, highest, strict=True))
    found = minimize(smallest, drawn, method="Nelder-Mead", bounds=bounds)
    return np.asarray(found.x, np.float64) if found.fun < SINGULAR else None


def _least_at_goal(robot: Robot, q: Array, orientation: Orientation) -> float:
    """Return the smallest singular value of the generalised Jacobian's rows that the goal fixes."""
    jacobian = generalised_jacobian(robot, robot.model.createData(), q)
    if orientation is not Orientation.FIXED:
        jacobian = jacobian[: 2 if robot.base is Base.PLANAR else 3]
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def spheres_beside(
    robot: Robot, way: Array, times: Array, most: int, speed: float, rng: np.random.Generator
) -> tuple[Obstacle, ...]:
    """Draw spheres of constant velocity near a motion of the arm that stay clear of it.

    Args:
        way: Configurations at the times. Shape (times, 7 + joints).
        most: Largest number of spheres.
        speed: Standard deviation of each component of their velocities [m/s].
    """
    points = arm_points(robot, way)
    starts = segments(points)
    chosen = list[Obstacle]()
    for _ in range(_CANDIDATES if most else 0):
        time, link = rng.integers(len(way)), rng.choice(starts)
        along, radius = rng.uniform(), rng.uniform(_SMALLEST, _LARGEST)
        aside, velocity = rng.normal(size=3), speed * rng.normal(size=3)
        if robot.base is Base.PLANAR:
            aside[2] = velocity[2] = 0.0
        at = (1.0 - along) * points[time, link] + along * points[time, link + 1]
        at = at + aside / np.linalg.norm(aside) * (radius + _CLEAR)
        name, begin = f"s{len(chosen) + 1}", at - times[time] * velocity
        sphere = Obstacle.sphere(name, begin, radius, velocity)
        clear = float(clearances(points, times, starts, [sphere]).distance.min())
        if clear < _CLEAR:
            if radius + clear - _CLEAR < _SMALLEST:
                continue
            sphere = Obstacle.sphere(name, begin, radius + clear - _CLEAR, velocity)
        chosen.append(sphere)
        if len(chosen) == most:
            break
    return tuple(chosen)


def quintic(begin: Array, end: Array, rates: Array, lasts: float) -> JointMotion:
    """Return a motion between joint positions, from some rates to rest, that lasts so long [s]."""
    ends = np.array([begin, end]), np.array([rates, np.zeros_like(rates)])
    return JointMotion(np.array([0.0, lasts]), *ends, np.zeros((2, len(begin))))


def stop(begin: Array, rates: Array, lasts: float) -> JointMotion:
    """Return a motion that stops the joints in a time [s]."""
    return quintic(begin, begin + rates * lasts / 2.0, rates, lasts)


def window_of(witness: JointMotion) -> DurationRange:
    """Return the durations from which the planner may choose instead of the witness's."""
    shortest, longest = (part * float(witness.time[-1]) for part in _WINDOW)
    return DurationRange(shortest, longest)


def to_stop(problem: PlanningProblem, witness: JointMotion) -> PlanningProblem:
    """Return the problem to stop as soon as possible, with 5 % more acceleration than a witness."""
    (lowest, highest), _ = witness.extremes(2)
    allowed = _SPARE * np.maximum(-lowest, highest)
    window = window_of(witness)
    return replace(
        problem,
        posture=Posture(at_rest=True),
        duration=window.maximum,
        duration_range=window,
        obstacles=(),
        objective=Objective(0.0, 0.0, 1.0),
        limits=Limits(joint_velocities=True, joint_accelerations=tuple(allowed.tolist())),
    )


def way_of(
    robot: Robot, start: SystemState, motion: JointMotion, steps: int = 200
) -> tuple[Array, Array, Array, Array]:
    """Return times of a motion, and its configurations, tangent velocities and accelerations.

    Shapes (times,) [s], (times, 7 + joints), (times, 6 + joints) and (times, joints) [rad/s2].
    """
    q, v = configuration(robot, start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    times = np.linspace(0.0, motion.time[-1], steps + 1)
    way, velocities, _ = driven(robot, q, momentum, motion, times)
    return times, way, velocities, motion.at(times)[2]


def random_state(
    robot: Robot, drift: Array, spin: Array, rate: float, rng: np.random.Generator
) -> SystemState:
    """Draw joint positions and their rates, up to `rate` [rad/s] each; see `state`.

    Motions that a planar base does not have are left out.
    """
    if robot.base is Base.PLANAR:
        drift[2] = spin[0] = spin[1] = 0.0
    joints = rng.uniform(*joint_range(robot))
    return state(joints, rate * rng.uniform(-1.0, 1.0, robot.joints), drift, spin)


def joint_range(robot: Robot) -> tuple[Array, Array]:
    """Return between which positions joints are drawn; those without limits from -pi to pi."""
    lowest = np.maximum(robot.lower_position_limits, -np.pi) + FROM_LIMITS
    return lowest, np.minimum(robot.upper_position_limits, np.pi) - FROM_LIMITS
