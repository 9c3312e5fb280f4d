"""Obstacles and the target body, from their topics or from a request."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.obstacles import Obstacle, carried
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.ros.inputs.ages import OF_SCENES, OF_TARGETS
from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.inputs.topic import Topic
from ff_planner_ros.ros.messages.from_messages import (
    scene_from_message,
    target_body_from_message,
    time_in_ns,
)
from ff_planner_ros.ros.topics import OBSTACLES, TARGET_BODY

# A latched message arrives once its publisher is discovered, on a busy machine seconds after the
# node listens. So long [s] the first request waits; longer if a publisher is discovered already.
_DISCOVERY, _MATCHED = 5.0, 15.0
_OWN = "scene"  # field of a request


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

    def __init__(self, inertial_frame: str, middleware: Middleware) -> None:
        """Subscribe to the topics of obstacles and target body."""
        self._inertial_frame, self._middleware = inertial_frame, middleware
        self._begun = time.monotonic()
        self._obstacles = Topic(OBSTACLES, self._read_scene, middleware, OF_SCENES)
        self._target = Topic(TARGET_BODY, self._seen_body, middleware, OF_TARGETS)

    def may_come(self) -> bool:
        """Return whether a scene that was published before the node listened may still arrive."""
        if self._obstacles.take() is not None:
            return False
        listens = time.monotonic() - self._begun
        return listens < _DISCOVERY or (
            listens < _MATCHED and bool(self._middleware.heard(OBSTACLES.name))
        )

    def scene(self, own: SceneMessage | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else the topic's.

        Raises:
            InvalidInput: None were received (NO_OBSTACLES), or the message is invalid.
        """
        if own is not None:
            return self._read_scene(own, _OWN)
        heard = self._obstacles.take()
        if heard is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                OBSTACLES.name,
                "missing",
                "none were received yet; publish an empty scene if nothing is in the way, or give "
                f"the request its scene{self._middleware.unheard_words(OBSTACLES.name)}",
            )
        return self._obstacles.read(heard)

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
                far ahead; or the topic's last message was stamped ahead of its arrival, or before
                the one before; or the topic has several publishers.
        """
        newest = self._obstacles.newest(now_ns, max_lead) if own is None else None
        scene = self.scene(own) if newest is None else self._obstacles.read(newest)
        if not any(one.moves for one in scene.obstacles):
            return scene
        field = f"{OBSTACLES.name if own is None else _OWN}.header.stamp"
        if not scene.stamp_ns and own is None:
            allowed = "it must say when the obstacles that move were there"
            raise InvalidInput(Status.OUT_OF_RANGE, field, 0, allowed)
        stamp_ns = scene.stamp_ns or now_ns
        # Nothing moves uniformly for long: an old scene would be carried out of the way.
        limits = now_ns, max_age, max_lead
        OF_SCENES.require(field, stamp_ns, *limits, is_own=own is not None)
        return replace(scene, stamp_ns=stamp_ns)

    def target_body(
        self, own: TargetBodyMessage | None, now_ns: int, max_age: float, max_lead: float
    ) -> SeenBody:
        """Return the target body: the one that a request brings (`own`), or else the topic's.

        Without a stamp, `own` counts as seen now. Limits of the stamp are in seconds.

        Raises:
            InvalidInput: None was received (NO_TARGET_BODY), the message is invalid, its stamp is
                too old or too far ahead of its arrival or of now, or the topic has several
                publishers.
        """
        came_ns = None
        if own is not None:
            seen = self._seen_body(own, now_ns)
        else:
            heard = self._target.newest(now_ns, max_lead)
            if heard is None:
                raise InvalidInput(
                    Status.NO_TARGET_BODY,
                    TARGET_BODY.name,
                    "missing",
                    "none was received yet; publish it, or give the request its target_body"
                    f"{self._middleware.unheard_words(TARGET_BODY.name)}",
                )
            seen, came_ns = self._target.read(heard), heard.came_ns
        limits = now_ns, max_age, max_lead
        field, is_own = f"{TARGET_BODY.name}.header.stamp", own is not None
        OF_TARGETS.require(field, seen.stamp_ns, *limits, came_ns, is_own)
        return seen

    @property
    def target_clock_offset(self) -> float | None:
        """Stamp of the last target body minus its time of arrival [s]; None: not known."""
        return self._target.clock_offset

    def _read_scene(self, message: SceneMessage, field: str = OBSTACLES.name) -> Scene:
        """Read the scene of a topic or of a request's field."""
        stamp_ns = time_in_ns(f"{field}.header.stamp", message.header.stamp)
        obstacles = scene_from_message(message, field, self._inertial_frame)
        return Scene(obstacles, stamp_ns, _OWN if field == _OWN else message.source)

    def _seen_body(self, message: TargetBodyMessage, otherwise_ns: int = 0) -> SeenBody:
        stamp_ns = time_in_ns("target_body.header.stamp", message.header.stamp) or otherwise_ns
        body = target_body_from_message(message, self._inertial_frame)
        return SeenBody(body, stamp_ns, message.source)
