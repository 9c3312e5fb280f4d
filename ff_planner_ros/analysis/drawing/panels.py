"""Quantities that are drawn over time: those of the paper's Figs. 3 to 6, joints and wheels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ff_planner_ros.analysis.extremes import distances, nearest
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import (
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
    unit_quaternion,
)
from ff_planner_ros.robot.rotation import euler_from_rotation


@dataclass(frozen=True)
class Quantity:
    """A vector quantity of a motion at its trajectory points; each component has its own panel."""

    title: str  # above the panels of all components
    labels: tuple[str, ...]  # component names and units; `$v_x$` is a symbol with its index
    of: Callable[[Trajectory], Array]  # returns the values of a motion, shape (points, labels)
    turns: bool = False  # whether the components are angles in degrees, equal modulo 360
    # Whether chaser attitudes are relative to the chaser's axes at the first motion's start
    from_start: bool = False
    # Lower and upper limit of each component, shape (labels, 2); or empty
    levels: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Mark:
    """A marked point of a curve, with its text."""

    method: Method
    time: float  # [s]
    value: float  # in the panel's unit
    words: str


@dataclass(frozen=True, eq=False)
class Panel:
    """One component of a quantity over time, for several motions."""

    label: str  # name and unit
    # Time and values, by method; each of shape (points,)
    curves: Mapping[Method, tuple[Array, Array]]
    levels: tuple[float, ...] = ()  # limits, if there are any
    marks: tuple[Mark, ...] = ()

    @property
    def note(self) -> str:
        """The limits in words, often far beyond the curves; empty unless both are finite."""
        low, high = self.levels or (-np.inf, np.inf)
        if not (np.isfinite(low) and np.isfinite(high)):
            return ""
        return f"limits ±{high:.4g}" if low == -high else f"limits {low:.4g} to {high:.4g}"

    @property
    def span(self) -> tuple[float, float]:
        """Range of the axis: lowest to highest value of all curves, with a margin."""
        values = np.concatenate([values for _, values in self.curves.values()])
        if not np.isfinite(values).any():
            return -1.0, 1.0
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        margin = max(_MARGIN * (high - low), _FLAT)
        return low - margin, high + margin


# Of the height that the curves need, free above and below them. A curve that varies by less than
# the second is drawn flat, so that rounding is not magnified.
_MARGIN, _FLAT = 0.05, 1e-5

_XYZ = ("x", "y", "z")
_POSITION = tuple(f"{axis} [m]" for axis in _XYZ)
_EULER = ("roll $φ$ (x) [deg]", "pitch $θ$ (y) [deg]", "yaw $ψ$ (z) [deg]")


def _pose(frame: str, position: str, orientation: str) -> tuple[Quantity, Quantity]:
    """Return position and orientation of a frame, `ee` or `chaser`, in the inertial frame."""
    return (
        Quantity(position, _POSITION, lambda motion: getattr(motion, f"{frame}_positions")),
        Quantity(
            f"{orientation}, Euler ZYX",
            _EULER,
            lambda motion: _euler_deg(getattr(motion, f"{frame}_quaternions_xyzw")),
            turns=True,
            from_start=frame == "chaser",
        ),
    )


END_EFFECTOR_POSE = _pose("ee", "end effector position", "end effector orientation")  # Fig. 3
CHASER_POSE = _pose("chaser", "chaser position", "chaser attitude from the start")  # Fig. 4
CHASER_VELOCITY = (  # Fig. 5
    Quantity(
        "chaser linear velocity",
        tuple(f"$v_{axis}$ [m/s]" for axis in _XYZ),
        lambda motion: motion.chaser_linear_velocities,
    ),
    Quantity(
        "chaser angular velocity",
        tuple(f"$ω_{axis}$ [deg/s]" for axis in _XYZ),
        lambda motion: np.rad2deg(motion.chaser_angular_velocities),
    ),
)


def clearance_panel(
    robot: Robot,
    obstacles: Sequence[Obstacle],
    motions: Mapping[Method, Trajectory],
    scene: Scene | None = None,
) -> Panel:
    """Return the distance of the robot to the closest obstacle [mm], with its minimum marked.

    The distance is that of the bodies, or else of the arm's centre lines, also between trajectory
    points. It is NaN without obstacles.

    Args:
        scene: Its allowed contacts, at goal and start, are ignored. None: there are none.
    """
    label, curves, marks = "distance to closest obstacle [mm]", {}, list[Mark]()
    for method, motion in motions.items():
        if not obstacles:
            curves[method] = (motion.time, np.full(len(motion.time), np.nan))
            continue
        found = distances(robot, obstacles, motion, scene)
        closest = np.where(np.isfinite(found.closest), found.closest, np.nan)
        curves[method] = (found.time, 1e3 * closest)
        least = nearest(robot, obstacles, found)
        marks.append(Mark(method, least.time, 1e3 * least.distance, least.words))
    return Panel(label, curves, marks=tuple(marks))


def joint_angles(robot: Robot) -> Quantity:
    """Return the joint positions with their limits [deg; prismatic: m]."""
    lower = np.where(robot.continuous, -np.inf, robot.lower_position_limits)
    upper = np.where(robot.continuous, np.inf, robot.upper_position_limits)
    title = "joint positions" if robot.joint_slides.any() else "joint angles"
    return _of_joints(robot, title, ("deg", "m"), "joint_positions", lower, upper)


def joint_rates(robot: Robot) -> Quantity:
    """Return the joint velocities with their limits [deg/s; prismatic: m/s]."""
    limits = robot.velocity_limits
    units = ("deg/s", "m/s")
    return _of_joints(robot, "joint velocities", units, "joint_velocities", -limits, limits)


def joint_torques(robot: Robot) -> Quantity:
    """Return the joint torques with their limits [N m; prismatic: N]."""
    limits = robot.effort_limits
    return _of_joints(robot, "joint torques", ("N m", "N"), "joint_torques", -limits, limits)


def _of_joints(
    robot: Robot, title: str, units: tuple[str, str], field: str, lower: Array, upper: Array
) -> Quantity:
    """Return a quantity of all joints, in the `units` of revolute and of prismatic ones."""
    of_each = [units[robot.slides(joint)] for joint in range(robot.joints)]
    factors = np.array([np.rad2deg(1.0) if unit.startswith("deg") else 1.0 for unit in of_each])
    labels = zip(robot.joint_names, of_each, strict=True)
    return Quantity(
        title,
        tuple(f"{name} [{unit}]" for name, unit in labels),
        lambda motion: factors * getattr(motion, field),
        levels=tuple(zip(*(factors * np.array([lower, upper])).tolist(), strict=True)),
    )


def wheel_quantities(robot: Robot, stored: Array | None) -> dict[str, Quantity]:
    """Return the wheels' momenta and torques with their limits, by name; empty without wheels.

    Args:
        stored: Wheel momenta at the first point, shape (wheels,) [N m s]; None: zero.
    """
    wheels = robot.wheels
    if wheels is None:
        return {}
    first = np.zeros(wheels.count) if stored is None else stored

    def along(motion: Trajectory) -> tuple[Array, Array]:
        q, v = from_trajectory(robot, motion)
        return wheels_along(robot, wheels, first, q, v, motion.joint_accelerations)

    def drawn(title: str, unit: str, number: int, limits: Array) -> Quantity:
        return Quantity(
            title,
            tuple(f"wheel {wheel + 1} [{unit}]" for wheel in range(wheels.count)),
            lambda motion: along(motion)[number],
            levels=tuple((-limit, limit) for limit in limits.tolist()),
        )

    return {
        "wheel_momenta": drawn("wheel momenta", "N m s", 0, wheels.momentum_limits),
        "wheel_torques": drawn("wheel torques", "N m", 1, wheels.torque_limits),
    }


def panels(quantity: Quantity, motions: Mapping[Method, Trajectory]) -> list[Panel]:
    """Return a panel per component; full turns bring angles closest to the first motion's."""
    first, *others = motions
    if quantity.from_start:
        motions = _seen_from_start(motions[first], motions)
    values = {method: quantity.of(motion) for method, motion in motions.items()}
    # What is not known of a motion at all, as a measured one's torques, is no curve.
    values = {m: of for m, of in values.items() if m is first or not np.isnan(of).all()}
    if quantity.turns:
        for method in [one for one in others if one in values]:
            time = motions[method].time[0]
            near = [np.interp(time, motions[first].time, angle) for angle in values[first].T]
            values[method] = values[method] - 360.0 * np.round((values[method][0] - near) / 360.0)
    return [
        Panel(
            label,
            {m: (motions[m].time, of[:, k]) for m, of in values.items()},
            quantity.levels[k] if quantity.levels else (),
        )
        for k, label in enumerate(quantity.labels)
    ]


