"""`ff-planner ask`: one request to a running node, answered as `plan` answers."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import robots
from _pytest.mark import ParameterSet
from managed_node import Manager
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
    wait_for,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem

ASK = (sys.executable, "-m", "ff_planner_ros.cli", "ask")
BRING = ("--bring", "state", "--bring", "obstacles")
PATIENT = ("-p", "state_max_age:=3600.0")  # a command takes seconds to start on a busy machine
CAPTURE = str(robots.LEMUR_SCENARIO)
# What a shell without job control does to what it starts with "&".
IN_BACKGROUND = ("sh", "-c", 'trap "" INT; exec "$@"', "sh")


@pytest.fixture(scope="module")
def world(
    tmp_path_factory: pytest.TempPathFactory, lemur_capture: PlanningProblem
) -> Iterator[tuple[PlannerProcess, Client]]:
    """Run a node that has received nothing yet but obstacles."""
    with (
        private_domain(),
        running_planner(tmp_path_factory.mktemp("asked"), *PATIENT) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        client.wait_for_an_answer()
        client.publish_obstacles(Scene(lemur_capture).obstacles())
        yield planner, client


def asked(*arguments: str) -> tuple[int, str, str]:
    """Return exit code, output and errors of a request."""
    done = subprocess.run(
        [*ASK, *arguments, "--timeout", str(DEADLINE)],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    return done.returncode, done.stdout, done.stderr


def solved(file: Path, *arguments: str) -> dict[str, Any]:
    code, out, err = asked(*arguments, "--json", str(file))
    assert code == 0, err
    answer: dict[str, Any] = json.loads(file.read_text())
    assert answer["plan_id"] in out
    assert answer["digest"] in out
    return answer


@pytest.mark.usefixtures("world")
def test_a_scenario_is_planned_by_the_node_to_its_goal(
    tmp_path: Path, lemur_capture: PlanningProblem
) -> None:
    answer = solved(tmp_path / "a.json", CAPTURE, *BRING, "--plan-only")
    assert answer["status"] == "solved"
    reached = np.array(answer["ee_positions"][-1])
    assert np.linalg.norm(reached - lemur_capture.target.position) < 1e-4
    assert answer["metrics"]["joint_path_length"] > 0.0


def test_a_plan_is_published_unless_only_the_plan_is_asked_for(
    world: tuple[PlannerProcess, Client], tmp_path: Path
) -> None:
    _, client = world
    kept = solved(tmp_path / "kept.json", CAPTURE, *BRING, "--plan-only")
    sent = solved(tmp_path / "sent.json", CAPTURE, *BRING)
    published = client.received["published_plan"]
    client.wait_until(lambda: published, "a published plan")
    assert [plan.plan_id for plan in published] == [sent["plan_id"]] != [kept["plan_id"]]
    assert published[-1].requester == "ff-planner ask"


@pytest.mark.usefixtures("world")
def test_what_is_set_counts_instead_of_the_scenario(tmp_path: Path) -> None:
    changes = ("--set", "duration=14", "--set", "points=20", "--set", "limits.chaser_rotation=0.5")
    answer = solved(tmp_path / "a.json", CAPTURE, *BRING, "--plan-only", *changes)
    assert len(answer["time"]) == 20
    assert answer["time"][-1] == pytest.approx(14.0, abs=1e-9)
    assert answer["metrics"]["max_chaser_rotation"] <= 0.5
    changes = ("--set", "target.chaser_rotation=0.01", "--set", "limits.chaser_rotation=0.5")
    answer = solved(tmp_path / "b.json", CAPTURE, *BRING, "--plan-only", *changes)
    assert answer["metrics"]["final_chaser_rotation"] <= 0.01 + 2e-6


def in_ci(*case: Any) -> ParameterSet:
    """A case that takes a process of its own, and is much like another."""
    return pytest.param(*case, marks=pytest.mark.ci)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((CAPTURE,), 2, "chaser_state is missing"),
        ((CAPTURE, *BRING, "--frame", "map"), 2, "frame_id is 'map': it must be 'inertial'"),
        in_ci((CAPTURE, "--set", "duration"), 2, "--set is duration: it must read key=value"),
        in_ci((CAPTURE, "--set", "colour=red"), 2, "allowed are target.position, "),
        in_ci((CAPTURE, "--set", "duration=soon"), 2, "duration is 'soon': it must be a number"),
        ((CAPTURE, "--set", "points=-1"), 2, "points is -1: it must be from 5 to 10000"),
        in_ci(("--bring", "state"), 2, "--bring is state: it goes with a scenario"),
        in_ci(
            (CAPTURE, "--time-budget", "0"), 2, "--time-budget is 0.0: it must be greater than 0"
        ),
        ((CAPTURE, *BRING, "--set", "target.position=[90, 0, 0]"), 3, "the arm reaches at most"),
        in_ci((CAPTURE, "--jsn", "a.json"), 2, "unrecognized arguments: --jsn"),
    ],
)
@pytest.mark.usefixtures("world")
def test_a_refusal_is_one_line_and_an_exit_code(
    arguments: tuple[str, ...], code: int, words: str
) -> None:
    ended, out, err = asked(*arguments)
    assert (ended, out) == (code, "")
    assert words in err


@pytest.mark.usefixtures("world")
def test_a_refusal_in_json_has_its_status(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    assert asked(CAPTURE, "--json", str(file))[0] == 2
    assert json.loads(file.read_text())["status"] == "no_state"


def test_a_goal_can_be_asked_for_without_a_scenario(
    world: tuple[PlannerProcess, Client], lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    _, client = world
    still = replace(
        lemur_capture.start,
        linear_velocity_chaser_in_inertial=np.zeros(3),
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(lemur_capture.robot.joints),
    )
    client.publish_and_wait(Scene(replace(lemur_capture, start=still)).state(client.now_ns()))
    target = lemur_capture.target
    settings = (
        f"target.position={target.position.tolist()}",
        f"target.quaternion_xyzw={target.quaternion_xyzw.tolist()}",
        "objective.joint_path_length=1",
        "duration=10",
    )
    answer = solved(tmp_path / "a.json", *(word for one in settings for word in ("--set", one)))
    assert np.linalg.norm(np.array(answer["ee_positions"][-1]) - target.position) < 1e-4


def test_where_no_node_runs_it_says_so() -> None:
    with private_domain():
        done = subprocess.run(
            [*ASK, CAPTURE, "--timeout", "0.1"], capture_output=True, text=True, timeout=DEADLINE
        )
    assert (done.returncode, done.stdout) == (2, "")
    assert "no node offers it within 0.1 s" in done.stderr


@pytest.mark.parametrize(
    ("number", "starter"),
    [
        (signal.SIGINT, ()),
        in_ci(signal.SIGINT, IN_BACKGROUND),
        in_ci(signal.SIGTERM, ()),
    ],
)
def test_whoever_stops_waiting_cancels_the_request(
    world: tuple[PlannerProcess, Client], number: signal.Signals, starter: tuple[str, ...]
) -> None:
    planner, client = world
    Manager(client).configure_with("planning_lead_time", 3600.0)
    client.wait_for_planner()
    # Stopped, the solvers end no search, however late a busy machine brings the signal.
    planner.send_to_solvers(signal.SIGSTOP)
    heard = client.received["exchanges"]
    before, points = len(heard), 999
    long = ("--time-budget", str(DEADLINE), "--set", f"points={points}")
    process = subprocess.Popen([*starter, *ASK, CAPTURE, *BRING, *long, "--timeout", str(DEADLINE)])

    def has_been_received() -> bool:
        assert process.poll() is None, "it ended before the signal"
        # Of requests before this one the node may tell late.
        return any(of.search.points == points for one in heard[before:] for of in one.request)

    try:
        wait_for(has_been_received, "a goal of the action")
        process.send_signal(number)
        assert process.wait(DEADLINE) == 130
    finally:
        process.kill()
        process.wait()
        planner.send_to_solvers(signal.SIGCONT)
    client.wait_until(lambda: heard[-1].answer, "the answer to the goal")
    assert heard[-1].event == "cancelled"
    assert heard[-1].answer[0].status.code == Status.CANCELLED
