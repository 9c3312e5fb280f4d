"""Inputs of a node without a middleware: a test says who publishes, and what time it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.serialization import serialize_message

from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput


class NamedPublishers:
    """The publishers of every topic, by the names of their nodes, which a test may change."""

    def __init__(self, *names: str) -> None:
        self.names = list(names)
        self.why_unheard = list[str]()

    def heard(self, _: str) -> list[str]:
        return self.names

    def heard_by_id(self, _: str) -> dict[object, str]:
        return {
            (name, self.names[:place].count(name)): name for place, name in enumerate(self.names)
        }

    def unheard(self, _: str) -> list[str]:
        return self.why_unheard

    def are_several(self, _: str) -> bool:
        return len(self.names) > 1


class ScenesOfMessages(SceneInput):
    """A scene input that is handed messages, as a test writes them, or their bytes."""

    def keep(self, message: Any, number: int | None = None) -> None:
        super().keep(_in_bytes(message), number)

    def callbacks(self) -> dict[str, Callable[..., None]]:
        return super().callbacks() | {
            "target_body": _of_messages(super().callbacks()["target_body"])
        }


class StatesOfMessages(StateInput):
    """A state input that is handed messages, as a test writes them, or their bytes."""

    def callbacks(self) -> dict[str, Callable[..., None]]:
        return {name: _of_messages(keep) for name, keep in super().callbacks().items()}


def scene_input(now_ns: Callable[[], int] = time.time_ns) -> ScenesOfMessages:
    """A scene input that has heard nothing, in the inertial frame, and nobody publishes."""
    nobody: Any = NamedPublishers()
    return ScenesOfMessages("inertial", now_ns, nobody)


def state_input(
    robot: Robot, source: str, odometry: OdometryParameters, now_ns: Callable[[], int]
) -> StatesOfMessages:
    """A state input that has heard nothing, in the inertial frame, and nobody publishes."""
    nobody: Any = NamedPublishers()
    return StatesOfMessages(robot, "inertial", source, odometry, now_ns, nobody)


def _of_messages(keep: Callable[..., None]) -> Callable[..., None]:
    def keep_message(message: Any, number: int | None = None) -> None:
        keep(_in_bytes(message), number)

    return keep_message


def _in_bytes(message: Any) -> bytes:
    return message if isinstance(message, bytes) else serialize_message(message)
