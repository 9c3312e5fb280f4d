"""The plan: a motion, its metrics, and how it was found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.problem.goal_words import Parametrisation
from ff_planner_ros.robot.quaternion import (
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
)

if TYPE_CHECKING:
    from ff_planner_ros.robot.model import Robot

# Family of a plan that is the unchanged remainder of a running plan.
REMAINDER = "remainder"

AXES, QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
# Columns of a trajectory's field: prefix, names, and the unit as suffix.
COLUMNS: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "chaser_positions": ("chaser_", AXES, "_m"),
    "chaser_quaternions_xyzw": ("chaser_", QUATERNION, ""),
    "chaser_linear_velocities": ("chaser_velocity_", AXES, "_m_per_s"),
    "chaser_angular_velocities": ("chaser_angular_velocity_", AXES, "_rad_per_s"),
    "ee_positions": ("ee_", AXES, "_m"),
    "ee_quaternions_xyzw": ("ee_", QUATERNION, ""),
    "ee_linear_velocities": ("ee_velocity_", AXES, "_m_per_s"),
    "ee_angular_velocities": ("ee_angular_velocity_", AXES, "_rad_per_s"),
}
# Quantities of a revolute and of a prismatic joint.
JOINT_COLUMNS = {
    "joint_positions": ("position_rad", "position_m"),
    "joint_velocities": ("velocity_rad_per_s", "velocity_m_per_s"),
    "joint_accelerations": ("acceleration_rad_per_s2", "acceleration_m_per_s2"),
    "joint_torques": ("torque_Nm", "force_N"),
}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The sampled motion of the system, in the inertial frame; one row per point.

    The chaser frame has its origin at the centre of mass of the chaser alone and the axes of
    the base link; quaternions rotate chaser or end-effector axes to inertial axes.
    """

    time: Array  # from the start, equal steps to the goal, and equal ones after; (points,) [s]
    joint_positions: Array  # shape (points, joints) [rad, m]
    joint_velocities: Array  # shape (points, joints) [rad/s, m/s]
    joint_accelerations: Array  # shape (points, joints) [rad/s2, m/s2]
    joint_torques: Array  # by inverse dynamics, Eq. (20); shape (points, joints) [N m, N]
    chaser_positions: Array  # shape (points, 3) [m]
    chaser_quaternions_xyzw: Array  # shape (points, 4)
    chaser_linear_velocities: Array  # of the chaser centre of mass; shape (points, 3) [m/s]
    chaser_angular_velocities: Array  # shape (points, 3) [rad/s]
    ee_positions: Array  # shape (points, 3) [m]
    ee_quaternions_xyzw: Array  # shape (points, 4)
    ee_linear_velocities: Array  # shape (points, 3) [m/s]
    ee_angular_velocities: Array  # shape (points, 3) [rad/s]

    FACTS = ("time", "joint_positions")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for item in fields(self):
            object.__setattr__(self, item.name, frozen(getattr(self, item.name)))

    def columns(self, robot: Robot | None = None) -> dict[str, Array]:
        """Return the motion as columns of one length, by name with unit; pandas takes them.

        Args:
            robot: Whose motion it is, which names its joints and knows which of them slide. None:
                the joints are numbered, and their columns have no units.
        """
        if robot is None:
            count = self.joint_positions.shape[1]
            return columns_of(self, [(f"joint_{joint}", None) for joint in range(1, count + 1)])
        joints = [(name, robot.slides(joint)) for joint, name in enumerate(robot.joint_names)]
        return columns_of(self, joints)

    def followed_by(self, after: Trajectory, begin: float = 0.0) -> Trajectory:
        """Return this motion and the next joined; the point that they share is this one's.

        Args:
            begin: Time of this motion at which that of the next is zero [s].
        """
        later = replace(after, time=begin + after.time)
        return Trajectory(
            **{
                item.name: np.concatenate([getattr(self, item.name), getattr(later, item.name)[1:]])
                for item in fields(self)
            }
        )


