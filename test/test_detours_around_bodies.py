"""First guesses go round bodies of any shape, thin plates too, past the nearest outline first."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_solid
from robots import LEMUR_SCENARIO

from ff_planner_benchmark.problems import shapes
from ff_planner_ros.analysis.drawing.solids import surface_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.paths import detours
from ff_planner_ros.planning.paths.end_effector_polynomial import (
    EndEffectorPaths,
    end_effector_paths,
)
from ff_planner_ros.planning.paths.outlines import around_body
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem, RigidMotion
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid

POINTS, DAMPING = 13, 0.005
STRAIGHT = np.zeros(18)


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    return load_scenario(LEMUR_SCENARIO)


def end_effectors(family: EndEffectorPaths, x: Array) -> Array:
    """Where the end effector is along a path. Shape (points, 3) [m]."""
    positions, _ = family.polynomial.pose(x.reshape(6, 3), np.linspace(0.0, 1.0, 101))
    return positions


def walled(problem: PlanningProblem, up: float, **motion: Array) -> PlanningProblem:
    """With a plate of 5 mm across the straight path; it reaches so much further up than down."""
    way = end_effectors(end_effector_paths(problem), STRAIGHT)
    along = way[-1] - way[0]
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).normalized()
    across = turn.toRotationMatrix()[:, 0]
    solid = Solid("box", np.array([0.5, 0.4, 0.005]))
    place = way[50] + up * across
    plate = Obstacle("plate", solid, RigidMotion(place, turn.coeffs(), **motion))
    return replace(problem, obstacles=(plate,))


@pytest.mark.parametrize("up", [-0.15, 0.15])
def test_a_thin_plate_across_the_straight_path_is_passed_on_four_sides_the_nearest_first(
    problem: PlanningProblem, up: float
) -> None:
    asked = walled(problem, up)
    family = end_effector_paths(asked)
    guesses = [*islice(family.first_guesses(asked.obstacles, POINTS, DAMPING), 5)]
    np.testing.assert_array_equal(guesses[0], STRAIGHT)
    (plate,) = asked.obstacles
    place = pin.SE3(
        pin.Quaternion(plate.motion.quaternion_xyzw).toRotationMatrix(), plate.motion.position
    )
    crossed = []
    for x in guesses:
        seen = np.array([place.actInv(point) for point in end_effectors(family, x)])
        at = int(np.flatnonzero(np.diff(np.sign(seen[:, 2])))[0])
        crossed.append(seen[at, :2])
    # The straight path crosses the plate, the others pass beside each of its four edges.
    assert (np.abs(crossed[0]) < [0.25, 0.2]).all()
    assert all((np.abs(place) > [0.25, 0.2]).any() for place in crossed[1:])
    sides = {tuple(np.sign(np.trunc(place / [0.25, 0.2]))) for place in crossed[1:]}
    assert len(sides) == 4
    assert np.sign(crossed[1][0]) == -np.sign(up)


def test_without_a_body_in_the_way_there_is_nothing_to_pass(problem: PlanningProblem) -> None:
    family = end_effector_paths(problem)
    straight = family.motion(STRAIGHT, POINTS, DAMPING)
    (plate,) = walled(problem, 0.0).obstacles
    away = plate.with_motion(position=plate.motion.position + np.array([0.0, 3.0, 0.0]))
    assert around_body(problem.robot, straight, problem.duration, ()) is None
    assert around_body(problem.robot, straight, problem.duration, (away,)) is None
    assert around_body(problem.robot, straight, problem.duration, (away, plate)) is not None
    # One that has left when the arm comes.
    leaving = plate.with_motion(velocity=np.array([0.0, 0.6, 0.0]))
    assert around_body(problem.robot, straight, problem.duration, (leaving,)) is None


def test_what_comes_along_is_passed_as_it_sees_the_arm_come(problem: PlanningProblem) -> None:
    """A ball that drifts across the arm's way is passed across the way that it sees."""
    family = end_effector_paths(problem)
    straight = family.motion(STRAIGHT, POINTS, DAMPING)
    way = end_effectors(family, STRAIGHT)
    solid = Solid("capsule", np.array([0.1, 0.001]))
    velocity = np.array([0.0, -0.5, 0.0])
    at_rest = Obstacle("ball", solid, RigidMotion(way[50]))
    coming = Obstacle(
        "ball", solid, RigidMotion(way[50] - problem.duration / 2 * velocity, velocity=velocity)
    )
    along = {}
    for ball in (at_rest, coming):
        hit = around_body(problem.robot, straight, problem.duration, (ball,))
        assert hit is not None
        unit = [step / np.linalg.norm(step) for step in hit.ways]
        along[ball.moves] = max(abs(float(step @ [0.0, 1.0, 0.0])) for step in unit)
    assert along[False] > 0.8
    assert along[True] < 0.4


@pytest.mark.parametrize("number", [99, 106])
def test_detours_lead_to_a_plan_sooner(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    task = PlanningTask(shapes.problem(number).problem, load_parameters().planner)
    found = perform(task).solver
    with monkeypatch.context() as without:
        without.setattr(detours, "around_body", lambda *_: None)
        other = perform(task).solver
    assert found.starts < other.starts
    assert found.rollouts < other.rollouts


@pytest.mark.parametrize("kind", ["sphere", "box", "cylinder", "capsule", "cone", "mesh"])
def test_a_solid_reaches_as_far_as_its_surface_does(kind: str) -> None:
    rng = np.random.default_rng(len(kind))
    for _ in range(5):
        solid = random_solid(rng, kind)
        ways = rng.normal(size=(6, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        corners, _ = surface_of(solid.geometry, 200)
        np.testing.assert_allclose(solid.furthest(ways), (ways @ corners.T).max(axis=1), atol=2e-3)
