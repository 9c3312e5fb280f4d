"""The optimisation problem: every derivative against differences, every row against the motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from reference_program import rows_of
from robots import ROBOTS, random_path, random_state
from scipy.interpolate import CubicHermiteSpline
from test_core import chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Obstacle,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.requirements import REQUIREMENTS
from ff_planner_ros.planning.requirements.limits.loads import Torques
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.rotation import euler_from_rotation

# Between fewer points there are rows at quarters, too: of parabolas, whose derivatives are theirs.
POINTS, DURATION, MARGIN = 41, 5.0, 0.01
# A state of each robot from which this motion stays away from singularities.
SEEDS = {"six joints": 8, "lemur": 2, "nine joints": 7, "canadarm2": 3, "sliding": 27}


class Case(NamedTuple):
    """A program with spheres near its arm, one of them far away, and a place to look at it."""

    program: PathProgram
    x: Array


@pytest.fixture(params=[*ROBOTS, "sliding"])
def case(request: pytest.FixtureRequest) -> Case:
    robot = chain_robot("sliding14") if request.param == "sliding" else None
    robot = robot or robot_from_urdf_text(*ROBOTS[request.param])
    rng = np.random.default_rng(SEEDS[request.param])
    start = random_state(robot, rng)
    q, v = configuration(robot, start)
    path = random_path(robot, start, rng, DURATION)
    arm = arm_points(robot, q[None])[0]
    spheres = [
        Obstacle.sphere(f"near joint {k}", arm[k] + rng.normal(scale=0.2, size=3), 0.1)
        for k in (0, 3, -1)
    ]
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    objective = Objective(joint_path_length=0.7, chaser_attitude=1.3)
    problem = PlanningProblem(
        robot=robot,
        start=start,
        target=Target(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        duration=DURATION,
        points=POINTS,
        obstacles=(*spheres, Obstacle.sphere("far", arm[0] + 100.0, 0.1)),
        objective=objective,
    )
    family = EndEffectorPaths(robot, q, momentum, path)
    margins = dict.fromkeys((required.name for required in REQUIREMENTS), 0.0)
    margins["clear_of_obstacles"] = MARGIN
    on_demand = frozenset({Torques.name})
    program = PathProgram(problem, family, objective, margins, POINTS, on_demand=on_demand)
    return Case(program, rng.normal(scale=0.05, size=18))


@pytest.mark.law("PLAN-27")
def test_every_derivative_is_that_of_differences(case: Case) -> None:
    program, step = _with_slow_joints(case).with_requirements(frozenset({Torques.name})), 1e-6
    at_x = program.linearise(case.x)
    for name, found in (
        ("value", at_x.gradient[None]),
        ("max_terms", at_x.max_terms_jacobian),
        ("constraints", at_x.constraints_jacobian),
    ):
        expected = np.empty_like(found)
        for k, aside in enumerate(step * np.eye(18)):
            ahead, behind = (
                np.atleast_1d(getattr(program.linearise(case.x + sign * aside), name))
                for sign in (1, -1)
            )
            # The rows are the same ones: none has come or gone.
            assert ahead.shape == behind.shape == (len(found),), name
            expected[:, k] = (ahead - behind) / (2 * step)
        errors = np.abs(found - expected).max(axis=1)
        worst = errors.argmax()
        assert errors[worst] < 1e-6 * np.abs(expected).max(), (
            f"{name}, row {worst}: {found[worst]} is not {expected[worst]}"
        )


def test_the_value_is_the_weighted_joint_path_and_the_peaks_both_signs_of_each_angle(
    case: Case,
) -> None:
    at_x = case.program.linearise(case.x)
    rollout = case.program.family.motion(case.x, POINTS)
    robot = case.program.problem.robot
    shares = robot.joint_weights * rollout.v[:-1, 6:]
    path = sum(np.sqrt(rates @ rates) * DURATION / (POINTS - 1) for rates in shares)
    assert at_x.value == pytest.approx(0.7 * path, rel=1e-12)
    angles = [
        angle
        for q in rollout.q
        for angle in euler_from_rotation(
            pin.Quaternion(q[3:7]).toRotationMatrix() @ robot.rotation_chaser_to_base
        )
    ]
    expected = 1.3 * np.array(angles + [-angle for angle in angles])
    assert at_x.max_terms.shape == (2 * 3 * POINTS,)
    np.testing.assert_allclose(np.sort(at_x.max_terms), np.sort(expected), rtol=0.0, atol=1e-12)
    assert at_x.objective == pytest.approx(0.7 * path + 1.3 * np.abs(angles).max(), rel=1e-12)


def test_value_gradient_and_hessian_grow_with_their_weight(case: Case) -> None:
    single, double = (
        replace(case.program, objective=Objective(weight, 0.0)).linearise(case.x)
        for weight in (1.0, 2.0)
    )
    assert double.value == pytest.approx(2 * single.value, rel=1e-14)
    np.testing.assert_allclose(double.gradient, 2 * single.gradient, rtol=1e-14)
    np.testing.assert_allclose(double.hessian, 2 * single.hessian, rtol=1e-14)
    smallest = np.linalg.eigvalsh(single.hessian)[0]
    assert smallest > -1e-12 * np.abs(single.hessian).max(), f"smallest eigenvalue {smallest:.1e}"


def test_an_attitude_of_no_weight_has_no_peaks(case: Case) -> None:
    program = replace(case.program, objective=Objective(1.0, 0.0))
    at_x = program.linearise(case.x)
    assert at_x.max_terms.shape == (0,)
    assert at_x.max_terms_jacobian.shape == (0, 18)
    assert at_x.objective == at_x.value


def test_every_link_near_a_sphere_has_a_row_at_and_between_the_points(case: Case) -> None:
    """Each clearance below 0.08 m, less the margin, by geometry alone; the start cannot move."""
    without_limits = replace(
        case.program.problem.robot,
        lower_position_limits=np.full(case.program.problem.robot.joints, -1e3),
        upper_position_limits=np.full(case.program.problem.robot.joints, 1e3),
    )
    at_x = of_problem(case.program, robot=without_limits).linearise(case.x)
    rollout = case.program.family.motion(case.x, POINTS)
    at_points, half_way = (arm_points(without_limits, q) for q in (rollout.q, rollout.q_half_way))
    arms, when = [*at_points[1:], *half_way], [*range(1, POINTS), *np.arange(POINTS - 1) + 0.5]

    def distances(arm: Array) -> list[float]:
        return [
            distance_from_segment(sphere.center, start, end) - sphere.radius
            for start, end in pairwise(arm)
            for sphere in case.program.problem.obstacles
            if np.linalg.norm(end - start) > 1e-3
        ]

    def margin(at_start: float, part: float) -> float:
        """Of what the start is nearer to, half of that, and with a quarter of the time all."""
        room = max(at_start, 0.0) / 2
        return min(MARGIN, room + MARGIN * min(4 * part, 1.0) ** 3 * (room < MARGIN / 2))

    expected = [
        distance - margin(at_start, step / (POINTS - 1))
        for arm, step in zip(arms, when, strict=True)
        for distance, at_start in zip(distances(arm), distances(at_points[0]), strict=True)
    ]
    near = np.sort(expected)
    near = near[near < 0.08]
    assert len(near) > 10
    np.testing.assert_allclose(np.sort(at_x.constraints)[: len(near)], near, rtol=0.0, atol=1e-12)
    assert at_x.constraints.max() < 10.0, "the far sphere has a row"


def distance_from_segment(point: Array, start: Array, end: Array) -> float:
    """By cases: abeam of the segment, or next to one of its ends."""
    along = (end - start) / np.linalg.norm(end - start)
    if 0.0 < (point - start) @ along < np.linalg.norm(end - start):
        return float(np.linalg.norm(np.cross(point - start, along)))
    return float(min(np.linalg.norm(point - start), np.linalg.norm(point - end)))


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_every_joint_near_or_beyond_a_limit_has_a_row_at_every_point_and_turn(
    case: Case, side: str
) -> None:
    rollout = case.program.family.motion(case.x, POINTS)
    joint = rollout.q[1:, 7 + 2]
    limit = np.median(joint)  # half of the points are beyond it
    limits = {"lower": np.full(case.program.problem.robot.joints, -1e3)}
    limits["upper"] = -limits["lower"]
    limits[side][2] = limit
    robot = replace(
        case.program.problem.robot,
        lower_position_limits=limits["lower"],
        upper_position_limits=limits["upper"],
    )
    found = of_problem(case.program, robot=robot, obstacles=()).linearise(case.x).constraints
    spline = joints_of(rollout)[2]
    joint = np.append(joint, spline(spline.derivative().roots(False, False)))
    # And where it stops after the last point, by jerks of 10 rad/s3.
    rate = rollout.v[-1, 6 + 2]
    stop = rollout.q[-1, 7 + 2] + rate * np.sqrt(2.0 * abs(rate) / 10.0) / 1.5
    beyond = stop - limit if side == "upper" else limit - stop
    if (rate > 0.0) == (side == "upper") and beyond > -1e-3:
        joint = np.append(joint, stop)
    expected = np.sort(joint - limit if side == "lower" else limit - joint)
    expected = expected[expected < 0.25]
    assert expected[0] < 0.0 < expected[-1]
    np.testing.assert_allclose(np.sort(found), expected, rtol=0.0, atol=1e-14)


def test_a_limit_that_is_exceeded_between_the_points_alone_is_that_of_its_requirement(
    case: Case,
) -> None:
    motion = case.program.family.motion(case.x, POINTS)
    rates = [spline.derivative() for spline in joints_of(motion)]
    peaks = [np.abs(s(s.derivative().roots(False, False))).max(initial=0.0) for s in rates]
    higher = peaks - np.abs(motion.v[:, 6:]).max(axis=0)
    joint = higher.argmax()
    assert higher[joint] > 1e-4
    far = np.full(len(rates), 1e3)
    limits = far.copy()
    limits[joint] = peaks[joint] - higher[joint] / 2
    robot = replace(
        case.program.problem.robot,
        lower_position_limits=-far,
        upper_position_limits=far,
        velocity_limits=limits,
    )
    program = of_problem(
        case.program, robot=robot, obstacles=(), limits=Limits(joint_velocities=True)
    )
    every = {required.name for required in REQUIREMENTS} - {Torques.name}
    assert program.met(program.linearise(case.x)) == every - {"joint_rates"}


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_where_a_joint_stops_has_the_derivatives_of_differences(case: Case, side: str) -> None:
    joints, step = case.program.problem.robot.joints, 1e-6
    end = case.program.family.motion(case.x, POINTS)
    tried = 0
    for joint in range(joints):
        if (end.v[-1, 6 + joint] > 0.0) != (side == "upper"):
            continue
        limits = {"lower": np.full(joints, -1e3), "upper": np.full(joints, 1e3)}
        limits[side][joint] = end.q[-1, 7 + joint]
        robot = replace(
            case.program.problem.robot,
            lower_position_limits=limits["lower"],
            upper_position_limits=limits["upper"],
        )
        program = of_problem(case.program, robot=robot, obstacles=())
        at_x = program.linearise(case.x)
        way = (2.0 * abs(end.v[-1, 6 + joint])) ** 1.5 / np.sqrt(10.0) / 3.0
        (row,) = np.flatnonzero(np.isclose(at_x.constraints, -way, rtol=1e-9))
        for k, aside in enumerate(step * np.eye(len(case.x))):
            ahead, behind = (
                program.linearise(case.x + sign * aside).constraints[row] for sign in (1, -1)
            )
            found = at_x.constraints_jacobian[row, k]
            assert found == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)
        tried += 1
    assert tried


def joints_of(motion: Motion) -> list[CubicHermiteSpline]:
    """What the search knows of each joint between the points."""
    time, joints = (
        np.linspace(0.0, DURATION, POINTS),
        zip(motion.q.T[7:], motion.v.T[6:], strict=True),
    )
    return [CubicHermiteSpline(time, positions, rates) for positions, rates in joints]


def test_every_joint_rate_near_or_beyond_its_limit_has_a_row_at_every_point_and_peak(
    case: Case,
) -> None:
    """The start's rates are what they are, whatever the path."""
    far = np.full(case.program.problem.robot.joints, 1e3)
    slow = _with_slow_joints(case)
    robot = replace(slow.problem.robot, lower_position_limits=-far, upper_position_limits=far)
    found = of_problem(slow, robot=robot, obstacles=()).linearise(case.x).constraints
    rollout = slow.family.motion(case.x, POINTS)
    rates = [spline.derivative() for spline in joints_of(rollout)]
    expected = [
        margin
        for spline, at_points, limit in zip(
            rates, rollout.v[1:, 6:].T, robot.velocity_limits, strict=True
        )
        for rate in [*at_points, *spline(spline.derivative().roots(False, False))]
        for margin in (limit - rate, limit + rate)
        if margin < 0.6 * limit
    ]
    assert min(expected) < 0.0 < max(expected)
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=0.0, atol=1e-14)
    without = of_problem(slow, robot=robot, obstacles=(), limits=Limits())
    assert without.linearise(case.x).constraints.shape == (0,)


