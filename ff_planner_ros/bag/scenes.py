"""Scenes of the plans in a bag: from their requests, or from the messages received."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.declared_messages import value_at, values_in
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.messages.obstacles import bodies_of
from ff_planner_ros.messages.target_bodies import captures, target_body_in
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    Sphere,
    TargetBody,
    carried,
    with_attached,
)
from ff_planner_ros.planning.problem.scene import OF_PROBLEM, Scene

_OBSTACLES = "ff_planner_msgs/msg/ObstacleSphereArray"
_OBSTACLE_BODIES = "ff_planner_msgs/msg/ObstacleArray"
_TARGET_BODY = "ff_planner_msgs/msg/TargetBody"
# The planner's topic of each type
_NAMES = {
    _OBSTACLES: "obstacles",
    _TARGET_BODY: "target_body",
    _OBSTACLE_BODIES: "obstacle_bodies",
}

Obstacles = tuple[Obstacle, ...]

# None stands for what the bag lacks, or what cannot be read.


@dataclass(frozen=True, eq=False)
class AskedScene:
    """The scene of a plan, as far as it is in the request."""

    scene: Scene  # without obstacles and target body
    obstacles: Obstacles | None  # that the request brings, at their stamp
    captures: bool  # whether a phase captures a target body
    body: TargetBody | None  # that the request brings, at its stamp


@dataclass(frozen=True)
class Stamps:
    """Stamps of a plan's inputs, and its duration, as in the answer; zero: not known."""

    obstacles_ns: int  # of the spheres, or of all obstacles that the request brings [ns]
    target_body_ns: int  # of the target body [ns]
    duration: float = 0.0  # to the capture [s]
    bodies_ns: int = 0  # of the obstacle bodies [ns]


@dataclass(frozen=True, eq=False)
class Received:
    """Obstacles and target bodies that were received, by their stamps [ns]."""

    obstacles: Mapping[int, Obstacles | None]  # spheres
    bodies: Mapping[int, TargetBody | None]
    obstacle_bodies: Mapping[int, Obstacles | None] = field(default_factory=dict)


def asked_scene(request: Any) -> AskedScene:
    """Return the scene in a decoded request, or in one of its later phases."""
    has_place = value_at(request, "goal.kind", GoalKind.POSE) == GoalKind.POSE
    goal = ("target",) if has_place else ()
    names = (*OF_PROBLEM, *goal)
    scene, body = (value_at(request, f"{part}[0]", None) for part in ("scene", "target_body"))
    told = {name: _told(request, name) for name in names}
    return AskedScene(
        scene=Scene(
            **{name: value for name, value in told.items() if value is not None},
            capture_time=value_at(request, "duration", None),
        ),
        obstacles=None if scene is None else obstacles_in(scene),
        captures=captures(request),
        body=None if body is None or not captures(request) else _body_in(body),
    )


def _told(request: Any, name: str) -> Any:
    """Return a field of the problem in a request; None: it is missing or invalid."""
    try:
        return values_in(PlanningProblem, request, names=(name,)).get(name)
    except (AttributeError, InvalidInput):
        return None


def stamps_of(answer: Any) -> Stamps:
    """Return the stamps in a decoded answer."""
    names = ("obstacles_stamp", "target_body_stamp", "obstacle_bodies_stamp")
    spheres_ns, body_ns, bodies_ns = (nanoseconds(value_at(answer.inputs, name)) for name in names)
    return Stamps(spheres_ns, body_ns, value_at(answer, "plans[0].duration", 0.0), bodies_ns)


