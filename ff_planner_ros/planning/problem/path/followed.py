"""A path to follow: poses of the end effector in time, and the smooth curve through them.

Between its points the path is a cubic spline of the position, and one of the quaternion that is
scaled to unit length. It begins with the end effector's own velocity at the start; its third
derivative is the same in the last two intervals (not-a-knot).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import QUATERNION, a_number, a_vector, each
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.path.curve import PathCurve
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.plane import require_height
from ff_planner_ros.robot.state import SystemState

if TYPE_CHECKING:
    from ff_planner_ros.planning.problem.problem import PlanningProblem

MOST_POINTS = 10_000
# Between two points the path turns by no more than a right angle: half of it in quaternions.
_LEAST_COSINE = math.cos(math.pi / 4) - 1e-9
# No tolerance is less [m, rad]: the check could not resolve it.
_LEAST = 1e-5
_UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])

# Fields of all kinds of paths.
POSITION_TOLERANCE: float = declare(
    a_number(at_least=_LEAST), "largest distance from the path", unit="m", default=1e-3
)
ORIENTATION_TOLERANCE: float = declare(
    a_number(at_least=_LEAST, at_most=math.pi / 2),
    "largest angle to the path's orientation, where it has one",
    unit="rad",
    default=1e-3,
)


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A pose of the end effector at a time.

    Raises:
        InvalidInput: Wrong size, not finite, a negative time, or a quaternion not of unit length.
    """

    time: float = declare(a_number(at_least=0.0), "from the plan's first point on", unit="s")
    position: Array = declare(a_vector(), "of the end effector then", unit="m")
    quaternion_xyzw: Array | None = declare(
        QUATERNION,
        "end-effector axes to inertial axes; left out at all points: the orientation is free",
        default=None,
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "")