def _seen_from_start(
    first: Trajectory, motions: Mapping[Method, Trajectory]
) -> dict[Method, Trajectory]:
    """Return motions with the chaser's attitude relative to that at the start of the first."""
    to_start = quaternion_inverse(unit_quaternion(first.chaser_quaternions_xyzw[0]))
    relative = {
        method: quaternion_product(to_start, unit_quaternion(motion.chaser_quaternions_xyzw))
        for method, motion in motions.items()
    }
    return {
        method: replace(motion, chaser_quaternions_xyzw=relative[method])
        for method, motion in motions.items()
    }


def _euler_deg(quaternions_xyzw: Array) -> Array:
    """Return ZYX Euler angles without jumps, shape (points, 3) [deg]; theta may exceed 90 deg.

    Two triples describe each rotation, up to full turns; each point takes the triple that is
    nearest to the point before.
    """
    angles = euler_from_rotation(rotation_from_quaternion(quaternions_xyzw))
    for before, now in pairwise(angles):
        beyond = np.array([now[0] + np.pi, np.pi - now[1], now[2] + np.pi])
        nearest = [before + np.angle(np.exp(1j * (angle - before))) for angle in (now, beyond)]
        now[:] = min(nearest, key=lambda angle: float(np.abs(angle - before).sum()))
    return np.rad2deg(angles)
