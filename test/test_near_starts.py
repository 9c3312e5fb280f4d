"""A start beside an obstacle is planned away from, or refused at once; a plan's end is a start."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bodied_robots import lemur_with_bodies
from handmade_plans import SETTINGS, arm
from robots import LEMUR_SCENARIO
from shaped_problems import SOLIDS

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.state import SystemState

NEEDED, AT_END = 1e-5, 1.2e-5  # clearance of a start, and of a plan's last point [m]
TURNED = np.array([0.3, 0.2, 0.1, 0.9]) / np.linalg.norm([0.3, 0.2, 0.1, 0.9])
RADIUS = 0.05
geometries = pytest.mark.parametrize("geometry", ["lines", "bodies"])


@cache
def at_rest(geometry: str) -> PlanningProblem:
    """The paper's capture without its obstacles, where nothing moves at the start."""
    problem, still = load_scenario(LEMUR_SCENARIO), np.zeros(3)
    start = replace(
        problem.start,
        linear_velocity_chaser_in_inertial=still,
        angular_velocity_chaser_in_inertial=still,
        joint_velocities=np.zeros(problem.robot.joints),
        joint_accelerations=None,
    )
    robot = problem.robot if geometry == "lines" else lemur_with_bodies()
    return replace(problem, robot=robot, start=start, obstacles=())


def beside(problem: PlanningProblem, kind: str, gap: float, side: float = -1.0) -> PlanningProblem:
    """The problem with an obstacle so far from its fourth link."""
    q, _ = configuration(problem.robot, problem.start)
    points = arm(problem.robot, q)
    middle, along = points[3:5].mean(axis=0), points[4] - points[3]
    normal = np.cross(along, [0.3, 0.5, -0.8])
    normal *= side / np.linalg.norm(normal)

    def at(off: float) -> PlanningProblem:
        place, still = middle + off * normal, np.zeros(3)
        if kind == "sphere":
            return replace(problem, obstacles=(Obstacle.sphere("near", place, RADIUS),))
        body = Obstacle("near", SOLIDS[kind], RigidMotion(place, TURNED, still, still))
        return replace(problem, obstacles=(body,))

    inside, outside = 0.0, 2.0
    while outside - inside > 1e-9:
        off = (inside + outside) / 2
        inside, outside = (off, outside) if clearance(at(off)) <= 0.0 else (inside, off)
    # Along the normal of the link the distance grows by less, where another part is nearer.
    low, high = outside, outside + 20.0 * gap
    while high - low > 1e-10:
        off = (low + high) / 2
        low, high = (off, high) if clearance(at(off)) < gap else (low, off)
    return at(high)


def clearance(problem: PlanningProblem, time: float = 0.0, q: Array | None = None) -> float:
    """How far the robot is from its obstacle, up to 1 m: by Coal, or by a line's formula."""
    q = configuration(problem.robot, problem.start)[0] if q is None else q
    if problem.obstacles[0].is_sphere and not problem.robot.bodies:
        (sphere,), points = problem.obstacles, arm(problem.robot, q)
        a, b = points[:-1], points[1:]
        length = np.maximum(np.sum((b - a) ** 2, axis=1), 1e-18)
        part = np.clip(np.sum((sphere.center - a) * (b - a), axis=1) / length, 0.0, 1.0)
        nearest = a + part[:, None] * (b - a)
        return float(np.linalg.norm(nearest - sphere.center, axis=1).min() - sphere.radius)
    contact = deepest_contact(problem, q, time, within=1.0)
    return 1.0 if contact is None else contact.distance


def outcome(problem: PlanningProblem) -> Plan | FfPlannerError:
    try:
        return perform(PlanningTask(problem, SETTINGS))
    except FfPlannerError as error:
        return error


@pytest.mark.law("PLAN-29")
@geometries
@pytest.mark.parametrize("kind", ["sphere", *SOLIDS])
def test_a_start_at_rest_beside_an_obstacle_is_planned_away_from(
    geometry: str, kind: str, times: Callable[[int, int], int]
) -> None:
    for gap in [1.1e-5, 1e-4][-times(1, 2) :]:
        problem = beside(at_rest(geometry), kind, gap)
        assert clearance(problem) == pytest.approx(gap, abs=1e-8)
        found = outcome(problem)
        assert isinstance(found, Plan), (gap, found)
        assert found.solver.starts <= 4
        assert 0.0 < found.metrics.min_clearance <= gap


@pytest.mark.law("PLAN-29")
@geometries
def test_a_start_nearer_than_a_plan_needs_is_refused_at_once(geometry: str) -> None:
    for kind in ("sphere", "box"):
        problem = beside(at_rest(geometry), kind, 0.7 * NEEDED)
        with pytest.raises(InvalidInput) as refused:
            require_plannable(problem, SETTINGS)
        assert refused.value.status is Status.START_IN_COLLISION
        words = str(refused.value)
        assert re.match(r"obstacles\[near\] is 0\.0070 mm from ", words)
        assert "a start needs a clearance of 0.01 mm from every obstacle" in words
        require_plannable(beside(at_rest(geometry), kind, 1.05 * NEEDED), SETTINGS)