def columns_of(motion: Trajectory, joints: Sequence[tuple[str, bool | None]]) -> dict[str, Array]:
    """Return a motion as columns of one length, by name with unit.

    Args:
        joints: Name of each joint, and whether it is prismatic; None: not known, without unit.
    """
    columns = {"time_s": motion.time}
    for part, quantities in JOINT_COLUMNS.items():
        for number, (joint, slides) in enumerate(joints):
            quantity = quantities[bool(slides)]
            quantity = quantity.partition("_")[0] if slides is None else quantity
            columns[f"{joint}_{quantity}"] = getattr(motion, part)[:, number]
    for part, (before, names, unit) in COLUMNS.items():
        for number, name in enumerate(names):
            columns[f"{before}{name}{unit}"] = getattr(motion, part)[:, number]
    return columns


def begins_of(motions: Iterable[Trajectory]) -> list[float]:
    """Return the start time of each of consecutive motions, the first at zero [s]."""
    ends: list[float] = np.cumsum([motion.time[-1] for motion in motions]).tolist()
    return [0.0, *ends[:-1]]


class BodyMotion(NamedTuple):
    """Motion of a body's frame at its centre of mass, in the inertial frame; one row per point."""

    positions: Array  # shape (points, 3) [m]
    quaternions_xyzw: Array  # body axes to inertial axes; shape (points, 4)
    linear_velocities: Array  # shape (points, 3) [m/s]
    angular_velocities: Array  # shape (points, 3) [rad/s]

    def followed_by(self, after: BodyMotion) -> BodyMotion:
        """Return this motion and the next joined; they share no point."""
        return BodyMotion(*map(np.concatenate, zip(self, after, strict=True)))


def with_end_effector(motion: Trajectory, place: Array, points: slice) -> BodyMotion:
    """Return the motion of a body that is fixed to the end effector, at some points of a plan.

    Args:
        place: Pose of its frame in the end effector's: position [m] and quaternion (x, y, z, w).
            Shape (7,).
    """
    turns, rates = motion.ee_quaternions_xyzw[points], motion.ee_angular_velocities[points]
    lever = rotation_from_quaternion(turns) @ place[:3]
    return BodyMotion(
        positions=motion.ee_positions[points] + lever,
        quaternions_xyzw=quaternion_product(turns, place[3:]),
        linear_velocities=motion.ee_linear_velocities[points] + np.cross(rates, lever),
        angular_velocities=rates,
    )


def in_end_effector(motion: Trajectory, pose: Array) -> Array:
    """Return an inertial pose, shape (7,), in the end effector's frame at a plan's last point."""
    back = quaternion_inverse(motion.ee_quaternions_xyzw[-1])
    way = rotation_from_quaternion(back) @ (pose[:3] - motion.ee_positions[-1])
    return np.concatenate([way, quaternion_product(back, pose[3:])])


@dataclass(frozen=True, eq=False)
class WheelMotion:
    """Momenta and torques of the reaction wheels that hold the chaser's attitude."""

    momenta: Array  # shape (points, wheels) [N m s]
    torques: Array  # rates of the momenta; shape (points, wheels) [N m]

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for item in fields(self):
            object.__setattr__(self, item.name, frozen(getattr(self, item.name)))

    def followed_by(self, after: WheelMotion) -> WheelMotion:
        """Return this motion and the next joined; the point that they share is this one's."""
        momenta = np.concatenate([self.momenta, after.momenta[1:]])
        return WheelMotion(momenta, np.concatenate([self.torques, after.torques[1:]]))


@dataclass(frozen=True)
class SolverReport:
    """How the solver found a path."""

    starts: int  # initial guesses tried
    iterations: int  # quadratic programs solved, for all initial guesses
    rollouts: int  # motions integrated, for all initial guesses, each with derivatives
    optimality: float  # first-order, see `solver`; infinite where nothing was optimised
    stop_reason: str  # why it stopped, a sentence
    ended_by: str = ""  # what ended the search, of `EndedBy`; empty: not known


