"""What the plans of a bag were made among: of their requests, or as it was received."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.problem import CONTACT_DISTANCE, Sphere
from ff_planner_ros.planning.scene import Scene

_OBSTACLES = "ff_planner_msgs/msg/ObstacleSphereArray"

# Obstacles are at rest in every bag; None: what a message holds cannot be read as such.
Spheres = tuple[Sphere, ...] | None


def asked_scene(request: Any) -> tuple[Scene, bool]:
    """Return the scene of a request, and whether the request brings the obstacles itself."""
    brings = bool(getattr(request, "use_obstacles", False))
    spheres = spheres_in(getattr(request, "obstacles", None)) if brings else None
    allowed: Sequence[str] = getattr(request, "allowed_at_goal", ())
    scene = Scene(
        obstacles=spheres or (),
        allowed_at_goal=tuple(map(str, allowed)),
        contact_distance=getattr(request, "contact_distance", 0.0) or CONTACT_DISTANCE,
        target=_target(request),
    )
    return scene, spheres is not None


def with_received(
    asked: tuple[Scene, bool] | None, stamp_ns: int, received: dict[int, Spheres]
) -> Scene | None:
    """Return a plan's scene; None: its obstacles are not known.

    Args:
        asked: Of `asked_scene`; None: the bag lacks the request.
        stamp_ns: Of the obstacles that the plan was made for [ns].
        received: Of `received_obstacles`.
    """
    scene, complete = asked or (Scene(), False)
    if complete:
        return scene
    spheres = received.get(stamp_ns)
    return None if spheres is None else replace(scene, obstacles=spheres)


def received_obstacles(bag: Bag) -> dict[int, Spheres]:
    """Return the obstacles that were received, by their stamp [ns].

    Raises:
        BagError: The disk fails.
    """
    received: dict[int, Spheres] = {}
    for message, scene in bag.decoded(_OBSTACLES):
        try:
            received[nanoseconds(scene.header.stamp)] = spheres_in(scene)
        except AttributeError as error:
            bag.note(f"obstacles on {message.topic} cannot be understood: {error}")
    return received


def spheres_in(scene: Any) -> Spheres:
    """Return the obstacles in a message."""
    try:
        return tuple(Sphere(one.id, _vector(one.center), one.radius) for one in scene.spheres)
    except (AttributeError, InvalidInput):
        return None


def _target(request: Any) -> Array | None:
    try:
        return _vector(request.target_pose.pose.position)
    except AttributeError:
        return None


def _vector(point: Any) -> Array:
    return np.array([point.x, point.y, point.z])
