"""What comes of a plan's samples, worked out without the planner: the truth between the points.

Joints on scipy's quintics through positions, velocities and accelerations. The base is integrated
by DOP853 from the conservation of momentum, Eq. (24), as it stands in the start state. Pinocchio's
kinematics says where the arm is, its forward dynamics which torques move it so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState


def joints_between(motion: Trajectory, dense: int) -> tuple[Array, Array, Array, Array]:
    """Times, and positions, rates and accelerations at them; `dense` times from point to point."""
    joints = motion.joint_positions, motion.joint_velocities, motion.joint_accelerations
    quintics = BPoly.from_derivatives(motion.time, np.stack(joints, axis=1))
    count = len(motion.time) - 1
    time = np.interp(np.arange(dense * count + 1), dense * np.arange(count + 1), motion.time)
    return time, quintics(time), quintics(time, 1), quintics(time, 2)


class Truth(NamedTuple):
    """What holds along a motion, at its points and between them."""

    time: Array
    q: Array  # configurations at those times
    position_miss: float  # at the goal [m]
    orientation_miss: float  # [rad]
    beyond_positions: float  # of the joints that are furthest outside [rad]; negative: inside
    beyond_rates: float  # in parts of the limit
    torques: Array  # largest modulus of each joint [N m]
    clearance: float  # [m]
    chaser_attitude: float  # largest modulus of an Euler angle [rad]


def truth(problem: PlanningProblem, motion: Trajectory) -> Truth:
    """Integrate the motion that comes of a plan's samples and measure it.

    From point to point at twenty times, and at four hundred times in all.
    """
    dense = max(20, 400 // (len(motion.time) - 1))
    robot, model, data = problem.robot, problem.robot.model, problem.robot.model.createData()
    time, positions, rates, accelerations = joints_between(motion, dense)
    joints = motion.joint_positions, motion.joint_velocities, motion.joint_accelerations
    quintics = BPoly.from_derivatives(motion.time, np.stack(joints, axis=1))
    q_start, v_start = start_of(robot, problem.start)
    pin.computeCentroidalMomentum(model, data, q_start, v_start)
    linear = data.hg.linear.copy()
    angular = data.hg.angular + np.cross(data.com[0], linear)

    def base_twist(when: float, base: Array) -> Array:
        q = np.concatenate([base, quintics(when)])
        q[3:7] /= np.linalg.norm(q[3:7])
        by_velocity = pin.computeCentroidalMap(model, data, q)
        wanted = np.concatenate([linear, angular - np.cross(data.com[0], linear)])
        of_joints = by_velocity[:, 6:] @ quintics(when, 1)
        twist: Array = np.linalg.solve(by_velocity[:, :6], wanted - of_joints)
        return twist

    def base_rate(when: float, base: Array) -> Array:
        moving, turning = np.split(base_twist(when, base), 2)
        vector, scalar = base[3:6], base[6]
        vector_rate = (scalar * turning + np.cross(vector, turning)) / 2
        return np.concatenate(
            [Rotation.from_quat(base[3:7]).apply(moving), vector_rate, [-vector @ turning / 2]]
        )

    bases = [q_start[:7]]
    for i in range(0, len(time) - 1, dense):  # no step goes over a point, where the jerk jumps
        part = time[i : i + dense + 1]
        ends = part[0], part[-1]
        solved = solve_ivp(base_rate, ends, bases[-1], "DOP853", part[1:], rtol=1e-8, atol=1e-10)
        bases.extend(solved.y.T)
    base = np.array(bases)
    base[:, 3:7] /= np.linalg.norm(base[:, 3:7], axis=1)[:, None]
    q = np.hstack([base, positions])
    v = np.hstack([[base_twist(*at) for at in zip(time, base, strict=True)], rates])
    arm, rotations = arms(robot, q)
    at_goal = np.abs(time - problem.duration).argmin()
    target = Rotation.from_quat(problem.target.quaternion_xyzw.copy())
    axes = Rotation.from_quat(q[:, 3:7]) * Rotation.from_matrix(
        robot.rotation_chaser_to_base.copy()
    )
    distances = [
        float(to_lines(arm, centers_of(sphere, time)).min()) - sphere.radius
        for sphere in problem.obstacles
    ]
    upper, lower = robot.upper_position_limits, robot.lower_position_limits
    return Truth(
        time=time,
        q=q,
        position_miss=float(np.linalg.norm(arm[at_goal, -1] - problem.target.position)),
        orientation_miss=float((target.inv() * rotations[at_goal]).magnitude()),
        beyond_positions=float(np.maximum(positions - upper, lower - positions).max()),
        beyond_rates=float((np.abs(rates) / robot.velocity_limits).max() - 1.0),
        torques=np.abs(torques_of(robot, q, v, accelerations)).max(axis=0),
        clearance=min(distances, default=np.inf),
        chaser_attitude=float(np.abs(axes.as_euler("ZYX")).max()),
    )


def start_of(robot: Robot, state: SystemState) -> tuple[Array, Array]:
    """Configuration and velocity of the base from those of the chaser's centre of mass."""
    chaser = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw.copy())
    base = chaser * Rotation.from_matrix(robot.rotation_chaser_to_base.copy()).inv()
    lever, omega = (
        base.apply(robot.position_chaser_in_base.copy()),
        state.angular_velocity_chaser_in_inertial,
    )
    moving = state.linear_velocity_chaser_in_inertial - np.cross(omega, lever)
    place = state.position_chaser_in_inertial - lever
    q = np.concatenate([place, base.as_quat(), state.joint_positions])
    v = np.concatenate([base.inv().apply([moving, omega]).ravel(), state.joint_velocities])
    return q, v


