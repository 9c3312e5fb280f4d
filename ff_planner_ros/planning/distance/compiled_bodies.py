"""A robot's bodies as the compiled core has them; the check never asks here."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ff_planner_ros.core import compiled
from ff_planner_ros.planning.distance.bodies import Kind, carriers, kinds_and_sizes, radii
from ff_planner_ros.robot.model import Robot


@lru_cache(maxsize=8)
def compiled_bodies(robot: Robot) -> compiled.Bodies:
    """Return the robot's bodies and pairs for the core."""
    kinds, sizes = kinds_and_sizes(robot)
    vertices = [
        np.asarray(body.solid.points()) if kind == Kind.HULL else np.empty((0, 3))
        for body, kind in zip(robot.bodies, kinds, strict=True)
    ]
    return compiled.Bodies(
        carriers=carriers(robot),
        rotations=np.array([body.placement_in_joint.rotation for body in robot.bodies]),
        positions=np.array([body.placement_in_joint.translation for body in robot.bodies]),
        centers=np.array([body.center_in_joint for body in robot.bodies]),
        radii=radii(robot),
        kinds=kinds,
        sizes=sizes,
        vertices=np.concatenate(vertices),
        vertex_counts=np.array([len(points) for points in vertices]),
        pairs=np.array(robot.pairs, np.intp).reshape(-1, 2),
    )
