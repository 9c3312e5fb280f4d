"""Problems with bodies of every kind of shape in the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, with_capture_target
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices

# Of each kind but the sphere, which is an obstacle of its own.
SOLIDS = {
    "box": Solid("box", np.array([0.3, 0.4, 0.005])),
    "cylinder": Solid("cylinder", np.array([0.1, 0.7])),
    "capsule": Solid("capsule", np.array([0.05, 0.3])),
    "cone": Solid("cone", np.array([0.2, 0.3])),
    "mesh": hull_of_vertices(
        "wedge",
        np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1], [0.05, 0.04, 0.02]], float),
    ),
}
FAR = np.array([30.0, -20.0, 10.0])  # where nothing is met


def bodies(rng: np.random.Generator) -> Iterator[Obstacle]:
    """Yield a body of each kind, far away: one rests, and the others move and turn."""
    for number, (kind, solid) in enumerate(SOLIDS.items()):
        yield Obstacle(
            kind,
            solid,
            RigidMotion(
                FAR + rng.normal(size=3),
                Rotation.random(random_state=number).as_quat(),
                rng.normal(scale=0.1, size=3) if number else np.zeros(3),
                rng.normal(scale=0.1, size=3) if number > 1 else np.zeros(3),
            ),
        )


def among_bodies(problem: PlanningProblem, seed: int = 0) -> PlanningProblem:
    """Return a problem with a body of each kind among its obstacles."""
    rng = np.random.default_rng(seed)
    ball = Obstacle.sphere("ball", FAR, 0.3, np.array([0.0, 0.02, 0.0]))
    # As a file may have them: spheres stand behind bodies.
    return replace(problem, obstacles=(*bodies(rng), ball, *problem.obstacles))


def among_cubes(problem: PlanningProblem) -> PlanningProblem:
    """Return a problem whose spheres are cubes of their volume."""
    edge = (4 * np.pi / 3) ** (1 / 3)
    cubes = [
        Obstacle(one.id, Solid("box", np.full(3, edge * one.radius)), RigidMotion(one.center))
        for one in problem.obstacles
        if one.is_sphere
    ]
    return replace(
        problem, obstacles=(*cubes, *(one for one in problem.obstacles if not one.is_sphere))
    )


def with_fixed_bodies(body: TargetBody, away: float = 0.0) -> TargetBody:
    """Return a target body with a body of each kind fixed to it, so far away along x [m]."""
    fixed = tuple(
        AttachedObstacle(
            f"fixed_{kind}",
            solid,
            np.array([away, 0.1 * number, -0.2]),
            Rotation.random(random_state=number).as_quat(),
        )
        for number, (kind, solid) in enumerate(SOLIDS.items())
    )
    return replace(body, obstacles=(*fixed, *body.obstacles))


def capture_among_bodies(problem: PlanningProblem, seed: int = 0) -> PlanningProblem:
    """Return a capture with bodies in the way, and fixed to the target body."""
    assert problem.target_body is not None
    body = with_fixed_bodies(problem.target_body, 25.0)
    return with_capture_target(body, among_bodies(problem, seed))
