"""What makes a question unanswerable before anything is solved."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.failures import LIMIT_TOLERANCE, link_name
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values


def require_sound_start(
    problem: PlanningProblem, q_start: Array, singular_value_threshold: float
) -> None:
    """Refuse a start outside the joint limits, inside an obstacle or in a singular posture.

    Joint rates count where the problem limits them.

    Args:
        q_start: Configuration at its start. Shape (7 + joints,).
        singular_value_threshold: Least allowed singular value of the generalised Jacobian.

    Raises:
        InvalidInput: Names the joint, the obstacle and the link, or the posture.
    """
    robot, joints = problem.robot, problem.start.joint_positions
    for name, position, lower, upper in zip(
        robot.joint_names,
        joints,
        robot.lower_position_limits,
        robot.upper_position_limits,
        strict=True,
    ):
        if not lower - LIMIT_TOLERANCE <= position <= upper + LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.position[{name}]",
                f"{position:.6f} rad",
                f"it must be within the joint's limits [{lower:.6f}, {upper:.6f}] rad",
            )
    if problem.limits.joint_velocities:
        for name, rate, limit in zip(
            robot.joint_names, problem.start.joint_velocities, robot.velocity_limits, strict=True
        ):
            if not abs(rate) <= limit + LIMIT_TOLERANCE:
                raise InvalidInput(
                    Status.START_OUTSIDE_LIMITS,
                    f"joints.velocity[{name}]",
                    f"{rate:.6f} rad/s",
                    f"it must be at most {limit:.6f} rad/s either way, the joint's limit",
                )
    positions = arm_points(robot, q_start[None])
    starts = segments(positions)
    distance = clearances(positions, starts, problem.obstacles).distance[0]
    if distance.min(initial=np.inf) <= 0.0:
        segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
        raise InvalidInput(
            Status.START_IN_COLLISION,
            f"obstacles[{problem.obstacles[sphere].id}]",
            f"around {link_name(robot, int(starts[segment]))}, "
            f"{-distance[segment, sphere]:.4f} m deep",
            "at the start the arm must be outside every obstacle",
        )
    smallest = float(smallest_singular_values(robot, q_start[None])[0])
    if not smallest >= singular_value_threshold - LIMIT_TOLERANCE:
        raise InvalidInput(
            Status.START_SINGULAR,
            "joints.position",
            np.array2string(joints, precision=4),
            "in this posture the end effector cannot move in every direction: the smallest "
            f"singular value of the generalised Jacobian is {smallest:.3g}, allowed is "
            f"{singular_value_threshold:g}",
        )


def require_reachable_goal(problem: PlanningProblem, q_start: Array, momentum: Array) -> None:
    """Refuse a goal that no posture reaches, or that lies inside an obstacle.

    The system's centre of mass moves in a straight line. The end effector is never further from
    it than the stretched arm from the first joint, plus the largest distance between the first
    joint and the centre of mass.

    Args:
        q_start: Configuration at its start. Shape (7 + joints,).
        momentum: Total P and L about the inertial origin. Shape (6,).

    Raises:
        NoPlanFound: Names the obstacle around the goal, or distance and reach.
    """
    robot, target = problem.robot, problem.target.position
    for sphere in problem.obstacles:
        depth = sphere.radius - float(np.linalg.norm(target - sphere.center))
        if depth >= 0.0:
            raise NoPlanFound(
                Status.COLLISION,
                f"target.position lies {depth:.4f} m inside obstacle {sphere.id}: at the goal the "
                "arm cannot be outside it",
            )
    model = robot.model
    data = model.createData()
    total_mass = pin.computeTotalMass(model, data)
    center = pin.centerOfMass(model, data, q_start)
    center_at_end = center + momentum[:3] / total_mass * problem.duration
    reach = _reach(robot, total_mass)
    distance = float(np.linalg.norm(target - center_at_end))
    if distance > reach:
        raise NoPlanFound(
            Status.GOAL_OUT_OF_REACH,
            f"target.position is {distance:.3f} m from where the system's centre of mass will be "
            f"at t = {problem.duration:g} s; the arm reaches at most {reach:.3f} m; choose a "
            "nearer goal or another duration",
        )


def _reach(robot: Robot, total_mass: float) -> float:
    """Return a distance from the system's centre of mass that the end effector never exceeds."""
    model = robot.model
    chaser, links = model.inertias[1], model.inertias[2:]
    placements = [model.jointPlacements[2 + k] for k in range(1, robot.joints)]
    placements.append(model.frames[robot.tip_frame_id].placement)
    # From the first joint to each joint and to the tip, the arm stretched.
    stretched = np.cumsum([0.0, *(np.linalg.norm(p.translation) for p in placements)])
    mount = np.linalg.norm(model.jointPlacements[2].translation - chaser.lever)
    moment = chaser.mass * mount + sum(
        link.mass * (length + np.linalg.norm(link.lever))
        for link, length in zip(links, stretched, strict=False)
    )
    return float(stretched[-1] + moment / total_mass)
