"""Bags of earlier versions: their plans come again, on this machine and on others."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import NoReturn

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.cli import main
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.certificate import CERTIFICATE_GAP
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.search.families import is_detour
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.runs import replay as replaying
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.recorded_run import RecordedRequest, recorded_run
from ff_planner_ros.runs.replay import Replayed, Verdict, replay

GOLDEN = Path(__file__).parent / "golden_bags"
BAGS = sorted(path for path in GOLDEN.iterdir() if path.is_dir())
# To the last bit on the machine that recorded them; others may round otherwise.
SAME = (Verdict.IDENTICAL, Verdict.WITHIN_TOLERANCE)
# Of these the plans come again as they were; those of 0.1 come nearly so.
SAME_PLANS = ("node_0_2",)
# Their quadratic programs were solved to fewer digits: it shows by so many tolerances, and in the
# clearance by so much [m].
MORE_DIGITS, ROUNDING = 10.0, 1e-6
SEEDS = range(12)
SETTINGS = load_parameters().planner


def test_there_are_golden_bags() -> None:
    assert BAGS


@pytest.mark.law("BAG-03")
@pytest.mark.parametrize("path", BAGS, ids=lambda path: path.name)
def test_every_answer_in_a_golden_bag_comes_again(path: Path) -> None:
    with open_bag(path) as bag:
        run = recorded_run(bag)
    for recorded in run.requests:
        found = replay(recorded)
        told = (recorded.name, found.words, *map(str, found.differences))
        weighs_attitude = recorded.request.objective.chaser_attitude > 0.0
        if recorded.status is Status.SOLVED and (weighs_attitude or _is_detour(recorded)):
            _require_no_worse(recorded, found, told)
        elif recorded.status is Status.SOLVED and path.name not in SAME_PLANS:
            _require_as_good(recorded, found, told)
        else:
            assert found.verdict in SAME or _is_only_told_closer(recorded, found), told
    statuses = [recorded.status for recorded in run.requests]
    if path.name == "node":
        assert any("do not say when the node read their requests" in note for note in run.notes)
        assert [recorded.door for recorded in run.requests].count("action") == 2
        assert statuses.count(Status.SOLVED) == 2


def test_a_node_of_version_0_2_had_the_tasks_that_it_would_have_now() -> None:
    """What it was asked, what it knew and what came of it, to the digest."""
    with open_bag(GOLDEN / "node_0_2") as bag:
        run = recorded_run(bag)
    early, captured, waited, tailed, going_on, blocked = run.requests
    for recorded in run.requests:
        assert recorded.response is not None
        digest = "" if recorded is early else recorded.read_request().task.digest
        assert recorded.response.task_digest == digest
    assert not any("do not say when the node read their requests" in note for note in run.notes)
    assert [one.door for one in run.requests].count("action") == 1
    tasks = [one.read_request().task for one in (captured, waited, tailed, going_on)]
    problems = [task.problem for task in tasks]
    assert [problem.target_body is not None for problem in problems] == [True, *3 * [False]]
    assert [problem.approach is not None for problem in problems] == [True, *3 * [False]]
    assert [len(problem.allowed_collisions) for problem in problems] == [1, 0, 0, 0]
    assert [str(problem.target.orientation) for problem in problems[1:3]] == ["about_axis", "fixed"]
    assert [str(task.end_behaviour) for task in tasks] == [
        "none",
        "none",
        "hold_end_effector",
        "none",
    ]
    assert going_on.response.inputs.previous_plan_id == tailed.name
    assert tasks[3].running is not None
    assert (waited.request.plan_only, waited.request.requester) == (True, "executive")
    assert (len(blocked.response.plans), len(blocked.response.metrics)) == (0, 1)


def _is_only_told_closer(recorded: RecordedRequest, found: Replayed) -> bool:
    """Tell whether nothing changed but digits and the certified clearance.

    Since 0.3 that is bounded closer, and quadratic programs are solved to more digits.
    """
    if recorded.response is None or found.answer is None or not found.differences:
        return False
    (new,), (old,) = found.answer.metrics, recorded.response.metrics
    others = [one for one in found.differences if one.quantity != "metrics.min_clearance"]
    rise = new.min_clearance - old.min_clearance
    is_near = all(one.tolerances < MORE_DIGITS for one in others)
    return is_near and -ROUNDING <= rise <= CERTIFICATE_GAP + ROUNDING


def _is_detour(recorded: RecordedRequest) -> bool:
    """Tell whether a plan's joints go far round: version 0.3 looks for shorter ways, too."""
    assert recorded.response is not None
    return is_detour(plan_from_answer(recorded.response).trajectory.joint_positions)


