"""Extremes of a motion: smallest distances to obstacles, and each joint's extremes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.allowed_contact import kept_apart
from ff_planner_ros.planning.distance.bodies import placed_bodies, radii
from ff_planner_ros.planning.distance.body_distances import obstacle_bounds, obstacle_distances
from ff_planner_ros.planning.distance.surroundings import Surroundings, surroundings
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.pose_motion import poses_between
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.collision.lines import in_words, with_bodies
from ff_planner_ros.robot.configuration import about, configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

# Few points hide what is between them: distances are sampled at this many times or more.
_TIMES = 400
# Of an obstacle, in a figure.
_LONGEST_NAME = 24
# Distances that are held in memory at once.
_MOST_DISTANCES = 500_000
_Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of the robot's bodies, or else the arm's centre lines, to every obstacle."""

    time: Array  # of the motion's points, and between them; shape (times,) [s]
    of_each: Array  # distance to the nearest body or line; shape (times, obstacles) [m]
    nearest: NDArray[np.intp]  # index of that body or line; shape (times, obstacles)

    @property
    def closest(self) -> Array:
        """Distance to the nearest obstacle; infinite without any. Shape (times,) [m]."""
        least: Array = self.of_each.min(axis=1, initial=np.inf)
        return least


@dataclass(frozen=True)
class Nearest:
    """Where the robot comes nearest to an obstacle."""

    distance: float  # negative inside the obstacle [m]
    time: float  # [s]
    obstacle: str  # its id
    link: str  # in words, or the name of the body

    @property
    def words(self) -> str:
        """Distance, obstacle and time, short enough for a figure."""
        name = self.obstacle
        name = name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"
        return f"{1e3 * self.distance:.1f} mm to {name} at {self.time:.2f} s"


