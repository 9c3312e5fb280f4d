"""Joints that slide: planned like those that turn, by a weight, within limits in m, m/s and N."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from recorded_requests import only_request
from robots import random_state, random_urdf
from shaped_problems import bodies
from test_core import WEIGHT, chain_robot

from ff_planner_benchmark.problems import joint_goals
from ff_planner_ros.analysis.drawing.panels import joint_angles, joint_rates, joint_torques
from ff_planner_ros.analysis.extremes import joint_extremes
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.analysis.robot_page import robot_facts, robot_rows
from ff_planner_ros.analysis.summary import plan_rows
from ff_planner_ros.bag import read_plans
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures, measure
from ff_planner_ros.planning.check.preconditions import _reach
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP, least_obstacle_distance
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.solids_apart import distance_between
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.followed import followed
from ff_planner_ros.planning.motion.joint_motion import steady_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame, system_frame
from ff_planner_ros.planning.paths.start_motion import start_motion
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Obstacle,
    Parametrisation,
    PlanningProblem,
    Posture,
    RigidMotion,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import bench_robot, planar_urdf
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
FAMILIES = (Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE)


def on_rail(number: int = 0) -> PlanningProblem:
    return joint_goals.problem("rail", number).problem


@cache
def planned(family: Parametrisation) -> tuple[PlanningTask, Plan]:
    problem = replace(on_rail(1 if family is FAMILIES[0] else 0), parametrisation=family)
    task = PlanningTask(problem, SETTINGS)
    return task, perform(task)


def refused(
    problem: PlanningProblem, plan: Plan, settings: PlannerSettings = SETTINGS
) -> list[str]:
    """What the check finds, in a frame of its own."""
    seen = system_frame(problem.robot, problem.start).plan(plan)
    own = in_own_frame(problem)
    seen = replace(seen, metrics=measure(own, seen.trajectory, settings))
    return [one.finding for one in failures(own, seen, settings)]


# The robot.


def test_a_joint_that_slides_belongs_to_the_arm() -> None:
    robot = bench_robot("rail6")
    assert robot.joint_names == ("rail", *(f"joint_{k}" for k in range(1, 7)))
    assert [robot.slides(k) for k in range(7)] == [True, *[False] * 6]
    assert [robot.unit(k) for k in (0, 1)] == ["m", "rad"]
    assert [robot.effort_unit(k) for k in (0, 1)] == ["N", "N m"]
    assert robot.notes == ()
    np.testing.assert_array_equal(robot.joint_slides[0], [1.0, 0.0, 0.0])
    assert not robot.joint_axes[0].any()


@pytest.mark.parametrize("name", ["sliding1", "sliding4", "sliding7"])
def test_lines_and_origins_are_where_pinocchio_has_them(name: str) -> None:
    robot, rng = chain_robot(name), np.random.default_rng(0)
    q, _ = configuration(robot, random_state(robot, rng))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    expected = [*(data.oMi[2 + k].translation for k in range(robot.joints)), tip.translation]
    np.testing.assert_allclose(arm_points(robot, q[None])[0], expected, rtol=0.0, atol=1e-12)


def test_on_a_table_a_joint_slides_along_it_and_not_off_it() -> None:
    turning = '<joint name="joint_1" type="revolute">'
    assert turning in planar_urdf(3)
    along = planar_urdf(3).replace(turning, turning.replace("revolute", "prismatic"))
    first, second = along.split('<axis xyz="0 0 1"/>', 1)
    links = "chaser", "end_effector", Base.PLANAR
    robot = robot_from_urdf_text(f'{first}<axis xyz="1 2 0"/>{second}', *links)
    assert robot.slides(0)
    with pytest.raises(
        InvalidInput, match=r"joint_1' axis .*90 degrees off x and y .*slide across it"
    ):
        robot_from_urdf_text(along, *links)


@pytest.mark.parametrize("weight", [1e-4, -1.0, np.inf, np.nan, 1e4])
def test_a_weight_that_leaves_no_digits_is_refused(weight: float) -> None:
    with pytest.raises(InvalidInput, match=r"robot\.slide_weight"):
        robot_from_urdf_text(random_urdf(3, 0, (1,)), "bus", "tool", slide_weight=weight)


# The weight.


def test_least_joint_rates_are_least_by_weight() -> None:
    """What moves the end effector alike without being least has a longer joint path."""
    robot, rng = chain_robot("sliding14"), np.random.default_rng(2)
    q, _ = configuration(robot, random_state(robot, rng))
    found = velocity(robot, q, np.zeros(6), rng.normal(scale=0.1, size=6))
    assert found is not None
    _, _, rows = np.linalg.svd(generalised_jacobian(robot, robot.model.createData(), q))
    shares = robot.joint_weights**2 * found.v[6:]
    np.testing.assert_allclose(rows[6:] @ shares, 0.0, atol=1e-12)
    assert np.abs(rows[6:] @ found.v[6:]).max() > 1e-4


def test_the_paper_s_paths_begin_with_the_rates_of_the_start() -> None:
    robot, rng = chain_robot("sliding14"), np.random.default_rng(3)
    state = random_state(robot, rng)
    q, v = configuration(robot, state)
    motion = start_motion(robot, state, 5.0)
    assert motion.null_space is not None
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    found = velocity(robot, q, momentum, motion.end_effector.twist, motion.null_space.rates)
    assert found is not None
    np.testing.assert_allclose(found.v[6:], state.joint_velocities, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_dearer_rail_slides_less(family: Parametrisation) -> None:
    task, plan = planned(family)
    robot = task.problem.robot
    slid = np.abs(np.diff(plan.trajectory.joint_positions[:, 0])).sum()
    dear = replace(robot, joint_weights=np.where(robot.joint_axes.any(axis=1), 1.0, 20.0))
    other = perform(PlanningTask(replace(task.problem, robot=dear), SETTINGS))
    assert np.abs(np.diff(other.trajectory.joint_positions[:, 0])).sum() < 0.7 * slid
    # And the path counts what it slides by that weight.
    rates = other.trajectory.joint_velocities[:-1] * dear.joint_weights
    length = np.linalg.norm(rates, axis=1).sum() * task.problem.duration / 49
    assert other.metrics.joint_path_length == pytest.approx(length, rel=1e-9)


# Plans.


@pytest.mark.parametrize("family", FAMILIES)
def test_a_plan_on_a_rail_comes_true(family: Parametrisation) -> None:
    task, plan = planned(family)
    assert plan.family == family.value
    assert np.abs(np.ptp(plan.trajectory.joint_positions[:, 0])) > 0.01
    assert refused(task.problem, plan) == []
    found = verify(task.problem.robot, plan.trajectory)
    assert found.passed
    assert found.deviation.final_position_error < 1e-5


def test_arms_that_reach_out_are_planned_too() -> None:
    """A telescope: the last joint slides along the last link, on a base that wheels hold."""
    text = random_urdf(7, 5, (7,))
    robot = robot_from_urdf_text(text, "bus", "tool", Base.ATTITUDE_HELD)
    drawn = random_state(robot, np.random.default_rng(1))
    start = replace(
        drawn,
        joint_velocities=np.zeros(7),
        angular_velocity_chaser_in_inertial=np.zeros(3),
    )
    goal = np.clip(start.joint_positions + 0.3, -2.4, 2.7)
    posture = Posture(goal)
    problem = replace(on_rail(), robot=robot, start=start, posture=posture, obstacles=())
    task = PlanningTask(replace(problem, parametrisation=Parametrisation.AUTO), SETTINGS)
    plan = perform(task)
    assert plan.trajectory.joint_positions[-1] == pytest.approx(goal, abs=1e-9)
    assert verify(robot, plan.trajectory).passed


def test_the_whole_robot_is_kept_clear_on_its_rail() -> None:
    """Bodies by the core's certificate in the search, and by Coal in the check."""
    robot = bench_robot("rail6", Geometry.SHAPES)
    assert robot.bodies
    drawn = on_rail(2)
    still = np.zeros(7)
    start = replace(drawn.start, joint_positions=still, joint_velocities=still)
    goal = Posture(np.array([0.35, 0.0, 0.6, 0.4, 0.3, 0.0, 0.0]))
    free = replace(drawn, robot=robot, start=start, posture=goal, obstacles=())
    straight = perform(PlanningTask(free, SETTINGS))
    in_the_way = Obstacle.sphere("s1", straight.trajectory.ee_positions[25] + [0.0, 0.0, 0.05], 0.1)
    asked = replace(free, obstacles=(in_the_way,))
    assert any("s1" in words for words in refused(asked, straight))
    plan = perform(PlanningTask(asked, SETTINGS))
    assert plan.metrics.min_clearance > 0.0
    assert plan.metrics.min_self_clearance > 0.0
    assert refused(asked, plan) == []


