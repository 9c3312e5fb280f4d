"""Problems of attitude-controlled chasers, prismatic joints, and goals in joint space.

All but "random start" have a motion that solves them, the witness.

- "held": reaction wheels hold the chaser's attitude while the end effector reaches a pose among
  spheres. Wheel limits are 1.05 or 3 times the witness's peaks, four problems each in turn.
- "rail": an arm on a prismatic joint along its chaser reaches a pose among spheres.
- "stow": the arm reaches a posture in a given time, among spheres.
- "random start": the protocol of Misra and Bai (2017): a chaser at rest, its attitude held by
  wheels, with an arm of eight joints, moves from random postures to one pose among spheres.
- "stop": the joints come to rest as soon as possible, with accelerations limited to little more
  than the witness's.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin

from ff_planner_benchmark.problems.witnessed import (
    STOPS_IN,
    drawn_problem,
    random_posture,
    spheres_beside,
    stop,
    to_stop,
    way_of,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    Orientation,
    PlanningProblem,
    Posture,
    Target,
)
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound, state
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import smallest_singular_values
from ff_planner_ros.robot.wheels import Wheels

ROBOTS, RANDOM_STARTS = ("lemur", "arm6", "arm7", "arm10"), "arm8"
# The robots of each kind, in turn.
KINDS = {
    "held": ROBOTS,
    "random start": (RANDOM_STARTS,),
    "rail": ("rail6", "rail7"),
    "stow": ROBOTS,
    "stop": ROBOTS,
}
# Limits of the wheels over the witness's peaks, in turn.
NEAR, FAR = 1.05, 3.0
# What wheels hold at the start, over the witness's peaks.
_STORED = 0.2
_FAST = 0.15  # [rad/s] joints that are to stop begin with at most
_SPHERES = 3
# Of random starts: how far the spheres are away from the arm there [m], and how long it has [s].
_AWAY, _LASTS = 0.02, 30.0
# And of their goal the smallest singular value of the generalised Jacobian at least.
_REGULAR = 0.08


@cache
def problem(kind: str, number: int) -> Drawn[JointMotion | None]:
    """Return a problem of one of `KINDS`; kind and number seed the draw.

    Of a random start no witness is known: None.
    """
    rng = np.random.default_rng([*kind.encode(), number])
    if kind == "random start":
        return Drawn(_from_random_start(rng), None)
    name = KINDS[kind][number % len(KINDS[kind])]
    robot = bench_robot(name)
    if kind == "held":
        robot = replace(robot, base=Base.ATTITUDE_HELD, wheels=Wheels())
    return first_sound(kind, name, lambda: _draw(kind, number, robot, rng))


def _draw(
    kind: str, number: int, robot: Robot, rng: np.random.Generator
) -> Drawn[JointMotion | None] | None:
    """Draw a problem with a witness; None if what was drawn is not sound."""
    posture = random_posture(robot, False, rng)
    if posture is None:
        return None
    drawn = drawn_problem(robot, posture, Orientation.FIXED, _SPHERES, rng)
    if drawn is None:
        return None
    problem, witness = drawn.problem, drawn.witness
    if kind == "held":
        factor = (NEAR, FAR)[number // len(ROBOTS) % 2]
        limited = _with_wheels(problem, witness, factor, rng)
        return Drawn(_moving_as_reached(limited, witness), witness)
    if kind == "rail":
        return Drawn(_moving_as_reached(problem, witness), witness)
    if kind == "stow":
        return Drawn(replace(problem, posture=Posture(witness.positions[-1])), witness)
    return _stopping(problem, rng)


def _from_random_start(rng: np.random.Generator) -> PlanningProblem:
    """Return the fixed scene of `_scene` with a random initial posture.

    The system's centre of mass is at rest in the origin.
    """
    robot, goal, spheres = _scene()

    def draw() -> Array | None:
        posture = random_posture(robot, False, rng)
        if posture is None:
            return None
        points = arm_points(robot, _at_origin(robot, posture)[None])
        away = clearances(points, np.zeros(1), segments(points), spheres).distance.min()
        return posture if away >= _AWAY else None

    posture = first_sound("random start", RANDOM_STARTS, draw)
    at = _at_origin(robot, posture)[:3] + robot.position_chaser_in_base
    start = state(posture, np.zeros(robot.joints), at=at)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, goal)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    target = Target(tip.translation.copy(), eigen_quaternion(tip.rotation))
    return asked(robot, start, target, _LASTS, obstacles=spheres)


@cache
def _scene() -> tuple[Robot, Array, tuple[Obstacle, ...]]:
    """Return the robot of random starts, its configuration at the goal, and spheres beside it."""
    robot = replace(bench_robot(RANDOM_STARTS), base=Base.ATTITUDE_HELD, wheels=Wheels())
    rng = np.random.default_rng(0)

    def draw() -> tuple[Robot, Array, tuple[Obstacle, ...]] | None:
        posture = random_posture(robot, False, rng)
        if posture is None:
            return None
        goal = _at_origin(robot, posture)
        spheres = spheres_beside(robot, goal[None], np.zeros(1), _SPHERES, 0.0, rng)
        is_regular = smallest_singular_values(robot, goal[None])[0] > _REGULAR
        return (robot, goal, spheres) if is_regular else None

    return first_sound("scene of random starts", RANDOM_STARTS, draw)


def _at_origin(robot: Robot, posture: Array) -> Array:
    """Return the configuration with its centre of mass at the origin and the base unrotated."""
    q = np.concatenate([np.zeros(6), [1.0], posture])
    q[:3] = -pin.centerOfMass(robot.model, robot.model.createData(), q)
    return q


def _moving_as_reached(problem: PlanningProblem, witness: JointMotion) -> PlanningProblem:
    """Return a problem whose goal moves as the end effector does at the witness's end.

    To rest there while the chaser drifts is another motion, which takes more of the wheels.
    """
    robot, data = problem.robot, problem.robot.model.createData()
    _, q, v, _ = way_of(robot, problem.start, witness)
    pin.forwardKinematics(robot.model, data, q[-1], v[-1])
    pin.updateFramePlacements(robot.model, data)
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    moving = replace(
        problem.target, linear_velocity=twist.linear.copy(), angular_velocity=twist.angular.copy()
    )
    return replace(problem, target=moving)


def _with_wheels(
    problem: PlanningProblem, witness: JointMotion, factor: float, rng: np.random.Generator
) -> PlanningProblem:
    """Return a problem with wheels whose limits are `factor` times the witness's peaks."""
    robot, wheels = problem.robot, Wheels()
    _, q, v, accelerations = way_of(robot, problem.start, witness)
    momenta, torques = wheels_along(robot, wheels, np.zeros(3), q, v, accelerations)
    stored = _STORED * np.abs(momenta).max() * rng.uniform(-1.0, 1.0, 3)
    limits = (
        tuple((factor * np.abs(rows).max(axis=0)).tolist()) for rows in (momenta + stored, torques)
    )
    held = replace(robot, wheels=Wheels(wheels.axes, *limits))
    return replace(problem, robot=held, start=replace(problem.start, wheel_momenta=stored))


def _stopping(
    problem: PlanningProblem, rng: np.random.Generator
) -> Drawn[JointMotion | None] | None:
    """Return a problem to stop as soon as possible and its witness; None: it leaves its limits."""
    robot, joints = problem.robot, problem.robot.joints
    rates, lasts = rng.uniform(-_FAST, _FAST, joints), float(rng.uniform(*STOPS_IN))
    witness = stop(problem.start.joint_positions, rates, lasts)
    end = witness.positions[-1]
    if ((end < robot.lower_position_limits) | (end > robot.upper_position_limits)).any():
        return None
    moving = replace(problem, start=replace(problem.start, joint_velocities=rates))
    return Drawn(to_stop(moving, witness), witness)