def _require_no_worse(recorded: RecordedRequest, found: Replayed, told: tuple[str, ...]) -> None:
    """Hold that the new plan is worth as much: version 0.3 looks for the attitude elsewhere."""
    assert found.answer is not None, told
    assert recorded.response is not None, told
    assert found.answer.status.code == Status.SOLVED, told
    weights = recorded.request.objective
    new, old = (
        weights.joint_path_length * metrics.joint_path_length
        + weights.chaser_attitude * metrics.max_chaser_euler
        for metrics in (found.answer.metrics[0], recorded.response.metrics[0])
    )
    assert new <= 1.001 * old, told


def _require_as_good(recorded: RecordedRequest, found: Replayed, told: tuple[str, ...]) -> None:
    """Hold that the new plan is nearly the old one, and keeps what the old one did not.

    Version 0.1 left out a little null-space motion at the start, solved on the points of the plan
    alone, and measured Euler angles from the user's axes: its chaser starts turned by a few
    degrees.
    """
    assert found.answer is not None, told
    assert recorded.response is not None, told
    assert found.answer.status.code == Status.SOLVED, told
    (new,), (old,) = found.answer.metrics, recorded.response.metrics
    assert new.start_velocity_jump < 1e-9, told
    assert new.final_position_error < 1e-4, told
    assert new.joint_path_length == pytest.approx(old.joint_path_length, rel=0.01), told
    amounts = {one.quantity: one.amount for one in found.differences}
    assert amounts.get("joint_positions", 0.0) < 0.05, told


@pytest.mark.parametrize("path", BAGS, ids=lambda path: path.name)
def test_an_exported_request_of_a_golden_bag_gives_the_plan_of_its_replay(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory, file = tmp_path / "scenarios", tmp_path / "answer.json"
    assert main(["export", str(path), "--scenarios", str(directory)]) == 0
    assert "not in the bag, taken as in this version: " in capsys.readouterr().err
    with open_bag(path) as bag:
        requests = {recorded.name: recorded for recorded in recorded_run(bag).requests}
    files = sorted(directory.glob("*.yaml"))
    assert files
    for scenario in files:
        again = replay(requests[scenario.stem]).answer
        assert again is not None
        main(["plan", str(scenario), "--json", str(file)])
        written = json.loads(file.read_text())
        assert written["status"] == Status(again.status.code).name.lower()
        assert written["digest"] == again.task_digest
        if again.status.code == Status.SOLVED:
            motion = plan_from_answer(again).trajectory
            assert written["joint_positions"] == motion.joint_positions.tolist()
            assert written["chaser_positions"] == motion.chaser_positions.tolist()
    capsys.readouterr()


@pytest.fixture(scope="module")
def of_this_version(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    bag = tmp_path_factory.mktemp("now") / "bag"
    record_answer(bag, PlanningTask(lemur_capture, SETTINGS), lemur_plan, 0.5)
    return bag


@pytest.mark.parametrize("version", ["0.1", "0.2", "now"])
@pytest.mark.parametrize("seed", SEEDS)
def test_damaged_messages_and_documents_never_end_in_a_traceback(
    seed: int,
    version: str,
    of_this_version: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of a bag whose checksums are right all the same: the worst that a reader lets through."""

    def no_plan(*_: object) -> NoReturn:
        raise NoPlanFound(Status.COLLISION, "not looked for")

    monkeypatch.setattr(replaying, "perform", no_plan)
    spoilt = tmp_path / "spoilt.mcap"
    bags = {"0.1": GOLDEN / "node", "0.2": GOLDEN / "node_0_2", "now": of_this_version}
    copy_spoilt(next(bags[version].glob("*.mcap")), spoilt, random.Random(seed))
    assert main(["replay", str(spoilt)]) in (2, 3)
    assert main(["replay", str(spoilt), "--set", "points=20"]) in (0, 2)
    capsys.readouterr()


def copy_spoilt(source: Path, target: Path, rng: random.Random) -> None:
    """Copy a file with its own definitions, replacing bytes in half of all that matters."""
    with source.open("rb") as read, target.open("wb") as written:
        reader, writer = make_reader(read), Writer(written)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            matters = channel.topic.endswith(("_service_event", "chaser_state", "obstacles"))
            cdr = spoil(rng, message.data, first=4, share=0.5 if matters else 0.0)
            writer.add_message(channels[channel.topic], message.log_time, cdr, message.publish_time)
        for one in reader.iter_attachments():
            content = spoil(rng, one.data, first=0, share=0.2)
            writer.add_attachment(0, 0, one.name, one.media_type, content)
        writer.finish()


def spoil(rng: random.Random, content: bytes, first: int, share: float) -> bytes:
    """Replace some bytes, in a share of all cases."""
    changed = bytearray(content)
    if rng.random() < share:
        for _ in range(rng.choice([1, 3, 30])):
            at = rng.randrange(first, len(changed))
            changed[at] = rng.choice([0, 1, 255, rng.randrange(256)])
    return bytes(changed)
