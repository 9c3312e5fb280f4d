"""A library of plans behind the node: what is tried first, and that the bag tells it by itself."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from managed_node import Manager
from quick_capture import resting_capture
from ros_processes import Scene, connected_client, private_domain, running_planner

from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.planning.scenario.library_file import LIBRARY, load_library, save_library
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.library import StoredPlan, kind_and_place
from ff_planner_ros.planning.task.task import PlanningTask, perform

pytestmark = pytest.mark.ci

SETTINGS = load_parameters().planner
THERE = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)


def moved(problem: PlanningProblem, by: float) -> PlanningProblem:
    """Return a problem whose goal is elsewhere, by so many metres."""
    there = problem.target.position + by * np.array([0.0, 1.0, 0.0])
    return replace(problem, target=replace(problem.target, position=there))


def write_library(directory: Path) -> np.ndarray:
    """Write a library of one plan, and return its path's coefficients."""
    task = PlanningTask(resting_capture(), SETTINGS)
    coefficients = perform(task).coefficients
    save_library([StoredPlan(*kind_and_place(task), coefficients)], directory)
    return coefficients


def test_a_node_plans_from_its_library_and_the_bag_replays_without_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    library = tmp_path / "library"
    stored = write_library(library)
    near = moved(resting_capture(), 0.01)
    walled = Obstacle.sphere(
        "wall", near.target.position, 0.3
    )  # of another number of obstacles: not near
    asked = [near, near, replace(near, obstacles=(*near.obstacles, walled)), moved(near, 9.0)]
    used = ("-p", f"planner.library:={library / LIBRARY}", "-p", "allow_remote_paths:=true")
    starts = ("-p", "planning_lead_time:=60.0", "-p", "autostart:=false")
    with private_domain(), running_planner(tmp_path, *used, *starts) as planner:
        with connected_client() as client:
            manager = Manager(client)
            for wrong in (tmp_path / "none", Path(__file__), tmp_path):
                assert manager.set("planner.library", str(wrong)).successful
                assert manager.change(THERE[0]) == [False]
            assert manager.set("planner.library", str(library)).successful
            assert manager.change(*THERE) == [True, True]
            refused = manager.set("planner.library", "")
            assert not refused.successful
            assert "which is fixed while the node is configured" in refused.reason
            requests = [Scene(problem).complete_request() for problem in asked]
            for request in requests:
                # Or else the second one begins from the first one's plan, as far from its start
                # as the machine needs from one to the next.
                request.plan_only = True
            answers = [client.plan(requests[0]), client.send_goal(requests[1]).result()[1]]
            answers += [client.plan(request) for request in requests[2:]]
        assert planner.stop() == 0
        log = planner.log
    assert log.count("planner.library is ") == 3
    assert log.count("no library can be read there") == 3
    assert f"planner.library: 1 plans in {library}" in log
    codes = [one.status.code for one in answers]
    assert codes[:2] == [Status.SOLVED] * 2
    assert Status.SOLVED not in codes[2:]
    guesses = [np.array(one.inputs.first_guess) for one in answers]
    assert [len(guess) for guess in guesses] == [len(stored), len(stored), 0, 0]
    assert guesses[0].tobytes() == guesses[1].tobytes() == stored.tobytes()
    # What comes of the guess is another plan than what comes without one.
    task = PlanningTask(near, SETTINGS, ahead=60.0)
    warm, cold = perform(replace(task, first_guess=stored)), perform(task)
    planned = np.array([point.positions for point in answers[0].plans[0].joint_trajectory.points])
    off = [np.abs(planned - plan.trajectory.joint_positions).max() for plan in (warm, cold)]
    assert off[0] < 1e-6 < 1e-3 < off[1], off  # messages round the state

    shutil.rmtree(library)
    bag = planner.bag
    capsys.readouterr()
    assert main(["replay", str(bag)]) == 0
    said = capsys.readouterr().out
    assert "4 identical;" in said
    assert "digest was" not in said
    assert [one.row()["first_guess"] for one in read_plans(bag)] == ["library"] * 2 + [None] * 2
    assert main(["info", str(bag)]) == 0
    assert capsys.readouterr().out.count("first guess: library") == 2
    assert main(["export", str(bag), "--scenarios", str(tmp_path / "tasks")]) == 0
    for one in answers[:2]:
        answer, scenario = tmp_path / "answer.json", tmp_path / "tasks" / f"{one.plan_id}.yaml"
        assert main(["plan", str(scenario), "--json", str(answer)]) == 0
        assert json.loads(answer.read_text())["digest"] == one.task_digest
    # The other way: what a bag's plan would have been without, and with another library.
    for named in ("", str(tmp_path / "again")):
        write_library(tmp_path / "again")
        assert main(["replay", str(bag), "--set", f"planner.library={named}"]) == 0
    assert main(["replay", str(bag), "--set", f"planner.library={tmp_path}"]) == 2


@pytest.mark.nightly
def test_a_plan_that_is_written_to_a_bag_keeps_its_first_guess(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    library, bag = tmp_path / "library", tmp_path / "bag"
    write_library(library)
    scenario = tmp_path / "scenario.yaml"
    write_scenario(PlanningTask(moved(resting_capture(), 0.01), SETTINGS), scenario)
    words = ["plan", str(scenario), "--library", str(library), "--bag", str(bag)]
    assert main(words) == 0
    assert len(load_library(library).plans) == 1
    shutil.rmtree(library)
    assert main(["replay", str(bag)]) == 0
    assert "1 identical;" in capsys.readouterr().out
    page = tmp_path / "report.html"
    assert main(["report", str(bag), "--output", str(page)]) == 0
    assert page.read_text(encoding="utf-8").count("the path of a library's plan") == 1