@dataclass(frozen=True)
class RobustReport:
    """The constraint back-off of a robust plan for given uncertainties, and its price."""

    sigmas: float  # standard deviations of margin that were asked for
    least_sigmas: float  # standard deviations of the smallest margin of the plan
    rounds: int  # plans made with increasing back-off; 0: the plain plan has all margins
    plain_joint_path_length: float  # of the plan without back-off [rad]
    # Back-off of the solver from the limits
    clearance: tuple[tuple[str, float], ...] = ()  # obstacle and distance [m]
    chaser_attitude: float = 0.0  # of the Euler angles [rad]
    torques: tuple[tuple[str, float], ...] = ()  # joint and torque [N m]
    corridor: float = 0.0  # of the approach [m]
    chaser_rotation: float = 0.0  # [rad]
    # Standard deviations of the uncertain quantities, by name of `Uncertainty`
    deviations: tuple[tuple[str, float], ...] = ()

    def told(self, joint_path_length: float) -> str:
        """Return the back-off and its price in words, given the joint path of the plan [rad]."""
        longer = joint_path_length - self.plain_joint_path_length
        return (
            f"smallest margin {self.least_sigmas:.2f} sigmas, {self.sigmas:g} required; joint path "
            f"{longer:+.4f} rad beside {self.plain_joint_path_length:.4f} rad of the plain plan"
        )


def may_be_singular(family: str) -> bool:
    """Tell whether motions of a family may begin, pass and end at singularities.

    They use no velocity map.
    """
    return family in (Parametrisation.JOINT_SPLINE, REMAINDER)


@dataclass(frozen=True, eq=False)
class Plan:
    """A checked plan: motion, metrics, and why the solver stopped."""

    joint_names: tuple[str, ...]  # in the order of the trajectory's columns
    trajectory: Trajectory
    # The paper's a6..a8 of the six components, Eq. (42), in the chaser's axes at the first point;
    # shape (18,), empty for another path
    xi: Array
    orientation_reading: str  # Euler angles of the last nine of xi (see `polynomial`), or empty
    metrics: Metrics
    solver: SolverReport
    # Name of the path family, or `REMAINDER`; empty: the motion is no path of a family
    family: str = ""
    # Decision variables, an initial guess for other plans; shape (variables,), empty: no family
    coefficients: Array = field(default_factory=lambda: np.empty(0))
    duration: float | None = None  # from the first point to the goal [s]; None: the problem's
    robust: RobustReport | None = None  # None: it was not asked for
    wheels: WheelMotion | None = None  # None: the chaser has none
    # The step at which the search was stopped: with it, a task gives this plan again; zero: the
    # search ran to its end
    effort: int = 0
    notes: tuple[str, ...] = ()  # on the scene of the problem

    # Angular rate of the whole system after the goal if the joints rest there [rad/s]; None: they
    # do not, or it was not asked for
    turn_rate_at_rest: float | None = None
    # Plans of the phases that follow, each by itself; empty: there are none
    then: tuple[Plan, ...] = ()

    FACTS = ("family", "duration", "trajectory", "metrics", "then", "notes")
    __repr__ = in_a_line

    @property
    def phases(self) -> tuple[Plan, ...]:
        """The plan of each phase, in order; at least this plan itself."""
        return (replace(self, then=()), *self.then) if self.then else (self,)

    @property
    def begins(self) -> list[float]:
        """Start time of each phase, the first at zero [s]."""
        return begins_of(phase.trajectory for phase in self.phases)

    @property
    def may_be_singular(self) -> bool:
        """Whether the motion may begin, pass and end at singularities."""
        return may_be_singular(self.family)

    @property
    def message(self) -> str:
        """Stop reason, constraint back-off, angular rate at rest and notes, as one text."""
        robust, rate = self.robust, self.turn_rate_at_rest
        kept = [] if robust is None else [robust.told(self.metrics.joint_path_length)]
        rests = (
            [] if rate is None else [f"with joints at rest the system turns at {rate:.4g} rad/s"]
        )
        return "; ".join([self.solver.stop_reason, *kept, *rests, *self.notes])

    def __post_init__(self) -> None:
        """Make the decision variables read-only."""
        for name in ("xi", "coefficients"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