def test_the_shortest_way_of_the_rail_keeps_its_limits() -> None:
    """A rail that alone moves: at least way over its highest rate, by geometry."""
    problem = on_rail()
    robot = problem.robot
    start = replace(
        problem.start,
        joint_positions=np.append(-0.3, problem.start.joint_positions[1:]),
        joint_velocities=np.zeros(7),
    )
    goal = np.append(0.3, start.joint_positions[1:])
    asked = replace(
        problem,
        start=start,
        posture=Posture(goal),
        obstacles=(),
        duration=30.0,
        duration_range=DurationRange(1.0, 30.0),
        objective=Objective(0.0, 0.0, 1.0),
        limits=Limits(joint_velocities=True, joint_accelerations=(0.05,) * 7, joint_torques=True),
    )
    plan = perform(PlanningTask(asked, SETTINGS))
    assert plan.duration is not None
    rate, push = robot.velocity_limits[0], 0.05
    # Full acceleration, full rate, full deceleration.
    assert plan.duration >= 0.6 / rate + rate / push
    assert plan.duration < 1.3 * (0.6 / rate + rate / push)
    assert np.abs(plan.trajectory.joint_velocities[:, 0]).max() <= rate * (1 + 1e-6)
    # The rail pushes the whole of what it carries, and the chaser the other way.
    data = robot.model.createData()
    q, _ = from_trajectory(robot, plan.trajectory)
    carried = sum(robot.model.inertias[k].mass for k in range(2, robot.model.njoints))
    reduced = carried * (1 - carried / pin.computeTotalMass(robot.model, data))
    along = plan.trajectory.joint_accelerations[:, 0]
    held = replace(robot, base=Base.ATTITUDE_HELD)
    from ff_planner_ros.robot.dynamics import joint_torques as forces

    v = np.zeros((len(q), 13))
    pushed = forces(held, q, v, np.outer(along, np.eye(7)[0]))[:, 0]
    np.testing.assert_allclose(pushed, reduced * along, rtol=0.0, atol=1e-9)


