"""What is around: obstacles and the target body, from their topics or from a request."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from ff_planner_msgs.msg import ObstacleArray, ObstacleSphereArray
from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
from rclpy.serialization import deserialize_message

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Sphere, TargetBody
from ff_planner_ros.ros.inputs.clock_offset import ClockOffset
from ff_planner_ros.ros.inputs.input_topics import (
    OBSTACLE_BODIES,
    OBSTACLES,
    TARGET_BODY,
    InputTopic,
)
from ff_planner_ros.ros.inputs.topic_memory import (
    ROUNDING,
    HeardMessage,
    ahead_of_now,
    require_current,
    require_same_clock,
    stamp_of,
)
from ff_planner_ros.ros.messages.from_messages import (
    spheres_from_message,
    target_body_from_message,
    time_in_ns,
)

_OWN = "scene"  # field of a request
_OF_TARGETS = Status.TARGET_TOO_OLD, Status.TARGET_IN_FUTURE, "target_max_age"

Seen = TypeVar("Seen")


@dataclass(frozen=True)
class Scene:
    """The obstacles, and where they come from."""

    spheres: tuple[Sphere, ...]  # at the stamp
    stamp_ns: int  # when they were seen [ns]; zero: not known
    source: str  # of the message, or the request's field; may be empty
    bodies_stamp_ns: int = 0  # of the message of bodies; zero: none was received, or not known [ns]
    bodies_source: str = ""  # as it says


@dataclass(frozen=True, eq=False)
class SeenBody:
    """The target body, and where it comes from."""

    body: TargetBody  # at the stamp
    stamp_ns: int  # when it was seen [ns]
    source: str  # of the message; may be empty


class SceneInput:
    """The newest obstacles and the newest target body; may be used from several threads."""

    def __init__(self, inertial_frame: str, now_ns: Callable[[], int] | None = None) -> None:
        """Start without messages.

        Args:
            now_ns: The node's clock; None: when messages come is not known, as in a replay.
        """
        self._inertial_frame = inertial_frame
        self._obstacles = _Newest(OBSTACLES, self._spheres, now_ns)
        self._bodies = _Newest(OBSTACLE_BODIES, self._no_bodies, now_ns)
        self._target = _Newest(TARGET_BODY, self._seen_body, now_ns)

    def callbacks(self) -> dict[str, Callable[[Any], None]]:
        """Return what takes the next message of a topic, by the topic's name."""
        return {
            OBSTACLES.name: self.keep,
            OBSTACLE_BODIES.name: self._bodies.keep,
            TARGET_BODY.name: self._target.keep,
        }

    def keep(self, message: ObstacleSphereArray | bytes) -> None:
        """Take the next obstacles, as they are or serialised: the newest count, valid or not."""
        self._obstacles.keep(message)

    def scene(self, own: SceneMessage | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else those of the topics.

        Raises:
            InvalidInput: There are none, or they cannot be used.
        """
        if own is not None:
            return self._own_scene(own)
        scene = self._obstacles.read()
        if scene is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                "obstacles",
                "missing",
                "none were received yet; publish an empty array if the scene is free, "
                "or give the request its scene",
            )
        bodies = self._bodies.read()
        if bodies is None:
            return scene
        return replace(scene, bodies_stamp_ns=bodies[0], bodies_source=bodies[1])

    def moving_scene(self, own: SceneMessage | None, now_ns: int, max_lead: float) -> Scene:
        """Return what `scene` does; spheres that move have a stamp, not too far ahead of now.

        Raises:
            InvalidInput: As by `scene`, or they have not.
        """
        scene = self.scene(own)
        if not any(sphere.moves for sphere in scene.spheres):
            return scene
        field = f"{OBSTACLES.name if own is None else _OWN}.header.stamp"
        stamp_ns = scene.stamp_ns
        if not stamp_ns and own is not None:
            stamp_ns = now_ns
        if not stamp_ns:
            allowed = "it must say when the spheres that move were there"
            raise InvalidInput(Status.OUT_OF_RANGE, field, 0, allowed)
        if own is None:
            self._obstacles.require_same_clock(now_ns, max_lead)
        # However long ago: they move uniformly.
        require_current(field, stamp_ns, now_ns, math.inf, max_lead)
        return replace(scene, stamp_ns=stamp_ns)

    def target_body(
        self, own: TargetBodyMessage | None, now_ns: int, max_age: float, max_lead: float
    ) -> SeenBody:
        """Return the target body: that which a request brings (`own`), or else the topic's.

        Without a stamp, `own` is as if it had been seen now.

        Raises:
            InvalidInput: There is none, or it cannot be used, or its stamp is too old, or too far
                ahead of now.
        """
        seen = self._target.read() if own is None else self._seen_body(own, now_ns)
        if seen is None:
            raise InvalidInput(
                Status.NO_TARGET_BODY,
                TARGET_BODY.name,
                "missing",
                "none was received yet; publish it, or give the request its target_body",
            )
        field, came_ns = f"{TARGET_BODY.name}.header.stamp", None
        if own is None:
            self._target.require_same_clock(now_ns, max_lead, _OF_TARGETS[1])
            came_ns = self._target.came_ns
        require_current(field, seen.stamp_ns, now_ns, max_age, max_lead, _OF_TARGETS, came_ns)
        return seen

    def target_clock_offset(self, now_ns: int) -> float | None:
        """Return by how much the clock of target bodies' stamps is ahead of the node's [s].

        As measured over the last seconds; None: nothing came, or it is not known when.
        """
        return self._target.offset(now_ns)

    def _spheres(self, message: ObstacleSphereArray) -> Scene:
        stamp_ns = time_in_ns("obstacles.header.stamp", message.header.stamp)
        spheres = spheres_from_message(message, self._inertial_frame)
        return Scene(spheres, stamp_ns, message.source)

    def _own_scene(self, message: SceneMessage) -> Scene:
        stamp_ns = time_in_ns(f"{_OWN}.header.stamp", message.header.stamp)
        return Scene(spheres_from_message(message, self._inertial_frame, _OWN), stamp_ns, _OWN)

    def _no_bodies(self, message: ObstacleArray) -> tuple[int, str]:
        """Return stamp and source of a message without bodies.

        Raises:
            InvalidInput: It has some: left out of a plan, they would be hit.
        """
        name = OBSTACLE_BODIES.name
        if message.bodies:
            allowed = "it must be empty: this version plans around spheres alone"
            found = f"{len(message.bodies)} bodies"
            raise InvalidInput(Status.UNSUPPORTED, f"{name}.bodies", found, allowed)
        return time_in_ns(f"{name}.header.stamp", message.header.stamp), message.source

    def _seen_body(self, message: TargetBodyMessage, otherwise_ns: int = 0) -> SeenBody:
        stamp_ns = time_in_ns("target_body.header.stamp", message.header.stamp) or otherwise_ns
        body = target_body_from_message(message, self._inertial_frame)
        return SeenBody(body, stamp_ns, message.source)


class _Newest(Generic[Seen]):
    """The newest message of a topic, read when it is asked for.

    Not before: thousands of spheres ten times a second would slow down the node. It is kept when
    the clock jumps back, too: a scene is often published only once.
    """

    def __init__(
        self, topic: InputTopic, read: Callable[[Any], Seen], now_ns: Callable[[], int] | None
    ) -> None:
        self._type, self._read, self._now_ns = topic.message_type, read, now_ns
        self._field = f"{topic.name}.header.stamp"
        self._lock = threading.Lock()
        self._kept: HeardMessage[Seen] | None = None
        self._offset = ClockOffset()
        self._last_read: tuple[HeardMessage[Seen], Seen] | None = None

    @property
    def came_ns(self) -> int | None:
        """When what is kept came, by the node's clock [ns]; None: not known."""
        kept = self._kept
        return None if kept is None else kept.came_ns

    def keep(self, message: Any) -> None:
        """Take the next message, as it is or serialised: the newest counts, valid or not.

        A message with an older stamp than that of what is kept comes late, and is left out. Without
        a stamp, or with one that is ahead of now, no message is older than another.
        """
        came_ns = None if self._now_ns is None else self._now_ns()
        now_ns = time.time_ns() if came_ns is None else came_ns
        heard = HeardMessage[Seen](message, stamp_of(message), came_ns)
        stamp_ns = heard.stamp_ns or 0
        with self._lock:
            if came_ns is not None and stamp_ns:
                self._offset.note(stamp_ns - came_ns, came_ns)
            kept_ns = 0 if self._kept is None else self._kept.stamp_ns or 0
            if not 0 < stamp_ns < kept_ns <= now_ns:
                self._kept = heard

    def offset(self, now_ns: int) -> float | None:
        """Return by how much the publisher's clock is ahead [s]; None: nothing came lately."""
        with self._lock:
            return self._offset.at(now_ns)

    def require_same_clock(
        self, now_ns: int, max_lead: float, early: Status = Status.STATE_IN_FUTURE
    ) -> None:
        """Refuse what was stamped ahead of its time of arrival by more than max_lead [s].

        Raises:
            InvalidInput: What is kept was, or anything that came in the last seconds.
        """
        require_same_clock(early, self._field, self.offset(now_ns), max_lead)
        kept = self._kept
        if kept is not None and kept.lead > max_lead + ROUNDING:
            raise ahead_of_now(early, self._field, kept.lead, max_lead)

    def read(self) -> Seen | None:
        """Return what the newest message holds; None: there is none.

        Raises:
            InvalidInput: It cannot be used.
        """
        kept, read = self._kept, self._last_read
        if kept is None:
            return None
        if read is not None and read[0] is kept:
            return read[1]
        message = kept.message
        if isinstance(message, bytes):
            message = deserialize_message(message, self._type)
        seen = self._read(message)
        self._last_read = kept, seen
        return seen
