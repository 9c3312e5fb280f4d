"""The chaser's attitude at the goal: asked for beside any goal, kept, measured and told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from core_rows import NO_OBJECTIVE
from dense_motion import truth
from recorded_requests import only_request
from robots import CONFIG
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.paths.chaser_loops import curvature
from ff_planner_ros.planning.paths.joint_spline import JointSplines, joint_splines
from ff_planner_ros.planning.problem.problem import (
    ChaserGoal,
    PlanningProblem,
    Posture,
)
from ff_planner_ros.planning.scenario.scenario import (
    Defaults,
    built_task,
    load_scenario,
    load_task,
    scenario_schema,
)
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.following import following
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.twin import seen_from
from ff_planner_ros.robot.model import Base
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

SETTINGS = load_parameters().planner
SCENARIOS = CONFIG / "scenarios"
SMALL = np.deg2rad(0.1)


def scenario(name: str, **changes: Any) -> PlanningProblem:
    return replace(load_scenario(SCENARIOS / f"{name}.yaml"), **changes)


def document(name: str) -> dict[str, Any]:
    told: dict[str, Any] = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())
    return told


def built(told: dict[str, Any]) -> PlanningTask:
    return built_task(told, SCENARIOS, Defaults(SETTINGS))


def attitudes(problem: PlanningProblem, plan: Plan) -> Rotation:
    """Of the chaser at the start and at the goal, integrated anew from the plan's joints."""
    base = Rotation.from_quat(truth(problem, plan.trajectory).q[[0, -1], 3:7])
    return base * Rotation.from_matrix(problem.robot.rotation_chaser_to_base)


def turned(problem: PlanningProblem, plan: Plan) -> float:
    first, last = attitudes(problem, plan)
    return float((first.inv() * last).magnitude())


def at_rest(problem: PlanningProblem) -> PlanningProblem:
    """A system at rest in its posture, which is the goal."""
    still, start = np.zeros(problem.robot.joints), problem.start
    start = replace(
        start,
        joint_velocities=still,
        joint_accelerations=still,
        linear_velocity_chaser_in_inertial=np.zeros(3),
        angular_velocity_chaser_in_inertial=np.zeros(3),
    )
    posture = Posture(start.joint_positions)
    return replace(problem, start=start, posture=posture, obstacles=(), duration=30.0)


def splines(problem: PlanningProblem) -> JointSplines:
    return joint_splines(problem, SETTINGS)


@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.5])
def test_rows_are_the_angle_and_its_components_with_exact_derivatives(angle: float) -> None:
    """Below the knee the angle is a parabola, which meets it there; limits are met where it is."""
    problem = scenario("lemur_capture")
    family = splines(problem)
    rng = np.random.default_rng(3)
    x = next(iter(family.first_guesses((), 13, 0.0))) + 0.1 * rng.normal(size=family.variables)
    end = Rotation.from_quat(family.motion(x, 13).q[-1, 3:7])
    axis = np.array([0.6, -0.48, 0.64])
    wanted = (end * Rotation.from_rotvec(-angle * axis)).as_matrix()
    limit, knee = 0.7, 0.05
    asked = compiled.chaser_at_goal(wanted, limit, knee)
    program = compiled.PathProgram(family.on_grid(13, 0.0), 1.0, NO_OBJECTIVE, [(0, asked)])
    found = program.at(x)
    measure = angle if angle > knee else angle**2 / (2 * knee) + knee / 2
    off = angle * axis
    each = np.column_stack([limit - off, limit + off]).ravel()
    np.testing.assert_allclose(found.constraints, [limit - measure, *each], atol=1e-12)
    for column in rng.choice(family.variables, 12, replace=False):
        step = np.zeros(family.variables)
        step[column] = 1e-5
        by = (program.at(x + step).constraints - program.at(x - step).constraints) / 2e-5
        np.testing.assert_allclose(found.constraints_jacobian[:, column], by, atol=2e-8)


