"""The check after the solve: what the plan's samples themselves say, whatever the solver said.

Nothing here uses the velocity map, the rollout or the optimisation problem. Poses, momentum and
clearance are recomputed by forward kinematics and dynamics from the samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.clearance import arm_points, clearances, penalty, segments
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.objectives import chaser_euler, joint_path_length
from ff_planner_ros.planning.plan import Metrics, Plan, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values, total_momentum

# The certified clearance is below the true one by at most this [m]: thinner than paint, and a
# quarter of the default margin.
_CERTIFICATE_GAP = 5e-4
# Joint margins violated by less are rounding [rad].
LIMIT_TOLERANCE = 1e-6


def measure(problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings) -> Metrics:
    """Return the metrics of a trajectory, computed from its samples alone.

    Args:
        problem: What was asked.
        trajectory: The answer.
        settings: For the penalty's g1 and g2.
    """
    robot = problem.robot
    data = robot.model.createData()
    q, v = from_trajectory(robot, trajectory)
    step = problem.duration / (problem.points - 1)

    tip = _tip_placement(robot, data, q[-1])
    target_rotation = pin.Quaternion(problem.target.quaternion_xyzw).toRotationMatrix()
    q_start, v_start = configuration(robot, problem.start)
    momentum = np.array([total_momentum(robot, data, *sample) for sample in zip(q, v, strict=True)])
    wanted = total_momentum(robot, data, q_start, v_start)
    chaser_momentum = robot.model.inertias[1].mass * trajectory.chaser_linear_velocities
    # A system whose total is zero is measured against the chaser's own momentum.
    scale = max(np.linalg.norm(wanted), np.linalg.norm(chaser_momentum, axis=1).max())

    positions = arm_points(robot, q)
    at_points = clearances(positions, segments(positions), problem.obstacles)
    margins = np.minimum(
        robot.upper_position_limits - trajectory.joint_positions,
        trajectory.joint_positions - robot.lower_position_limits,
    )
    return Metrics(
        joint_path_length=joint_path_length(trajectory.joint_velocities, step),
        max_chaser_euler=float(np.abs(chaser_euler(robot, q)).max()),
        min_clearance=certified_clearance(robot, q, v, step, problem.obstacles),
        min_joint_margin=float(margins.min()),
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
        problem: What was asked.
        plan: With metrics of `measure`.
        settings: The tolerances.

    Raises:
        NoPlanFound: Names the first failure, where it is and by how much; carries the plan.
    """
    metrics, trajectory = plan.metrics, plan.trajectory
    if not metrics.min_clearance >= 0.0:
        raise NoPlanFound(Status.COLLISION, _describe_collision(problem, plan), plan)
    if not metrics.min_joint_margin >= -LIMIT_TOLERANCE:
        lower, upper = problem.robot.lower_position_limits, problem.robot.upper_position_limits
        excess = np.maximum(trajectory.joint_positions - upper, lower - trajectory.joint_positions)
        point, joint = np.unravel_index(excess.argmax(), excess.shape)
        raise NoPlanFound(
            Status.LIMIT_VIOLATED,
            f"joint {plan.joint_names[joint]} is {excess[point, joint]:.4f} rad outside its limits "
            f"[{lower[joint]:.4f}, {upper[joint]:.4f}] at t = {trajectory.time[point]:.2f} s; "
            "choose another goal, start posture or duration",
            plan,
        )
    if not metrics.min_singular_value >= settings.singular_value_threshold:
        q, _ = from_trajectory(problem.robot, trajectory)
        point = smallest_singular_values(problem.robot, q).argmin()
        raise NoPlanFound(
            Status.SINGULAR,
            f"dynamic singularity near t = {trajectory.time[point]:.2f} s of "
            f"{problem.duration:g} s: the smallest singular value of the generalised Jacobian is "
            f"{metrics.min_singular_value:.3g}, allowed is {settings.singular_value_threshold:g}; "
            "choose a nearer goal, another start posture or duration",
            plan,
        )
    for name, value, allowed, unit, advice in (
        (
            "final_position_error",
            metrics.final_position_error,
            settings.position_tolerance,
            "m",
            "use more points",
        ),
        (
            "final_orientation_error",
            metrics.final_orientation_error,
            settings.orientation_tolerance,
            "rad",
            "use more points",
        ),
        (
            "momentum_error",
            metrics.momentum_error,
            settings.momentum_tolerance,
            "(relative)",
            "report this as a fault of the planner",
        ),
        (
            "start_velocity_jump",
            metrics.start_velocity_jump,
            settings.start_velocity_tolerance,
            "rad/s",
            "the start's joint rates hold a null-space motion; damp it before planning",
        ),
    ):
        if not value <= allowed:
            raise NoPlanFound(
                Status.CHECK_FAILED,
                f"the check refused the plan: {name} is {value:.3g} {unit}, allowed is "
                f"{allowed:.3g}; {advice}",
                plan,
            )