def distances(
    robot: Robot,
    obstacles: Sequence[Obstacle],
    motion: Trajectory,
    scene: Scene | None = None,
) -> Distances:
    """Return the distances of a motion to obstacles, also between its points.

    Args:
        scene: Its allowed contacts, at goal and start, are ignored. None: there are none.
    """
    time, q = _between_points(robot, motion)
    seen = Scene() if scene is None else scene.captured_at(float(motion.time[-1]))
    apart = kept_apart(robot, obstacles, seen, q, time)
    robot, around = with_bodies(robot), surroundings(tuple(obstacles))
    rows = max(1, _MOST_DISTANCES // max(1, len(robot.bodies) * len(obstacles)))
    of_each, nearest = list[Array](), list[NDArray[np.intp]]()
    for k in range(0, len(time), rows):
        part = slice(k, k + rows)
        counts = apart.at(np.arange(len(time))[part])
        distance = _distances(robot, around, time[part], q[part], counts)
        of_each.append(distance.min(axis=1))
        nearest.append(distance.argmin(axis=1))
    return Distances(time, np.concatenate(of_each), np.concatenate(nearest))


def _distances(robot: Robot, around: Surroundings, time: Array, q: Array, counts: _Flags) -> Array:
    """Return distances of bodies to obstacles; infinite where another body is surely nearer.

    Shape (times, bodies, obstacles) [m]; `counts` may be broadcast to it.
    """
    placed = placed_bodies(robot, q[:, 7:])
    lowest = np.where(counts, obstacle_bounds(robot, placed, q, time, around), np.inf)
    around_both = radii(robot)[:, None] + around.radii
    highest = lowest + 2.0 * around_both
    distance = np.full(lowest.shape, np.inf)
    rows = np.nonzero((lowest <= highest.min(axis=1, keepdims=True)) & np.isfinite(lowest))
    there = around.seen_from_base(q, time, rows[0], rows[2])
    distance[rows] = obstacle_distances(robot, placed, there, around, rows).distance
    return distance


def nearest(
    robot: Robot, obstacles: Sequence[Obstacle], found: Distances, number: int | None = None
) -> Nearest:
    """Return the smallest distance to any obstacle, or to that of index `number`."""
    if number is None:
        number = int(found.of_each.min(axis=0).argmin())
    time = int(found.of_each[:, number].argmin())
    return Nearest(
        distance=float(found.of_each[time, number]),
        time=float(found.time[time]),
        obstacle=obstacles[number].id,
        link=in_words(robot, int(found.nearest[time, number])),
    )


@dataclass(frozen=True)
class JointExtremes:
    """Extreme position, velocity and torque of one joint in a motion."""

    name: str
    slides: bool  # prismatic: units below are m, m/s and N instead
    start: float  # [rad]
    end: float  # [rad]
    lowest: float  # [rad]
    highest: float  # [rad]
    margin: float  # smallest distance to a position limit; negative beyond it [rad]
    margin_time: float  # [s]
    rate: float  # largest magnitude of the velocity [rad/s]
    rate_time: float  # [s]
    rate_limit: float  # [rad/s]
    torque: float  # largest magnitude, also between points; NaN: not known [N m]
    torque_at_points: float  # largest magnitude at a trajectory point [N m]
    torque_time: float  # of `torque_at_points` [s]
    torque_limit: float  # infinite: none [N m]


def joint_extremes(
    robot: Robot, motion: Trajectory, peak_torques: Sequence[float] = ()
) -> list[JointExtremes]:
    """Return the extremes of each joint; of positions and velocities also between points.

    Args:
        peak_torques: Largest torques also between points, shape (joints,) [N m]; empty: unknown.
    """
    (lowest, highest), position_times = _extremes(motion, 0)
    rates, rate_times = _extremes(motion, 1)
    robot = about(robot, motion.joint_positions[0])
    margins = np.stack(
        [lowest - robot.lower_position_limits, robot.upper_position_limits - highest]
    )
    torques = np.abs(motion.joint_torques)
    found = []
    for k, name in enumerate(robot.joint_names):
        side, way = margins[:, k].argmin(), np.abs(rates[:, k]).argmax()
        known = np.isfinite(torques[:, k]).all()
        point = torques[:, k].argmax() if known else 0
        found.append(
            JointExtremes(
                name=name,
                slides=robot.slides(k),
                start=float(motion.joint_positions[0, k]),
                end=float(motion.joint_positions[-1, k]),
                lowest=float(lowest[k]),
                highest=float(highest[k]),
                margin=float(margins[side, k]),
                margin_time=float(position_times[side, k]),
                rate=float(np.abs(rates[way, k])),
                rate_time=float(rate_times[way, k]),
                rate_limit=float(robot.velocity_limits[k]),
                torque=_torque(torques[:, k], peak_torques[k : k + 1]),
                torque_at_points=float(torques[point, k]),
                torque_time=float(motion.time[point]),
                torque_limit=float(robot.effort_limits[k]),
            )
        )
    return found


def _torque(at_points: Array, peak: Sequence[float]) -> float:
    """Return the largest torque [N m]; the peak may be missing or NaN."""
    return float(max([at_points.max(), *(value for value in peak if np.isfinite(value))]))


def _extremes(motion: Trajectory, order: int) -> tuple[Array, Array]:
    """Return each joint's lowest and highest position (order 0) or velocity (1), and the times.

    Both have shape (2, joints).
    """
    if _is_smooth(motion):
        return joint_motion(motion).extremes(order)
    values = motion.joint_velocities if order else motion.joint_positions
    rows = np.stack([values.argmin(axis=0), values.argmax(axis=0)])
    return np.stack([values.min(axis=0), values.max(axis=0)]), motion.time[rows]


def _is_smooth(motion: Trajectory) -> bool:
    """Tell whether a motion can be interpolated; a measured one has no accelerations."""
    return bool(np.isfinite(motion.joint_accelerations).all())


def _between_points(robot: Robot, motion: Trajectory) -> tuple[Array, Array]:
    """Return times, (times,), and configurations, (times, 7 + joints)."""
    time, joints = motion.time, motion.joint_positions
    chaser, attitudes = motion.chaser_positions, motion.chaser_quaternions_xyzw
    if _is_smooth(motion):
        pieces = -(-_TIMES // (len(time) - 1))
        time = np.interp(
            np.arange(pieces * (len(time) - 1) + 1), pieces * np.arange(len(time)), time
        )
        joints = joint_motion(motion).at(time)[0]
        twists = (motion.chaser_linear_velocities, motion.chaser_angular_velocities)
        chaser, attitudes = poses_between(motion.time, chaser, attitudes, *twists, time)
    none, no_rates = np.zeros(3), np.zeros(robot.joints)
    q = [
        configuration(robot, SystemState(position, attitude, none, none, angles, no_rates))[0]
        for position, attitude, angles in zip(chaser, attitudes, joints, strict=True)
    ]
    return time, np.array(q)
