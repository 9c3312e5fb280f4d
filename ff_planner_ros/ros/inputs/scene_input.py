"""The obstacles to plan around, from their topic or from a request."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ff_planner_msgs.msg import ObstacleSphereArray
from rclpy.serialization import deserialize_message

from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.ros.inputs.input_topics import OBSTACLES, header_stamp
from ff_planner_ros.ros.messages.from_messages import spheres_from_message, time_in_ns


@dataclass(frozen=True)
class Scene:
    """The obstacles, and where they come from."""

    spheres: tuple[Sphere, ...]
    stamp_ns: int  # when they were seen [ns]; zero: not known
    source: str  # of the message; may be empty


class SceneInput:
    """The newest obstacles received; may be used from several threads."""

    def __init__(self, inertial_frame: str, now_ns: Callable[[], int] = time.time_ns) -> None:
        """Start without messages; `now_ns` is read to find stamps that are ahead of it [ns]."""
        self._inertial_frame, self._now_ns = inertial_frame, now_ns
        self._lock = threading.Lock()
        # Not read here: thousands of spheres ten times a second would slow down the node.
        # Kept when the clock jumps back, too: a scene is often published only once.
        self._kept: ObstacleSphereArray | bytes | None = None
        self._stamp_ns = 0  # of what is kept
        self._read: tuple[ObstacleSphereArray | bytes, Scene] | None = None

    def callbacks(self) -> dict[str, Callable[[Any], None]]:
        """Return what takes the next message of a topic, by the topic's name."""
        return {OBSTACLES.name: self.keep}

    def keep(self, message: ObstacleSphereArray | bytes) -> None:
        """Take the next message, as it is or serialised: the newest counts, valid or not.

        A message with an older stamp than that of the scene comes late, and is left out. Without
        a stamp, or with one that is ahead of now, no message is older than another.
        """
        if isinstance(message, bytes):
            stamp_ns = header_stamp(message)
        else:
            stamp_ns = nanoseconds(message.header.stamp)
        with self._lock:
            if not 0 < stamp_ns < self._stamp_ns <= self._now_ns():
                self._kept, self._stamp_ns = message, stamp_ns

    def scene(self, own: ObstacleSphereArray | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else those of the topic.

        Raises:
            InvalidInput: There are none, or they cannot be used.
        """
        if own is not None:
            return self._scene(own)
        kept, read = self._kept, self._read
        if kept is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                "obstacles",
                "missing",
                "none were received yet; publish an empty array if the scene is free, "
                "or give the request its obstacles",
            )
        if read is not None and read[0] is kept:
            return read[1]
        serialised = isinstance(kept, bytes)
        scene = self._scene(deserialize_message(kept, ObstacleSphereArray) if serialised else kept)
        self._read = kept, scene
        return scene

    def _scene(self, message: ObstacleSphereArray) -> Scene:
        stamp_ns = time_in_ns("obstacles.header.stamp", message.header.stamp)
        spheres = spheres_from_message(message, self._inertial_frame)
        return Scene(spheres, stamp_ns, message.source)