def test_a_loop_turns_the_base_by_the_curvature_to_second_order() -> None:
    """A small square in the plane of two joints, integrated by the momentum alone."""
    problem = at_rest(scenario("lemur_capture"))
    robot, joints = problem.robot, problem.start.joint_positions
    found = curvature(robot, joints)
    np.testing.assert_allclose(found, -found.swapaxes(0, 1), atol=1e-12)
    family = splines(problem)
    bump = np.zeros(family.each)
    bump[1:4], late = 1.0, np.roll(bump, 2)
    late = np.zeros(family.each)
    late[3:6] = 1.0
    rows = family.free(family.basis.on_grid(2001))
    both = rows @ np.array([bump, late]).T
    area = 0.5 * np.sum(both[:-1, 0] * both[1:, 1] - both[1:, 0] * both[:-1, 1])
    for i, j in ((0, 1), (1, 3), (2, 5)):
        x, size = np.zeros((robot.joints, family.each)), 1e-2
        held = family.near(np.tile(np.r_[np.zeros(7), joints], (50, 1)))
        x[i] += size * bump
        x[j] += size * late
        q = family.motion(held + x.ravel(), 401).q
        turn = (Rotation.from_quat(q[0, 3:7]).inv() * Rotation.from_quat(q[-1, 3:7])).as_rotvec()
        np.testing.assert_allclose(turn / (size**2 * area), found[i, j], atol=2e-2)


@pytest.mark.parametrize("turn", [[2.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.5, 0.5, 4.0]])
def test_the_first_guess_of_an_arm_at_rest_leads_the_chaser_most_of_the_way(
    turn: list[float],
) -> None:
    """Without a loop the arm would stay where it is, and no small change would turn the chaser."""
    wanted = Rotation.from_rotvec(np.deg2rad(turn))
    problem = in_own_frame(at_rest(scenario("lemur_capture")))
    goal = ChaserGoal(quaternion_xyzw=wanted.as_quat())
    family = splines(replace(problem, chaser_goal=goal))
    guess = next(iter(family.first_guesses((), 13, 0.0)))
    q = family.motion(guess, 101).q
    np.testing.assert_allclose(q[-1, 7:], q[0, 7:], atol=1e-9)
    to_chaser = Rotation.from_matrix(problem.robot.rotation_chaser_to_base)
    off = wanted.inv() * Rotation.from_quat(q[-1, 3:7]) * to_chaser
    assert off.magnitude() < 0.5 * wanted.magnitude()


