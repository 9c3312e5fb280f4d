"""Robots and their states on a planar base: the table fixes height, roll and pitch.

The table's normal is z of the inertial frame, of the base link and of the root link.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.state import SystemState

# Errors of cameras that track a flat table, which are removed; larger ones are refused [rad], [m],
# [m/s, rad/s].
MAX_TILT, MAX_HEIGHT_ERROR, MAX_SPEED_OFF_PLANE = 0.02, 0.01, 0.01

# Tolerance of axes on a planar base [rad]: in URDFs, rpy="1.57 0 0" is a right angle.
MAX_AXIS_TILT = 1e-3


def require_planar(model: pin.Model, base_frame: pin.Frame) -> None:
    """Check that z of base link and root link are parallel, and that all joints move in the plane.

    Revolute joints rotate about z, prismatic ones move across it.

    Raises:
        InvalidInput: One of these is not so.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = [("base link's z axis", base_frame.placement.rotation[:, 2])]
    for joint in range(2, model.njoints):
        moving = pin.getJointJacobian(model, data, joint, pin.WORLD)[:, model.idx_vs[joint]]
        axes.append((f"joint '{model.names[joint]}' axis", moving))
    for name, axis in axes:
        along, across = abs(axis[-1]), math.hypot(*axis[-3:-1])
        if not axis[-3:].any():  # prismatic
            along, across = math.hypot(*axis[:2]), abs(axis[2])
        angle = math.atan2(across, along)
        if not angle <= MAX_AXIS_TILT:
            raise InvalidInput(
                Status.BAD_ROBOT,
                name,
                f"{math.degrees(angle):.4g} degrees off {'z' if axis[-3:].any() else 'x and y'} of "
                "the root link",
                "with robot.base planar every joint must turn about the normal of the table, or "
                "slide across it, which is z of base link and root link; "
                f"{math.degrees(MAX_AXIS_TILT):.2g} degrees are let pass as rounding",
            )


def on_the_table(state: SystemState) -> SystemState:
    """Return a state projected to the table: without tilt and without velocity off the plane.

    Raises:
        InvalidInput: These exceed the errors of a measurement.
    """
    flat, tilt = flattened(state.quaternion_chaser_to_inertial_xyzw)
    if tilt > MAX_TILT:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "chaser.quaternion_xyzw",
            state.quaternion_chaser_to_inertial_xyzw.tolist(),
            f"with robot.base planar the chaser's z axis is that of the inertial frame; it is "
            f"{math.degrees(tilt):.3g} degrees off, and {math.degrees(MAX_TILT):.2g} are let pass "
            "as an error of measurement",
        )
    velocity = in_plane(
        "chaser.linear_velocity", state.linear_velocity_chaser_in_inertial, [2], "m/s"
    )
    omega = in_plane(
        "chaser.angular_velocity", state.angular_velocity_chaser_in_inertial, [0, 1], "rad/s"
    )
    return replace(
        state,
        quaternion_chaser_to_inertial_xyzw=flat,
        linear_velocity_chaser_in_inertial=velocity,
        angular_velocity_chaser_in_inertial=omega,
    )


def in_plane(field: str, vector: Array, off_plane: list[int], unit: str) -> Array:
    """Return a linear or angular velocity on the table with its components off the plane zero.

    Args:
        off_plane: Indices of these components.

    Raises:
        InvalidInput: They exceed the errors of a measurement.
    """
    off = float(np.linalg.norm(vector[off_plane]))
    if off > MAX_SPEED_OFF_PLANE:
        what = "along z" if off_plane == [2] else "about x and y"
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            field,
            vector.tolist(),
            f"with robot.base planar it leaves the plane: {what} it must be zero, and "
            f"{MAX_SPEED_OFF_PLANE:g} {unit} are let pass as an error of measurement",
        )
    kept = vector.copy()
    kept[off_plane] = 0.0
    return kept


def require_height(field: str, position: Array, height: float) -> None:
    """Check that a place of the end effector has the height [m] that the table gives it.

    Raises:
        InvalidInput: It is further off than errors of a measurement.
    """
    if abs(position[2] - height) > MAX_HEIGHT_ERROR:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            field,
            position.tolist(),
            f"with robot.base planar the end effector stays at z = {height:.6g} m; "
            f"{MAX_HEIGHT_ERROR:g} m beside it are let pass as an error of measurement",
        )


def flattened(quaternion_xyzw: Array) -> tuple[Array, float]:
    """Return the nearest attitude with z up or down, and the rotation angle to it [rad]."""
    upright = math.hypot(*quaternion_xyzw[2:]) >= math.hypot(*quaternion_xyzw[:2])
    flat = np.where([not upright, not upright, upright, upright], quaternion_xyzw, 0.0)
    kept = float(np.linalg.norm(flat))
    tilt = 2.0 * math.atan2(float(np.linalg.norm(quaternion_xyzw - flat)), kept)
    return (quaternion_xyzw, 0.0) if tilt == 0.0 else (flat / kept, tilt)