@dataclass(frozen=True, eq=False)
class PathToFollow:
    """A path that the end effector follows within tolerances, instead of a target.

    Raises:
        InvalidInput: Fewer than two points or more than 10,000, the first not at time zero, times
            that do not increase, quaternions at some points alone, or more than a right angle
            between two points.
    """

    points: tuple[PathPoint, ...] = declare(
        each(part(PathPoint), least=1),
        "instead of a pose: poses that the end effector passes, the first at time 0, the last at "
        "the goal; between them a cubic spline",
        key="path",
    )
    position_tolerance: float = POSITION_TOLERANCE
    orientation_tolerance: float = ORIENTATION_TOLERANCE

    FACTS = ("points", "position_tolerance", "orientation_tolerance")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check what the points cannot check by themselves."""
        check_declared(self, "target")
        count, times = len(self.points), self.times
        if not 2 <= count <= MOST_POINTS:
            allowed = f"it must have 2 to {MOST_POINTS} points"
            raise InvalidInput(Status.WRONG_SIZE, "target.path", f"{count} points", allowed)
        if times[0] != 0.0:
            allowed = "it must be 0: the path begins with the plan"
            raise InvalidInput(Status.OUT_OF_RANGE, "target.path[0].time", times[0], allowed)
        late = np.flatnonzero(np.diff(times) <= 0.0)
        if late.size:
            field, before = f"target.path[{late[0] + 1}].time", times[late[0]]
            allowed = f"it must be later than that of the point before, {before:g} s"
            raise InvalidInput(Status.OUT_OF_RANGE, field, times[late[0] + 1], allowed)
        self._check_quaternions()

    def _check_quaternions(self) -> None:
        given = [one.quaternion_xyzw is not None for one in self.points]
        if any(given) and not all(given):
            field = f"target.path[{given.index(not given[0])}].quaternion_xyzw"
            found = "missing" if given[0] else "given"
            allowed = "all points must have one, or none, where the orientation is free"
            raise InvalidInput(Status.OUT_OF_RANGE, field, found, allowed)
        if self.turns:
            cosines = np.abs((self._quaternions[1:] * self._quaternions[:-1]).sum(axis=1))
            if cosines.min() < _LEAST_COSINE:
                number = int(cosines.argmin())
                angle = math.degrees(2.0 * math.acos(min(float(cosines[number]), 1.0)))
                field = f"target.path[{number + 1}].quaternion_xyzw"
                allowed = "from one point to the next at most 90 deg: give points between"
                raise InvalidInput(
                    Status.OUT_OF_RANGE, field, f"{angle:.4g} deg from that before", allowed
                )

    @cached_property
    def times(self) -> Array:
        """Times of the points. Shape (points,) [s]."""
        return np.array([one.time for one in self.points])

    @property
    def duration(self) -> float:
        """Time of the last point [s]."""
        return float(self.times[-1])

    @property
    def turns(self) -> bool:
        """Whether it has an orientation."""
        return self.points[0].quaternion_xyzw is not None

    @cached_property
    def positions(self) -> Array:
        """Positions of the points. Shape (points, 3) [m]."""
        return np.array([one.position for one in self.points])

    @cached_property
    def _quaternions(self) -> Array:
        """Quaternions of the points, each of the sign that is nearer to the one before. (., 4)."""
        every = np.array([one.quaternion_xyzw for one in self.points])
        flips = np.sign((every[1:] * every[:-1]).sum(axis=1))
        every[1:] *= np.cumprod(np.where(flips < 0.0, -1.0, 1.0))[:, None]
        return every

    def moved(
        self,
        place: Callable[[Array, float], Array],
        attitude: Callable[[Array], Array] = lambda quaternion: quaternion,
    ) -> PathToFollow:
        """Return the path as another frame sees it.

        Args:
            place: From a position and its time to the position there.
            attitude: From a quaternion to the quaternion there.
        """
        points = [
            PathPoint(
                one.time,
                place(one.position, one.time),
                None if one.quaternion_xyzw is None else attitude(one.quaternion_xyzw),
            )
            for one in self.points
        ]
        return replace(self, points=tuple(points))

    def curve(self, twist: Array | None = None) -> PathCurve:
        """Return the curve through the points.

        Args:
            twist: Of the end effector at the start, inertial axes, shape (6,) [m/s, rad/s]; None:
                the curve begins as its points do, not-a-knot.
        """
        from scipy.interpolate import CubicSpline  # slow to load, and only paths come here

        values = np.hstack([self.positions, self._quaternions]) if self.turns else self.positions
        if twist is None:
            return PathCurve(CubicSpline(self.times, values))
        first = twist[:3]
        if self.turns:
            turn, (*axis, cosine) = twist[3:], self._quaternions[0]
            rate = np.append(cosine * turn + np.cross(turn, axis), -turn @ axis) / 2.0
            first = np.concatenate([first, rate])
        ends = ((1, first), "not-a-knot" if len(values) > 2 else (2, np.zeros(len(first))))
        return PathCurve(CubicSpline(self.times, values, bc_type=ends))


def end_effector(robot: Robot, start: SystemState) -> tuple[pin.SE3, Array]:
    """Return pose and twist of the end effector in a state, the twist in inertial axes, (6,)."""
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, *configuration(robot, start))
    pose = pin.updateFramePlacement(model, data, robot.tip_frame_id).copy()
    twist = pin.getFrameVelocity(model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    return pose, np.array(twist.vector)


def curve_of(problem: PlanningProblem) -> PathCurve:
    """Return the curve that the end effector follows, of a problem with a path."""
    if problem.path is None:
        raise InvalidInput(Status.OUT_OF_RANGE, "path", None, "the problem must have one")
    return _curve(problem.path, problem.robot, problem.start)


@lru_cache(maxsize=8)
def _curve(path: PathToFollow, robot: Robot, start: SystemState) -> PathCurve:
    _, twist = end_effector(robot, start)
    return path.curve(twist)


def followed_target(problem: PlanningProblem, path: PathToFollow) -> Target:
    """Check a problem with a path to follow, and return the target: where the path ends.

    Raises:
        InvalidInput: Another duration than the path's, a range of durations, a target body,
            approach or camera, or a path out of the plane of a planar base.
    """
    if problem.duration_range is not None or problem.duration != path.duration:
        window = problem.duration_range
        found = problem.duration if window is None else [window.minimum, window.maximum]
        allowed = f"it must be the time of the path's last point, {path.duration!r} s, or left out"
        raise InvalidInput(Status.OUT_OF_RANGE, "duration", found, allowed)
    refuse_grasps(problem, "with target.path it must be left out")
    if problem.robot.base is Base.PLANAR:
        height = float(end_effector(problem.robot, problem.start)[0].translation[2])
        for number, position in enumerate(path.positions):
            require_height(f"target.path[{number}].position", position, height)
    end = _curve(path, problem.robot, problem.start).at(path.times[-1:])
    return Target(
        end.positions[0],
        _UNTURNED if end.quaternions is None else end.quaternions[0],
        linear_velocity=end.twists[0, :3],
        angular_velocity=end.twists[0, 3:],
        linear_acceleration=end.accelerations[0, :3],
        angular_acceleration=end.accelerations[0, 3:],
        orientation=Orientation.FIXED if path.turns else Orientation.FREE,
    )


def refuse_grasps(problem: PlanningProblem, allowed: str) -> None:
    """Refuse what needs a grasp, or another goal of one place, beside a goal that is none.

    Raises:
        InvalidInput: A target body, an approach or a camera is given.
    """
    for field, given in (
        ("target_body", problem.target_body),
        ("approach", problem.approach),
        ("camera", problem.camera),
    ):
        if given is not None:
            raise InvalidInput(Status.UNSUPPORTED, field, "given", allowed)
