"""Recorded tasks with something changed: keys, values, and what comes of them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import answer_with, exchange, write_bag
from recorded_requests import only_request, recorded

from ff_planner_ros.cli import main
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.runs import what_if
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.what_if import changed_task, parsed

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def task(lemur_capture: PlanningProblem) -> PlanningTask:
    return PlanningTask(lemur_capture, SETTINGS)


@pytest.fixture(scope="module")
def bag(task: PlanningTask, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("what_if") / "bag"
    record_answer(directory, task, lemur_plan, 0.5)
    return directory


def with_changes(task: PlanningTask, *settings: str) -> PlanningTask:
    return changed_task(recorded(task, None), [parsed(one) for one in settings])


@pytest.mark.ci
def test_the_answer_is_that_of_the_changed_task(
    bag: Path,
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    capsys: pytest.CaptureFixture[str],
) -> None:
    changes = ("objective.joint_path_length=0", "objective.chaser_attitude=1", "points=30")
    options = [word for change in changes for word in ("--set", change)]
    assert main(["replay", str(bag), *options, "--set", "planner.joint_path_tie_break=0.01"]) == 0
    changed = replace(lemur_capture, objective=Objective(0.0, 1.0), points=30)
    wanted = perform(PlanningTask(changed, replace(SETTINGS, joint_path_tie_break=0.01)))
    lengths = [one.metrics.joint_path_length for one in (lemur_plan, wanted)]
    clearances = [one.metrics.min_clearance * 1e3 for one in (lemur_plan, wanted)]
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("bag "))
    assert "SOLVED > SOLVED" in row
    assert f"{lengths[0]:.4f} > {lengths[1]:.4f}" in row
    assert f"{clearances[0]:.2f} > {clearances[1]:.2f}" in row


def test_limits_and_duration_are_changed_in_every_request(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hurried = ["--set", "duration=1.5", "--set", "planner.starts=1"]
    for limits, status in (("none", "SOLVED"), ("from_urdf", "COLLISION")):
        options = [*hurried, "--set", f"limits.velocity={limits}"]
        assert main(["replay", str(bag), *options]) == 0
        assert f"SOLVED > {status}" in capsys.readouterr().out


def test_a_task_that_is_changed_to_what_it_is_stays_the_same(task: PlanningTask, bag: Path) -> None:
    recorded_task = only_request(bag)
    for setting in (f"points={task.problem.points}", "search.effort=0"):
        assert changed_task(recorded_task, [parsed(setting)]).digest == task.digest


def test_the_mass_of_a_link_is_changed(bag: Path, task: PlanningTask) -> None:
    masses = [
        sum(inertia.mass for inertia in one.problem.robot.model.inertias)
        for one in (task, changed_task(only_request(bag), [parsed("urdf.chaser.mass=1000")]))
    ]
    assert masses[1] > 1000.0 > masses[0] > 0.0


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("planner.start=5", ("planner.start ", "unknown", "starts")),
        ("robot.urdf=other.urdf", ("--set", "robot.urdf", "another scenario")),
        ("points", ("--set is points", "key=value")),
        ("planner.starts=0", ("planner.starts is 0", "from 1 to 1000")),
        ("planner.starts=2.5", ("planner.starts is 2.5", "whole number")),
        ("points=many", ("points is 'many'", "whole number")),
        ("duration=long", ("duration is 'long'", "number")),
        ("limits.velocity=no", ("limits.velocity is False", "from_urdf")),
        (
            "allowed_collisions.pairs=link_7/c1",
            ("allowed_collisions.pairs is 'link_7/c1'", "a list"),
        ),
        ("allowed_collisions.pairs=[1]", ("allowed_collisions.pairs[0] is 1",)),
        ("obstacles.nothing.radius=1", ("obstacles.nothing.radius", "no such value")),
        ("urdf.nothing.mass=1", ("urdf.nothing.mass", "links with a mass are chaser")),
    ],
)
def test_what_cannot_be_changed_so_is_refused_by_name(
    setting: str, words: tuple[str, ...], task: PlanningTask
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        with_changes(task, setting)
    for word in words:
        assert word in str(refusal.value)


def test_a_change_that_fits_no_task_is_refused(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With lines nothing may touch: that is how it is seen to arrive, without a search."""
    for change in ("allowed_collisions.pairs=[link_7/c1]", "planner.start=5"):
        assert main(["replay", str(bag), "--set", change]) == 2
        assert change.partition("=")[0] in capsys.readouterr().err
    assert main(["replay", str(bag), "--set", "points"]) == 2


