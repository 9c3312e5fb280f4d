"""Whoever wants a plan enters the same function, with the same task for the same request."""

from __future__ import annotations

import ast
import sys
import time
from multiprocessing import Pipe
from pathlib import Path
from typing import NoReturn

import pytest
from robots import CONFIG, LEMUR_SCENARIO

from ff_planner_benchmark.bench.plans import SCENARIO_PLANS
from ff_planner_ros.cli import main
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task import task as door
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.requests import solver_process


@pytest.fixture
def entered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Digests of the tasks with which `perform` was entered; none of them is planned."""
    digests: list[str] = []

    def noted(*_: object) -> NoReturn:
        caller = sys._getframe(2)  # behind what plans a phase
        assert caller.f_code is perform.__code__
        digests.append(caller.f_locals["task"].digest)
        raise NoPlanFound(Status.COLLISION, "not looked for")

    monkeypatch.setattr(door, "as_it_begins", noted)
    return digests


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """The paper's capture two seconds ahead, with a tail."""
    capture = load_task(LEMUR_SCENARIO, Defaults(load_parameters().planner))
    task = PlanningTask(
        capture.problem,
        capture.settings,
        ahead=2.0,
        end_behaviour=EndBehaviour.STOP_JOINTS,
        tail=1.5,
    )
    path = tmp_path / "ahead.yaml"
    write_scenario(task, path)
    return path


@pytest.mark.law("NODE-21")
def test_command_line_solver_process_and_replay_enter_with_equal_tasks(
    scenario: Path, entered: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    assert main(["plan", str(scenario), "--bag", str(bag)]) == 3
    task = load_task(scenario, Defaults(load_parameters().planner))
    with Pipe()[1] as link:
        refusal = solver_process._answer(link, task, Budget(10.0), time.monotonic())
    assert isinstance(refusal, NoPlanFound)
    assert main(["replay", str(bag)]) == 0
    assert "digest" not in capsys.readouterr().out
    assert entered == 3 * [task.digest]


@pytest.mark.law("NODE-21")
def test_every_other_command_enters_it_too(
    scenario: Path, entered: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (["plan", "--method", "straight"], ["verify"]):
        assert main([*arguments, str(scenario)]) == 3
    assert len(set(entered)) == 1
    assert main(["plan", str(scenario), "--bag", str(tmp_path / "bag")]) == 3
    assert main(["replay", str(tmp_path / "bag"), "--set", "points=20"]) == 0
    assert len(set(entered)) == 2
    before = len(entered)
    main(["compare", str(LEMUR_SCENARIO), "--output", str(tmp_path)])
    assert len(entered) == before + 9
    next(iter(SCENARIO_PLANS.rows(1, load_parameters().planner)))
    assert len(entered) == before + 10
    capsys.readouterr()


def test_a_digest_is_in_every_answer_with_a_task(
    entered: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "answer.json"
    capture = CONFIG / "scenarios" / "lemur_capture.yaml"
    assert main(["plan", str(capture), "--json", str(file)]) == 3
    assert f'"digest": "{entered[0]}"' in file.read_text()
    capsys.readouterr()


@pytest.mark.law("PLAN-21")
def test_only_the_room_of_planning_judges_plans_and_words_refusals() -> None:
    package = Path(door.__file__).parents[2]
    for path in package.rglob("*.py"):
        if "planning" in path.parts:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.ImportFrom)
                and node.module == "ff_planner_ros.planning.check.check"
            ):
                judging = {alias.name for alias in node.names} - {"measure"}
                assert not judging, f"{path} must let `perform` judge"