# Refusals.


def scaled(plan: Plan, rows: str, column: Array) -> Plan:
    changed = getattr(plan.trajectory, rows).copy()
    changed[:, 0] = column
    return replace(plan, trajectory=replace(plan.trajectory, **{rows: changed}))


def test_what_a_rail_exceeds_is_told_in_its_units() -> None:
    task, plan = planned(FAMILIES[1])
    problem, robot = task.problem, task.problem.robot
    assert robot.slides(0)
    position, rate = (
        np.abs(rows[:, 0]).max()
        for rows in (plan.trajectory.joint_positions, plan.trajectory.joint_velocities)
    )
    force = plan.metrics.peak_joint_torques[0]

    def with_first(name: str, value: float) -> PlanningProblem:
        limits = getattr(robot, name).copy()
        limits[0] = value
        return replace(problem, robot=replace(robot, **{name: limits}))

    (found,) = refused(with_first("velocity_limits", 0.9 * rate), plan)
    assert found.startswith("joint rail moves at ")
    assert f"m/s beyond its limit of {0.9 * rate:g} m/s" in found
    assert "rad" not in found
    strong = replace(
        with_first("effort_limits", 0.5 * force), limits=replace(problem.limits, joint_torques=True)
    )
    (found,) = refused(strong, plan)
    assert found.startswith("joint rail needs ")
    assert f" N beyond its effort limit of {0.5 * force:g} N, at" in found
    slow = replace(
        problem, limits=replace(problem.limits, joint_accelerations=(1e-4,) + (9.0,) * 6)
    )
    (found,) = refused(slow, plan)
    assert "m/s2 beyond its limit of 0.0001 m/s2" in found
    lower, upper = robot.lower_position_limits.copy(), robot.upper_position_limits.copy()
    reached = plan.trajectory.joint_positions[:, 0]
    upper[0], lower[0] = reached.max() - 0.004, -1.0
    (found,) = refused(
        replace(
            problem,
            robot=replace(robot, lower_position_limits=lower, upper_position_limits=upper),
        ),
        plan,
    )
    assert "joint rail is at " in found
    assert f"m, 0.004 m beyond its limit of {upper[0]:g} m" in found
    assert position < 0.5
    forces = plan.trajectory.joint_torques[:, 0] + 0.01
    found = refused(problem, scaled(plan, "joint_torques", forces))[0]
    assert "torque_error is 0.01 N, allowed is 1e-06 N" in found