def test_in_a_sequence_a_key_of_a_phase_means_the_first(task: PlanningTask) -> None:
    sequence = replace(task, then=(Phase(duration=5.0, target=Posture(at_rest=True)),))
    changed = with_changes(sequence, "duration=7.5", "points=30", "phases[1].duration=6")
    assert (changed.problem.duration, changed.problem.points) == (7.5, 30)
    assert [one.duration for one in changed.then] == [6.0]


def test_a_clock_that_ended_a_search_does_not_end_the_new_one(task: PlanningTask) -> None:
    then = (Phase(duration=5.0, target=Posture(at_rest=True), effort=9),)
    changed = with_changes(replace(task, then=then, effort=7), "points=30")
    assert [changed.effort, *(one.effort for one in changed.then)] == [0, 0]


def test_the_library_that_is_asked_for_is_used_and_else_the_guess_of_the_run(
    monkeypatch: pytest.MonkeyPatch, task: PlanningTask
) -> None:
    class Other:
        def __init__(self, path: Path, _: str) -> None:
            assert path == Path("other.npz")

        def first_guess(self, asked: PlanningTask) -> Any:
            assert asked.problem.points == 30
            return np.full(25, 2.0)

    monkeypatch.setattr(what_if, "load_library", Other)
    guessed = replace(task, first_guess=np.full(25, 1.0))
    for settings, wanted in (
        (["planner.library=other.npz", "points=30"], 2.0),
        (["planner.library="], None),
        (["planner.starts=3"], 1.0),
    ):
        guess = with_changes(guessed, *settings).first_guess
        assert (guess is None) == (wanted is None)
        assert guess is None or set(guess.tolist()) == {wanted}


def test_refused_attempts_have_numbers_and_others_have_none(
    task: PlanningTask,
    lemur_plan: Plan,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    attempt = NoPlanFound(Status.COLLISION, "too near", lemur_plan)
    record_answer(tmp_path / "bag", task, attempt, 0.5)
    far = ("planner.singular_value_threshold=0.9", "parametrisation=end_effector_polynomial")
    changes = [word for change in far for word in ("--set", change)]
    assert main(["replay", str(tmp_path / "bag"), *changes]) == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("bag "))
    assert f"COLLISION > START_SINGULAR  {lemur_plan.metrics.joint_path_length:.4f} > -" in row


def test_a_request_without_a_task_is_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused = answer_of(FfPlannerError(Status.NO_STATE, "none"), "run.7", 0.0)
    bag = write_bag(tmp_path / "bag", exchange(refused))
    assert main(["replay", str(bag), "--set", "points=30"]) == 0
    assert "note: run.7 is left out: the bag holds no task of it" in capsys.readouterr().out


def test_an_answer_is_told_in_radians_degrees_and_millimetres(lemur_plan: Plan) -> None:
    angles = {"max_chaser_euler": math.radians(12.5), "max_chaser_rotation": math.radians(14.25)}
    metrics = replace(lemur_plan.metrics, joint_path_length=2.5, min_clearance=0.0125, **angles)
    told = replace(lemur_plan, metrics=metrics)
    wanted = ("SOLVED", "2.5000", "12.500", "14.250", "12.50")
    assert what_if._cells(told) == wanted
    assert what_if._recorded_cells(answer_with(told)) == wanted
