"""A real planner's run, from its bag alone: every answer comes again, and what differs is found."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState, PlanAnswer, PlanRequest
from ff_planner_msgs.msg import Exchange as ExchangeMessage
from rclpy.serialization import deserialize_message
from ros_processes import (
    DEADLINE,
    FRAME,
    Client,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)
from std_msgs.msg import Header

from ff_planner_ros.bag.exchanges import Exchange, exchanges
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import Message, open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.runs.replay import Verdict, replay

LEAD_NS = 60_000_000_000
NO_PROBLEM = ("busy", "cancelled")


@dataclass(frozen=True)
class Run:
    """A bag, and which plan id belongs to what was tried."""

    bag: Path
    plan_ids: dict[str, str]
    recorded: list[Exchange]
    notes: tuple[str, ...]

    def request(self, name: str) -> Exchange:
        (found,) = (one for one in self.recorded if one.plan_id == self.plan_ids[name])
        return found


@pytest.fixture(scope="module")
def run(lemur_capture: PlanningProblem, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return _recorded(lemur_capture, tmp_path_factory, _everything)


@pytest.fixture(scope="module")
def strict(lemur_capture: PlanningProblem, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A node with margins for errors, whose controller takes no motion at the end."""
    settings = (
        "planner.robust.sigmas:=3.0",
        "planner.clearance_margin:=0.01",
        "controller.allow_nonzero_velocity_at_trajectory_end:=false",
    )
    return _recorded(lemur_capture, tmp_path_factory, _strictly, *settings)


def _recorded(
    problem: PlanningProblem,
    directories: pytest.TempPathFactory,
    ask: Callable[[Client, Scene], dict[str, Any]],
    *settings: str,
) -> Run:
    """Return the run of a node with these parameters that is asked for plans."""
    given = "state_max_age:=60.0", "state_future_tolerance:=600.0", *settings
    arguments = [word for one in given for word in ("-p", one)]
    scene, directory = Scene(problem), directories.mktemp("replay")
    with private_domain(), running_planner(directory, *arguments) as planner:
        with connected_client() as client:
            client.publish_obstacles(scene.obstacles())
            client.wait_for_planner()
            answers = ask(client, scene)
        assert planner.stop() == 0
    with open_bag(planner.bag) as bag:
        recorded = list(exchanges(bag))
        notes = bag.notes
    plan_ids = {name: one.plan_id for name, one in answers.items()}
    return Run(planner.bag, plan_ids, recorded, notes)


def _in_time(client: Client, scene: Scene) -> PlanRequest:
    """Return a complete request that is not late even where a plan takes a minute."""
    asked, start_ns = scene.complete_request(), client.now_ns() + LEAD_NS
    asked.start_time = time_message(start_ns)
    asked.start_state[0].header.stamp = time_message(start_ns - 2_000_000_000)
    return asked


def _strictly(client: Client, scene: Scene) -> dict[str, Any]:
    at_rest = _in_time(client, scene)
    at_rest.end_behaviour = "stop_joints"
    _, robust = client.send_goal(at_rest).result()
    return {"robust": robust, "controller": client.plan(_in_time(client, scene))}


def _everything(client: Client, scene: Scene) -> dict[str, Any]:
    answers: dict[str, Any] = {}
    stamp_ns = client.now_ns() + LEAD_NS
    client.publish_and_wait(scene.state(stamp_ns))
    asked = scene.request()
    asked.start_time = time_message(stamp_ns)
    answers["from topics"] = first = client.plan(asked)

    # The arm is where that plan wants it to be: the next plan begins on it.
    state = _on_the_way(first, point=10)
    client.publish_state(state)
    asked = scene.request()
    asked.start_time = time_message(nanoseconds(state.header.stamp) + 500_000_000)
    unreachable = deepcopy(asked)  # or else there is another plan while the state travels
    unreachable.goal.pose.pose.position.x = 10.0
    stamp = state.header.stamp
    client.plan_until(unreachable, lambda answer: answer.inputs.state_stamp == stamp)
    answers["following"] = client.plan(asked)

    complete = _in_time(client, scene)
    complete.end_behaviour = "hold_end_effector"
    answers["complete"] = client.plan(complete)
    attitude = _in_time(client, scene)
    attitude.objective.joint_path_length, attitude.objective.chaser_attitude = 0.5, 0.5
    _, answers["action"] = client.send_goal(attitude).result()

    negative = _in_time(client, scene)
    negative.duration = -1.0
    answers["negative"] = client.plan(negative)
    blocked = _in_time(client, scene)
    blocked.scene[0].spheres[0].radius = 10.0
    answers["blocked"] = client.plan(blocked)
    hasty = _in_time(client, scene)
    hasty.search.time_budget = 0.001
    answers["hasty"] = client.plan(hasty)

    long = _in_time(client, scene)
    long.search.points = 5000
    goal = client.send_goal(long)
    assert goal.progress.wait(DEADLINE)
    answers["busy"] = client.plan(_in_time(client, scene))
    assert goal.cancel()
    _, answers["cancelled"] = goal.result()
    return answers


