"""The target: pose, twist and acceleration of the end effector at the end of a plan."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, finite_vector, frozen, zero_vector
from ff_planner_ros.common.declared import check_declared, declare, declare_velocity
from ff_planner_ros.common.forms import (
    DIRECTION,
    QUATERNION,
    Form,
    a_numbered_word,
    a_vector,
    of_numbers,
)
from ff_planner_ros.common.plain_values import numbers
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.plane import MAX_TILT, flattened, in_plane, require_height
from ff_planner_ros.robot.rotation import rotation_from_euler
from ff_planner_ros.robot.state import SystemState

# What rounding leaves of a turn that was meant to be across the free axis [rad/s, rad/s2].
FREE_TURN_TOLERANCE = 1e-6
# A target tilted by less [rad] stays as it is, so that repeated checks do not change it.
TILT_OF_ROUNDING = 1e-9


def _euler_degrees(field: str, value: object) -> Array:
    """Return the quaternion of three angles: R = Rz Ry Rx."""
    euler = np.deg2rad(finite_vector(field, numbers(field, value), 3))
    return frozen(eigen_quaternion(rotation_from_euler(euler)))


EULER_DEGREES = Form(_euler_degrees, lambda: of_numbers(3))


@dataclass(frozen=True, eq=False)
class Target:
    """The goal of the end effector at the end of the plan, in the inertial frame.

    Raises:
        InvalidInput: Wrong size, not finite, a quaternion not of unit length, a free axis that
            is missing, of no length or not allowed, or angular motion in a free direction.
    """

    position: Array = declare(
        a_vector(),
        "of the end effector at the end, where it is then",
        unit="m",
        message="pose.pose.position",
    )
    # Without meaning if orientation is FREE
    quaternion_xyzw: Array = declare(
        QUATERNION,
        "end-effector axes to inertial axes",
        instead=(
            "euler_xyz_deg",
            EULER_DEGREES,
            "angles phi, theta, psi about x, y, z of the inertial frame: R = Rz Ry Rx [deg]",
        ),
        unless=("orientation", "free", (0.0, 0.0, 0.0, 1.0)),
        message="pose.pose.orientation",
    )
    linear_velocity: Array = declare_velocity("linear", "of the end effector at the end")
    angular_velocity: Array = declare_velocity("angular", "of the end effector at the end")
    linear_acceleration: Array = declare(
        a_vector(), "of the end effector at the end", unit="m/s2", default_factory=zero_vector
    )
    angular_acceleration: Array = declare(
        a_vector(), "of the end effector at the end", unit="rad/s2", default_factory=zero_vector
    )
    orientation: Orientation = declare(
        a_numbered_word(Orientation),
        "what of the orientation counts: fixed: all; free: nothing; about_axis: all but the "
        "rotation about free_axis",
        brief=True,
        default=Orientation.FIXED,
        message="orientation",
    )
    # Of unit length; None unless orientation is ABOUT_AXIS
    free_axis_in_ee: Array | None = declare(
        DIRECTION,
        "axis about which the end effector may rotate, any length but zero; only with about_axis",
        key="free_axis",
        frame="in the end effector's frame",
        default=None,
        message="free_axis",
    )

    FACTS = ("position", "quaternion_xyzw", "linear_velocity", "angular_velocity", "orientation")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        if str(self.orientation) == Orientation.FREE:
            object.__setattr__(self, "quaternion_xyzw", [0.0, 0.0, 0.0, 1.0])
        check_declared(self, "target")
        self._check_free_axis()
        for name in ("angular_velocity", "angular_acceleration"):
            self._refuse_free_turn(name)

    def _check_free_axis(self) -> None:
        name, axis = "target.free_axis", self.free_axis_in_ee
        if self.orientation is not Orientation.ABOUT_AXIS:
            if axis is not None:
                allowed = "it may be given where orientation is about_axis"
                raise InvalidInput(Status.OUT_OF_RANGE, name, axis, allowed)
            return
        if axis is None:
            allowed = "orientation about_axis needs the axis, in the end effector's frame"
            raise InvalidInput(Status.OUT_OF_RANGE, name, "missing", allowed)

    def _refuse_free_turn(self, name: str) -> None:
        wanted, where = getattr(self, name), "is free"
        axis = self.free_axis_in_ee
        if self.orientation is Orientation.FIXED:
            return
        if axis is not None:
            to_inertial = pin.Quaternion(self.quaternion_xyzw).toRotationMatrix()
            wanted, where = wanted @ to_inertial @ axis, "about free_axis is free"
        if float(np.linalg.norm(wanted)) > FREE_TURN_TOLERANCE:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                f"target.{name}",
                getattr(self, name).tolist(),
                f"with orientation {self.orientation} the turn {where}: none can be wanted there",
            )


def target_on_the_table(robot: Robot, start: SystemState, target: Target) -> Target:
    """Return a target projected onto the plane in which a planar base moves the end effector.

    Raises:
        InvalidInput: The target is further off that plane than errors of measurement explain.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, *configuration(robot, start))
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    require_height("target.position", target.position, float(tip.translation[2]))
    if target.free_axis_in_ee is not None:
        target = _without_free_axis(tip.rotation @ target.free_axis_in_ee, target)
    if target.orientation is Orientation.FIXED:
        to_ee = pin.Quaternion(eigen_quaternion(tip.rotation.T))
        wanted = pin.Quaternion(target.quaternion_xyzw) * to_ee
        heading, tilt = flattened(wanted.coeffs())
        upside_down = abs(heading[3]) + abs(heading[2]) == 0.0
        if tilt > MAX_TILT or upside_down:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "target.quaternion_xyzw",
                target.quaternion_xyzw.tolist(),
                "with robot.base planar the end effector turns about z only: its start attitude, "
                f"{np.round(eigen_quaternion(tip.rotation), 6).tolist()}, turned about z",
            )
        if tilt > TILT_OF_ROUNDING:
            turned = pin.Quaternion(heading) * pin.Quaternion(eigen_quaternion(tip.rotation))
            target = replace(target, quaternion_xyzw=turned.normalized().coeffs())
    place = np.append(target.position[:2], tip.translation[2])
    vectors: dict[str, Any] = {
        f"{kind}_{quantity}": in_plane(
            f"target.{kind}_{quantity}", getattr(target, f"{kind}_{quantity}"), rows, unit
        )
        for kind, rows, units in (("linear", [2], "m"), ("angular", [0, 1], "rad"))
        for quantity, unit in (("velocity", f"{units}/s"), ("acceleration", f"{units}/s2"))
    }
    return replace(target, position=place, **vectors)


