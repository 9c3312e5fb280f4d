"""The golden bag: its plans come again, on this machine and on others."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import NoReturn

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from ff_planner_ros.bag.exchanges import Exchange, exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.cli import main
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.runs import replay as replaying
from ff_planner_ros.runs.replay import Replayed, Verdict, replay

NODE = Path(__file__).parent / "golden_bags" / "node"
(FILE,) = NODE.glob("*.mcap")
# To the last bit on the machine that recorded them; others may round otherwise.
SAME = (Verdict.IDENTICAL, Verdict.WITHIN_TOLERANCE)
SEEDS = range(12)


@pytest.fixture(scope="module")
def run() -> list[Exchange]:
    with open_bag(NODE) as bag:
        return list(exchanges(bag))


@pytest.fixture(scope="module")
def replayed(run: list[Exchange]) -> dict[str, Replayed]:
    return {one.plan_id: replay(one) for one in run}


@pytest.mark.law("BAG-03")
def test_every_answer_in_a_golden_bag_comes_again(replayed: dict[str, Replayed]) -> None:
    for plan_id, found in replayed.items():
        is_same = found.verdict in SAME or not found.exchange.task
        assert is_same, (plan_id, found.words, *map(str, found.differences))
    assert sum(one.verdict in SAME for one in replayed.values()) == 7


def test_its_tasks_are_those_that_the_node_had(run: list[Exchange]) -> None:
    """What it was asked, what it knew and what came of it, to the digest."""
    for one in run:
        assert bool(one.task) == bool(one.answer.task_digest)
        if one.task:
            assert one.planned_task().digest == one.answer.task_digest
    solved = [one for one in run if one.status is Status.SOLVED]
    _, captured, waited, tailed, going_on = solved
    interfaces = {one.interface: one for one in run}
    assert (interfaces["action"], interfaces["replanning"]) == (captured, going_on)
    tasks = [one.planned_task() for one in solved]
    problems = [task.problem for task in tasks]
    assert [problem.target_body is not None for problem in problems] == [False, True, *3 * [False]]
    assert [problem.approach is not None for problem in problems] == [False, True, *3 * [False]]
    assert [len(problem.allowed_collisions) for problem in problems] == [0, 1, 0, 0, 0]
    behaviours = [str(task.end_behaviour) for task in tasks]
    assert behaviours == ["none", "none", "none", "stop_joints", "none"]
    assert going_on.answer.inputs.previous_plan_id == tailed.plan_id
    assert tasks[4].running is not None
    assert (waited.request.plan_only, waited.requester) == (True, "executive")
    blocked = run[-1].answer
    assert (len(blocked.plans), len(blocked.metrics)) == (0, 0)


def test_an_exported_task_of_a_golden_bag_gives_the_plan_of_its_replay(
    replayed: dict[str, Replayed], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory, file = tmp_path / "scenarios", tmp_path / "answer.json"
    assert main(["export", str(NODE), "--scenarios", str(directory)]) == 0
    files = sorted(directory.glob("*.yaml"))
    assert len(files) == 7
    for scenario in files:
        found = replayed[scenario.stem]
        main(["plan", str(scenario), "--json", str(file)])
        written = json.loads(file.read_text())
        assert written["status"] == found.exchange.status.name.lower()
        assert written["digest"] == found.exchange.answer.task_digest
        if isinstance(found.again, Plan):
            motion = found.again.trajectory
            assert written["joint_positions"] == motion.joint_positions.tolist()
            assert written["chaser_positions"] == motion.chaser_positions.tolist()
    capsys.readouterr()


@pytest.mark.sampled
@pytest.mark.parametrize("seed", SEEDS)
def test_damaged_messages_and_documents_never_end_in_a_traceback(
    seed: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of a bag whose checksums are right all the same: the worst that a reader lets through."""

    def no_plan(*_: object) -> NoReturn:
        raise NoPlanFound(Status.COLLISION, "not looked for")

    monkeypatch.setattr(replaying, "perform", no_plan)
    spoilt = tmp_path / "spoilt.mcap"
    copy_spoilt(FILE, spoilt, random.Random(seed))
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
            matters = channel.topic.endswith("exchanges")
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
