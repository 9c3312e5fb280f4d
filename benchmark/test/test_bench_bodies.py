"""The laws of the problems with bodies, checked by Pinocchio's own model of geometry."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import pinocchio_geometry

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.problems import bodies
from ff_planner_ros.problems.bodies import ROBOTS
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.problems.paths import roll_out
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.momentum import smallest_singular_values

FINE = 250
STRAIGHT = np.zeros((6, 3))


@pytest.fixture(
    scope="module",
    params=[
        *((robot, 0) for robot in ROBOTS),
        *(pytest.param((robot, 1), marks=pytest.mark.nightly) for robot in ROBOTS),
    ],
    ids=lambda drawn: f"{drawn[0]}-{drawn[1]}",
)
def drawn(request: pytest.FixtureRequest) -> Drawn[Array]:
    return bodies.problem(*request.param)


def least_distances(problem: PlanningProblem, way: Array) -> tuple[float, float]:
    """Of bodies from each other, and from the spheres, along a way."""
    robot, spheres = problem.robot, problem.obstacles
    model = pinocchio_geometry(robot, spheres)
    data, geometry = robot.model.createData(), model.createData()
    own = outer = np.inf
    for q in way:
        pin.updateGeometryPlacements(robot.model, data, model, geometry, q)
        pin.computeDistances(model, geometry)
        found = [result.min_distance for result in geometry.distanceResults]
        own = min(own, *found[: len(robot.pairs)])
        outer = min(outer, *found[len(robot.pairs) :])
    return own, outer


def test_the_robots_have_bodies_panels_and_all() -> None:
    for name in ROBOTS:
        robot = bodies.problem(name, 0).problem.robot
        assert robot.geometry is Geometry.SHAPES
        assert sum(body.joint == 1 for body in robot.bodies) >= 3, name
        assert robot.joints + 1 in {body.joint for body in robot.bodies}, name  # a tool
        assert len(robot.pairs) >= 15, name


def test_the_witness_stays_clear_of_itself_and_of_the_spheres(drawn: Drawn[Array]) -> None:
    own, outer = least_distances(drawn.problem, roll_out(drawn.problem, drawn.witness, FINE).q)
    assert own >= 0.01
    assert outer >= 0.02
    assert 3 <= len(drawn.problem.obstacles) <= 6


def test_the_straight_path_touches_something(drawn: Drawn[Array]) -> None:
    assert min(least_distances(drawn.problem, roll_out(drawn.problem, STRAIGHT, FINE).q)) < 1e-4


def test_the_witness_keeps_the_limits_and_leads_to_the_target(drawn: Drawn[Array]) -> None:
    problem, robot = drawn.problem, drawn.problem.robot
    motion = roll_out(problem, drawn.witness, FINE)
    joints, rates = motion.q[:, 7:], np.abs(motion.v[:, 6:])
    assert (joints >= robot.lower_position_limits - 1e-6).all()
    assert (joints <= robot.upper_position_limits + 1e-6).all()
    assert (rates <= 1.001 * robot.velocity_limits).all()
    assert smallest_singular_values(robot, motion.q).min() > 0.99 * 0.05
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, motion.q[-1])
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    np.testing.assert_allclose(tip.translation, problem.target.position, atol=1e-5)


def test_the_same_problem_is_drawn_again_and_another_number_is_another() -> None:
    def numbers(number: int) -> Array:
        bodies.problem.cache_clear()
        found = bodies.problem("arm6", number)
        return np.concatenate([found.problem.start.joint_positions, found.witness.ravel()])

    np.testing.assert_array_equal(numbers(0), numbers(0))
    assert not np.array_equal(numbers(0), numbers(3))
