"""What SIGKILL leaves of a recording: everything but the last flush interval."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import pytest
import recorder_to_kill
from evil_bags import whole_records
from mcap.exceptions import EndOfFile
from mcap.records import Message, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from recorder_to_kill import ENTRY, FLUSH_INTERVAL
from ros_processes import private_domain, read_bag

from ff_planner_ros.bag.recover import recover

pytestmark = pytest.mark.ci

KILLS = 20
SEED = 6


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is left of recorders that were killed at random moments."""
    directory = tmp_path_factory.mktemp("killed")
    command = [sys.executable, recorder_to_kill.__file__, str(directory), str(SEED), str(KILLS)]
    with private_domain():
        subprocess.run(command, check=True)
    return directory


def _published(directory: Path, number: int) -> tuple[dict[int, int], int]:
    """When each message was published, by its number, and until when they must be there [ns]."""
    entries = list(ENTRY.iter_unpack((directory / f"{number}.published").read_bytes()))
    killed_number, killed_ns = entries.pop()
    assert killed_number == -1
    woken = [stamp for message, stamp in entries if message == 0]
    assert len(woken) > 1
    until = min(killed_ns - round(FLUSH_INTERVAL * 1e9), woken[-2])
    return {message: stamp for message, stamp in entries if message}, until


def _left(bag: Path) -> list[tuple[int, int]]:
    """Number and time of publication [ns] of each message, up to where the last file breaks off."""
    left = []
    for file in sorted(bag.glob("*.mcap")):
        decode, data = None, file.read_bytes()
        # A part of a record would make the library trip over whatever is missing of it.
        *_, (_, end) = ((0, 0), *whole_records(data))
        with suppress(EndOfFile):
            for record in StreamReader(BytesIO(data[:end]), validate_crcs=True).records:
                if isinstance(record, Schema):
                    decode = DecoderFactory().decoder_for("cdr", record)
                elif isinstance(record, Message):
                    left.append((int(decode(record.data).data), record.publish_time))
    return left


@pytest.mark.sampled
@pytest.mark.law("BAG-05")
@pytest.mark.parametrize("number", range(KILLS))
def test_only_the_last_flush_interval_is_lost(killed: Path, number: int) -> None:
    published, until = _published(killed, number)
    left = _left(killed / str(number))
    assert [found for found, _ in left] == list(published)[: len(left)]
    for found, publish_time in left:
        assert published.get(found - 1, 0) <= publish_time <= published[found]
    assert {n for n, stamp in published.items() if stamp <= until} <= {n for n, _ in left}


@pytest.mark.sampled
@pytest.mark.parametrize("number", range(KILLS))
def test_a_killed_recording_is_recovered_to_a_bag_that_others_read(
    killed: Path, tmp_path: Path, number: int
) -> None:
    recovery = recover(killed / str(number), tmp_path / "bag")
    left = [str(found) for found, _ in _left(killed / str(number))]
    assert recovery.saved == {"/text": len(left)}
    assert [message.data for message in read_bag(tmp_path / "bag")["/text"]] == left