def _without_free_axis(axis: Array, target: Target) -> Target:
    """Return a target on a planar base whose heading is free, for the free axis is the normal.

    Raises:
        InvalidInput: The free axis is not the normal.
    """
    if math.hypot(axis[0], axis[1]) > MAX_TILT:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "target.free_axis",
            target.free_axis_in_ee,
            "with robot.base planar the end effector turns about the normal of the table only; "
            "orientation must be fixed or free",
        )
    return replace(target, orientation=Orientation.FREE, free_axis_in_ee=None)


def require_enough_joints(robot: Robot, target: Target) -> None:
    """Refuse a goal with more conditions than the arm has joints.

    Raises:
        InvalidInput: It has more; the text names them.
    """
    conditions = conditions_of(robot, target)
    if sum(conditions.values()) > robot.joints:
        joints = f"{robot.joints} joint{'s' if robot.joints != 1 else ''}"
        raise too_many_conditions(target, conditions, f"the arm has {joints}", robot.joints)


def conditions_of(robot: Robot, target: Target) -> dict[str, int]:
    """Return the conditions on the end effector's pose by name, with their degrees of freedom."""
    planar = robot.base is Base.PLANAR
    conditions = {"position": 2 if planar else 3}
    if target.orientation is Orientation.FIXED:
        conditions["heading" if planar else "orientation"] = 1 if planar else 3
    elif target.orientation is Orientation.ABOUT_AXIS:
        conditions["direction of free_axis"] = 2
    return conditions


def too_many_conditions(
    target: Target, conditions: dict[str, int], why: str, at_most: int
) -> InvalidInput:
    """Return the error of a goal with more conditions than an arm can meet, at most `at_most`."""
    count = sum(conditions.values())
    words = " and ".join(f"{name} ({number})" for name, number in conditions.items())
    if conditions["position"] > at_most:
        field, value = "target.position", "given"
        advice = f"no goal has fewer than {conditions['position']}"
    else:
        field, value = "target.orientation", str(target.orientation)
        advice = "orientation free has fewer"
    return InvalidInput(
        Status.UNSUPPORTED, field, value, f"{words} are {count} conditions, {why}; {advice}"
    )