def _on_the_way(answer: PlanAnswer, point: int) -> ChaserState:
    """The state that a plan predicts for one of its points."""
    (plan,) = answer.plans
    pose, joints = plan.chaser_path.poses[point], plan.joint_trajectory
    return ChaserState(
        header=Header(stamp=pose.header.stamp, frame_id=FRAME),
        pose=pose.pose,
        twist=plan.chaser_twists[point],
        joint_names=joints.joint_names,
        joint_positions=joints.points[point].positions,
        joint_velocities=joints.points[point].velocities,
    )


def copied(bag: Path, target: Path, change: Callable[[Message], bytes | None]) -> Path:
    """Copy a bag; messages are changed, or left out where the change is None."""
    with open_bag(bag) as source, BagWriter(target, flush_interval=0.0) as copy:
        for name, content in source.attachments.items():
            copy.attach(name, "text/plain", content)
        for name, record in source.metadata.items():
            if name != "rosbag2":
                copy.add_record(name, record)
        for topic in source.topics.values():
            copy.add_topic(topic.name, topic.type_name, [])
        for message in source.messages():
            cdr = change(message)
            if cdr is not None:
                copy.write(message.topic, cdr, message.log_time_ns, message.publish_time_ns)
    return target


def test_the_runs_had_everything_that_a_replay_must_cope_with(run: Run, strict: Run) -> None:
    statuses = {name: one.request(name).status for one in (run, strict) for name in one.plan_ids}
    assert statuses == {
        "from topics": Status.SOLVED,
        "following": Status.SOLVED,
        "complete": Status.SOLVED,
        "action": Status.SOLVED,
        "negative": Status.OUT_OF_RANGE,
        "blocked": Status.START_IN_COLLISION,
        "hasty": Status.TIMED_OUT,
        "busy": Status.BUSY,
        "cancelled": Status.CANCELLED,
        "robust": Status.SOLVED,
        "controller": Status.CONTROLLER_CONSTRAINT,
    }
    assert {one.interface for one in run.recorded} == {"service", "action"}
    assert run.recorded[0].status is Status.NO_STATE


@pytest.mark.law("BAG-01")
def test_every_answer_tells_what_it_was_made_from(run: Run) -> None:
    assert run.notes == ()
    told = {name: run.request(name).answer.inputs for name in run.plan_ids}
    times = {name: nanoseconds(inputs.received_stamp) for name, inputs in told.items()}
    assert times.pop("busy") == 0
    assert list(times.values()) == sorted(set(times.values()))
    assert times["from topics"] > 0
    followed = {name: inputs.previous_plan_id for name, inputs in told.items()}
    assert followed["following"] == run.plan_ids["from topics"]
    assert followed["from topics"] == ""
    # On a slow machine, the state that a request brings may be one on the plan before.
    assert set(followed.values()) <= {"", *run.plan_ids.values()}
    sources = {name: inputs.state_source for name, inputs in told.items()}
    assert sources["from topics"] == sources["following"] == "chaser_state"
    assert (sources["negative"], sources["blocked"]) == ("start_state", "start_state")


def test_every_request_has_its_times_by_the_clock_of_the_node(run: Run) -> None:
    for one in run.recorded:
        assert 0 < one.asked_ns <= one.answered_ns, one.plan_id


@pytest.mark.law("BAG-02")
def test_every_answer_comes_again_to_the_last_bit(run: Run, strict: Run) -> None:
    """But for those to requests that were refused before their task was complete."""
    replayed = {one.plan_id: replay(one) for one in run.recorded}
    without_task = {one.plan_id for one in run.recorded if not one.task}
    for plan_id, one in replayed.items():
        wanted = Verdict.NOT_PLANNED if plan_id in without_task else Verdict.IDENTICAL
        if plan_id in {run.plan_ids[name] for name in NO_PROBLEM}:
            wanted = Verdict.NOT_PLANNED
        words = plan_id, one.verdict, one.words, *map(str, one.differences)
        assert one.verdict is wanted, words
    planned = {name for name, plan_id in run.plan_ids.items() if plan_id not in without_task}
    assert planned >= run.plan_ids.keys() - {"busy", "cancelled", "negative"}
    hasty = replayed[run.plan_ids["hasty"]].again  # here a step ends the search, and not a clock
    assert isinstance(hasty, NoPlanFound)
    assert hasty.status is Status.TIMED_OUT
    assert hasty.effort >= 1
    for told in strict.recorded:
        wanted = Verdict.IDENTICAL if told.task else Verdict.NOT_PLANNED
        assert replay(told).verdict is wanted, told.plan_id


def test_the_tasks_are_those_of_then(run: Run, strict: Run) -> None:
    following = run.request("following").planned_task()
    assert following.running is not None
    assert following.ahead == pytest.approx(0.5)
    assert run.request("from topics").planned_task().running is None
    complete = run.request("complete").planned_task()
    assert (complete.end_behaviour, complete.tail) == (EndBehaviour.HOLD_END_EFFECTOR, 2.0)
    tasks = [one.planned_task() for one in (run.request("action"), strict.request("robust"))]
    assert [one.settings.clearance_margin for one in tasks] == [0.002, 0.01]
    assert [one.settings.robust.sigmas for one in tasks] == [0.0, 3.0]


