"""The check after the solve: what the plan's samples themselves say, whatever the solver said.

Nothing here uses the velocity map, the rollout or the optimisation problem. Poses, momentum and
clearance are recomputed by forward kinematics and dynamics from the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, penalty, segments
from ff_planner_ros.planning.failures import failures, goal_index, refusal
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.objectives import chaser_euler, joint_path_length
from ff_planner_ros.planning.plan import Metrics, Plan, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values, total_momentum

# The certified clearance is below the true one by at most this [m]: thinner than paint, and a
# quarter of the default margin.
_CERTIFICATE_GAP = 5e-4


def measure(problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings) -> Metrics:
    """Return the metrics of a trajectory, computed from its samples alone.

    Args:
        trajectory: The answer; what comes after the problem's duration is its tail.
        settings: For the penalty's g1 and g2.
    """
    robot = problem.robot
    data = robot.model.createData()
    q, v = from_trajectory(robot, trajectory)
    goal = goal_index(problem, trajectory)
    to_goal = slice(goal + 1)

    tip = _tip_placement(robot, data, q[goal])
    target_rotation = pin.Quaternion(problem.target.quaternion_xyzw).toRotationMatrix()
    q_start, v_start = configuration(robot, problem.start)
    momentum = np.array([total_momentum(robot, data, *sample) for sample in zip(q, v, strict=True)])
    wanted = total_momentum(robot, data, q_start, v_start)
    chaser_momentum = robot.model.inertias[1].mass * trajectory.chaser_linear_velocities
    # A system whose total is zero is measured against the chaser's own momentum.
    scale = max(np.linalg.norm(wanted), np.linalg.norm(chaser_momentum, axis=1).max())

    positions = arm_points(robot, q)
    at_points = clearances(positions, segments(positions), problem.obstacles)
    torques = joint_torques(robot, q, v, trajectory.joint_accelerations)
    margins = np.minimum(
        robot.upper_position_limits - trajectory.joint_positions,
        trajectory.joint_positions - robot.lower_position_limits,
    )
    return Metrics(
        joint_path_length=joint_path_length(
            trajectory.joint_velocities[to_goal], problem.duration / goal
        ),
        max_chaser_euler=float(np.abs(chaser_euler(robot, q[to_goal])).max()),
        min_clearance=certified_clearance(robot, q, v, np.diff(trajectory.time), problem.obstacles),
        min_joint_margin=float(margins.min()),
        min_velocity_margin=float(
            (robot.velocity_limits - np.abs(trajectory.joint_velocities)).min()
        ),
        peak_joint_torques=tuple(np.abs(torques).max(axis=0).tolist()),
        torque_error=float(np.abs(trajectory.joint_torques - torques).max()),
        penalty=penalty(at_points.distance, settings.penalty_gain, settings.penalty_exponent),
        final_position_error=float(np.linalg.norm(tip.translation - problem.target.position)),
        final_orientation_error=float(np.linalg.norm(pin.log3(tip.rotation.T @ target_rotation))),
        momentum_error=float(np.linalg.norm(momentum - wanted, axis=1).max() / scale),
        min_singular_value=float(smallest_singular_values(robot, q).min()),
        start_velocity_jump=float(
            np.abs(trajectory.joint_velocities[0] - problem.start.joint_velocities).max()
        ),
    )


def require_sound(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> None:
    """Refuse a plan that fails the check.

    Args:
        plan: With metrics of `measure`.

    Raises:
        NoPlanFound: Names every failure, where it is and by how much; carries the plan.
    """
    found = list(failures(problem, plan, settings))
    if found:
        raise refusal(plan, found)


def certified_clearance(
    robot: Robot, q: Array, v: Array, step: float | Array, spheres: Sequence[Sphere]
) -> float:
    """Return a lower bound of the clearance along the whole motion, between the points too.

    Between two points the motion is the cubic through both configurations and velocities. In a
    piece of it no point of the arm moves further than its speed allows, so the clearance is at
    least the mean of both ends' less half that way. Pieces whose bound is too low to tell are
    halved. The bound is within `_CERTIFICATE_GAP` of the truth.

    Args:
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        step: Time from each point to the next, shape (points - 1,), or the same for all [s].

    Returns:
        Clearance [m]; infinite without spheres.
    """
    if not spheres:
        return np.inf
    steps = np.broadcast_to(step, len(q) - 1)
    positions = arm_points(robot, q)
    starts = segments(positions)
    by_sphere = clearances(positions, starts, spheres).distance.min(axis=1)
    at_points = by_sphere.min(axis=1)
    cubics = _cubics_between(robot, q, v, steps)
    farthest = _way_bounds(positions[0], q[0], cubics)
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    at_begin, at_end = at_points[:-1], at_points[1:]
    lowest = certified = float(at_points.min())
    # What no step can bring nearer than the nearest point need not be looked at again.
    reachable = by_sphere.min(axis=0) <= lowest + farthest.max()
    spheres = [sphere for sphere, keep in zip(spheres, reachable, strict=True) if keep]
    while True:
        bound = (at_begin + at_end - farthest[index] * (end - begin)) / 2
        open_ = bound < lowest - _CERTIFICATE_GAP
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return certified
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        powers = middle[:, None] ** np.array([1, 2, 3])
        ways = np.einsum("ip,ipj->ij", powers, cubics[index])
        between = np.array(
            [pin.integrate(robot.model, *at) for at in zip(q[index], ways, strict=True)]
        )
        at_middle = clearances(arm_points(robot, between), starts, spheres).distance
        at_middle = at_middle.min(axis=(1, 2))
        lowest = min(lowest, float(at_middle.min()))
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


def _cubics_between(robot: Robot, q: Array, v: Array, steps: Array) -> Array:
    """Return the tangent-space cubics through consecutive configurations and velocities.

    Returns:
        Coefficients of s, s^2, s^3 from one to the next, s from 0 to 1. Shape
        (points - 1, 3, 6 + joints).
    """
    whole = np.array([pin.difference(robot.model, *pair) for pair in pairwise(q)])
    first, last = steps[:, None] * v[:-1], steps[:, None] * v[1:]
    turned = np.array([pin.Jexp6(pin.Motion(way[:6])) for way in whole])
    last[:, :6] = np.linalg.solve(turned, last[:, :6, None])[:, :, 0]
    return np.stack([first, 3 * whole - 2 * first - last, first + last - 2 * whole], axis=1)


def _way_bounds(positions: Array, q: Array, cubics: Array) -> Array:
    """Return a speed for each cubic that no point of the arm exceeds along it [m per unit of s].

    Each joint, and the base's turn, move a point at most at their rate times the stretched
    length of what lies beyond them.
    """
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    beyond = np.cumsum(lengths[::-1])[::-1]
    reach = np.linalg.norm(positions[0] - q[:3]) + beyond[0]
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning = (np.linalg.norm(part, axis=1) for part in np.split(rates[:, :6], 2, axis=1))
    bounds: Array = moving + turning * (reach + way / 2) + rates[:, 6:] @ beyond
    return bounds


def _tip_placement(robot: Robot, data: pin.Data, q: Array) -> pin.SE3:
    """Return the end effector's pose in the inertial frame."""
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