def scene_at_start(
    asked: AskedScene | None, stamps: Stamps, start_ns: int, received: Received
) -> Scene | None:
    """Return a plan's scene at its first point; None: the bag does not have all of it.

    The body that a later phase captures is part of it: `phases_of` takes it out of the phases
    before.

    Args:
        asked: Scene in the request; None: the bag lacks the request.
        stamps: Stamps in the answer.
        start_ns: Time of the plan's first point [ns].
    """
    told = asked or AskedScene(Scene(), None, captures=False, body=None)
    found = told.obstacles
    if found is None:
        found = received.obstacles.get(stamps.obstacles_ns)
    if found is None:
        return None
    found = carried(found, (start_ns - stamps.obstacles_ns) / NANOSECONDS)
    if told.obstacles is None:
        # Without a stamp there may have been none.
        bodies = received.obstacle_bodies.get(stamps.bodies_ns, None if stamps.bodies_ns else ())
        if bodies is None:
            return None
        found += carried(bodies, (start_ns - stamps.bodies_ns) / NANOSECONDS)
    captured = stamps.duration or told.scene.capture_time
    if not told.captures:
        return replace(told.scene, obstacles=found, capture_time=captured)
    body = told.body or received.bodies.get(stamps.target_body_ns)
    if body is None:
        return None
    try:
        body = body.after((start_ns - stamps.target_body_ns) / NANOSECONDS)
        obstacles = with_attached(found, body)
    except InvalidInput:
        return None
    return replace(told.scene, obstacles=obstacles, target_body=body, capture_time=captured)


class ReceivedScenes:
    """The obstacles and target bodies in a bag."""

    def __init__(self, bag: Bag) -> None:
        """Read them.

        Raises:
            BagError: The disk fails.
        """
        # By type and stamp, in the order of recording: topic, log time, content
        self._found: dict[tuple[str, int], list[tuple[str, int, Any]]] = defaultdict(list)
        self._topics = {(one.type_name, name) for name, one in bag.topics.items()}
        for message, scene in bag.decoded(*_NAMES):
            try:
                read = _body_in if message.type_name == _TARGET_BODY else obstacles_in
                at = message.type_name, nanoseconds(scene.header.stamp)
                self._found[at].append((message.topic, message.log_time_ns, read(scene)))
            except AttributeError as error:
                bag.note(f"what is around, on {message.topic}, cannot be understood: {error}")

    def at(self, stamps: Stamps, namespace: str, asked_ns: int) -> Received:
        """Return what a planner had of these stamps when it was asked.

        Args:
            namespace: Namespace of the planner, without a trailing slash.
            asked_ns: When the request was recorded [ns].
        """
        of_type = {
            _OBSTACLES: stamps.obstacles_ns,
            _TARGET_BODY: stamps.target_body_ns,
            _OBSTACLE_BODIES: stamps.bodies_ns,
        }
        kept = {
            kind: {stamp_ns: same[-1]}
            for kind, stamp_ns in of_type.items()
            if (same := self._of(kind, stamp_ns, namespace, asked_ns))
        }
        return Received(*(kept.get(kind, {}) for kind in of_type))

    def _of(self, kind: str, stamp_ns: int, namespace: str, asked_ns: int) -> list[Any]:
        """Return messages of a stamp up to the request, or else the first one after it."""
        own = f"{namespace}/{_NAMES[kind]}"
        is_named = (kind, own) in self._topics
        same = [
            (log_ns, content)
            for topic, log_ns, content in self._found.get((kind, stamp_ns), ())
            if topic == own or not is_named
        ]
        before = [content for log_ns, content in same if log_ns <= asked_ns]
        # A recorder may hear a message a little later than the node; without a stamp there may have
        # been no bodies.
        late = [] if kind == _OBSTACLE_BODIES and not stamp_ns else [one for _, one in same[:1]]
        return before or late


def obstacles_in(scene: Any) -> Obstacles | None:
    """Return the obstacles in a message, at its stamp; None: they are invalid."""
    try:
        return (
            *(Sphere(**values_in(Sphere, one)) for one in value_at(scene, "spheres", ())),
            *bodies_of(scene, "scene"),
        )
    except (AttributeError, InvalidInput):
        return None


def _body_in(message: Any) -> TargetBody | None:
    try:
        return target_body_in(message)
    except (AttributeError, InvalidInput):
        return None
