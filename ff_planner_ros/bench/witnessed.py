"""Problems that have a solution because a joint spline was drawn first: its end is the goal.

The motions of any arm from any start: singular ones, and those of arms with many joints or few.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from ff_planner_ros.arrays import Array
from ff_planner_ros.bench.robots import bench_robot
from ff_planner_ros.planning.forward import driven
from ff_planner_ros.planning.joint_motion import JointMotion
from ff_planner_ros.planning.problem import Limits, Objective, PlanningProblem, Target
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values, total_momentum
from ff_planner_ros.robot.state import SystemState

# Smallest singular value of a singular start at most; the planner's threshold is 0.02.
SINGULAR = 1e-3
# How far each joint turns at most on the way [rad], and how fast the chaser begins [m/s, rad/s].
_TURN, _DRIFT, _SPIN = 0.9, 0.01, 0.01
# Joints stay away from their limits [rad], and the witness's rates below so much of theirs.
_FROM_LIMITS, _OF_RATES = 0.1, 0.6
_POINTS, _STEPS = 50, 100


@cache
def singular_start(robot: str, number: int) -> PlanningProblem:
    """Return a problem that begins in a singular posture, always the same one."""
    arm = bench_robot(robot)
    rng = np.random.default_rng([*f"singular {robot}".encode(), number])
    while True:
        posture = _singular_posture(arm, rng)
        if posture is not None:
            problem = drawn_problem(arm, posture, rng)
            if problem is not None:
                return problem


def drawn_problem(robot: Robot, posture: Array, rng: np.random.Generator) -> PlanningProblem | None:
    """Draw a drifting chaser, a motion of the arm from a posture, and take its end as the goal.

    The end effector shall rest there. None: the motion would leave a joint's limits.
    """
    start = SystemState(
        position_chaser_in_inertial=np.zeros(3),
        quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity_chaser_in_inertial=_DRIFT * rng.normal(size=3),
        angular_velocity_chaser_in_inertial=_SPIN * rng.normal(size=3),
        joint_positions=posture,
        joint_velocities=np.zeros(robot.joints),
    )
    duration = float(rng.uniform(8.0, 15.0))
    end = posture + rng.uniform(-_TURN, _TURN, robot.joints)
    lowest, highest = robot.lower_position_limits, robot.upper_position_limits
    if (end < lowest + _FROM_LIMITS).any() or (end > highest - _FROM_LIMITS).any():
        return None
    # The fastest rate of a motion from rest to rest is 15/8 of the mean one.
    if (15.0 / 8.0 * np.abs(end - posture) / duration > _OF_RATES * robot.velocity_limits).any():
        return None
    still = np.zeros((2, robot.joints))
    joints = JointMotion(np.array([0.0, duration]), np.array([posture, end]), still, still)
    q, v = configuration(robot, start)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    there, *_ = driven(robot, q, momentum, joints, np.linspace(0.0, duration, _STEPS + 1))
    pin.forwardKinematics(robot.model, data, there[-1])
    goal = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    return PlanningProblem(
        robot=robot,
        start=start,
        target=Target(
            position=goal.translation.copy(),
            quaternion_xyzw=pin.Quaternion(goal.rotation).coeffs(),
        ),
        duration=duration,
        points=_POINTS,
        obstacles=(),
        objective=Objective(1.0, 0.0),
        limits=Limits(joint_velocities=True),
    )


def _singular_posture(robot: Robot, rng: np.random.Generator) -> Array | None:
    """Return a singular posture well within the limits; None: none was found near a random one."""
    lowest = robot.lower_position_limits + _FROM_LIMITS
    highest = robot.upper_position_limits - _FROM_LIMITS
    q = np.concatenate([np.zeros(6), [1.0], np.zeros(robot.joints)])

    def smallest(joints: Array) -> float:
        return float(smallest_singular_values(robot, np.append(q[:7], joints)[None])[0])

    drawn = rng.uniform(lowest, highest)
    bounds = list(zip(lowest, highest, strict=True))
    found = minimize(smallest, drawn, method="Nelder-Mead", bounds=bounds)
    return np.asarray(found.x, np.float64) if found.fun < SINGULAR else None


def with_objective(problem: PlanningProblem, objective: Objective) -> PlanningProblem:
    """Return the same problem with another objective."""
    return replace(problem, objective=objective)