def test_what_a_robust_plan_keeps_and_costs_is_told(run: Run, strict: Run) -> None:
    plain, robust = run.request("from topics").answer, strict.request("robust").answer
    assert "sigmas" not in plain.status.message
    assert "sigmas, 3 required; joint path +0." in robust.status.message


def test_every_task_has_the_digest_that_the_node_told(run: Run) -> None:
    for one in run.recorded:
        assert bool(one.task) == bool(one.answer.task_digest), one.plan_id
        if one.task:
            assert one.planned_task().digest == one.answer.task_digest


def spoiling(plan_id: str, change: Callable[[Any], None]) -> Callable[[Message], bytes]:
    """Return what changes the answer of one request in a bag."""

    def spoil(message: Message) -> bytes:
        if message.topic == "/exchanges":
            told = deserialize_message(message.cdr, ExchangeMessage)
            if told.plan_id == plan_id and told.answer:
                change(told)
                return encode(told)
        return message.cdr

    return spoil


def test_another_task_than_the_recorded_one_is_named(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = run.plan_ids["complete"]

    def another(told: Any) -> None:
        told.answer[0].task_digest = "0123456789abcdef"

    main(["replay", str(copied(run.bag, tmp_path / "spoilt", spoiling(wanted, another)))])
    (line,) = (one for one in capsys.readouterr().out.splitlines() if "digest" in one)
    assert wanted in line
    assert "digest of the task was 0123456789abcdef, is" in line


def test_a_request_without_a_task_is_not_exported(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export = ["export", str(run.bag), "--scenarios", str(tmp_path / "scenarios")]
    assert main(export) == 0
    notes = capsys.readouterr().err
    assert f"{run.plan_ids['negative']} is left out: task is missing" in notes
    assert main(export) == 2, "it is there"


@pytest.mark.law("BAG-02")
@pytest.mark.parametrize(
    ("which", "names"),
    [
        ("run", ("from topics", "following", "complete", "action")),
        ("strict", ("robust", "controller")),
    ],
)
def test_an_exported_request_is_planned_again_to_the_last_bit(
    which: str, names: tuple[str, ...], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run: Run = request.getfixturevalue(which)
    directory, file = tmp_path / "scenarios", tmp_path / "answer.json"
    assert main(["export", str(run.bag), "--scenarios", str(directory)]) == 0
    for name in names:
        response = run.request(name).answer
        scenario = directory / f"{run.plan_ids[name]}.yaml"
        code = main(["plan", str(scenario), "--json", str(file)])
        answer = json.loads(file.read_text())
        assert answer["status"] == Status(response.status.code).name.lower()
        assert answer["digest"] == response.task_digest
        assert code == (0 if response.status.code == Status.SOLVED else 3)
        if code:
            assert answer["message"] == response.status.message
            continue
        motion = plan_from_answer(response).trajectory
        for quantity in ("joint_positions", "joint_torques", "chaser_positions", "ee_positions"):
            assert np.array(answer[quantity]).tobytes() == getattr(motion, quantity).tobytes()


def test_a_joint_position_that_was_another_one_is_found_with_its_amount(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = run.plan_ids["complete"]

    def moved(told: Any) -> None:
        told.answer[0].plans[0].joint_trajectory.points[7].positions[2] += 0.00125

    spoilt = copied(run.bag, tmp_path / "spoilt", spoiling(wanted, moved))
    assert main(["replay", str(spoilt)]) == 3
    (row,) = (line for line in capsys.readouterr().out.splitlines() if wanted in line)
    assert "DIFFERENT: joint_positions by 0.00125 rad at point 7, joint 3" in row


def test_nothing_but_its_exchanges_and_the_robot_is_needed(run: Run, tmp_path: Path) -> None:
    cut = copied(run.bag, tmp_path / "cut", lambda m: m.cdr if m.topic == "/exchanges" else None)
    with open_bag(cut) as bag:
        found = {one.plan_id: replay(one) for one in exchanges(bag)}
    for name in ("from topics", "following", "blocked"):
        assert found[run.plan_ids[name]].verdict is Verdict.IDENTICAL


def test_the_command_prints_a_line_for_each_request_and_leaves_the_bag_alone(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(run.bag, bag)
    before = {file: file.read_bytes() for file in bag.iterdir()}
    assert main(["replay", str(bag)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, plan_id in run.plan_ids.items():
        (row,) = (line for line in lines if line.startswith(f"{plan_id} "))
        words = {
            "busy": "not planned: another",
            "cancelled": "not planned: its client",
            "negative": "not planned: it was refused before",
        }
        assert words.get(name, "identical") in row
    assert {file: file.read_bytes() for file in bag.iterdir()} == before