BESIDE: dict[str, PlanningProblem] = {
    "a pose": scenario("lemur_capture"),
    "a capture": scenario("lemur_tumbling"),
    "a posture": scenario("stow", duration=20.0, duration_range=None),
    "rest": replace(scenario("lemur_capture"), posture=Posture(at_rest=True)),
    "a table": scenario("planar_capture"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", BESIDE)
def test_beside_any_goal_the_chaser_ends_as_it_began(name: str) -> None:
    problem = BESIDE[name]
    asked = replace(problem, chaser_goal=ChaserGoal(rotation=SMALL))
    plan = perform(PlanningTask(asked, SETTINGS))
    assert turned(asked, plan) <= SMALL + 2e-6
    assert plan.metrics.final_chaser_rotation == pytest.approx(turned(asked, plan), abs=2e-6)
    assert not failures(asked, plan, SETTINGS)


def test_a_closed_loop_of_the_joints_turns_the_satellite() -> None:
    """Start posture and goal posture are the same; seen from another frame it is the same plan."""
    problem = at_rest(scenario("lemur_capture"))
    wanted = Rotation.from_rotvec(np.deg2rad([0.8, -0.5, 0.6]))
    goal = ChaserGoal(quaternion_xyzw=wanted.as_quat(), tolerance=1e-3)
    asked = replace(problem, chaser_goal=goal)
    plan = perform(PlanningTask(asked, SETTINGS))
    joints = plan.trajectory.joint_positions
    np.testing.assert_allclose(joints[-1], joints[0], atol=1e-9)
    _, last = attitudes(asked, plan)
    assert (wanted.inv() * last).magnitude() <= 1e-3 + 2e-6
    assert plan.metrics.final_chaser_rotation == pytest.approx(wanted.magnitude(), abs=1.1e-3)
    assert plan.metrics.joint_path_length > 0.1


def test_an_attitude_means_the_same_in_every_frame() -> None:
    problem = scenario("lemur_capture")
    start = Rotation.from_quat(problem.start.quaternion_chaser_to_inertial_xyzw)
    wanted = start * Rotation.from_rotvec([0.0, 0.02, -0.01])
    goal = ChaserGoal(quaternion_xyzw=wanted.as_quat())
    frame = Rotation.from_rotvec([0.4, -1.0, 0.7])
    here = replace(problem, chaser_goal=goal)
    there = seen_from(here, pin.SE3(frame.as_matrix(), np.array([5.0, -3.0, 2.0])))
    found = [perform(PlanningTask(one, SETTINGS)) for one in (here, there)]
    lengths = [one.metrics.joint_path_length for one in found]
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-6)
    for one, plan, sought in zip((here, there), found, (wanted, frame * wanted), strict=True):
        _, last = attitudes(one, plan)
        assert (sought.inv() * last).magnitude() <= 1e-3 + 2e-6


def test_a_chaser_that_is_turned_at_the_goal_is_refused_with_field_and_angle(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    angle = turned(lemur_capture, lemur_plan)
    assert lemur_plan.metrics.final_chaser_rotation == pytest.approx(angle, abs=2e-6)
    kept = replace(lemur_capture, chaser_goal=ChaserGoal(rotation=angle + 1e-5))
    assert not failures(kept, lemur_plan, SETTINGS)
    (failure,) = failures(
        replace(lemur_capture, chaser_goal=ChaserGoal(rotation=SMALL)), lemur_plan, SETTINGS
    )
    assert failure.status is Status.LIMIT_VIOLATED
    assert f"the chaser has rotated by {angle:.5g} rad, {angle - SMALL:.3g} rad beyond " in (
        failure.finding
    )
    assert f"target.chaser_rotation of {SMALL:g} rad, at the goal, t = " in failure.finding
    assert "a longer duration" in failure.advice
    goal = ChaserGoal(quaternion_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), tolerance=SMALL)
    (failure,) = failures(replace(lemur_capture, chaser_goal=goal), lemur_plan, SETTINGS)
    assert "the chaser is off target.chaser_quaternion_xyzw by " in failure.finding
    assert f"beyond target.chaser_tolerance of {SMALL:g} rad" in failure.finding


def test_what_cannot_be_had_is_told_with_its_angle() -> None:
    """Half a turn within ten seconds."""
    half = ChaserGoal(quaternion_xyzw=np.array([0.0, 0.0, 1.0, 0.0]))
    problem = scenario("lemur_capture", chaser_goal=half)
    with pytest.raises(NoPlanFound, match=r"is off target\.chaser_quaternion_xyzw by") as refused:
        perform(PlanningTask(problem, replace(SETTINGS, starts=2)))
    assert refused.value.status is Status.LIMIT_VIOLATED


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"chaser_rotation": 0.0}, "target.chaser_rotation is 0.0: it must be greater than 0"),
        ({"chaser_rotation": 1e-6}, "target.chaser_rotation is 1e-06: it must be at least 1e-05"),
        ({"chaser_tolerance": 0.1}, "target.chaser_tolerance is 0.1: it needs chaser_quaternion"),
        (
            {"chaser_rotation": 0.1, "chaser_quaternion_xyzw": [0, 0, 0, 1]},
            "target.chaser_quaternion_xyzw is [0.0, 0.0, 0.0, 1.0]: with chaser_rotation it must",
        ),
        ({"chaser_quaternion_xyzw": [0, 0, 0, 2]}, "target.chaser_quaternion_xyzw"),
    ],
)
def test_a_scenario_is_refused_by_the_name_of_its_field(told: dict[str, Any], words: str) -> None:
    asked = document("lemur_capture")
    asked["target"] |= told
    with pytest.raises(InvalidInput) as refused:
        built(asked)
    assert words in str(refused.value)
    asked = document("whole_capture")
    asked["phases"][1]["target"] |= told
    with pytest.raises(InvalidInput) as refused:
        built(asked)
    assert words in str(refused.value)


def test_a_base_that_cannot_turn_so_is_refused_and_one_that_is_held_keeps_its_attitude() -> None:
    table = scenario("planar_capture")
    tilted = Rotation.from_rotvec([0.1, 0.0, 0.3]).as_quat()
    asked = replace(table, chaser_goal=ChaserGoal(quaternion_xyzw=tilted))
    with pytest.raises(InvalidInput, match="planar the chaser turns about z only"):
        perform(PlanningTask(asked, SETTINGS))
    held = scenario("lemur_wheels")
    assert held.robot.base is Base.ATTITUDE_HELD
    asked = replace(held, chaser_goal=ChaserGoal(quaternion_xyzw=tilted))
    with pytest.raises(InvalidInput, match="attitude_held the chaser does not turn"):
        perform(PlanningTask(asked, SETTINGS))
    plain = perform(PlanningTask(held, SETTINGS))
    kept = perform(PlanningTask(replace(held, chaser_goal=ChaserGoal(rotation=1e-4)), SETTINGS))
    assert kept.coefficients.tobytes() == plain.coefficients.tobytes()
    assert kept.metrics.final_chaser_rotation == 0.0