def arms(robot: Robot, q: Array) -> tuple[Array, Rotation]:
    """Joint origins and end effector, shape (points, joints + 1, 3), and the latter's attitudes."""
    data, points = robot.model.createData(), np.empty((len(q), robot.joints + 1, 3))
    turns = np.empty((len(q), 3, 3))
    for k, at in enumerate(q):
        pin.forwardKinematics(robot.model, data, at)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        points[k, :-1] = [placed.translation for placed in list(data.oMi)[2:]]
        points[k, -1], turns[k] = tip.translation, tip.rotation
    return points, Rotation.from_matrix(turns)


def centers_of(sphere: Obstacle, time: Array) -> Array:
    """Where a sphere's centre is at some times; how bodies tumble is tested by itself."""
    if sphere.body is not None:
        return sphere.body.places(sphere.motion.lever[None], time)[:, 0]
    return np.asarray(sphere.center + time[:, None] * sphere.motion.velocity)


def to_lines(arm: Array, centers: Array) -> Array:
    """How far the arm's lines are from a centre at each of some times, by Pythagoras.

    Args:
        arm: Shape (times, joints + 1, 3).
        centers: Shape (times, 3).
    """
    begin, along = arm[:, :-1], np.diff(arm, axis=1)
    way = centers[:, None] - begin
    length = np.maximum((along**2).sum(axis=2), 1e-18)
    part = np.clip((way * along).sum(axis=2) / length, 0.0, 1.0)
    apart: Array = np.linalg.norm(way - part[..., None] * along, axis=2).min(axis=1)
    return apart


def torques_of(robot: Robot, q: Array, v: Array, accelerations: Array) -> Array:
    """The torques for which the forward dynamics, nothing on the base, give these accelerations."""
    model, data, torques = robot.model, robot.model.createData(), np.empty_like(accelerations)
    for k, (at, moving, wanted) in enumerate(zip(q, v, accelerations, strict=True)):
        inverse = np.array(pin.computeMinverse(model, data, at))
        inverse = np.triu(inverse) + np.triu(inverse, 1).T
        free = pin.aba(model, data, at, moving, np.zeros(model.nv))[6:]
        torques[k] = np.linalg.solve(inverse[6:, 6:], wanted - free)
    return torques
