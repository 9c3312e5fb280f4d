"""What the search has compiled for it against the same mathematics by numpy and Pinocchio."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import reference_clearance
from bodied_robots import random_robot
from core_rows import EACH, certified_by_core, resting_paths
from near_bodies import certified_clearance
from reference_objectives import chaser_euler, joint_path
from robots import random_state
from test_body_clearance import random_motion
from test_body_distances import spheres_around
from test_core import FREE, PLANAR, SLIDING, agree, chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning import distance
from ff_planner_ros.planning.check.check import failures, measure
from ff_planner_ros.planning.distance import body_motion, search_certificate
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.problem.problem import Obstacle, Parametrisation, PlanningProblem
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

SETTINGS = load_parameters().planner


@pytest.mark.law("PLAN-21")
@pytest.mark.parametrize("family", ["joint_spline", "end_effector_polynomial"])
def test_the_check_says_the_same_of_a_plan_with_the_core_taken_away(
    family: str, lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = replace(lemur_capture, parametrisation=Parametrisation(family))
    found = plan(problem, SETTINGS)

    def said_of(aside: float) -> tuple[Metrics, list[str]]:
        """What the check says of a motion that it has not seen before."""
        positions = found.trajectory.joint_positions + aside
        seen = replace(found, trajectory=replace(found.trajectory, joint_positions=positions))
        seen = replace(seen, metrics=measure(problem, seen.trajectory, SETTINGS))
        return seen.metrics, [failure.finding for failure in failures(problem, seen, SETTINGS)]

    def taken_away(*_: object, **__: object) -> None:
        raise AssertionError("the check asked the core")

    sound, spoilt = said_of(0.0), said_of(0.4)
    assert sound == (found.metrics, [])
    assert len(spoilt[1]) >= 3
    for name in [name for name in dir(compiled) if callable(getattr(compiled, name))]:
        monkeypatch.setattr(compiled, name, taken_away)
    with pytest.raises(AssertionError, match="asked the core"):
        plan(problem, SETTINGS)
    assert said_of(0.0) == sound
    assert said_of(0.4) == spoilt


def test_the_search_certifies_the_same_with_the_distances_of_the_check_taken_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither what is between two points nor how far bodies move there comes from the check."""
    robot, rng = random_robot(1), np.random.default_rng(1)
    motion = random_motion(robot, 1, points=12)
    (centers,), radii = spheres_around(robot, motion.q[:1], 4, rng)
    spheres = [
        Obstacle.sphere(str(k), *one) for k, one in enumerate(zip(centers, radii, strict=True))
    ]
    last, chosen = len(motion.time) - 1, np.arange(4 * len(robot.bodies))

    def certified() -> tuple[float, float]:
        pairs = np.arange(len(robot.pairs))
        return (
            search_certificate.search_distance(robot, motion, spheres, chosen, last, 0.0),
            search_certificate.search_pair_distance(robot, motion, pairs, last, 0.0),
        )

    def taken_away(*_: object, **__: object) -> None:
        raise AssertionError("the search asked the check")

    found = certified()
    for part in pkgutil.iter_modules(distance.__path__, f"{distance.__name__}."):
        module = importlib.import_module(part.name)
        if module is search_certificate:
            continue
        for name, value in vars(module).items():
            if inspect.isfunction(value):
                monkeypatch.setattr(module, name, taken_away)
    with pytest.raises(AssertionError, match="asked the check"):
        body_motion.body_ways(robot, motion)
    spheres = [replace(one) for one in spheres]  # nobody knows them yet
    assert certified() == found


@pytest.mark.parametrize("joints", [1, 3, 7, 14])
@pytest.mark.parametrize("moving", [0.0, 1.0])
@pytest.mark.parametrize(("slow", "smoothing"), [(0.0, 0.0), (0.01, 0.05), (0.3, 2.0)])
def test_the_joint_path_and_its_derivatives_are_those_of_numpy(
    joints: int, moving: float, slow: float, smoothing: float
) -> None:
    """Also of joints that stand still."""
    robot, rng = chain_robot(f"free{joints}"), np.random.default_rng(joints)
    x = moving * rng.normal(size=EACH * joints)
    asked = compiled.PathObjective(1.0, slow, smoothing, np.empty(0), 0.0, np.eye(3), 0.0)
    found, v, by_x, *_ = evaluated(robot, asked, x)
    value, gradient, hessian = joint_path(v, by_x, 0.2, slow, smoothing)
    assert found.value == pytest.approx(value, rel=1e-12)
    agree(found.gradient, gradient, "gradient")
    agree(found.hessian, hessian, "Hessian")
    np.testing.assert_array_equal(found.hessian, found.hessian.T)


