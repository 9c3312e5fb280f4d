"""Scenes of the plans in a bag: from their requests, or from the messages received."""

from __future__ import annotations

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
    """Return the stamps in a decoded answer; answers of earlier versions have fewer."""
    names = ("obstacles_stamp", "target_body_stamp", "obstacle_bodies_stamp")
    times = (value_at(answer, f"inputs.{name}", None) for name in names)
    spheres_ns, body_ns, bodies_ns = (0 if time is None else nanoseconds(time) for time in times)
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
    # Answers of earlier versions lack it: the request gave the duration.
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


def received_scenes(bag: Bag) -> Received:
    """Return the obstacles and target bodies that were received.

    Raises:
        BagError: The disk fails.
    """
    obstacles: dict[str, dict[int, Obstacles | None]] = {_OBSTACLES: {}, _OBSTACLE_BODIES: {}}
    bodies: dict[int, TargetBody | None] = {}
    for message, scene in bag.decoded(_OBSTACLES, _OBSTACLE_BODIES, _TARGET_BODY):
        try:
            stamp_ns = nanoseconds(scene.header.stamp)
            if message.type_name == _TARGET_BODY:
                bodies[stamp_ns] = _body_in(scene)
            else:
                obstacles[message.type_name][stamp_ns] = obstacles_in(scene)
        except AttributeError as error:
            bag.note(f"what is around, on {message.topic}, cannot be understood: {error}")
    return Received(obstacles[_OBSTACLES], bodies, obstacles[_OBSTACLE_BODIES])


def obstacles_in(scene: Any) -> Obstacles | None:
    """Return the obstacles in a message, at its stamp; messages of earlier versions lack bodies."""
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
