"""Motion after the goal in which the end effector follows the target, in what it specifies."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.runge_kutta import runge_kutta_step
from ff_planner_ros.planning.motion.steered import twist_conditions
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem, Target
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import base_twist, generalised_jacobian
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    quaternion_product,
)

# Faster rates [rad/s] mean a dynamic singularity.
_SINGULAR_RATE = 10.0
# Half width of central differences [s]: exact to nine digits for rates that vary in seconds.
_ASIDE = 1e-3


def holding_in_part(
    problem: PlanningProblem, q_goal: Array, rates: Array, momentum: Array, time: Array
) -> tuple[Array, Array, Array]:
    """Return a motion whose end effector keeps the twist that the target specifies.

    The part of the joint velocities at the goal that does not move the end effector fades out.

    Args:
        q_goal: Configuration at the goal. Shape (7 + joints,).
        rates: Joint velocities there. Shape (joints,).
        momentum: Total P and L about the inertial origin. Shape (6,).
        time: Times since the goal, the first zero. Shape (times,) [s].

    Returns:
        Configurations, tangent velocities and dv/dt, a row per time.

    Raises:
        NoPlanFound: The motion meets a dynamic singularity.
    """
    robot, target = problem.robot, problem.target
    data = robot.model.createData()

    def velocity(seconds: float, q: Array, spare: Array) -> Array:
        twist = _twist_held(problem, seconds)
        held = _held_rates(robot, data, target, q, momentum, twist, spare)
        if held is None:
            raise singular_refusal(problem.duration + seconds, problem.duration + time[-1])
        return np.concatenate([base_twist(robot, data, q, momentum, held), held])

    def faded(seconds: float) -> Array:
        s = seconds / float(time[-1])
        left: Array = (1.0 - s) ** 2 * (1.0 + 2.0 * s) * rates
        return left

    q = [q_goal]
    for begin, step in zip(time[:-1], np.diff(time), strict=True):

        def of_stage(stage: int, at: Array, begin: float = begin, step: float = step) -> Array:
            seconds = begin + (0.0, 0.5, 0.5, 1.0)[stage] * step
            return velocity(seconds, at, faded(seconds))

        way = runge_kutta_step(robot.model, q[-1], step, of_stage)
        q.append(pin.integrate(robot.model, q[-1], way))
    v, dv = [], []
    for seconds, at in zip(time, q, strict=True):
        v.append(velocity(seconds, at, faded(seconds)))
        beside = [
            velocity(
                seconds + way, pin.integrate(robot.model, at, way * v[-1]), faded(seconds + way)
            )
            for way in (-_ASIDE, _ASIDE)
        ]
        dv.append((beside[1] - beside[0]) / (2.0 * _ASIDE))
    return np.array(q), np.array(v), np.array(dv)


def poses_held(problem: PlanningProblem, seconds: Array) -> tuple[Array, Array]:
    """Return the end effector's reference poses after the goal.

    They follow the grasp of the target body, if there is one, else the target's constant twist.

    Args:
        seconds: Times since the goal. Shape (times,) [s].

    Returns:
        Positions, shape (times, 3) [m], and quaternions (x, y, z, w), shape (times, 4).
    """
    target, body = problem.target, problem.target_body
    if body is not None:
        grasp = body.grasp(problem.duration + seconds)
        return grasp.positions, quaternion_from_rotation(grasp.rotations)
    positions = target.position + np.outer(seconds, target.linear_velocity)
    turns = quaternion_from_rotation_vector(np.outer(seconds, target.angular_velocity))
    return positions, quaternion_product(turns, target.quaternion_xyzw)


def _twist_held(problem: PlanningProblem, seconds: float) -> Array:
    """Return the end effector's reference twist so many seconds after the goal. Shape (6,)."""
    target, body = problem.target, problem.target_body
    if body is None:
        return np.concatenate([target.linear_velocity, target.angular_velocity])
    there: Array = body.grasp(np.array([problem.duration + seconds])).twists[0]
    return there


def _held_rates(
    robot: Robot,
    data: pin.Data,
    target: Target,
    q: Array,
    momentum: Array,
    twist: Array,
    spare: Array,
) -> Array | None:
    """Return the joint velocities nearest to `spare` that give what the target asks of a twist.

    None: the arm is in a dynamic singularity.

    Args:
        momentum: Total P and L about the inertial origin. Shape (6,).
        twist: Of the end effector, inertial axes. Shape (6,).
        spare: Joint rates. Shape (joints,).
    """
    rows = robot.base.tip_rows
    conditions = twist_conditions(robot, data, target.orientation, target.free_axis_in_ee, q)
    of_rates = conditions @ generalised_jacobian(robot, data, q)
    nearest = of_rates / robot.joint_weights**2
    drifting = np.concatenate([base_twist(robot, data, q, momentum, spare), spare])
    pin.computeJointJacobians(robot.model, data, q)
    pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    jacobian = pin.getFrameJacobian(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    slack = conditions @ (twist - jacobian @ drifting)[rows]
    try:
        rates: Array = spare + nearest.T @ np.linalg.solve(of_rates @ nearest.T, slack)
    except np.linalg.LinAlgError:
        return None
    return rates if float(rates @ rates) < _SINGULAR_RATE**2 else None