def _with_slow_joints(case: Case) -> PathProgram:
    """Limit two joint rates so that half of the points are beyond, one in either direction."""
    rates = case.program.family.motion(case.x, POINTS).v[1:, 6:]
    limits = np.full(case.program.problem.robot.joints, 1e3)
    for joint in (np.argmax(rates.max(axis=0)), np.argmin(rates.min(axis=0))):
        limits[joint] = np.median(np.abs(rates[:, joint]))
    robot = replace(case.program.problem.robot, velocity_limits=limits)
    return of_problem(case.program, robot=robot, limits=Limits(joint_velocities=True))


def of_problem(program: PathProgram, **changes: Any) -> PathProgram:
    """The same program of a problem that differs; the motion stays."""
    return replace(program, problem=replace(program.problem, **changes))


def test_far_from_everything_there_are_no_rows(case: Case) -> None:
    far = np.full(case.program.problem.robot.joints, 1e3)
    robot = replace(
        case.program.problem.robot, lower_position_limits=-far, upper_position_limits=far
    )
    at_x = of_problem(
        case.program, robot=robot, obstacles=case.program.problem.obstacles[-1:]
    ).linearise(case.x)
    assert at_x.constraints.shape == (0,)
    assert at_x.constraints_jacobian.shape == (0, 18)
    assert at_x.violation == 0.0


def test_what_the_smallest_singular_values_have_more_than_a_margin_has_the_right_derivative(case):
    (required,) = (each for each in REQUIREMENTS if each.name == "singular_values")
    program, x = case.program, case.x

    def rows(x):
        motion = program.family.motion(x, POINTS)
        sensitivity = sensitivity_of(program.family, motion)
        return rows_of(required, program.problem, motion, sensitivity, margin)

    margin = 0.0
    assert rows(x) is None
    margin = 0.5
    values, jacobian, _ = rows(x)
    assert jacobian.shape == (len(values), len(x))
    assert len(values) > 0
    direction = np.random.default_rng(0).normal(size=len(x))
    after, before = (rows(x + 1e-6 * sign * direction)[0] for sign in (1.0, -1.0))
    assert (after - before) / 2e-6 == pytest.approx(jacobian @ direction, rel=1e-4, abs=1e-6)


def test_the_name_of_every_requirement_is_a_word_and_no_others() -> None:
    names = [required.name for required in REQUIREMENTS]
    assert all(name.isidentifier() for name in names), names
    assert len(set(names)) == len(names)