@pytest.mark.parametrize("name", FREE + PLANAR)
def test_the_chaser_s_euler_angles_and_their_derivatives_are_those_of_numpy(name: str) -> None:
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    x, to_base = rng.normal(size=EACH * robot.joints), pin.exp3(rng.normal(size=3))
    asked = compiled.PathObjective(0.0, 0.0, 0.0, np.empty(0), 1.0, to_base, 0.0)
    found, _, _, q, by_x = evaluated(robot, asked, x)
    euler, of_euler = chaser_euler(q, by_x, to_base)
    agree(found.max_terms, np.append(euler, -euler), "angles")
    both = np.concatenate([of_euler, -of_euler]).reshape(-1, len(x))
    agree(found.max_terms_jacobian, both, "derivatives")


def evaluated(
    robot: Robot, objective: compiled.PathObjective, x: Array
) -> tuple[compiled.EvaluatedPath, Array, Array, Array, Array]:
    """Return what an objective says of a path, and v and q there with their derivatives."""
    seen = list[tuple[Array, Array, Array, Array]]()

    def look(motion: compiled.MotionOfPath) -> None:
        seen.append((motion.v, motion.v_by_x, motion.q, motion.q_by_x))

    paths = resting_paths(robot, 9, lasting=False)
    found = compiled.PathProgram(paths, 0.2, objective, [(0, look)]).at(x)
    return found, *seen[0]


@pytest.mark.parametrize("name", FREE + PLANAR + SLIDING)
def test_the_certificate_of_the_search_is_below_the_truth_by_its_gap_at_most(name: str) -> None:
    """Among spheres that rest and that move, near and far; the truth by many times."""
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    q_start, v = configuration(robot, random_state(robot, rng))
    times = np.cumsum(rng.uniform(0.1, 0.3, 12))
    q = np.array([pin.integrate(robot.model, q_start, t * v) for t in times])
    points = arm_points(robot, q).reshape(-1, 3)
    for away in (0.4, 3.0):
        places = rng.choice(points, 5) + away * rng.normal(size=(5, 3))
        spheres = [
            Obstacle.sphere(
                str(k), place, rng.uniform(0.05, 0.3), rng.normal(scale=0.1 * k, size=3)
            )
            for k, place in enumerate(places)
        ]
        hurried = v + rng.normal(scale=0.3, size=(12, len(v)))  # they turn round between points
        question = (robot, q, hurried, times, spheres)
        found = certified_by_core(*question, gap=1e-5)
        dense = reference_clearance.dense_clearance(*question, parts=1000)
        assert dense - 1e-4 <= found <= dense + 1e-9


@pytest.mark.parametrize("speed", [1e3, 1e7, 1e30])
def test_a_sphere_that_passes_by_far_away_does_not_hide_how_near_another_one_is(
    speed: float,
) -> None:
    """Looked at as closely as its speed asks for, the whole way would take for ever."""
    robot = chain_robot("free6")
    q = np.tile(configuration(robot, random_state(robot, np.random.default_rng(0)))[0], (12, 1))
    times, still = np.linspace(0.0, 12.0, 12), np.zeros((12, robot.model.nv))
    tip = arm_points(robot, q[:1])[0, -1]
    rock = Obstacle.sphere("rock", tip + np.array([0.0, 0.0, 30.0]), 0.2)
    begins = tip + np.array([-6.1 * speed, 90.0, 0.0])
    passing = Obstacle.sphere("debris", begins, 0.2, [speed, 0.0, 0.0])
    for certificate in (certified_clearance, certified_by_core):
        alone = certificate(robot, q, still, times, [rock])
        both = certificate(robot, q, still, times, [rock, passing])
        assert both == pytest.approx(alone, abs=1e-9)
