"""What messages say of joints that the model has locked, held against where it has them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.locked_joints import LockedJoint
from ff_planner_ros.ros.inputs.raw_subscription import deserialised
from ff_planner_ros.ros.messages.joint_names import joints_named
from ff_planner_ros.ros.topics import CHASER_STATE, JOINT_STATES, Endpoint

# Names, positions and rates of joints in a message, by its type.
_FIELDS = {
    JOINT_STATES.message_type: ("name", "position", "velocity"),
    CHASER_STATE.message_type: ("joint_names", "joint_positions", "joint_velocities"),
}


@dataclass(frozen=True)
class _Off:
    """A number of a locked joint that is not what the model assumes."""

    joint: LockedJoint
    field: str
    found: float
    is_rate: bool

    @property
    def told(self) -> str:
        """The number with its unit."""
        return f"{self.found:.6g} {self.joint.unit}{'/s' if self.is_rate else ''}"


class LockedJoints:
    """The newest message on each joint that the model has locked, whoever publishes it."""

    def __init__(self, robot: Robot) -> None:
        """Begin without messages."""
        self._robot = robot
        self._named = joints_named([one.name for one in robot.locked_joints])
        self._heard: dict[str, tuple[Endpoint, bytes]] = {}  # by joint

    def keep(self, topic: Endpoint, message: bytes) -> None:
        """Keep a message of a topic if it names such a joint."""
        for name in self._named(message):
            self._heard[name] = topic, message

    def clear(self) -> None:
        """Forget everything."""
        self._heard.clear()

    def require_locked(self, tolerance: float) -> None:
        """Refuse if a joint was last heard to be elsewhere than locked, or to move.

        Raises:
            InvalidInput: It was (START_OUTSIDE_LIMITS).
        """
        if math.isinf(tolerance):
            return
        found = list[_Off]()
        for name, (topic, message) in list(self._heard.items()):
            try:
                read = deserialised(message, topic)
            except InvalidInput:
                continue  # damaged
            told = _differences(topic.name, read, self._robot, tolerance)
            found += [one for one in told if one.joint.name == name]
        _refuse(found, tolerance)


def require_locked(source: str, message: Any, robot: Robot, tolerance: float) -> None:
    """Refuse a message that has a joint elsewhere than where the model has it locked, or moving.

    Args:
        source: Topic or field of the message, a JointState or a ChaserState.
        tolerance: Allowed difference [rad, m] and rate [rad/s, m/s].

    Raises:
        InvalidInput: There is such a joint (START_OUTSIDE_LIMITS).
    """
    _refuse(list(_differences(source, message, robot, tolerance)), tolerance)


def _differences(source: str, message: Any, robot: Robot, tolerance: float) -> Iterator[_Off]:
    """Yield what a message says of locked joints that is not as the model has it."""
    name, *kinds = _FIELDS[type(message)]
    names = getattr(message, name)
    locked = {one.name: one for one in robot.locked_joints}
    for is_rate, kind in enumerate(kinds):
        values: Sequence[float] = getattr(message, kind)
        if len(values) != len(names):
            continue  # a message need not have rates; of the arm's joints it is refused elsewhere
        for joint, value in zip(names, values, strict=True):
            if joint not in locked or math.isnan(value):  # NaN: not measured
                continue
            one = locked[joint]
            off = float(value) if is_rate else float(value) - one.position
            if one.type == "continuous" and not is_rate and math.isfinite(off):
                off = math.remainder(off, math.tau)
            if not abs(off) <= tolerance:
                yield _Off(one, f"{source}.{kind}[{joint}]", float(value), bool(is_rate))


def _refuse(found: Sequence[_Off], tolerance: float) -> None:
    if not found:
        return
    first, rest = found[0], found[1:]
    unit = first.joint.unit
    at = "at rest" if first.is_rate else f"at {first.joint.position:g} {unit}"
    allowed = (
        f"the model has this joint {_how(first.joint)} {at}, and masses, collisions and the "
        f"chaser's centre of mass depend on it; {tolerance:g} {unit}{'/s' if first.is_rate else ''}"
        f" are allowed (parameter locked_joint_tolerance); {_advice(found)}"
    )
    if rest:
        allowed += f"; also {', '.join(f'{one.field} is {one.told}' for one in rest)}"
    raise InvalidInput(Status.START_OUTSIDE_LIMITS, first.field, first.told, allowed)


def _how(joint: LockedJoint) -> str:
    return "fixed" if joint.is_fixed else "locked"


def _advice(found: Iterable[_Off]) -> str:
    """Return what to set, or to do."""
    places = {one.joint.name: one for one in found if not one.is_rate}
    settable = [one for one in places.values() if not one.joint.is_fixed]
    if settable:
        told = ", ".join(f"{one.joint.name}: {one.found:.6g}" for one in settable)
        return f'set robot.locked_joints to "{told}" (with the others that it names)'
    if places:
        return "it is fixed in the URDF: give the model the URDF of the robot as it is"
    return "stop it, or plan with it as a joint of the arm"
