"""What an operator is told of an attempt that does not meet its constraints."""

from __future__ import annotations

import ast
import pickle
import re
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import CONFIG
from shared_plans import planned

import ff_planner_ros
from ff_planner_ros.common.declared import declared
from ff_planner_ros.errors import BagError, Failure, FfPlannerError, OutOfTime, Status
from ff_planner_ros.parameters import DECLARATIONS, load_parameters
from ff_planner_ros.planning.check.check import failures, refusal
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.limits import ChaserGoal
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Obstacle,
    Orientation,
    PlanningProblem,
    Posture,
    Target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.capture_impulse import CaptureImpulse
from ff_planner_ros.planning.requirements.limits.wheels import WheelLimits
from ff_planner_ros.planning.requirements.requirement import ANOTHER_DURATION, Samples
from ff_planner_ros.planning.scenario.scenario import load_scenario, scenario_schema


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def sound(lemur_capture: PlanningProblem, settings: PlannerSettings) -> Plan:
    return planned(lemur_capture, settings)


def exacting(settings: PlannerSettings) -> PlannerSettings:
    """Return settings whose tolerances no plan meets."""
    return replace(
        settings,
        position_tolerance=1e-12,
        orientation_tolerance=1e-12,
        singular_value_threshold=1.0,
    )


def inaccurate(sound: Plan) -> Plan:
    """Return a plan with wrong torques and a jump at the start, which changes its momentum."""
    motion = sound.trajectory
    rates = motion.joint_velocities.copy()
    rates[0, -1] += 0.02
    spoilt = {"joint_velocities": rates, "joint_torques": motion.joint_torques + 0.1}
    return replace(sound, trajectory=replace(motion, **spoilt))


def cramped(problem: PlanningProblem, sound: Plan) -> PlanningProblem:
    """Return a problem of which the sound plan violates nearly everything."""
    robot = problem.robot
    return replace(
        problem,
        robot=replace(
            robot,
            upper_position_limits=robot.upper_position_limits - 3.0,
            velocity_limits=robot.velocity_limits / 100.0,
            effort_limits=robot.effort_limits / 100.0,
        ),
        obstacles=(Obstacle.sphere("bolt", sound.trajectory.ee_positions[25], 0.05),),
        limits=Limits(joint_velocities=True),
    )


