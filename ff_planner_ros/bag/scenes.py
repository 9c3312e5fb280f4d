"""What the plans of a bag were made among: of their requests, or as it was received."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.declared_messages import value_at, values_in
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.messages.target_bodies import target_body_in
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.problem import (
    PlanningProblem,
    Sphere,
    TargetBody,
    carried,
    with_attached,
)
from ff_planner_ros.planning.problem.scene import OF_PROBLEM, Scene

_OBSTACLES = "ff_planner_msgs/msg/ObstacleSphereArray"
_TARGET_BODY = "ff_planner_msgs/msg/TargetBody"

Spheres = tuple[Sphere, ...]

# What the bag does not hold, or what cannot be read, is None.


@dataclass(frozen=True, eq=False)
class AskedScene:
    """What a request says of the scene of its plan."""

    scene: Scene  # without obstacles and target body
    obstacles: Spheres | None  # its own, at their stamp
    captures: bool  # whether the target is a body
    body: TargetBody | None  # its own, at its stamp


@dataclass(frozen=True)
class Stamps:
    """The times of a plan, as its response says; zero: not known."""

    obstacles_ns: int  # when they were seen [ns]
    target_body_ns: int  # when it was seen [ns]
    duration: float = 0.0  # to the capture [s]


@dataclass(frozen=True, eq=False)
class Received:
    """Obstacles and target bodies that were received, by their stamps [ns]."""

    obstacles: Mapping[int, Spheres | None]
    bodies: Mapping[int, TargetBody | None]


def asked_scene(request: Any) -> AskedScene:
    """Return what a request says of the scene."""
    captures = value_at(request, "goal.kind", GoalKind.POSE) == GoalKind.CAPTURE
    goal = () if captures else ("target",)
    names = (*OF_PROBLEM, *goal)
    scene, body = (value_at(request, f"{part}[0]", None) for part in ("scene", "target_body"))
    told = {name: _told(request, name) for name in names}
    return AskedScene(
        scene=Scene(
            **{name: value for name, value in told.items() if value is not None},
            capture_time=value_at(request, "duration", None),
        ),
        obstacles=None if scene is None else spheres_in(scene),
        captures=captures,
        body=None if body is None or not captures else _body_in(body),
    )


def _told(request: Any, name: str) -> Any:
    """Return a field of the problem that a request asks for; None: it has none, or a wrong one."""
    try:
        return values_in(PlanningProblem, request, names=(name,)).get(name)
    except (AttributeError, InvalidInput):
        return None


def stamps_of(answer: Any) -> Stamps:
    """Return the times in an answer; those of earlier versions tell fewer."""
    names = ("obstacles_stamp", "target_body_stamp")
    times = (value_at(answer, f"inputs.{name}", None) for name in names)
    obstacles_ns, body_ns = (0 if time is None else nanoseconds(time) for time in times)
    return Stamps(obstacles_ns, body_ns, value_at(answer, "plans[0].duration", 0.0))


def scene_at_start(
    asked: AskedScene | None, stamps: Stamps, start_ns: int, received: Received
) -> Scene | None:
    """Return a plan's scene at its first point; None: the bag does not tell all of it.

    Args:
        asked: None: the bag lacks the request.
        start_ns: Of the plan [ns].
    """
    told = asked or AskedScene(Scene(), None, captures=False, body=None)
    spheres = told.obstacles
    if spheres is None:
        spheres = received.obstacles.get(stamps.obstacles_ns)
    if spheres is None:
        return None
    spheres = carried(spheres, (start_ns - stamps.obstacles_ns) / NANOSECONDS)
    # Answers of earlier versions do not tell: their duration was given.
    captured = stamps.duration or told.scene.capture_time
    if not told.captures:
        return replace(told.scene, obstacles=spheres, capture_time=captured)
    body = told.body or received.bodies.get(stamps.target_body_ns)
    if body is None:
        return None
    try:
        body = body.after((start_ns - stamps.target_body_ns) / NANOSECONDS)
        obstacles = with_attached(spheres, body)
    except InvalidInput:
        return None
    return replace(told.scene, obstacles=obstacles, target_body=body, capture_time=captured)


def received_scenes(bag: Bag) -> Received:
    """Return the obstacles and target bodies that were received.

    Raises:
        BagError: The disk fails.
    """
    obstacles: dict[int, Spheres | None] = {}
    bodies: dict[int, TargetBody | None] = {}
    for message, scene in bag.decoded(_OBSTACLES, _TARGET_BODY):
        try:
            stamp_ns = nanoseconds(scene.header.stamp)
            if message.type_name == _OBSTACLES:
                obstacles[stamp_ns] = spheres_in(scene)
            else:
                bodies[stamp_ns] = _body_in(scene)
        except AttributeError as error:
            bag.note(f"what is around, on {message.topic}, cannot be understood: {error}")
    return Received(obstacles, bodies)


def spheres_in(scene: Any) -> Spheres | None:
    """Return the obstacles in a message, at its stamp."""
    try:
        return tuple(Sphere(**values_in(Sphere, one)) for one in scene.spheres)
    except (AttributeError, InvalidInput):
        return None


def _body_in(message: Any) -> TargetBody | None:
    try:
        return target_body_in(message)
    except (AttributeError, InvalidInput):
        return None