@geometries
@pytest.mark.parametrize("kind", ["sphere", *SOLIDS])
def test_an_arm_that_must_get_round_what_it_starts_beside_keeps_clear_of_it_between_the_points(
    geometry: str, kind: str, times: Callable[[int, int], int]
) -> None:
    """The straight way leads into the obstacle: only a margin keeps an arm that grazes it clear."""
    for gap in [2e-5, 4e-4][-times(1, 2) :]:
        problem = beside(at_rest(geometry), kind, gap, side=1.0)
        found = outcome(problem)
        assert isinstance(found, Plan), (gap, found)
        assert found.solver.starts <= 4
        assert 0.0 < found.metrics.min_clearance <= gap


@geometries
def test_a_start_that_moves_into_a_body_of_any_shape_is_refused_at_once(geometry: str) -> None:
    for kind in ("box", "capsule"):
        problem = beside(at_rest(geometry), kind, 2e-5)
        (body,) = problem.obstacles
        q, _ = configuration(problem.robot, problem.start)
        way = arm(problem.robot, q)[3:5].mean(axis=0) - body.motion.position
        for speed in (0.2, -0.2):
            moving = body.with_motion(velocity=speed * way / np.linalg.norm(way))
            asked = replace(problem, obstacles=(moving,))
            if speed < 0.0:
                require_plannable(asked, SETTINGS)
                continue
            with pytest.raises(InvalidInput, match=r"mm are needed at the start") as refused:
                require_plannable(asked, SETTINGS)
            assert str(refused.value).startswith("obstacles[near] is 0.020 mm from ")


def end_of(problem: PlanningProblem, plan: Plan) -> PlanningProblem:
    """The problem from where a plan ends."""
    motion = plan.trajectory
    start = SystemState(
        motion.chaser_positions[-1],
        motion.chaser_quaternions_xyzw[-1],
        motion.chaser_linear_velocities[-1],
        motion.chaser_angular_velocities[-1],
        motion.joint_positions[-1],
        motion.joint_velocities[-1],
        motion.joint_accelerations[-1],
    )
    return replace(problem, start=start)


@pytest.mark.law("PLAN-25")
@geometries
@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_a_plan_ends_no_nearer_to_an_obstacle_than_another_one_may_start(
    geometry: str, kind: str
) -> None:
    """An obstacle is put beside where a plan ends: a little nearer, and a little further."""
    problem = at_rest(geometry)
    plan = perform(PlanningTask(problem, SETTINGS))
    ended = end_of(problem, plan)
    for gap in (0.8 * NEEDED, 1.15 * NEEDED, 1.05 * AT_END):
        among = replace(problem, obstacles=beside(ended, kind, gap).obstacles)
        found = list(failures(among, plan, SETTINGS))
        words = "0.012 mm are needed so that another plan may start there"
        assert any(words in one.finding for one in found) == (gap < AT_END)
        start = end_of(among, plan)
        if gap > NEEDED:
            require_plannable(start, SETTINGS)
            continue
        with pytest.raises(InvalidInput, match=r"a start needs a clearance of 0\.01 mm"):
            require_plannable(start, SETTINGS)


@pytest.mark.law("PLAN-25")
def test_a_plan_ends_with_joints_that_can_stop_before_their_limits() -> None:
    """Joints move at the goal, since the chaser drifts: limits are put just beyond that."""
    problem = load_scenario(LEMUR_SCENARIO)
    plan = perform(PlanningTask(problem, SETTINGS))
    at_end, rates = plan.trajectory.joint_positions[-1], plan.trajectory.joint_velocities[-1]
    planned = 0
    for joint in np.flatnonzero(np.abs(rates) > 3e-3):
        name = "upper_position_limits" if rates[joint] > 0.0 else "lower_position_limits"
        limits = getattr(problem.robot, name).copy()
        limits[joint] = at_end[joint] + np.copysign(2e-5, rates[joint])
        limited = replace(problem, robot=replace(problem.robot, **{name: limits}))
        found = [one.finding for one in failures(limited, plan, SETTINGS)]
        reaches = np.abs(plan.trajectory.joint_positions[:, joint] - limits[joint]).min() < 2.1e-5
        assert reaches
        assert any("stops no sooner than at" in words for words in found), joint
        other = outcome(limited)
        if isinstance(other, Plan):
            require_plannable(end_of(limited, other), SETTINGS)
            planned += 1
    assert planned


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_start_may_accelerate_as_much_as_a_plan_may(sign: float) -> None:
    """Of a limit that is small, rounding is allowed."""
    problem, limit = at_rest("lines"), 1e-3
    limits = Limits(joint_accelerations=(limit, *6 * [50.0]))
    for beyond, is_allowed in ((0.9e-6, True), (1.1e-6, False)):
        accelerations = sign * (limit + beyond) * np.eye(7)[0]
        start = replace(problem.start, joint_accelerations=accelerations)
        asked = replace(problem, start=start, limits=limits)
        if is_allowed:
            require_plannable(asked, SETTINGS)
            continue
        with pytest.raises(InvalidInput, match=r"joints\.acceleration\[joint_1\] is"):
            require_plannable(asked, SETTINGS)
