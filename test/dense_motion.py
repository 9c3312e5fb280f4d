"""What comes of a plan's samples, worked out without the planner: the truth between the points.

Joints on scipy's quintics through positions, velocities and accelerations. The base is integrated
by DOP853 from the conservation of momentum, Eq. (24), as it stands in the start state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.rotation import euler_from_rotation


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
    q_start, v_start = configuration(robot, problem.start)
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
    pin.forwardKinematics(model, data, q[np.abs(time - problem.duration).argmin()])
    tip = pin.updateFramePlacement(model, data, robot.tip_frame_id)
    target = Rotation.from_quat(problem.target.quaternion_xyzw)
    clear = np.inf
    if problem.obstacles:
        arm = arm_points(robot, q)
        clear = clearances(arm, time, segments(arm), problem.obstacles).distance.min()
    axes = Rotation.from_quat(q[:, 3:7]).as_matrix() @ robot.rotation_chaser_to_base
    upper, lower = robot.upper_position_limits, robot.lower_position_limits
    return Truth(
        time=time,
        q=q,
        position_miss=float(np.linalg.norm(tip.translation - problem.target.position)),
        orientation_miss=float((target.inv() * Rotation.from_matrix(tip.rotation)).magnitude()),
        beyond_positions=float(np.maximum(positions - upper, lower - positions).max()),
        beyond_rates=float((np.abs(rates) / robot.velocity_limits).max() - 1.0),
        torques=np.abs(joint_torques(robot, q, v, accelerations)).max(axis=0),
        clearance=float(clear),
        chaser_attitude=float(np.abs(euler_from_rotation(axes)).max()),
    )
