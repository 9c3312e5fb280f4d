"""What messages say of joints that the model has locked: where it has them, or is to have them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.robot import RobotParameters, locked_joints_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.locked_joints import LockedJoint, measurable
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


class MeasuredRobot:
    """The robot, with the joints that are locked where they are measured."""

    def __init__(
        self,
        robot: Robot,
        given: Collection[str],
        load: Callable[[Mapping[str, float]], Robot],
        renewed: Callable[[Robot], None] = lambda _: None,
    ) -> None:
        """Begin with the robot as the parameters alone have it.

        Args:
            given: Names of joints that the parameters have at positions.
            load: Returns the robot with others at positions [rad, m].
            renewed: Called with a model that takes the place of the one before.
        """
        self._last, self._load, self._renewed = robot, load, renewed
        self._names, self._lock = measurable(robot.locked_joints, given), threading.Lock()

    def at(self, measured: Mapping[str, float], tolerance: float) -> Robot:
        """Return the model with joints where they were measured; the last one if it has them there.

        Args:
            measured: Positions of joints [rad, m].
            tolerance: Difference that does not count [rad, m].

        Raises:
            InvalidInput: A joint was not measured (NO_STATE), or the robot is refused with joints
                there.
        """
        self.require(measured)
        positions = {name: measured[name] for name in self._names}
        with self._lock:
            found = {one.name: one for one in self._last.locked_joints}
            off = (_off(found[name], at) for name, at in positions.items())
            if not all(abs(one) <= tolerance for one in off):
                self._last = self._load(positions)
                self._renewed(self._last)
            return self._last

    def require(self, measured: Mapping[str, float]) -> None:
        """Refuse if a joint was not measured.

        Raises:
            InvalidInput: It was not (NO_STATE).
        """
        for name in self._names:
            if name not in measured:
                allowed = (
                    "a state must have it: robot.locked_joints is measured, and masses, collisions "
                    "and the chaser's centre of mass depend on it"
                )
                field = f"position of locked joint {name}"
                raise InvalidInput(Status.NO_STATE, field, "never measured", allowed)


def measured_robot(
    parameters: RobotParameters,
    robot: Robot,
    load: Callable[[Mapping[str, float]], Robot],
    renewed: Callable[[Robot], None] = lambda _: None,
) -> MeasuredRobot | None:
    """Return the robot as it is measured; None: the parameters say where joints are locked."""
    if not parameters.measures:
        return None
    return MeasuredRobot(robot, locked_joints_of(parameters.locked_joints), load, renewed)


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

    def positions(self) -> dict[str, float]:
        """Return where joints were last heard to be [rad, m]."""
        found = dict[str, float]()
        for name, read, _ in self._messages():
            told = positions_in(read, self._robot)
            if name in told:
                found[name] = told[name]
        return found

    def require_locked(
        self, tolerance: float, robot: Robot | None = None, moving_alone: bool = False
    ) -> None:
        """Refuse if a joint was last heard to be elsewhere than locked, or to move.

        Args:
            robot: Has the joints locked; None: the one that this began with.
            moving_alone: Only if it moves.

        Raises:
            InvalidInput: It was (START_OUTSIDE_LIMITS).
        """
        if math.isinf(tolerance):
            return
        found = list[_Off]()
        for name, read, topic in self._messages():
            told = _differences(topic, read, robot or self._robot, tolerance)
            found += [
                one for one in told if one.joint.name == name and (one.is_rate or not moving_alone)
            ]
        _refuse(found, tolerance)

    def _messages(self) -> Iterator[tuple[str, Any, str]]:
        """Yield each joint that was heard of, the message, and its topic."""
        for name, (topic, message) in list(self._heard.items()):
            with suppress(InvalidInput):  # damaged
                yield name, deserialised(message, topic), topic.name


def positions_in(message: Any, robot: Robot) -> dict[str, float]:
    """Return the positions of locked joints in a JointState or a ChaserState [rad, m]."""
    name, kind, _ = _FIELDS[type(message)]
    names, values = getattr(message, name), getattr(message, kind)
    locked = {one.name for one in robot.locked_joints}
    told = zip(names, values, strict=False) if len(names) == len(values) else ()
    return {joint: float(at) for joint, at in told if joint in locked and math.isfinite(at)}


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
            off = float(value) if is_rate else _off(one, float(value))
            if not abs(off) <= tolerance:
                yield _Off(one, f"{source}.{kind}[{joint}]", float(value), bool(is_rate))


def _off(joint: LockedJoint, at: float) -> float:
    """Return how far a joint is from where it is locked, without whole turns if it has no end."""
    off = at - joint.position
    return (
        math.remainder(off, math.tau) if joint.type == "continuous" and math.isfinite(off) else off
    )


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
