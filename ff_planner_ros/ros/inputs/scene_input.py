"""What is around: obstacles and the target body, from their topics or from a request."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from ff_planner_msgs.msg import ObstacleArray, ObstacleSphereArray
from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Sphere, TargetBody
from ff_planner_ros.ros.inputs.contradictions import of_bodies, of_spheres
from ff_planner_ros.ros.inputs.input_topics import (
    OBSTACLE_BODIES,
    OBSTACLES,
    TARGET_BODY,
)
from ff_planner_ros.ros.inputs.newest_message import NewestMessage
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.speakers import require_agreement
from ff_planner_ros.ros.inputs.topic_memory import (
    HeardMessage,
    came_lately,
    require_current,
    seconds_between,
    unheard_words,
)
from ff_planner_ros.ros.messages.from_messages import (
    spheres_from_message,
    target_body_from_message,
    time_in_ns,
)

# What is latched comes as soon as its publisher is discovered: on a busy machine seconds after the
# node listens. So long [s] the first request waits; longer where a publisher is there already.
_DISCOVERY, _MATCHED = 5.0, 15.0
_OWN = "scene"  # field of a request
_OF_SCENES = Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "obstacles_max_age"
_OF_TARGETS = Status.TARGET_TOO_OLD, Status.TARGET_IN_FUTURE, "target_max_age"


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

    def __init__(
        self,
        inertial_frame: str,
        now_ns: Callable[[], int] | None = None,
        publishers: Publishers | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Start without messages.

        Args:
            now_ns: The node's clock; None: when messages come is not known, as in a replay.
            publishers: None: not known, likewise.
            tell: Takes a warning for the log.
        """
        self._inertial_frame, self._publishers, self._tell = inertial_frame, publishers, tell
        self._begun = time.monotonic()
        self._obstacles = NewestMessage(OBSTACLES, self._spheres, now_ns)
        self._bodies = NewestMessage(OBSTACLE_BODIES, self._no_bodies, now_ns)
        self._target = NewestMessage(TARGET_BODY, self._seen_body, now_ns)

    def callbacks(self) -> dict[str, Callable[..., None]]:
        """Return what takes the next message of a topic, and its number, by the topic's name."""
        return {
            OBSTACLES.name: self.keep,
            OBSTACLE_BODIES.name: self._bodies.keep,
            TARGET_BODY.name: self._target.keep,
        }

    def keep(self, message: ObstacleSphereArray | bytes, number: int | None = None) -> None:
        """Take the next obstacles, as they are or serialised: the newest count, valid or not."""
        before = self._obstacles.late
        self._obstacles.keep(message, number)
        late = self._obstacles.late
        if late is not None and before is None:
            self._tell(f"left out: {late}")

    def may_come(self) -> bool:
        """Whether obstacles that were published before the node listened may be on their way."""
        if self._publishers is None or self._obstacles.is_known:
            return False
        listens = time.monotonic() - self._begun
        is_matched = listens < _MATCHED and bool(self._publishers.heard(OBSTACLES.name))
        return is_matched or listens < _DISCOVERY

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
                f"or give the request its scene{unheard_words(OBSTACLES.name, self._publishers)}",
            )
        bodies = self._bodies.read()
        if bodies is None:
            return scene
        return replace(scene, bodies_stamp_ns=bodies[0], bodies_source=bodies[1])

    def moving_scene(
        self,
        own: SceneMessage | None,
        now_ns: int,
        max_lead: float,
        max_age: float = math.inf,
    ) -> Scene:
        """Return what `scene` does; spheres that move have a stamp that is near enough to now.

        Args:
            max_lead: Of any stamp of the topic, and of spheres that move [s].
            max_age: Of spheres that move [s].

        Raises:
            InvalidInput: As by `scene`, or they have not; what was heard last was stamped ahead of
                now or before what was heard before, or publishers contradict each other.
        """
        scene = self.scene(own)
        if own is None:
            self._require_sound(now_ns, max_lead)
        if not any(sphere.moves for sphere in scene.spheres):
            return scene
        field = f"{OBSTACLES.name if own is None else _OWN}.header.stamp"
        stamp_ns = scene.stamp_ns
        if not stamp_ns and own is not None:
            stamp_ns = now_ns
        if not stamp_ns:
            allowed = "it must say when the spheres that move were there"
            raise InvalidInput(Status.OUT_OF_RANGE, field, 0, allowed)
        # Nothing moves uniformly for long: an old scene would be carried out of the way.
        require_current(field, stamp_ns, now_ns, max_age, max_lead, _OF_SCENES)
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
                "none was received yet; publish it, or give the request its target_body"
                f"{unheard_words(TARGET_BODY.name, self._publishers)}",
            )
        field, came_ns = f"{TARGET_BODY.name}.header.stamp", None
        if own is None:
            self._target.require_same_clock(now_ns, max_lead, _OF_TARGETS[1])
            two = self._target.last_two()
            if two is not None and all(came_lately(one, now_ns) for one in two):
                require_agreement(
                    TARGET_BODY.name, self._publishers, two, self._bodies_apart, lately=True
                )
            came_ns = self._target.came_ns
        require_current(field, seen.stamp_ns, now_ns, max_age, max_lead, _OF_TARGETS, came_ns)
        return seen

    def target_clock_offset(self, now_ns: int) -> float | None:
        """Return by how much the clock of target bodies' stamps is ahead of the node's [s].

        As measured over the last seconds; None: nothing came, or it is not known when.
        """
        return self._target.offset(now_ns)

    def _require_sound(self, now_ns: int, max_lead: float) -> None:
        """Refuse obstacles of topics that came in another order or with another clock."""
        self._obstacles.require_same_clock(now_ns, max_lead)
        two = self._obstacles.last_two()
        lately = two is not None and all(came_lately(one, now_ns) for one in two)
        require_agreement(OBSTACLES.name, self._publishers, two, self._scenes_apart, lately=lately)
        self._obstacles.require_in_order()

    def _scenes_apart(self, before: HeardMessage[Scene], after: HeardMessage[Scene]) -> str:
        spheres = [self._obstacles.sound(one) for one in (before, after)]
        if spheres[0] is None or spheres[1] is None:
            return ""
        time = seconds_between(before, after)
        return of_spheres(spheres[0].spheres, spheres[1].spheres, time)

    def _bodies_apart(self, before: HeardMessage[SeenBody], after: HeardMessage[SeenBody]) -> str:
        bodies = [self._target.sound(one) for one in (before, after)]
        if bodies[0] is None or bodies[1] is None:
            return ""
        return of_bodies(bodies[0].body, bodies[1].body, seconds_between(before, after))

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
