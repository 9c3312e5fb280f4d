"""The target body of a message, as it is or decoded from a bag, as planning has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ff_planner_ros.arrays import Array, finite_vector
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.planning.target_body import AttachedSphere, TargetBody

# Fields of the message, by those of a scenario.
NAMED_AS = {
    "target_body.position": "target_body.pose.position",
    "target_body.quaternion_xyzw": "target_body.pose.orientation",
    "target_body.linear_velocity": "target_body.twist.linear",
    "target_body.angular_velocity": "target_body.twist.angular",
    "target_body.grasp.quaternion_xyzw": "target_body.grasp.orientation",
}


def target_body_in(message: Any) -> TargetBody:
    """Read a target body, at the stamp of its message.

    Raises:
        InvalidInput: It describes no body; the field is named as if the message's were
            `target_body`, as topic and field of a request are.
    """
    inertia = message.inertia
    _require_zero("inertia.com", [_vector(inertia.com)], "the frame is at the centre of mass")
    products = inertia.ixy, inertia.ixz, inertia.iyz
    with fields_named(NAMED_AS):
        return TargetBody(
            position=_vector(message.pose.position),
            quaternion_xyzw=_quaternion(message.pose.orientation),
            linear_velocity=_vector(message.twist.linear),
            angular_velocity=_vector(message.twist.angular),
            inertia=_tensor((inertia.ixx, inertia.iyy, inertia.izz), products),
            grasp_position=_vector(message.grasp.position),
            grasp_quaternion_xyzw=_quaternion(message.grasp.orientation),
            obstacles=tuple(_attached(number, one) for number, one in enumerate(message.obstacles)),
        )


def _attached(number: int, message: Any) -> AttachedSphere:
    field = f"obstacles[{number}]"
    twist = [_vector(message.twist.linear), _vector(message.twist.angular)]
    _require_zero(f"{field}.twist", twist, "the sphere is fixed to the body")
    by_id = f"target_body.obstacles[{message.id}]"
    with fields_named({f"{by_id}.{one}": f"target_body.{field}.{one}" for one in _OF_SPHERE}):
        return AttachedSphere(message.id, _vector(message.center), message.radius)


_OF_SPHERE = ("center", "radius")


def _require_zero(field: str, parts: list[Array], why: str) -> None:
    numbers = np.concatenate(parts)
    if finite_vector(f"target_body.{field}", numbers, len(numbers)).any():
        allowed = f"it must be zero: {why}"
        raise InvalidInput(Status.UNSUPPORTED, f"target_body.{field}", numbers.tolist(), allowed)


def _tensor(moments: tuple[float, ...], products: tuple[float, ...]) -> Array:
    xy, xz, yz = products
    xx, yy, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _vector(message: Any) -> Array:
    return np.array([message.x, message.y, message.z])


def _quaternion(message: Any) -> Array:
    return np.array([message.x, message.y, message.z, message.w])
