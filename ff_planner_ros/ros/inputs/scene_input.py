"""Obstacles and the target body, from their topics or from a request."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.obstacles import Obstacle, carried
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.ros.inputs.contradictions import of_bodies, of_obstacles
from ff_planner_ros.ros.inputs.input_topics import OBSTACLES, TARGET_BODY
from ff_planner_ros.ros.inputs.newest_message import NewestMessage
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.topic_memory import require_current, unheard_words
from ff_planner_ros.ros.messages.from_messages import (
    scene_from_message,
    target_body_from_message,
    time_in_ns,
)

# A latched message arrives once its publisher is discovered, on a busy machine seconds after the
# node listens. So long [s] the first request waits; longer if a publisher is discovered already.
_DISCOVERY, _MATCHED = 5.0, 15.0
_OWN = "scene"  # field of a request
_OF_SCENES = Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "obstacles_max_age"
_OF_TARGETS = Status.TARGET_TOO_OLD, Status.TARGET_IN_FUTURE, "target_max_age"


@dataclass(frozen=True)
class Scene:
    """Obstacles, with stamp and source of their message."""

    obstacles: tuple[Obstacle, ...]  # at the stamp
    stamp_ns: int  # zero: not known [ns]
    source: str  # as the message of the topic says, or the request's field; may be empty

    def obstacles_at(self, time_ns: int) -> tuple[Obstacle, ...]:
        """Return the obstacles, moved to where they will be at a time [ns]."""
        return carried(self.obstacles, (time_ns - self.stamp_ns) / NANOSECONDS)


@dataclass(frozen=True, eq=False)
class SeenBody:
    """The target body, with stamp and source of its message."""

    body: TargetBody  # at the stamp
    stamp_ns: int  # when it was seen [ns]
    source: str  # of the message; may be empty


class SceneInput:
    """The newest obstacles and the newest target body; may be used from several threads."""

    def __init__(
        self,
        inertial_frame: str,
        now_ns: Callable[[], int],
        publishers: Publishers,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Begin without messages.

        Args:
            now_ns: The node's clock [ns].
            tell: Called with each warning for the log.
        """
        self._inertial_frame, self._publishers, self._tell = inertial_frame, publishers, tell
        self._begun = time.monotonic()
        known = now_ns, publishers
        self._obstacles = NewestMessage(OBSTACLES, self._read_scene, _scenes_apart, *known)
        self._target = NewestMessage(TARGET_BODY, self._seen_body, _targets_apart, *known)

    def callbacks(self) -> dict[str, Callable[..., None]]:
        """Return each topic's callback, which takes a message's bytes and its sequence number."""
        return {OBSTACLES.name: self.keep, TARGET_BODY.name: self._target.keep}

    def keep(self, message: bytes, number: int | None) -> None:
        """Keep a message of the topic `obstacles`, as `NewestMessage.keep` does."""
        before = self._obstacles.late
        self._obstacles.keep(message, number)
        late = self._obstacles.late
        if late is not None and before is None:
            self._tell(f"left out: {late}")

    def may_come(self) -> bool:
        """Return whether a scene that was published before the node listened may still arrive."""
        if self._obstacles.is_known:
            return False
        listens = time.monotonic() - self._begun
        return listens < _DISCOVERY or (
            listens < _MATCHED and bool(self._publishers.heard(OBSTACLES.name))
        )

    def scene(self, own: SceneMessage | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else the topic's.

        Raises:
            InvalidInput: None were received (NO_OBSTACLES), or the message is invalid.
        """
        scene = self._obstacles.read() if own is None else self._read_scene(own, _OWN)
        if scene is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                OBSTACLES.name,
                "missing",
                "none were received yet; publish an empty scene if nothing is in the way, "
                f"or give the request its scene{unheard_words(OBSTACLES.name, self._publishers)}",
            )
        return scene

    def moving_scene(
        self,
        own: SceneMessage | None,
        now_ns: int,
        max_lead: float,
        max_age: float = math.inf,
    ) -> Scene:
        """Return the obstacles as `scene` does, after a check of the stamp if any of them moves.

        Args:
            own: Scene of the request; without a stamp, its moving obstacles count as seen now.
            now_ns: Current time by the node's clock [ns].
            max_lead: How far stamps of the topic and of moving obstacles may be ahead of now [s].
            max_age: How old the stamp of moving obstacles may be [s].

        Raises:
            InvalidInput: As by `scene`; or the stamp of moving obstacles is missing, too old or too
                far ahead; or the topic's messages come out of order, or its publishers contradict.
        """
        scene = self.scene(own)
        if own is None:
            self._obstacles.require_same_clock(now_ns, max_lead)
            self._obstacles.require_agreement(now_ns)
            self._obstacles.require_in_order()
        if not any(one.moves for one in scene.obstacles):
            return scene
        field = f"{OBSTACLES.name if own is None else _OWN}.header.stamp"
        if not scene.stamp_ns and own is None:
            allowed = "it must say when the obstacles that move were there"
            raise InvalidInput(Status.OUT_OF_RANGE, field, 0, allowed)
        stamp_ns = scene.stamp_ns or now_ns
        # Nothing moves uniformly for long: an old scene would be carried out of the way.
        limits = now_ns, max_age, max_lead
        require_current(field, stamp_ns, *limits, _OF_SCENES, is_own=own is not None)
        return replace(scene, stamp_ns=stamp_ns)

    def target_body(
        self, own: TargetBodyMessage | None, now_ns: int, max_age: float, max_lead: float
    ) -> SeenBody:
        """Return the target body: the one that a request brings (`own`), or else the topic's.

        Without a stamp, `own` counts as seen now. Limits of the stamp are in seconds.

        Raises:
            InvalidInput: None was received (NO_TARGET_BODY), the message is invalid, its stamp is
                too old or too far ahead of now, or the topic's publishers contradict each other.
        """
        seen = self._target.read() if own is None else self._seen_body(own, now_ns)
        if seen is None:
            raise InvalidInput(
                Status.NO_TARGET_BODY,
                TARGET_BODY.name,
                "missing",
                "none was received yet; publish it, or give the request its target_body"
                f"{unheard_words(TARGET_BODY.name, self._publishers)}",
            )
        field, came_ns = f"{TARGET_BODY.name}.header.stamp", None
        if own is None:
            self._target.require_same_clock(now_ns, max_lead, _OF_TARGETS[1])
            self._target.require_agreement(now_ns, until_old=True)
            came_ns = self._target.came_ns
        limits = now_ns, max_age, max_lead
        require_current(field, seen.stamp_ns, *limits, _OF_TARGETS, came_ns, own is not None)
        return seen

    def target_clock_offset(self, now_ns: int) -> float | None:
        """Return how far the clock of the target body's publisher is ahead of the node's [s].

        As measured over the last seconds; None: no message.
        """
        return self._target.offset(now_ns)

    def _read_scene(self, message: SceneMessage, field: str = OBSTACLES.name) -> Scene:
        """Read the scene of a topic or of a request's field."""
        stamp_ns = time_in_ns(f"{field}.header.stamp", message.header.stamp)
        obstacles = scene_from_message(message, field, self._inertial_frame)
        return Scene(obstacles, stamp_ns, _OWN if field == _OWN else message.source)

    def _seen_body(self, message: TargetBodyMessage, otherwise_ns: int = 0) -> SeenBody:
        stamp_ns = time_in_ns("target_body.header.stamp", message.header.stamp) or otherwise_ns
        body = target_body_from_message(message, self._inertial_frame)
        return SeenBody(body, stamp_ns, message.source)


def _scenes_apart(before: Scene, after: Scene, time: float) -> str:
    return of_obstacles(before.obstacles, after.obstacles, time)


def _targets_apart(before: SeenBody, after: SeenBody, time: float) -> str:
    return of_bodies(before.body, after.body, time)
