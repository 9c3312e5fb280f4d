"""Whatever the bytes: a result or a BagError, never another error, never an endless loop."""

from __future__ import annotations

import io
import random
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mutants import bytes_mutated

from ff_planner_ros.bag.exchanges import EXCHANGE
from ff_planner_ros.bag.export import export_csv
from ff_planner_ros.bag.info import info
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.recover import recover
from ff_planner_ros.errors import BagError

MODEL, MOTION = "std_msgs/msg/String", "trajectory_msgs/msg/JointTrajectory"
DEADLINE = 60  # [s] far more than any mutant takes
SEED = 20260606


@pytest.fixture(autouse=True)
def _no_endless_loop() -> Iterator[None]:
    def give_up(_signal: int, _frame: FrameType | None) -> None:
        raise TimeoutError("it does not end")

    previous = signal.signal(signal.SIGALRM, give_up)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


def file_of(bag: Path) -> Path:
    (file,) = bag.glob("*.mcap")
    return file


def copy_of(bag: Path, types: set[str], compression: CompressionType, checksums: bool) -> bytes:
    """A bag's messages of some types, in a file as it is asked for."""
    file = io.BytesIO()
    writer = Writer(file, 1000, compression, enable_crcs=checksums)
    writer.start("ros2", "test")
    writer.add_attachment(0, 0, "robot.urdf", "application/xml", b"<robot/>")
    writer.add_metadata("ff_planner_ros", {"host": "here"})
    with file_of(bag).open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema.name in types:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                number = writer.register_channel(channel.topic, "cdr", number, channel.metadata)
                writer.add_message(number, message.log_time, message.data, message.publish_time)
    writer.finish()
    return file.getvalue()


def read_everything(file: Path) -> int:
    with open_bag(file) as bag:
        messages = list(bag.messages())
        for type_name in {topic.type_name for topic in bag.topics.values()}:
            decoded = list(bag.decoded(type_name))
            assert len(decoded) <= len(messages)
        assert all(note.isprintable() for note in bag.notes)
    return len(messages)


def use_everything(file: Path, directory: Path) -> str:
    """Do with a file whatever can be done; how it went."""
    tables, recovered = directory / "tables", directory / "recovered"
    outcome = "refused"
    with suppress(BagError):
        outcome = f"{read_everything(file)} messages"
    for use in (
        lambda: list(info(file)),
        lambda: export_csv(file, tables),
        lambda: recover(file, recovered),
        lambda: read_everything(recovered),
    ):
        with suppress(BagError):
            use()
    shutil.rmtree(tables, ignore_errors=True)
    shutil.rmtree(recovered, ignore_errors=True)
    return outcome


@pytest.mark.parametrize(
    ("make", "mutants"),
    [
        (lambda bag: copy_of(bag, {MODEL, MOTION}, CompressionType.ZSTD, checksums=True), 150),
        (lambda bag: copy_of(bag, {MODEL, MOTION}, CompressionType.NONE, checksums=False), 200),
        (lambda bag: copy_of(bag, {EXCHANGE}, CompressionType.NONE, checksums=False), 25),
    ],
    ids=["as recorded", "without checksums", "answers without checksums"],
)
def test_a_mutant_is_read_or_refused(
    offline_bag: Path,
    tmp_path: Path,
    make: Callable[[Path], bytes],
    mutants: int,
    times: Callable[[int, int], int],
) -> None:
    original, chance = make(offline_bag), random.Random(SEED)
    file = tmp_path / "mutant.mcap"
    file.write_bytes(original)
    outcomes = {use_everything(file, tmp_path)}
    assert "refused" not in outcomes
    for number in range(times(mutants, 10 * mutants)):
        file.write_bytes(bytes_mutated(original, chance))
        signal.alarm(DEADLINE)
        try:
            outcomes.add(use_everything(file, tmp_path))
        except Exception as error:
            error.add_note(f"mutant {number} of seed {SEED}")
            raise
        signal.alarm(0)
    assert len(outcomes) > 1  # some mutants are damaged so that one sees it


def test_answers_with_mutated_contents_are_told_or_left_out(
    offline_bag: Path, tmp_path: Path
) -> None:
    """The bytes of the messages alone, so that each comes as far as it can."""
    with file_of(offline_bag).open("rb") as stream:
        records = [
            (schema, message)
            for schema, _, message in make_reader(stream).iter_messages()
            if schema.name == EXCHANGE
        ]
    chance = random.Random(SEED)
    file = tmp_path / "mutants.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        schema = records[0][0]
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        channel = writer.register_channel("/exchanges", "cdr", number)
        for time in range(400):
            original = records[time % len(records)][1].data
            writer.add_message(channel, time, bytes_mutated(original, chance), time)
        writer.finish()
    signal.alarm(DEADLINE)
    assert read_everything(file) == 400
    assert use_everything(file, tmp_path) == "400 messages"
    assert any("does not fit its definition" in line for line in info(file))
