"""Planning ahead of a snapshot, against a drift in closed form and an independent engine."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import drawn_plan

from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Progress, Watch
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    ObstacleBody,
    PlanningProblem,
    Sphere,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.digest import canonical, digest_of
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import (
    PlanningTask,
    attempted,
    perform,
    without_search,
)
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import execute
from ff_planner_ros.simulation.feed_forward import feed_forward

WAIT = 3.0  # [s] from the measurement to the start of the plan
DRIFT = np.array([0.02, 0.0, 0.05])  # [m/s] the paper's chaser


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def drifting(lemur_capture: PlanningProblem) -> PlanningProblem:
    """The capture by a chaser that drifts and does not turn, its arm held."""
    return replace(lemur_capture, start=_drifted(lemur_capture.start, 0.0))


def _drifted(state: SystemState, seconds: float) -> SystemState:
    """Nothing turns and nothing bends: everything moves on by v t."""
    return replace(
        state,
        position_chaser_in_inertial=state.position_chaser_in_inertial + seconds * DRIFT,
        linear_velocity_chaser_in_inertial=DRIFT,
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(7),
    )


def _plan(problem: PlanningProblem, ahead: float, settings: PlannerSettings) -> Plan:
    return perform(PlanningTask(problem, settings, ahead))


def _reached(problem: PlanningProblem, plan: Plan) -> Array:
    """Where the end effector comes to when the plan is executed from where the chaser then is."""
    robot = problem.robot
    there = _drifted(problem.start, WAIT)
    start = replace(
        there,
        linear_velocity_chaser_in_inertial=plan.trajectory.chaser_linear_velocities[0],
        angular_velocity_chaser_in_inertial=plan.trajectory.chaser_angular_velocities[0],
        joint_velocities=plan.trajectory.joint_velocities[0],
    )
    run = execute(Engine(robot), start, feed_forward(robot, plan.trajectory, 8))
    return run.ee_positions[-1]


@pytest.mark.law("NODE-03")
def test_a_plan_from_the_snapshot_itself_misses_by_what_the_chaser_drifts_meanwhile(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    miss = _reached(drifting, _plan(drifting, 0.0, settings)) - drifting.target.position
    np.testing.assert_allclose(miss, WAIT * DRIFT, atol=1e-3)
    assert np.linalg.norm(miss) > 0.15


@pytest.mark.law("NODE-03")
def test_a_plan_from_where_the_chaser_will_be_reaches_the_goal(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    plan = _plan(drifting, WAIT, settings)
    np.testing.assert_allclose(plan.trajectory.chaser_positions[0], WAIT * DRIFT, atol=1e-9)
    miss = _reached(drifting, plan) - drifting.target.position
    assert np.linalg.norm(miss) < 1e-3


def test_the_tail_is_part_of_the_plan(drifting: PlanningProblem, settings: PlannerSettings) -> None:
    plan = perform(
        PlanningTask(drifting, settings, end_behaviour=EndBehaviour.STOP_JOINTS, tail=2.0)
    )
    assert plan.trajectory.time[-1] == pytest.approx(drifting.duration + 2.0)
    np.testing.assert_allclose(plan.trajectory.joint_velocities[-1], 0.0, atol=1e-9)


def test_progress_is_told_and_the_search_ends_when_it_is_told_to(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    told: list[Progress] = []

    class Impatient(Watch):
        def require_time(self, *_: str) -> None:
            if len(told) >= 3:
                raise OutOfTime("enough")

        def report(self, progress: Progress) -> None:
            told.append(progress)

    with pytest.raises(NoPlanFound, match="enough"):
        perform(PlanningTask(drifting, settings), Impatient())
    assert [progress.iterations for progress in told] == [1, 2, 3]
    assert {progress.phase for progress in told} == {"searching"}
    assert all(progress.starts == 1 and progress.violation >= 0.0 for progress in told)


@pytest.mark.law("PLAN-23")
def test_equal_tasks_have_equal_digests_and_every_difference_counts(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    task, again = (PlanningTask(replace(lemur_capture), settings) for _ in range(2))
    assert task.digest == again.digest
    assert len(task.digest) == 16
    start, target, sphere = lemur_capture.start, lemur_capture.target, lemur_capture.obstacles[0]
    strict = Controller(lemur_capture.robot.joint_names, False, False)
    running = joint_motion(drawn_plan(lemur_capture.robot, seed=1).trajectory)
    less = np.nextafter(start.joint_positions, -9.0)
    problems = {
        "robot": replace(lemur_capture, robot=replace(lemur_capture.robot, urdf="other")),
        "start": replace(lemur_capture, start=replace(start, joint_positions=less)),
        "target": replace(
            lemur_capture, target=replace(target, angular_acceleration=np.full(3, 5e-324))
        ),
        "duration": replace(lemur_capture, duration=np.nextafter(lemur_capture.duration, 99.0)),
        "points": replace(lemur_capture, points=lemur_capture.points + 1),
        "obstacles": replace(lemur_capture, obstacles=lemur_capture.obstacles[1:]),
        "id": replace(
            lemur_capture,
            obstacles=(replace(sphere, id="other"), *lemur_capture.obstacles[1:]),
        ),
        "objective": replace(lemur_capture, objective=Objective(1.0, 1e-300)),
        "limits": replace(lemur_capture, limits=Limits(joint_velocities=True)),
        "attitude": replace(lemur_capture, limits=Limits(chaser_attitude=0.2)),
        "rotation": replace(lemur_capture, limits=Limits(chaser_rotation=0.2)),
    }
    tasks = {name: PlanningTask(problem, settings) for name, problem in problems.items()} | {
        "settings": replace(task, settings=replace(settings, starts=settings.starts + 1)),
        "ahead": replace(task, ahead=1e-9),
        "running": replace(task, running=running),
        "end_behaviour": replace(task, end_behaviour=EndBehaviour.STOP_JOINTS, tail=1.0),
        "tail": replace(task, end_behaviour=EndBehaviour.STOP_JOINTS, tail=1.5),
        "controller": replace(task, controller=strict),
        "first_guess": replace(task, first_guess=np.zeros(18)),
    }
    digests = {task.digest, *(one.digest for one in tasks.values())}
    assert len(digests) == 1 + len(tasks)


def test_a_digest_is_the_same_in_another_process(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    task = PlanningTask(lemur_capture, settings)
    code = "import pickle, sys; print(pickle.load(sys.stdin.buffer).digest)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=pickle.dumps(replace(task)),
        capture_output=True,
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "1"},
    )
    assert done.stdout.decode().strip() == task.digest


def test_a_controller_that_takes_every_sound_plan_changes_no_digest(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    mild = Controller(lemur_capture.robot.joint_names, True, False)
    picky = replace(mild, stopped_velocity_tolerance=0.01)
    alone, taken, not_taken = (
        PlanningTask(lemur_capture, settings, controller=c) for c in (None, mild, picky)
    )
    assert alone.digest == taken.digest != not_taken.digest


@pytest.mark.law("PLAN-32")
def test_the_controllers_rules_are_kept(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    strict = Controller(lemur_capture.robot.joint_names, False, False)
    with pytest.raises(NoPlanFound, match="still moves at") as refusal:
        perform(PlanningTask(lemur_capture, settings, controller=strict))
    assert refusal.value.status is Status.CONTROLLER_CONSTRAINT
    stops = EndBehaviour.STOP_JOINTS
    perform(PlanningTask(lemur_capture, settings, end_behaviour=stops, tail=2.0, controller=strict))


def test_what_any_method_brings_is_judged(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    """The straight line hits the obstacles of the capture."""
    task, straight = PlanningTask(lemur_capture, settings), without_search(straight_line)
    with pytest.raises(NoPlanFound, match=r"straight line: xi = 0.*--method optimal") as refusal:
        perform(task, method=straight)
    assert refusal.value.status is Status.COLLISION
    assert refusal.value.failures[0].status is Status.COLLISION
    motion, found = attempted(task, straight)
    assert isinstance(motion, Plan)
    assert found == refusal.value.failures


@pytest.mark.parametrize("guess", [np.zeros((3, 6)), np.full(18, np.nan)])
def test_a_first_guess_that_is_none_is_refused(
    lemur_capture: PlanningProblem, settings: PlannerSettings, guess: Array
) -> None:
    with pytest.raises(InvalidInput, match="first_guess"):
        PlanningTask(lemur_capture, settings, first_guess=guess)


def test_zeros_of_either_sign_are_one_to_a_digest() -> None:
    """A message drops the sign of an obstacle that rests."""
    solid, place = Solid("box", np.ones(3)), np.zeros(3)
    rests = ObstacleBody("b", solid, place)
    negative = ObstacleBody("b", solid, -place, velocity=-place)
    assert digest_of(rests) == digest_of(negative)
    assert digest_of(Sphere("s", place, 1.0)) == digest_of(Sphere("s", -place, 1.0))


def test_a_digest_says_what_digests_always_said_and_leaves_out_what_came_later() -> None:
    told = {
        Limits(): {"joint_velocities": False, "chaser_attitude": math.inf},
        Limits(joint_torques=False): {
            "joint_velocities": False,
            "chaser_attitude": math.inf,
            "joint_torques": False,
        },
        Objective(1.0, 0.0): {"joint_path_length": 1.0, "chaser_attitude": 0.0},
        Sphere("c1", np.ones(3), 0.5): {"id": "c1", "center": np.ones(3), "radius": 0.5},
    }
    for value, fields_said in told.items():
        expected = [part for pair in fields_said.items() for one in pair for part in canonical(one)]
        assert b"".join(canonical(value)) == b"".join(expected)


def test_a_refusal_of_a_joint_that_is_carried_beyond_its_limit_tells_what_was_measured(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    """A joint that nobody saw beyond its limit is no fault of the encoder."""
    start = lemur_capture.start
    rates = np.zeros(7)
    rates[4] = 0.05
    upper = lemur_capture.robot.upper_position_limits.copy()
    upper[4] = start.joint_positions[4] + 0.3
    problem = replace(
        lemur_capture,
        robot=replace(lemur_capture.robot, upper_position_limits=upper),
        start=replace(start, joint_velocities=rates),
        obstacles=(),
    )
    measured = start.joint_positions[4]
    with pytest.raises(InvalidInput) as refused:
        perform(PlanningTask(problem, settings, ahead=10.0))
    assert refused.value.field == "joints.position[joint_5]"
    assert str(refused.value).startswith(
        f"joints.position[joint_5] is {measured + 0.5:.6f} rad, measured as {measured:.6f} rad "
        "10.000 s before: it must be within the joint's limits"
    )
    upper[4] = measured - 0.1
    with pytest.raises(InvalidInput) as at_once:
        perform(PlanningTask(problem, settings))
    assert "measured" not in str(at_once.value)