def test_a_sound_plan_has_none(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    assert failures(lemur_capture, sound, settings) == ()


@pytest.mark.law("PLAN-28")
def test_every_constraint_is_told_and_the_first_gives_the_status(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    problem = cramped(lemur_capture, sound)
    found = failures(problem, inaccurate(sound), exacting(settings))
    assert [failure.status for failure in found] == [
        Status.COLLISION,
        Status.LIMIT_VIOLATED,
        Status.LIMIT_VIOLATED,
        Status.SINGULAR,
        Status.TORQUE_TOO_HIGH,
        *[Status.CHECK_FAILED] * 5,
    ]
    error = refusal(sound, found)
    assert error.status is Status.COLLISION
    assert error.attempt is sound
    for failure in found:
        assert failure.finding in str(error)
        for word in failure.advice:
            assert str(error).count(word) >= 1 or word == ANOTHER_DURATION
    # Both position and velocity limits say so, the operator reads it once.
    assert str(error).count("more planner.starts") == 1


GOALS: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "pose": ({}, "another goal orientation or start posture", ("posture at",)),
    "place": ({"orientation": Orientation.FREE}, "another goal or start posture", ("orientation",)),
    "posture": (
        {"posture": Posture(np.zeros(7))},
        "another goal or start posture",
        ("orientation", "nearer"),
    ),
    "rest": ({"posture": Posture(at_rest=True)}, "another start posture", ("goal",)),
}


@pytest.mark.parametrize("goal", GOALS)
def test_advice_is_of_what_the_goal_has_and_is_given_once(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings, goal: str
) -> None:
    """A place has no orientation to change, rest no goal, and a posture is no nearer."""
    changes, other, never = GOALS[goal]
    problem = cramped(lemur_capture, sound)
    if "orientation" in changes:
        target = Target(problem.target.position, [0.0, 0.0, 0.0, 1.0], **changes)
        changes = {"target": target}
    plan, judged_by = inaccurate(sound), exacting(settings)
    if "posture" in changes:  # of which no pose of the end effector is asked
        plan, judged_by = replace(sound, family="joint_spline"), settings
    error = refusal(plan, failures(replace(problem, **changes), plan, judged_by))
    advice = str(error).partition("What may help: ")[2].split(", ")
    assert other in advice
    assert not [word for word in advice for part in never if part in word]
    assert len(set(advice)) == len(advice)
    assert ANOTHER_DURATION not in advice  # a longer one is in it
    assert "a longer duration" in advice


@pytest.mark.parametrize("wide", ["capture_velocity_tolerance", "capture_turn_rate_tolerance"])
def test_a_tolerance_that_is_zero_already_cannot_be_smaller(
    settings: PlannerSettings, wide: str
) -> None:
    problem = load_scenario(CONFIG / "scenarios/panel_capture.yaml")
    motion = planned(problem, settings).trajectory
    heavy = replace(problem.target_body, mass=50.0)
    limited = replace(problem, target_body=heavy, limits=Limits(capture_impulse=1e-6))
    samples = Samples(limited, replace(settings, **{wide: 0.01}), motion)
    (failure,) = CaptureImpulse().assess(samples).failures
    assert failure.advice == (f"a smaller planner.{wide}", "another posture at the goal")


def test_wheels_that_hold_nothing_cannot_hold_less_at_the_start() -> None:
    problem = load_scenario(CONFIG / "scenarios/lemur_wheels.yaml")
    for held, told in ((np.zeros(3), False), (np.array([0.0, 0.1, 0.0]), True)):
        start = replace(problem.start, wheel_momenta=held)
        momenta, torques = WheelLimits().limits(replace(problem, start=start))
        assert ("wheels that hold less at the start" in momenta.advice) is told
        assert "a larger objective.wheel_momentum" in momenta.advice
        assert torques.advice == ("a longer duration", "more planner.starts")


def test_every_key_that_a_message_names_is_one_that_the_user_may_write() -> None:
    """Of all text of the rooms that refuse: keys of scenarios, parameters, paths in messages."""

    def keys(schema: Any, prefix: str = "") -> Iterator[str]:
        for name, one in schema.get("properties", {}).items():
            yield f"{prefix}{name}"
            yield from keys(one, f"{prefix}{name}.")
        for one in (*schema.get("anyOf", ()), *filter(None, [schema.get("items")])):
            yield from keys(one, prefix)

    known = {*keys(scenario_schema())}
    heads = "|".join(key for key in known if "." not in key)
    places = (one for kind in (PlanningProblem, ChaserGoal) for one in declared(kind).values())
    known |= {*DECLARATIONS, *(str(one.message).removesuffix("[0]") for one in places)}
    named = re.compile(rf"(?<![\w./])(?:{heads})\.[a-z_]+(?:\.[a-z_]+)*")
    root, found = Path(ff_planner_ros.__file__).parent, dict[str, str]()
    for path in (one for room in ("planning", "robot") for one in (root / room).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        prose = {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
        for one in ast.walk(tree):
            if isinstance(one, ast.Constant) and isinstance(one.value, str):
                words = [] if id(one) in prose else named.findall(one.value)
                found |= dict.fromkeys(words, str(path.relative_to(root)))
    assert len(found) > 50
    assert {key: place for key, place in found.items() if key not in known} == {}


def test_the_number_of_attempts_is_told(sound: Plan) -> None:
    failure = Failure(Status.COLLISION, "c1 is in the way", ("more points",))
    solver = replace(sound.solver, starts=8)
    assert str(refusal(replace(sound, solver=solver), [failure])) == (
        "no plan found in 8 attempts; in the best, c1 is in the way. What may help: more points"
    )
    assert str(refusal(sound, [failure])) == (
        "no plan found in the only attempt, c1 is in the way. What may help: more points"
    )
    assert str(refusal(sound, [failure], advice=["patience", "luck"])) == (
        "no plan found in the only attempt, c1 is in the way. What may help: patience, luck"
    )


def test_a_constraint_that_is_not_met_at_the_goal_is_told_as_the_goals(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    """Another posture or another way cannot help: the goal must change."""
    clamp = Obstacle.sphere("clamp", sound.trajectory.ee_positions[-1], 0.01)
    (failure,) = failures(replace(lemur_capture, obstacles=(clamp,)), sound, settings)
    assert "inside obstacle clamp at the goal, t = 10.00 s of 10 s" in failure.finding


@pytest.mark.parametrize(("depth", "told"), [(0.001, True), (0.01, False)])
def test_a_smaller_margin_is_advised_where_it_can_make_the_difference(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings, depth: float, told: bool
) -> None:
    tip = sound.trajectory.ee_positions[-1]
    toward_arm = sound.trajectory.ee_positions[-2] - tip
    beyond = tip - 0.2 * toward_arm / np.linalg.norm(toward_arm)
    sphere = Obstacle.sphere("dish", beyond, _distance(lemur_capture, sound, beyond) + depth)
    (failure,) = failures(replace(lemur_capture, obstacles=(sphere,)), sound, settings)
    assert f"{depth:g} m inside obstacle dish" in failure.finding
    assert ("a smaller planner.clearance_margin" in failure.advice) is told


def _distance(problem: PlanningProblem, sound: Plan, place: Any) -> float:
    """How near the arm comes to a place at its points."""
    q, _ = from_trajectory(problem.robot, sound.trajectory)
    positions = arm_points(problem.robot, q)
    point = Obstacle.sphere("point", place, 1e-9)
    return float(
        clearances(positions, sound.trajectory.time, segments(positions), [point]).distance.min()
    )


def test_a_collision_between_the_points_is_told_as_such(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    """At the times that the check looks at, a sphere is as good as touched."""
    place = sound.trajectory.ee_positions[25] + [0.0, 0.0, 0.1]
    motion = Samples(lemur_capture, settings, sound.trajectory).followed
    arm = arm_points(lemur_capture.robot, motion.q)
    point = Obstacle.sphere("point", place, 1e-9)
    near = clearances(arm, motion.time, segments(arm), [point]).distance.min()
    dish = Obstacle.sphere("dish", place, float(near) - 6.5e-5)
    (failure,) = failures(replace(lemur_capture, obstacles=(dish,)), sound, settings)
    assert "may touch obstacle dish" in failure.finding
    assert re.search(r"all that is certain is a clearance of -0\.\d+ mm", failure.finding)
    assert "more points" in failure.advice


def test_a_refusal_crosses_processes_with_its_attempt_and_all_failures(lemur_plan: Plan) -> None:
    failures = (
        Failure(Status.COLLISION, "the arm touches a sphere", ("more points",)),
        Failure(Status.CHECK_FAILED, "the goal is missed", ()),
    )
    copy = pickle.loads(pickle.dumps(refusal(lemur_plan, failures)))
    assert (copy.status, copy.failures) == (Status.COLLISION, failures)
    assert str(copy) == copy.constraint == str(refusal(lemur_plan, failures))
    assert copy.attempt.metrics == lemur_plan.metrics
    for item in fields(Trajectory):
        expected = getattr(lemur_plan.trajectory, item.name)
        assert np.array_equal(getattr(copy.attempt.trajectory, item.name), expected)


@pytest.mark.parametrize("error", [OutOfTime("no time is left"), BagError("the bag is damaged")])
def test_an_error_of_one_status_crosses_processes(error: FfPlannerError) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), copy.status, str(copy)) == (type(error), error.status, str(error))


def test_a_clearance_tells_what_it_is_of_and_when(lemur_plan: Plan) -> None:
    near = replace(
        lemur_plan.metrics,
        min_self_clearance=0.0042,
        min_self_clearance_pair="chaser/link_7",
        min_self_clearance_time=3.456,
    )
    assert near.told("min_self_clearance") == "4.2 mm, chaser/link_7 at 3.46 s"
    assert lemur_plan.metrics.told("min_self_clearance") == "no pairs"
    line, obstacle = lemur_plan.metrics.min_clearance_pair.split("/")
    assert (line, obstacle) == ("joint_4-joint_5", "c2")


@pytest.mark.parametrize(
    ("value", "words"), [(0.0123, "12.3 mm"), (np.inf, "no obstacles"), (np.nan, "none")]
)
def test_a_clearance_in_words_says_when_there_is_nothing_to_be_clear_of(
    value: float, words: str
) -> None:
    assert METRIC_BY_NAME["min_clearance"].text(value) == words
