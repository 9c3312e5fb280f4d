"""Obstacles and the target body, from their topics or from a request."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from ff_planner_msgs.msg import ObstacleArray, ObstacleSphereArray
from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.obstacles import (
    Obstacle,
    Sphere,
    bodies_in,
    carried,
    spheres_in,
)
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.ros.inputs.contradictions import of_bodies, of_obstacles
from ff_planner_ros.ros.inputs.input_topics import (
    OBSTACLE_BODIES,
    OBSTACLES,
    TARGET_BODY,
)
from ff_planner_ros.ros.inputs.newest_message import NewestMessage
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.topic_memory import require_current, unheard_words
from ff_planner_ros.ros.messages.from_messages import (
    bodies_from_message,
    scene_from_message,
    spheres_from_message,
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
    """Obstacles, with stamps and sources of their messages."""

    spheres: tuple[Sphere, ...]  # at the stamp
    stamp_ns: int  # of the spheres, or of a request's scene [ns]; zero: not known
    source: str  # as the message of the spheres says, or the request's field; may be empty
    bodies: tuple[Obstacle, ...] = ()  # at their stamp, or else that of the spheres
    bodies_stamp_ns: int = 0  # of the message of bodies; zero: none was received, or not known [ns]
    bodies_source: str = ""  # as the message of bodies says

    def obstacles_at(self, time_ns: int) -> tuple[Obstacle, ...]:
        """Return spheres and bodies, moved to where they will be at a time [ns]."""
        bodies_ns = self.bodies_stamp_ns or self.stamp_ns
        return (
            *carried(self.spheres, (time_ns - self.stamp_ns) / NANOSECONDS),
            *carried(self.bodies, (time_ns - bodies_ns) / NANOSECONDS),
        )


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
        now_ns: Callable[[], int] | None = None,
        publishers: Publishers | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Begin without messages.

        Args:
            now_ns: The node's clock [ns]; None: times of arrival are unknown, as in a replay.
            publishers: None: unknown, as in a replay.
            tell: Called with each warning for the log.
        """
        self._inertial_frame, self._publishers, self._tell = inertial_frame, publishers, tell
        self._begun = time.monotonic()
        known = now_ns, publishers
        self._obstacles = NewestMessage(OBSTACLES, self._spheres, _scenes_apart, *known)
        self._bodies = NewestMessage(OBSTACLE_BODIES, self._bodies_in, _scenes_apart, *known)
        self._target = NewestMessage(TARGET_BODY, self._seen_body, _targets_apart, *known)

    def callbacks(self) -> dict[str, Callable[..., None]]:
        """Return each topic's callback, which takes a message and its sequence number."""
        return {
            OBSTACLES.name: self.keep,
            OBSTACLE_BODIES.name: partial(self._keep, self._bodies),
            TARGET_BODY.name: self._target.keep,
        }

    def keep(self, message: ObstacleSphereArray | bytes, number: int | None = None) -> None:
        """Keep a message of the topic `obstacles`, as `NewestMessage.keep` does."""
        self._keep(self._obstacles, message, number)

    def _keep(self, topic: NewestMessage[Any], message: Any, number: int | None = None) -> None:
        before = topic.late
        topic.keep(message, number)
        late = topic.late
        if late is not None and before is None:
            self._tell(f"left out: {late}")

    def may_come(self) -> bool:
        """Return whether what was published before the node subscribed may still arrive.

        Bodies are optional: only a publisher that is discovered already is waited for.
        """
        if self._publishers is None:
            return False
        listens = time.monotonic() - self._begun
        if not self._obstacles.is_known and listens < _DISCOVERY:
            return True
        return listens < _MATCHED and any(
            not topic.is_known and self._publishers.heard(name)
            for name, topic in (
                (OBSTACLES.name, self._obstacles),
                (OBSTACLE_BODIES.name, self._bodies),
            )
        )

    def scene(self, own: SceneMessage | None = None) -> Scene:
        """Return the obstacles: those that a request brings (`own`), or else those of the topics.

        Raises:
            InvalidInput: None were received (NO_OBSTACLES), or a message is invalid.
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
                f"or give the request its scene{unheard_words(OBSTACLES.name, self._publishers)}",
            )
        bodies = self._bodies.read()
        if bodies is None:
            return scene
        names = {one.id for one in scene.spheres}
        for index, one in enumerate(bodies.bodies):
            if one.id in names:
                field, allowed = (
                    f"{OBSTACLE_BODIES.name}.bodies[{index}].id",
                    "a sphere has it, too",
                )
                raise InvalidInput(Status.OUT_OF_RANGE, field, repr(one.id), allowed)
        return replace(
            scene,
            bodies=bodies.bodies,
            bodies_stamp_ns=bodies.stamp_ns,
            bodies_source=bodies.source,
        )

    def moving_scene(
        self,
        own: SceneMessage | None,
        now_ns: int,
        max_lead: float,
        max_age: float = math.inf,
    ) -> Scene:
        """Return the obstacles as `scene` does, after a check of the stamps of those that move.

        Args:
            own: Scene of the request; without a stamp, its moving obstacles count as seen now.
            now_ns: Current time by the node's clock [ns].
            max_lead: How far stamps of topics and of moving obstacles may be ahead of now [s].
            max_age: How old stamps of moving obstacles may be [s].

        Raises:
            InvalidInput: As by `scene`; or a moving obstacle's stamp is missing, too old or too far
                ahead; or a topic's messages come out of order, or its publishers contradict.
        """
        scene = self.scene(own)
        if own is None:
            self._require_sound(now_ns, max_lead)
        limits = now_ns, max_age, max_lead
        if own is not None:
            if any(one.moves for one in (*scene.spheres, *scene.bodies)):
                stamp_ns = scene.stamp_ns or now_ns
                require_current(f"{_OWN}.header.stamp", stamp_ns, *limits, _OF_SCENES, is_own=True)
                return replace(scene, stamp_ns=stamp_ns)
            return scene
        for name, kind, obstacles, stamp_ns in (
            (OBSTACLES.name, "spheres", scene.spheres, scene.stamp_ns),
            (OBSTACLE_BODIES.name, "bodies", scene.bodies, scene.bodies_stamp_ns),
        ):
            if any(one.moves for one in obstacles):
                field = f"{name}.header.stamp"
                if not stamp_ns:
                    allowed = f"it must say when the {kind} that move were there"
                    raise InvalidInput(Status.OUT_OF_RANGE, field, 0, allowed)
                # Nothing moves uniformly for long: an old scene would be carried out of the way.
                require_current(field, stamp_ns, *limits, _OF_SCENES)
        return scene

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

        As measured over the last seconds; None: no message, or times of arrival are unknown.
        """
        return self._target.offset(now_ns)

    def _require_sound(self, now_ns: int, max_lead: float) -> None:
        """Refuse topics with another clock, contradicting publishers or messages out of order."""
        for topic in (self._obstacles, self._bodies):
            topic.require_same_clock(now_ns, max_lead)
            topic.require_agreement(now_ns)
            topic.require_in_order()

    def _spheres(self, message: ObstacleSphereArray) -> Scene:
        stamp_ns = time_in_ns(f"{OBSTACLES.name}.header.stamp", message.header.stamp)
        spheres = spheres_from_message(message, self._inertial_frame)
        return Scene(spheres, stamp_ns, message.source)

    def _bodies_in(self, message: ObstacleArray) -> Scene:
        """Return a scene of bodies alone, with their stamp and source."""
        stamp_ns = time_in_ns(f"{OBSTACLE_BODIES.name}.header.stamp", message.header.stamp)
        bodies = bodies_from_message(message, self._inertial_frame)
        return Scene((), stamp_ns, message.source, bodies)

    def _own_scene(self, message: SceneMessage) -> Scene:
        stamp_ns = time_in_ns(f"{_OWN}.header.stamp", message.header.stamp)
        found = scene_from_message(message, self._inertial_frame)
        return Scene(spheres_in(found), stamp_ns, _OWN, bodies_in(found))

    def _seen_body(self, message: TargetBodyMessage, otherwise_ns: int = 0) -> SeenBody:
        stamp_ns = time_in_ns("target_body.header.stamp", message.header.stamp) or otherwise_ns
        body = target_body_from_message(message, self._inertial_frame)
        return SeenBody(body, stamp_ns, message.source)


def _scenes_apart(before: Scene, after: Scene, time: float) -> str:
    there, here = ((*one.spheres, *one.bodies) for one in (before, after))
    return of_obstacles(there, here, time)


def _targets_apart(before: SeenBody, after: SeenBody, time: float) -> str:
    return of_bodies(before.body, after.body, time)
