"""Inputs of a node without a middleware: a test says who publishes what, and what time it is."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any

from rclpy.serialization import serialize_message

from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.topics import Endpoint


class Waiting:
    """A subscription whose messages a test hands over."""

    def __init__(self) -> None:
        self.messages = list[tuple[bytes, dict[str, Any]]]()

    def take(self) -> list[tuple[bytes, dict[str, Any]]]:
        taken, self.messages = self.messages, []
        return taken


class FakeMiddleware(Middleware):
    """Topics that a test publishes on, by the names of nodes that it may change."""

    def __init__(self, clock: Callable[[], int], *names: str) -> None:
        self.clock, self.names, self.simulated = clock, list(names), False
        self.allows_several, self.why_unheard = False, list[str]()
        self.waiting: dict[str, Waiting] = {}
        self._numbers = defaultdict[str, Counter[str]](Counter)

    def subscribe(self, topic: Endpoint) -> Any:
        return self.waiting.setdefault(topic.name, Waiting())

    def say(self, topic: str, message: Any, by: str = "/one", came_ns: int | None = None) -> None:
        """Publish a message, or its bytes, which comes now unless `came_ns` says when."""
        self._numbers[topic][by] += 1
        cdr = message if isinstance(message, bytes) else serialize_message(message)
        info = {
            "received_timestamp": self.clock() if came_ns is None else came_ns,
            "publication_sequence_number": self._numbers[topic][by],
        }
        self.waiting[topic].messages.append((cdr, info))

    @property
    def now_ns(self) -> int:
        return self.clock()

    @property
    def time_is_simulated(self) -> bool:
        return self.simulated

    def heard(self, _: str) -> list[str]:
        return self.names

    def several(self, _: str) -> list[str]:
        return self.names if len(self.names) > 1 and not self.allows_several else []

    def unheard(self, _: str) -> list[str]:
        return self.why_unheard


class HeardScenes(SceneInput):
    """A scene input in the inertial frame, and what its topics say."""

    def __init__(self, clock: Callable[[], int] = time.time_ns, *names: str) -> None:
        self.middleware = FakeMiddleware(clock, *names)
        super().__init__("inertial", self.middleware)

    def hear(self, scene: Any) -> None:
        self.middleware.say("obstacles", scene)

    def hear_body(self, body: Any) -> None:
        self.middleware.say("target_body", body)


class HeardStates(StateInput):
    """A state input, and what its topics say."""

    def __init__(self, robot: Robot, parameters: NodeParameters, clock: Callable[[], int]) -> None:
        self.middleware = FakeMiddleware(clock)
        super().__init__(robot, parameters, self.middleware)
        self.hear = self.middleware.say