ASKED: list[dict[str, Any]] = [
    {"chaser_rotation": 0.02},
    {"chaser_quaternion_xyzw": [0.0, 0.0, 0.6, 0.8], "chaser_tolerance": 0.01},
]


@pytest.mark.parametrize("told", ASKED, ids=str)
def test_it_is_written_and_read_as_it_was(told: dict[str, Any], tmp_path: Path) -> None:
    """Beside a pose, a body and a posture, and in a phase; what asks for nothing has its digest."""
    for name in ("lemur_capture", "lemur_tumbling", "stow"):
        asked = document(name)
        plain = built(asked)
        asked["target"] = asked.get("target", {}) | told
        task = built(asked)
        assert task.digest != plain.digest
        assert replace(task, problem=replace(task.problem, chaser_goal=ChaserGoal())).digest == (
            plain.digest
        )
        write_scenario(task, tmp_path / f"{name}.yaml")
        written = yaml.safe_load((tmp_path / f"{name}.yaml").read_text())
        assert told.items() <= written["target"].items()
        again = load_task(tmp_path / f"{name}.yaml", Defaults(SETTINGS))
        assert again.digest == task.digest
    asked = document("whole_capture")
    asked["phases"][0]["target"] = told
    asked["phases"][1]["target"] |= told
    task = built(asked)
    assert task.problem.chaser_goal.most == task.then[0].chaser_goal.most < np.inf
    assert task.then[1].chaser_goal.most == np.inf
    write_scenario(task, tmp_path / "whole.yaml")
    assert load_task(tmp_path / "whole.yaml", Defaults(SETTINGS)).digest == task.digest


def test_the_schema_knows_it_beside_every_goal() -> None:
    validate = pytest.importorskip("jsonschema").validate
    for name in ("lemur_capture", "lemur_tumbling", "stow"):
        asked = document(name)
        asked["target"] = asked.get("target", {}) | ASKED[1]
        validate(asked, scenario_schema())


def test_the_answer_as_json_has_it(lemur_capture: PlanningProblem) -> None:
    task = PlanningTask(replace(lemur_capture, chaser_goal=ChaserGoal(rotation=0.05)), SETTINGS)
    plan = perform(task)
    told = json.loads(json.dumps(plan_dictionary(plan, task, 1.0)))
    assert told["target"]["chaser_rotation"] == 0.05
    assert told["metrics"]["final_chaser_rotation"] == plan.metrics.final_chaser_rotation
    assert plan_document(told).plan.metrics == plan.metrics


def test_it_counts_at_the_goal_and_not_after_it(lemur_capture: PlanningProblem) -> None:
    """While the end effector is held, the chaser goes on turning."""
    asked = replace(lemur_capture, chaser_goal=ChaserGoal(rotation=SMALL))
    task = PlanningTask(asked, SETTINGS, end_behaviour=EndBehaviour.HOLD_END_EFFECTOR, tail=4.0)
    plan = perform(task)
    motion = plan.trajectory
    goal = int(np.abs(motion.time - asked.duration).argmin())
    first, last, end = Rotation.from_quat(motion.chaser_quaternions_xyzw[[0, goal, -1]])
    assert (first.inv() * last).magnitude() <= SMALL + 2e-6
    assert (first.inv() * end).magnitude() > 10.0 * SMALL
    assert plan.metrics.final_chaser_rotation <= SMALL + 2e-6


def test_a_phase_has_its_own_and_none_of_the_phase_before(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    asked = replace(lemur_capture, chaser_goal=ChaserGoal(rotation=1.0))
    rest, own = Posture(at_rest=True), ChaserGoal(rotation=0.5)
    for goal, most in ((ChaserGoal(), np.inf), (own, 0.5)):
        phase = Phase(duration=5.0, target=rest, chaser_goal=goal)
        later = following(PlanningTask(asked, SETTINGS, then=(phase,)), lemur_plan)
        assert later.problem.chaser_goal.most == most


def test_a_recorded_plan_is_replayed_to_the_last_bit(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    turn = Rotation.from_rotvec([0.0, 0.02, -0.01]).as_quat()
    asked = replace(lemur_capture, chaser_goal=ChaserGoal(quaternion_xyzw=turn, tolerance=2e-3))
    task = PlanningTask(asked, SETTINGS)
    record_answer(tmp_path / "bag", task, perform(task), 0.5)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL
