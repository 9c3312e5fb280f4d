"""Planning ahead of a snapshot, against a drift in closed form and an independent engine."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
import pytest
from drawn_plans import drawn_plan
from robots import CONFIG, LEMUR_URDF, random_urdf

from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import a_number
from ff_planner_ros.errors import InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Progress, Watch
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Obstacle,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Posture,
    RigidMotion,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import (
    PlanningTask,
    attempted,
    perform,
    without_search,
)
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Base, Robot, load_robot, robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.payload import Payload
from ff_planner_ros.robot.wheels import Wheels
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
    strict = Controller(False, False)
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
    mild = Controller(True, False)
    picky = replace(mild, stopped_velocity_tolerance=0.01)
    alone, taken, not_taken = (
        PlanningTask(lemur_capture, settings, controller=c) for c in (None, mild, picky)
    )
    assert alone.digest == taken.digest != not_taken.digest


@pytest.mark.law("PLAN-32")
def test_the_controllers_rules_are_kept(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    strict = Controller(False, False)
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


@dataclass(frozen=True)
class Kept(Requirement):
    """A requirement of somebody else."""

    name: ClassVar[str] = "kept"
    distance: float = declare(a_number(), "a number")


def with_everything(settings: PlannerSettings, goal: str) -> PlanningTask:
    """A task in which nothing has its default: of a body that is captured, a pose or a posture."""
    task = load_task(CONFIG / "scenarios/whole_capture.yaml", Defaults(settings))
    problem, robot = task.problem, task.problem.robot
    rates = 0.1 * np.arange(1.0, 8.0)
    passing = Obstacle.sphere("passing", [9.0, 0.5, 1.0], 0.1, [0.1, 0.2, 0.3])
    box = Solid("box", np.array([0.5, 0.3, 0.2]))
    turning = Obstacle(
        "turning", box, RigidMotion([-9.0, 0.5, 1.0], [0.5] * 4, [0.1, 0.2, 0.3], [0.1] * 3)
    )
    along = Approach(np.array([0.0, 0.6, 0.8]), 0.3, 0.4)
    camera = Camera("link_7", np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.6, 0.8]), 0.5, 0.2)
    body = problem.target_body
    assert body is not None
    ball = AttachedObstacle.sphere("ball", np.array([0.1, 9.0, 0.2]), 0.1)
    problem = replace(problem, allowed_collisions=())
    problem = with_capture_target(replace(body, obstacles=(*body.obstacles[:2], ball)), problem)
    goals: dict[str, dict[str, Any]] = {
        "body": {},
        "pose": {"target_body": None, "obstacles": ()},
        "posture": {
            "target_body": None,
            "obstacles": (),
            "posture": Posture(0.1 * np.ones(7), 0.01 * np.ones(7)),
        },
    }
    if goal != "body":
        free_axis = {"orientation": Orientation.ABOUT_AXIS, "free_axis_in_ee": [0.0, 0.6, 0.8]}
        still = dict.fromkeys(("angular_velocity", "angular_acceleration"), np.zeros(3))
        goals[goal]["target"] = replace(problem.target, **free_axis, **still)
    problem = replace(problem, **goals[goal])
    problem = replace(
        problem,
        obstacles=(*problem.obstacles, passing, turning),
        start=replace(problem.start, joint_accelerations=0.01 * rates),
        limits=Limits(True, 0.5, tuple(rates.tolist()), True, 0.6, 20.0, 30.0, 0.4),
        objective=Objective(1.0, 0.5, 0.2, 0.1),
        duration_range=DurationRange(0.5 * problem.duration, 2.0 * problem.duration, [0.1] * 3),
        parametrisation=Parametrisation.JOINT_SPLINE,
        approach=along if problem.posture is None else None,
        camera=camera if problem.posture is None else None,
        allowed_collisions=("link_7/passing",),
        contact_distance=0.07,
        requirements=(Kept(0.3),),
    )
    held = Payload("end_effector", 3.0, np.diag([1.0, 2.0, 2.5]), np.array([0.1, 0.2, 0.3]))
    then = (
        Phase(2.0, target=problem.target, approach=along, camera=camera, payload=held, effort=5),
        Phase(DurationRange(1.0, 2.0), target=Posture(0.1 * np.ones(7), 0.01 * np.ones(7))),
        Phase(3.0, target_body=body, allowed_collisions=("link_7/passing",), contact_distance=0.07),
    )
    running = joint_motion(drawn_plan(robot, seed=1).trajectory, -1.0)
    robust = replace(settings.robust, sigmas=3.0)
    return PlanningTask(
        problem,
        replace(settings, robust=robust, capture_turn_rate_tolerance=0.01),
        ahead=0.5,
        running=running,
        running_goal=7.0,
        end_behaviour=EndBehaviour.STOP_JOINTS,
        tail=2.0,
        controller=Controller(False, True, 0.01),
        first_guess=np.arange(1.0, 19.0),
        effort=7,
        then=then,
    )


def altered(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a copy for each number, word and part below a value with that alone changed."""
    if is_dataclass(value) and not isinstance(value, Robot):
        kept = {item.name: getattr(value, item.name) for item in fields(value)}
        for name, part in kept.items():
            for place, other in altered(part):
                one = object.__new__(type(value))  # whatever the class allows
                for each, as_it_is in (kept | {name: other}).items():
                    object.__setattr__(one, each, as_it_is)
                yield f".{name}{place}", one
    elif isinstance(value, tuple | list):
        for number, entry in enumerate(value):
            for place, other in altered(entry):
                yield f"[{number}]{place}", (*value[:number], other, *value[number + 1 :])
        if value:
            yield " without the last", tuple(value[:-1])
    else:
        yield from otherwise(value)


