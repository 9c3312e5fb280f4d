"""A plan in words and numbers: what was asked, and where it is at its worst, by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.extremes import (
    Distances,
    JointExtremes,
    distances,
    joint_extremes,
    nearest,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, Orientation, Target
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.report.html import element, row, table, when
from ff_planner_ros.report.run_report import ReportedPlan
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import euler_from_rotation

# More obstacles than this are no list that anybody reads.
_MOST_LISTED = 20
# Of a vector's numbers that are shown.
_DECIMALS = 6
_OBSTACLE_COLUMNS = ("obstacle", "place [m]", "radius or shape [m]", "velocity [m/s]")
_NEAREST_COLUMNS = ("least distance [mm]", "at", "from")
_JOINT_COLUMNS = ("joint", "start", "end", "margin to limits", "largest velocity", "largest torque")


def task_words(plan: ReportedPlan) -> Iterator[tuple[str, str]]:
    """Yield name and value of what was asked: start, target, constraints and obstacles."""
    motion, goal = plan.motion, plan.goal
    yield "start, chaser", _pose(motion.chaser_positions[0], motion.chaser_quaternions_xyzw[0])
    velocity, turning = motion.chaser_linear_velocities[0], motion.chaser_angular_velocities[0]
    if np.round([velocity, turning], _DECIMALS).any():
        rates = _vector(np.rad2deg(turning), ".4g")
        yield "", f"moving {_vector(velocity, '.4g')} m/s, turning {rates} deg/s"
    yield "start, end effector", _pose(motion.ee_positions[0], motion.ee_quaternions_xyzw[0])
    yield "target, end effector", _target(goal)
    away = f"{np.linalg.norm(goal.position - motion.ee_positions[0]):.3f} m"
    if goal.orientation is Orientation.FIXED:
        start = Rotation.from_quat(motion.ee_quaternions_xyzw[0])
        turn = (start.inv() * Rotation.from_quat(goal.quaternion_xyzw)).magnitude()
        away += f" and {np.rad2deg(turn):.1f} deg"
    yield "", f"{away} from the start"
    for name, kept in plan.scene.constraints.items():
        first, *more = kept.words()
        yield name, first
        yield from (("", line) for line in more)
    yield "obstacles", _obstacles(plan.obstacles)


def worst(
    plan: ReportedPlan, motion: Trajectory, metrics: Metrics | None
) -> Iterator[tuple[str, Element]]:
    """Yield name and value of a motion's extremes: clearances, and joints nearest their limits.

    Args:
        metrics: Metrics of the motion; None: it is no checked plan.
    """
    robot, obstacles = plan.robot, plan.obstacles
    found = _joints_at_worst(robot, motion, metrics)
    if obstacles:
        found_all = distances(robot, obstacles, motion, plan.scene)
        least = nearest(robot, obstacles, found_all)
        words = f"{1e3 * least.distance:.1f} mm between {least.link} and {least.obstacle}, at "
        certain = ""
        if metrics is not None and np.isfinite(metrics.min_clearance):
            certain = f"; for certain never less than {1e3 * metrics.min_clearance:.1f} mm"
        yield "least clearance", _with_time(words, least.time, certain)
    if metrics is not None and metrics.min_self_clearance_pair:
        words = f"{1e3 * metrics.min_self_clearance:.1f} mm for certain, "
        words += f"{metrics.min_self_clearance_pair} at "
        yield "least self-clearance", _with_time(words, metrics.min_self_clearance_time)
    near = min(found, key=lambda joint: joint.margin)
    words = f"{near.name}, {_place(near, near.margin, decimals=1)} from its limit, at "
    if np.isfinite(near.margin):
        yield "nearest to a joint limit", _with_time(words, near.margin_time)
    fast = max(found, key=lambda joint: joint.rate / joint.rate_limit)
    yield "fastest beside its limit", _with_time(f"{fast.name}, {_rate(fast)}, at ", fast.rate_time)
    known = [joint for joint in found if np.isfinite(joint.torque)]
    if known:
        strong = max(known, key=lambda joint: (joint.torque / joint.torque_limit, joint.torque))
        yield "most torque beside its limit", _torque(strong, f"{strong.name}, ")


def joint_table(robot: Robot, motion: Trajectory, metrics: Metrics | None) -> Element:
    """Return a table of each joint's start, end and extremes."""
    rows = []
    for joint in _joints_at_worst(robot, motion, metrics):
        margin, known = f"{_place(joint, joint.margin)}, at ", np.isfinite(joint.torque)
        rows.append(
            row(
                (
                    joint.name,
                    _place(joint, joint.start),
                    _place(joint, joint.end),
                    _with_time(margin, joint.margin_time)
                    if np.isfinite(joint.margin)
                    else "no limits",
                    _with_time(f"{_rate(joint)}, at ", joint.rate_time),
                    _torque(joint) if known else "not known",
                )
            )
        )
    return table(_JOINT_COLUMNS, rows)


