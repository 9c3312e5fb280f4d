"""The obstacles to plan around, from their topic or from a request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ff_planner_msgs.msg import ObstacleSphereArray

from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.ros.inputs.input_topics import OBSTACLES
from ff_planner_ros.ros.messages.from_messages import spheres_from_message


@dataclass(frozen=True)
class Scene:
    """The obstacles, and where they come from."""

    spheres: tuple[Sphere, ...]
    stamp_ns: int  # when they were seen [ns]; zero: not known
    source: str  # of the message; may be empty


class SceneInput:
    """The last obstacles received."""

    def __init__(self, inertial_frame: str) -> None:
        """Start without messages."""
        self._inertial_frame = inertial_frame
        # Not checked here: thousands of spheres ten times a second would slow down the node.
        # Kept when the clock jumps back, too: a scene is often published only once.
        self._message: ObstacleSphereArray | None = None

    def callbacks(self) -> dict[str, Callable[[Any], None]]:
        """Return what takes the next message of a topic, by the topic's name."""
        return {OBSTACLES.name: self.keep}

    def keep(self, message: ObstacleSphereArray) -> None:
        """Take the next message: it replaces the one before, valid or not."""
        self._message = message

    def scene(self, own: ObstacleSphereArray | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else those of the topic.

        Raises:
            InvalidInput: There are none, or they cannot be used.
        """
        message = self._message if own is None else own
        if message is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                "obstacles",
                "missing",
                "none were received yet; publish an empty array if the scene is free, "
                "or give the request its obstacles",
            )
        spheres = spheres_from_message(message, self._inertial_frame)
        return Scene(spheres, nanoseconds(message.header.stamp), message.source)