def otherwise(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield other numbers, words and entries of an array than a value's."""
    match value:
        case np.ndarray():
            places = list(np.ndindex(value.shape))
            for place in places if len(places) < 10 else (places[0], places[-1]):
                other = value.copy()
                other[place] += 0.25
                yield str(list(place)), other
        case StrEnum():
            yield "", next(one for one in type(value) if one is not value)
        case bool():
            yield "", not value
        case str():
            yield "", f"{value} too"
        case int() | float():
            yield "", value + 1


NOT_DIGESTED = (".threads", ".ee_at_rest")
# Of an obstacle that is fixed to a body.
FOLLOWS_FROM_BODY = r"\.problem\.obstacles\[(\d)\]\.motion.*"


@pytest.mark.parametrize("goal", ["body", "pose", "posture"])
def test_nothing_that_a_plan_depends_on_is_left_out_of_the_digest(
    settings: PlannerSettings, goal: str
) -> None:
    """Each number and word of a task alone; what is fixed to a body follows from the body.

    The number of processes changes no plan. Why joint velocities are what they are is for messages.
    """
    task = with_everything(settings, goal)
    fixed = {k for k, one in enumerate(task.problem.obstacles) if one.body is not None}
    digests, same = {task.digest: ""}, list[str]()
    for place, other in altered(task):
        digest = other.digest
        if digest == task.digest:
            same.append(place)
            continue
        twin = digests.setdefault(digest, place)
        assert twin == place or ".obstacles" in place, (twin, place)
    for place in (one for one in same if not one.endswith(NOT_DIGESTED)):
        number = re.fullmatch(FOLLOWS_FROM_BODY, place)
        follows = number is not None and int(number[1]) in fixed
        assert follows or (goal != "pose" and place.startswith(".problem.target.")), place
    assert len(digests) > 300


def test_nothing_of_a_robot_that_a_plan_depends_on_is_left_out_of_its_digest() -> None:
    wheels = Wheels(np.vstack([np.eye(3), np.ones(3)]), (1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0))
    held = robot_from_urdf_text(random_urdf(6, 1), "bus", "tool", Base.ATTITUDE_HELD, wheels=wheels)
    sliding = robot_from_urdf_text(random_urdf(4, 1, (2,)), "bus", "tool", slide_weight=2.0)
    shaped = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.SHAPES)
    for robot, names in (
        (held, ("base", "wheels", "urdf", "base_link", "tip_link")),
        (sliding, ("joint_weights",)),
        (shaped, ("geometry", "pairs")),
    ):
        for name in names:
            for place, other in altered(getattr(robot, name)):
                changed = replace(robot, **{name: other})
                assert digest_of(changed) != digest_of(robot), (name, place)


def test_zeros_of_either_sign_are_one_to_a_digest() -> None:
    """A message drops the sign of an obstacle that rests."""
    solid, place = Solid("box", np.ones(3)), np.zeros(3)
    rests = Obstacle("b", solid, RigidMotion(place))
    negative = Obstacle("b", solid, RigidMotion(-place, velocity=-place))
    assert digest_of(rests) == digest_of(negative)
    assert digest_of(Obstacle.sphere("s", place, 1.0)) == digest_of(
        Obstacle.sphere("s", -place, 1.0)
    )


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
        "10.000 s before: at the start joint joint_5 is at "
    )
    upper[4] = measured - 0.1
    with pytest.raises(InvalidInput) as at_once:
        perform(PlanningTask(problem, settings))
    assert "measured" not in str(at_once.value)