def obstacle_table(
    robot: Robot, obstacles: Sequence[Obstacle], motion: Trajectory, scene: Scene | None = None
) -> Element:
    """Return a table of the obstacles that the arm comes nearest to; the scene: see `distances`."""
    found = distances(robot, obstacles, motion, scene)
    listed = np.argsort(found.of_each.min(axis=0), kind="stable")[:_MOST_LISTED]
    rows = [row(_obstacle(robot, obstacles, found, int(sphere))) for sphere in sorted(listed)]
    made = table((*_OBSTACLE_COLUMNS, *_NEAREST_COLUMNS), rows)
    if len(listed) < len(obstacles):
        made.append(element("p", f"The nearest {len(listed)} of {len(obstacles)}."))
    return made


def _joints_at_worst(
    robot: Robot, motion: Trajectory, metrics: Metrics | None
) -> list[JointExtremes]:
    """Return the extremes of each joint; of torques with the peaks of the check, if known."""
    peaks = metrics.peak_joint_torques if metrics is not None else ()
    return joint_extremes(robot, motion, peaks if len(peaks) == robot.joints else ())


def _obstacle(
    robot: Robot, obstacles: Sequence[Obstacle], found: Distances, number: int
) -> Iterator[str | Element]:
    one, least = obstacles[number], nearest(robot, obstacles, found, number)
    yield one.id
    motion = one.motion
    yield _vector(motion.position, ".3f")
    yield f"{one.radius:g}" if one.is_sphere else one.solid.words
    moving = _vector(motion.velocity, ".4g") if motion.velocity.any() else "at rest"
    if motion.angular_velocity.any() and not one.is_sphere:
        moving += f", turning {_vector(np.rad2deg(motion.angular_velocity), '.4g')} deg/s"
    yield moving
    yield f"{1e3 * least.distance:.1f}"
    yield when(least.time)
    yield least.link


def _obstacles(obstacles: Sequence[Obstacle] | None) -> str:
    if obstacles is None:
        return "not known"
    if not obstacles:
        return "none"
    names = ", ".join(sphere.id for sphere in obstacles[:_MOST_LISTED])
    more = ", ..." if len(obstacles) > _MOST_LISTED else ""
    return f"{len(obstacles)}: {names}{more}"


def _with_time(words: str, time: float, after: str = "") -> Element:
    return element("span", words, when(time), after)


def _place(joint: JointExtremes, value: float, decimals: int = 2) -> str:
    """Return a position of a joint, or a difference of positions, as text."""
    return f"{1e3 * value:.1f} mm" if joint.slides else f"{np.rad2deg(value):.{decimals}f} deg"


def _rate(joint: JointExtremes) -> str:
    share = _share(joint.rate, joint.rate_limit)
    if joint.slides:
        return f"{1e3 * joint.rate:.3g} mm/s{share}"
    return f"{np.rad2deg(joint.rate):.3g} deg/s{share}"


def _torque(joint: JointExtremes, name: str = "") -> Element:
    """Return the largest torque in words; its time is known only if it is one of a point."""
    unit = "N" if joint.slides else "N m"
    largest, at_points = f"{joint.torque:.4g} {unit}", f"{joint.torque_at_points:.4g} {unit}"
    words = f"{name}{largest}{_share(joint.torque, joint.torque_limit)}"
    if at_points != largest:
        words += f" between points; at points {at_points}"
    return _with_time(f"{words}, at ", joint.torque_time)


def _share(value: float, limit: float) -> str:
    """Return words on how much of its limit a value is; there may be no limit."""
    if not np.isfinite(limit):
        return ""
    share = 100.0 * value / limit
    return f" ({share:.0f} % of its limit)" if share >= 1.0 else " (under 1 % of its limit)"


def _target(goal: Target) -> str:
    if goal.orientation is Orientation.FREE:
        return f"{_vector(goal.position, '.3f')} m, any orientation"
    pose = _pose(goal.position, goal.quaternion_xyzw)
    if goal.free_axis_in_ee is None:
        return pose
    return f"{pose}, free to turn about its axis {_vector(goal.free_axis_in_ee, '.3g')}"


def _pose(position: Array, quaternion_xyzw: Array) -> str:
    euler = np.rad2deg(euler_from_rotation(Rotation.from_quat(quaternion_xyzw).as_matrix()))
    return f"{_vector(position, '.3f')} m, roll, pitch, yaw {_vector(euler, '.1f')} deg"


def _vector(values: Array, digits: str) -> str:
    # What rounding leaves of a zero, and its sign, is none of the reader's business.
    shown = np.round(values, _DECIMALS) + 0.0
    return f"[{', '.join(format(value, digits) for value in shown.tolist())}]"
