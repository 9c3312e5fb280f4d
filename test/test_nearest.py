"""The place that drawings mark: nothing else comes nearer, and the line goes from skin to skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import pinocchio_geometry
from drawn_plans import drawn_plan

from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot

ARM = bench_robot("arm6", Geometry.SHAPES)


def by_pinocchio(robot: Robot, motion: Trajectory, spheres: tuple[Obstacle, ...]) -> float:
    """The least distance of all pairs at all points, by Pinocchio's own model of geometry."""
    model, count = pinocchio_geometry(robot, spheres), len(robot.bodies)
    data, geometry, least = robot.model.createData(), model.createData(), np.inf
    for time, q in zip(motion.time, from_trajectory(robot, motion)[0], strict=True):
        for k, sphere in enumerate(spheres):
            center = sphere.center + (time - motion.time[0]) * sphere.motion.velocity
            model.geometryObjects[count + k].placement = pin.SE3(np.eye(3), center)
        pin.updateGeometryPlacements(robot.model, data, model, geometry, q)
        pin.computeDistances(model, geometry)
        least = min(least, *(result.min_distance for result in geometry.distanceResults))
    return float(least)


def spheres_beside(motion: Trajectory, rng: np.random.Generator) -> tuple[Obstacle, ...]:
    ways: Array = motion.ee_positions[::8]
    return tuple(
        Obstacle.sphere(f"s{k}", at + 0.4 * rng.normal(size=3), 0.1, 0.02 * rng.normal(size=3))
        for k, at in enumerate(ways)
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("obstacles", [True, False], ids=("obstacles", "no obstacles"))
def test_nothing_is_nearer(seed: int, obstacles: bool) -> None:
    motion = drawn_plan(ARM, seed=seed).trajectory
    spheres = spheres_beside(motion, np.random.default_rng(seed)) if obstacles else ()
    found = nearest(ARM, motion, spheres)
    assert found is not None
    assert found.distance == pytest.approx(by_pinocchio(ARM, motion, spheres), abs=1e-6)
    between = np.linalg.norm(found.ends[1] - found.ends[0])
    assert between == pytest.approx(abs(found.distance), abs=1e-5)
    assert found.pair in found.words
    body, _, other = found.pair.partition("/")
    pair = "/".join(name.partition("#")[0] for name in (body, other))
    left = nearest(ARM, motion, spheres, [pair])
    assert left is not None
    assert left.pair != found.pair
    assert left.distance > found.distance
    assert f"{found.time:.2f} s" in found.words


def test_a_robot_of_lines_has_no_such_place() -> None:
    arm = bench_robot("arm6")
    assert nearest(arm, drawn_plan(arm, seed=1).trajectory, ()) is None


def test_a_robot_whose_bodies_may_all_touch_has_none_without_obstacles() -> None:
    motion = drawn_plan(ARM, seed=1).trajectory
    assert nearest(replace(ARM, pairs=()), motion, ()) is None