def certified_clearance(
    robot: Robot, q: Array, v: Array, step: float, spheres: Sequence[Sphere]
) -> float:
    """Return a lower bound of the clearance along the whole motion, between the points too.

    Between two points the motion is the cubic through both configurations and velocities. In a
    piece of it no point of the arm moves further than its speed allows, so the clearance is at
    least the mean of both ends' less half that way. Pieces whose bound is too low to tell are
    halved. The bound is within `_CERTIFICATE_GAP` of the truth.

    Args:
        robot: The robot.
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        step: Time between two points [s].
        spheres: The obstacles.

    Returns:
        Clearance [m]; infinite without spheres.
    """
    if not spheres:
        return np.inf
    positions = arm_points(robot, q)
    starts = segments(positions)
    at_points = clearances(positions, starts, spheres).distance.min(axis=(1, 2))
    cubics = [_cubic_between(robot, q[i : i + 2], v[i : i + 2], step) for i in range(len(q) - 1)]
    fastest = np.array([_speed_bound(positions[0], q[0], cubic, step) for cubic in cubics])
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    at_begin, at_end = at_points[:-1], at_points[1:]
    lowest = certified = float(at_points.min())
    while True:
        bound = (at_begin + at_end - fastest[index] * (end - begin) * step) / 2
        open_ = bound < lowest - _CERTIFICATE_GAP
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return certified
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        between = np.array(
            [
                pin.integrate(robot.model, q[i], _cubic_at(s, cubics[i]))
                for i, s in zip(index, middle, strict=True)
            ]
        )
        at_middle = clearances(arm_points(robot, between), starts, spheres).distance
        at_middle = at_middle.min(axis=(1, 2))
        lowest = min(lowest, float(at_middle.min()))
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


def _cubic_between(robot: Robot, q: Array, v: Array, step: float) -> Array:
    """Return the tangent-space cubic through two configurations and velocities.

    Returns:
        Coefficients of s, s^2, s^3 from the first to the second, s from 0 to 1. Shape
        (3, 6 + joints).
    """
    whole = pin.difference(robot.model, q[0], q[1])
    first, last = step * v[0], step * v[1]
    last[:6] = np.linalg.solve(pin.Jexp6(pin.Motion(whole[:6])), last[:6])
    return np.array([first, 3 * whole - 2 * first - last, first + last - 2 * whole])


def _cubic_at(s: float, cubic: Array) -> Array:
    value: Array = np.array([s, s**2, s**3]) @ cubic
    return value


def _speed_bound(positions: Array, q: Array, cubic: Array, step: float) -> float:
    """Return a speed [m/s] that no point of the arm exceeds along a cubic.

    Each joint, and the base's turn, move a point at most at their rate times the stretched
    length of what lies beyond them.
    """
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    beyond = np.cumsum(lengths[::-1])[::-1]
    reach = np.linalg.norm(positions[0] - q[:3]) + beyond[0]
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubic) / step
    turn_rate = np.linalg.norm(rates[3:6])
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubic[:, :3]).sum(axis=0))
    base = np.linalg.norm(rates[:3]) + turn_rate * (reach + way / 2)
    return float(base + rates[6:] @ beyond)


def _describe_collision(problem: PlanningProblem, plan: Plan) -> str:
    """Say which link meets which obstacle, where, by how much, and what to try."""
    trajectory = plan.trajectory
    q, _ = from_trajectory(problem.robot, trajectory)
    positions = arm_points(problem.robot, q)
    starts = segments(positions)
    distance = clearances(positions, starts, problem.obstacles).distance
    point, segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
    depth, time = -distance[point, segment, sphere], trajectory.time[point]
    if depth <= 0.0:
        return (
            f"the arm may touch obstacle {problem.obstacles[sphere].id} between two points near "
            f"t = {time:.2f} s: certified clearance is {plan.metrics.min_clearance * 1e3:.2f} mm; "
            "use more points or a larger planner.clearance_margin"
        )
    return (
        f"no way around obstacle {problem.obstacles[sphere].id} found: "
        f"{link_name(problem.robot, int(starts[segment]))} is {depth:.4f} m inside it "
        f"at t = {time:.2f} s of {problem.duration:g} s; "
        "choose another goal, start posture or duration"
    )


def link_name(robot: Robot, start: int) -> str:
    """Return words for the arm's segment that starts at a joint.

    Args:
        robot: The robot.
        start: Index of the joint.
    """
    ends = (*robot.joint_names, robot.tip_link)
    return f"the link from {ends[start]} to {ends[start + 1]}"


def _tip_placement(robot: Robot, data: pin.Data, q: Array) -> pin.SE3:
    """Return the end effector's pose in the inertial frame."""
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