def test_a_rail_may_miss_its_goal_by_what_is_allowed_of_positions() -> None:
    task, plan = planned(FAMILIES[1])
    ends, moves = (
        rows[-1] for rows in (plan.trajectory.joint_positions, plan.trajectory.joint_velocities)
    )
    problem = replace(task.problem, posture=Posture(ends + 0.01 * np.eye(7)[0], moves))
    wide = replace(SETTINGS, position_tolerance=0.02)
    assert refused(problem, plan, wide) == []
    (found,) = refused(problem, plan, replace(wide, position_tolerance=0.005))
    assert "joint rail is further than asked by -0.01 m, allowed is 0.005 m" in found


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"joint_positions": 0.5},
            "is 0.500000 m: at the start joint rail is at 0.5 m, 0.1 m beyond its limit of 0.4 m",
        ),
        (
            {"joint_velocities": 0.2},
            "joint rail moves at 0.2 m/s, 0.1 m/s beyond its limit of 0.1 m/s",
        ),
        ({"joint_positions": 0.399, "joint_velocities": 0.09}, "m/s at 0.399000 m"),
    ],
)
def test_a_start_beyond_the_rail_is_refused_in_its_units(
    change: dict[str, float], words: str
) -> None:
    problem = on_rail()
    start = problem.start
    for name, value in change.items():
        start = replace(start, **{name: np.append(value, getattr(start, name)[1:])})
    with pytest.raises(InvalidInput) as error:
        perform(PlanningTask(replace(problem, start=start), SETTINGS))
    assert "[rail]" in str(error.value)
    assert words in str(error.value)


def test_margins_of_a_rail_count_by_its_weight() -> None:
    task, plan = planned(FAMILIES[1])
    problem, robot = task.problem, task.problem.robot
    heavy = replace(robot, joint_weights=np.append(0.01, np.ones(6)))
    seen = system_frame(robot, problem.start).plan(plan)
    own = in_own_frame(problem)
    found = measure(replace(own, robot=heavy), seen.trajectory, SETTINGS)
    rail = min(
        float(
            np.min(np.abs(robot.upper_position_limits[0] - plan.trajectory.joint_positions[:, 0]))
        ),
        float(
            np.min(np.abs(plan.trajectory.joint_positions[:, 0] - robot.lower_position_limits[0]))
        ),
    )
    assert found.min_joint_margin == pytest.approx(0.01 * rail, abs=1e-6)


# Told, recorded, replayed.


