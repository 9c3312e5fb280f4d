"""The compiled core against the same mathematics by numpy and Pinocchio."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import reference_clearance
import reference_end_effector as reference
from core_rows import distances_of_core, sensitivity_of
from reference_velocity_map import VelocityMap, stacked
from robots import coupled_urdf, random_path, random_state, random_urdf

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures, measure
from ff_planner_ros.planning.distance.clearance import arm_points, arm_points_with_derivatives
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.start_motion import NullSpaceFade
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.problems.robots import planar_urdf
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum

# Outputs and derivatives agree to this part of their largest entry, or of 1 where that is greater.
EXACT = 1e-10
DURATION = 5.0

FREE = [f"free{joints}" for joints in range(1, 15)]
PLANAR = [f"planar{joints}" for joints in (1, 2, 3, 7, 14)]
SLIDING = [f"sliding{joints}" for joints in (1, 2, 4, 7, 14)]
# Of those that slide [rad/m].
WEIGHT = 1.7


def chain_robot(name: str) -> Robot:
    """`free3` and `planar3` have three joints; of `sliding7` the joints 1, 4 and 7 slide."""
    joints = int(re.sub(r"\D", "", name))
    if name.startswith("coupled"):
        return robot_from_urdf_text(coupled_urdf(joints, joints), "bus", "tool")
    if name.startswith("planar"):
        return robot_from_urdf_text(planar_urdf(joints), "chaser", "end_effector", Base.PLANAR)
    sliding = range(1, joints + 1, 3) if name.startswith("sliding") else ()
    urdf = random_urdf(joints, joints, sliding)
    return robot_from_urdf_text(urdf, "bus", "tool", slide_weight=WEIGHT)


def agree(found: Array, expected: Array, what: str) -> None:
    assert found.shape == expected.shape, what
    largest = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=EXACT * largest, err_msg=what)


@pytest.mark.parametrize("name", FREE + PLANAR + SLIDING)
@pytest.mark.parametrize("still", [True, False], ids=["at rest", "drifting"])
def test_the_velocity_map_and_its_derivatives_are_those_of_pinocchio(
    name: str, still: bool
) -> None:
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    # An arm of fewer than six joints has no regular J_D: it needs damping.
    damping = 0.0 if robot.joints >= 6 and robot.base is Base.FREE_FLYER else 0.3
    velocity_map = VelocityMap(robot, damping)
    for number in range(4):
        q, _ = configuration(robot, random_state(robot, rng))
        momentum = np.zeros(6) if still else rng.normal(scale=40.0, size=6)
        twist, bias = rng.normal(scale=0.2, size=6), rng.normal(scale=0.2, size=robot.joints)
        solution = velocity_map.solve(q, momentum, twist, bias)
        found = compiled.velocity(chain_of(robot), q, momentum, twist, bias, damping)
        if np.linalg.norm(solution.v[6:]) >= 10.0:
            assert found is None
            continue
        assert found is not None
        at = stacked([solution])
        by_q, by_twist = velocity_map.derivatives(at)
        expected = (solution.v, by_q[0], by_twist[0])
        for what, one, other in zip(("v", "dq", "dtwist"), found, expected, strict=True):
            agree(one, other, f"{what} of {name}, question {number}")


@pytest.mark.parametrize("name", FREE + SLIDING)
@pytest.mark.parametrize("drawn", ["at rest", "drifting", "with null-space motion"])
def test_motions_of_the_end_effector_and_their_derivatives_are_those_of_pinocchio(
    name: str, drawn: str
) -> None:
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    state = random_state(robot, rng)
    polynomial = random_path(robot, state, rng, DURATION, reach=0.1)
    q, v = configuration(robot, state)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    momentum *= 0.0 if drawn == "at rest" else 1.0
    fade = NullSpaceFade(*rng.normal(scale=0.1, size=(2, robot.joints)), seconds=0.6 * DURATION)
    paths = EndEffectorPaths(
        robot, q, momentum, polynomial, fade if drawn == "with null-space motion" else None
    )
    x, damping = rng.normal(scale=0.05, size=18), 0.3
    found, expected = paths.motion(x, 9, damping), reference.motion(paths, x, 9, damping)
    if isinstance(expected, float):
        assert found.singular_at == pytest.approx(expected, abs=1e-12)
        return
    by_x = reference.sensitivity(paths, expected, damping)
    in_core = sensitivity_of(paths, found, damping)
    for what in ("q", "v", "q_half_way"):
        agree(getattr(found, what), getattr(expected, what), what)
        agree(getattr(in_core, what), getattr(by_x, what), f"d {what} / dx")
    agree(in_core.acceleration, by_x.acceleration, "dv/dt")


@pytest.mark.parametrize("name", FREE + PLANAR + SLIDING)
def test_distances_of_lines_and_their_derivatives_are_those_of_numpy(name: str) -> None:
    """Among many spheres far away, of which the broad phase must not lose one that is near."""
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    q_start, v = configuration(robot, random_state(robot, rng))
    q = np.array([pin.integrate(robot.model, q_start, t * v) for t in np.arange(8.0)])
    times = np.sort(rng.uniform(0.0, DURATION, 8))
    points = arm_points(robot, q).reshape(-1, 3)
    places = rng.choice(points, 60) + rng.choice([0.5, 5.0], (60, 1)) * rng.normal(size=(60, 3))
    motions = rng.choice([0.0, 0.1], (60, 1)) * rng.normal(size=(60, 3))
    spheres = [
        Obstacle.sphere(str(k), place, rng.uniform(0.05, 0.5), moving)
        for k, (place, moving) in enumerate(zip(places, motions, strict=True))
    ]
    for few in ([], spheres):
        found = distances_of_core(robot, q, times, few, 0.5)
        order = np.argsort(found.names)
        expected = reference_clearance.clearance_rows(robot, found.q, found.q_by_x, times, few, 0.5)
        np.testing.assert_array_equal(found.names[order], expected[2])
        agree(found.values[order], expected[0], "distance")
        agree(found.jacobian[order], expected[1], "d distance / dx")
    assert 0 < len(found.names) < robot.joints * len(times) * len(spheres)


@pytest.mark.parametrize("name", FREE + PLANAR + SLIDING)
def test_arm_points_and_their_derivatives_are_those_of_numpy(name: str) -> None:
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    q = np.array([configuration(robot, random_state(robot, rng))[0] for _ in range(5)])
    question = robot, q, rng.normal(size=(5, 6 + robot.joints, int(rng.integers(1, 30))))
    found = arm_points_with_derivatives(*question)
    expected = reference_clearance.arm_points_with_derivatives(*question)
    for what, one, other in zip(("points", "derivatives"), found, expected, strict=True):
        agree(one, other, what)


@pytest.mark.law("PLAN-21")
def test_the_check_of_a_plan_uses_nothing_of_the_core(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the check calls the core")

    for name in [name for name in vars(compiled) if name[0].islower()]:
        monkeypatch.setattr(compiled, name, refuse)
    settings = load_parameters().planner
    measured = replace(lemur_plan, trajectory=replace(lemur_plan.trajectory))
    metrics = measure(lemur_capture, measured.trajectory, settings)
    assert metrics == lemur_plan.metrics
    assert list(failures(lemur_capture, measured, settings)) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"q": np.zeros(12)}, r"q has the shape (12, ), not (13, )"),
        ({"q": np.full(13, np.nan)}, "q is not finite"),
        ({"momentum": np.zeros((6, 1))}, r"momentum has the shape (6, 1, ), not (6, )"),
        ({"twist_ee_in_inertial": np.array([0.0, 0.0, np.inf, 0.0, 0.0, 0.0])}, "twist"),
        ({"bias": np.zeros(5)}, "bias has the shape"),
        ({"damping": np.nan}, "damping is not finite"),
    ],
)
def test_wrong_sizes_and_nan_are_refused_by_name(change: dict[str, Array], said: str) -> None:
    robot = chain_robot("free6")
    arguments = {
        "q": np.append(np.zeros(6), [1.0, *np.zeros(6)]),
        "momentum": np.zeros(6),
        "twist_ee_in_inertial": np.zeros(6),
        "bias": np.zeros(6),
        "damping": 0.1,
    }
    assert compiled.velocity(chain_of(robot), **arguments) is not None
    with pytest.raises(ValueError, match=re.escape(said)):
        compiled.velocity(chain_of(robot), **(arguments | change))


def test_a_chain_without_joints_or_with_too_many_is_refused() -> None:
    for joints in (0, 65):
        bodies = joints + 1
        with pytest.raises(ValueError, match=f"1 to 64 joints, not {joints}"):
            compiled.Chain(
                np.zeros((bodies, 3)),
                np.zeros((bodies, 3, 3)),
                np.zeros((joints, 3)),
                np.zeros((joints, 3)),
                np.ones(joints),
                np.ones(bodies),
                np.zeros((bodies, 3)),
                np.zeros((bodies, 3, 3)),
                list(range(joints)),
                list(range(joints)),
                np.ones(joints),
                np.zeros(joints),
                joints,
            )


def test_an_arm_with_too_many_joints_is_refused_by_its_robot() -> None:
    with pytest.raises(InvalidInput, match="an arm of 65 joints: an arm has 64 joints at most"):
        chain_of(chain_robot("planar65"))
