"""Recorded problems with something changed: keys, values, and what comes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.what_if import allowed_keys, parsed

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def bag(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    directory = tmp_path_factory.mktemp("what_if") / "bag"
    record_answer(directory, PlanningTask(lemur_capture, SETTINGS), lemur_plan, 0.5)
    return directory


@pytest.mark.ci
def test_the_answer_is_that_of_the_changed_problem(
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


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("planner.start=5", ("--set planner.start", "unknown", "planner.starts", "duration")),
        ("robot.urdf=other.urdf", ("--set robot.urdf", "unknown")),
        ("points", ("--set is points", "key=value")),
        ("planner.starts=0", ("planner.starts is 0", "at least 1")),
        ("planner.starts=2.5", ("planner.starts is 2.5", "whole number")),
        ("points=many", ("points is 'many'", "whole number")),
        ("duration=long", ("duration is 'long'", "number")),
        (
            "allowed_collisions.pairs=link_7/c1",
            ("allowed_collisions.pairs is 'link_7/c1'", "a list"),
        ),
        ("allowed_collisions.pairs=[1]", ("allowed_collisions.pairs[0] is 1",)),
        ("post_goal_duration=yes", ("post_goal_duration is True", "number", "[s]")),
    ],
)
def test_what_cannot_be_changed_so_is_refused_by_name(setting: str, words: tuple[str, ...]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        parsed(setting)
    for word in words:
        assert word in str(refusal.value)


def test_what_may_touch_at_the_goal_is_changed(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With lines nothing may: that is how it is seen to arrive, without a search."""
    changes = ("allowed_collisions.pairs=[link_7/c1]", "allowed_collisions.distance=0.2")
    assert [parsed(change).value for change in changes] == [["link_7/c1"], 0.2]
    for change in (changes[0], "allowed_collisions.distance=-1"):
        assert main(["replay", str(bag), "--set", change]) == 0
        assert "SOLVED > OUT_OF_RANGE" in capsys.readouterr().out


def test_a_word_that_is_none_is_refused_before_anything_is_planned(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(bag), "--set", "limits.velocity=no"]) == 2
    assert "limits.velocity is no: it must be from_urdf or none" in capsys.readouterr().err


def test_refused_attempts_have_numbers_and_others_have_none(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    attempt = NoPlanFound(Status.COLLISION, "too near", lemur_plan)
    record_answer(tmp_path / "bag", PlanningTask(lemur_capture, SETTINGS), attempt, 0.5)
    far = ("planner.singular_value_threshold=0.9", "parametrisation=end_effector_polynomial")
    changes = [word for change in far for word in ("--set", change)]
    assert main(["replay", str(tmp_path / "bag"), *changes]) == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("bag "))
    assert f"COLLISION > START_SINGULAR  {lemur_plan.metrics.joint_path_length:.4f} > -" in row


def test_every_setting_of_the_planner_may_be_changed() -> None:
    settings, robust = vars(SETTINGS).keys() - {"robust"}, vars(SETTINGS.robust)
    names = {*settings, *(f"robust.{name}" for name in robust)}
    assert {f"planner.{name}" for name in names} <= set(allowed_keys())