def test_tables_figures_and_reports_tell_a_rail_in_its_units() -> None:
    task, plan = planned(FAMILIES[0])
    robot = task.problem.robot
    facts = robot_facts(robot)
    # The rail carries all that moves where the chaser is the world.
    model = pin.buildModelFromXML(robot.urdf)
    rail, last = facts["joints"][0], facts["joints"][-1]
    assert rail["moves"]["mass"] == pytest.approx(pin.computeTotalMass(model), rel=1e-12)
    assert last["moves"]["mass"] == model.inertias[-1].mass
    rows = dict(robot_rows({**facts, "joints": [rail]}))
    assert rows["    limits"] == "-0.4 to 0.4 m, 0.1 m/s, 150 N"
    assert rows["joint path"] == "sliding by 1 m counts as 1 rad"
    told = dict(plan_rows(robot, plan, 0.1, "", chosen=False, limits=None, attains=False))
    torque, force = told["peak joint torque"].split("; ")
    assert torque.split()[1:] == [
        "N",
        "m,",
        robot.joint_names[int(np.argmax(plan.metrics.peak_joint_torques[1:])) + 1],
    ]
    assert force.endswith(" N, rail")
    for quantity, first, second in (
        (joint_angles(robot), "rail [m]", "joint_1 [deg]"),
        (joint_rates(robot), "rail [m/s]", "joint_1 [deg/s]"),
        (joint_torques(robot), "rail [N]", "joint_1 [N m]"),
    ):
        assert quantity.labels[:2] == (first, second)
    drawn = joint_angles(robot).of(plan.trajectory)
    np.testing.assert_array_equal(drawn[:, 0], plan.trajectory.joint_positions[:, 0])
    np.testing.assert_array_equal(drawn[:, 1], np.rad2deg(plan.trajectory.joint_positions[:, 1]))
    assert joint_extremes(robot, plan.trajectory)[0].slides


def test_a_scenario_an_answer_and_a_bag_hold_a_rail(tmp_path: Path) -> None:
    task, _ = planned(FAMILIES[1])
    robot = task.problem.robot
    dear = replace(robot, joint_weights=np.append(2.5, np.ones(6)))
    task = replace(task, problem=replace(task.problem, robot=dear))
    plan = perform(task)
    cheap = replace(task.problem, robot=robot)
    assert PlanningTask(cheap, SETTINGS).digest != task.digest
    write_scenario(task, tmp_path / "rail.yaml")
    again = load_task(tmp_path / "rail.yaml", Defaults(SETTINGS))
    assert again.digest == task.digest
    np.testing.assert_array_equal(again.problem.robot.joint_weights, dear.joint_weights)
    answer = json.loads(json.dumps(plan_dictionary(plan, task, 0.1)))
    assert answer["robot"]["slide_weight"] == 2.5
    document = plan_document(answer)
    assert document.robot.slides(0)
    assert document.robot.slide_weight == 2.5
    bag = tmp_path / "bag"
    record_answer(bag, task, plan, 0.5)
    recorded = only_request(bag)
    assert replay(recorded).verdict is Verdict.IDENTICAL
    (read,) = read_plans(bag)
    columns = read.columns()
    assert {"rail_position_m", "rail_velocity_m_per_s", "rail_force_N"} <= set(columns)
    assert "joint_1_position_rad" in columns
    assert "rail_position_rad" not in columns


def test_a_goal_beyond_the_rail_is_refused_by_its_name() -> None:
    problem = on_rail()
    goal = np.append(0.6, problem.start.joint_positions[1:])
    with pytest.raises(InvalidInput, match=r"joint\.?.*\[rail\].*0\.6 m.*-0\.4 to 0\.4 m"):
        replace(problem, posture=Posture(goal))


def test_a_rail_that_is_too_slow_leaves_no_plan() -> None:
    problem = on_rail()
    slow = problem.robot.velocity_limits.copy()
    slow[0] = 0.001
    goal = np.append(0.35, problem.start.joint_positions[1:])
    start = replace(
        problem.start,
        joint_positions=np.append(-0.35, problem.start.joint_positions[1:]),
        joint_velocities=np.zeros(7),
    )
    asked = replace(
        problem,
        robot=replace(problem.robot, velocity_limits=slow),
        start=start,
        posture=Posture(goal),
    )
    with pytest.raises(NoPlanFound) as error:
        perform(PlanningTask(asked, replace(SETTINGS, starts=2)))
    assert error.value.status is Status.LIMIT_VIOLATED
    assert "s is too short for joint rail to reach the posture asked for" in str(error.value)


def test_a_robot_without_slides_has_weights_of_one() -> None:
    robot: Robot = bench_robot("arm6")
    assert not robot.has_slides
    np.testing.assert_array_equal(robot.joint_weights, np.ones(6))
    assert WEIGHT != 1.0


@pytest.mark.parametrize("name", ["rail6", "rail7"])
def test_no_goal_is_out_of_reach_that_an_arm_on_a_rail_reaches(name: str) -> None:
    robot, rng = bench_robot(name), np.random.default_rng(0)
    lower, upper, data = (
        robot.lower_position_limits,
        robot.upper_position_limits,
        robot.model.createData(),
    )
    furthest = 0.0
    for _ in range(300):
        joints = rng.uniform(-0.3, 0.3, robot.joints)
        joints[0] = rng.choice([lower[0], upper[0]])
        joints[1:3] = rng.uniform(-3.0, 3.0, 2)
        q = np.concatenate([np.zeros(6), [1.0], joints])
        center = pin.centerOfMass(robot.model, data, q)
        pin.forwardKinematics(robot.model, data, q)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).translation
        furthest = max(furthest, float(np.linalg.norm(tip - center)))
    assert 0.8 * _reach(robot) < furthest <= _reach(robot)
    without = replace(robot, tree=replace(robot.tree, slides=np.zeros((robot.joints, 3))))
    assert _reach(without) < _reach(robot) - 0.3


@pytest.mark.parametrize("seed", range(4))
def test_lines_that_grow_where_a_joint_slides_out_keep_clear_of_boxes(seed: int) -> None:
    """What is certified is below what many moments show, by Coal and Pinocchio, and near to it."""
    robot = robot_from_urdf_text(random_urdf(7, 5, (4,)), "bus", "tool")
    rng = np.random.default_rng(seed)
    q, v = configuration(robot, random_state(robot, rng))
    motion = followed(robot, q, v, steady_motion(0.0, 3.0, q[7:], v[6:]), multiple=16)
    whole, data = with_bodies(robot), robot.model.createData()
    (sliding,) = (k for k, body in enumerate(whole.bodies) if body.stretches)
    joint, lines = whole.bodies[sliding].joint, list[tuple[np.ndarray, np.ndarray]]()
    for at in followed(robot, q, v, motion.joints, multiple=512).q:
        pin.forwardKinematics(robot.model, data, at)
        begin, end = (data.oMi[k].translation.copy() for k in (joint, joint + 1))
        lines.append((begin, end))
    lengths = [np.linalg.norm(end - begin) for begin, end in lines]
    assert np.ptp(lengths) > 0.01
    beside = (lines[-1][0] + lines[-1][1]) / 2 + 0.3 * rng.normal(size=3)
    crate = replace(next(bodies(rng)), motion=RigidMotion(beside))
    asked = whole, motion, surroundings((crate,)), np.array([sliding]), len(motion.time) - 1
    least = least_obstacle_distance(*asked)
    dense = min(
        distance_between(
            coal.Capsule(0.0, float(np.linalg.norm(end - begin))),
            pin.SE3(
                pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - begin).matrix(),
                (begin + end) / 2,
            ),
            crate.solid.geometry,
            pin.SE3(crate.motion.rotation, crate.motion.position),
        )
        for begin, end in lines
    )
    assert dense - CHECK_GAP - 1e-5 <= least.certified <= dense + 1e-6


def test_with_no_weight_joints_that_slide_are_held() -> None:
    """At zero, or at the limit that is next to it; what is said of one of them holds."""
    text = random_urdf(4, 3, (1, 3))
    first, second = '<limit lower="-2.5"', '<limit lower="0.25"'
    before, joint, after = text.partition('<joint name="joint_3"')
    text = before + joint + after.replace(first, second, 1)
    links = "bus", "tool"
    robot = robot_from_urdf_text(text, *links, slide_weight=0.0)
    assert robot.joint_names == ("joint_2", "joint_4")
    assert "joint_1 at 0 m, joint_3 at 0.25 m" in robot.notes[0]
    held = robot_from_urdf_text(text, *links, held_at={"joint_1": 0.0, "joint_3": 0.25})
    assert held.urdf == robot.urdf
    other = robot_from_urdf_text(text, *links, held_at={"joint_1": 0.5}, slide_weight=0.0)
    assert "joint_1 at 0.5 m" in other.notes[0]
