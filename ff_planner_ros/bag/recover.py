"""Copies all that can be read of a damaged bag to a new one; the damaged bag is not changed."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Channel
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from ff_planner_ros.bag.files import open_files
from ff_planner_ros.bag.mcap.mcap_file import McapFile, Progress
from ff_planner_ros.bag.mcap.rosbag2_metadata import (
    ROSBAG2,
    FileInfo,
    TopicInfo,
    as_yaml,
    custom_data,
    metadata,
)
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.common.shown import printable
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import BagError, InvalidInput

WHOLE, NOTHING, LOSSY = 0, 1, 3  # exit codes
RECORD = "ff_planner_ros_recovery"  # metadata of the new bag: where it is from, what was lost


@dataclass(frozen=True)
class Recovery:
    """Result of a recovery."""

    saved: Mapping[str, int]  # number of messages saved, of every topic
    # Number of messages that the index lists and that are lost, by topic
    lost: Mapping[str, int]
    is_whole: bool  # whether everything in the files was saved
    notes: Sequence[str]  # what was wrong, and what was done about it


def print_recovery(bag: Path, output: Path | None) -> int:
    """Recover a bag into a new one (None: beside the old one), and print what was saved and lost.

    Returns:
        Exit code: 0 everything in the bag was saved, 3 a part, 1 nothing.

    Raises:
        BagError: There is no bag, or the output exists or cannot be written.
    """
    if output is None:
        old = bag.resolve()
        output = old.with_name(f"{old.name if old.is_dir() else old.stem}_recovered")
    recovery = recover(bag, output)
    for note in recovery.notes:
        print(f"note: {note}")
    if not sum(recovery.saved.values()):
        print("nothing was saved: there is no message that can be read")
        return NOTHING
    for topic, saved in sorted(recovery.saved.items()):
        lost = recovery.lost.get(topic, 0)
        print(f"{saved:9} saved{f', {lost} lost' if lost else ''}  {printable(topic)}")
    print(f"{sum(recovery.saved.values())} messages were saved to {output}")
    if recovery.is_whole:
        return WHOLE
    print("a part is lost: see the notes above, which are in the new bag, too")
    return LOSSY


def recover(bag: Path, output: Path) -> Recovery:
    """Copy everything that can be read of a bag to a new one, file by file.

    The output, a directory, is not made if there is no message to save.

    Raises:
        BagError: There is no bag, or the output exists or cannot be written.
    """
    if not bag.exists():
        raise BagError(f"bag {bag} is not there")
    if output.exists():
        raise BagError(f"bag {output} exists already, and is not overwritten")
    partial = output.with_name(f"{output.name}.partial")
    try:
        partial.mkdir(parents=True)
    except FileExistsError:
        raise BagError(f"{partial} is in the way: another recovery runs, or was killed") from None
    except OSError as error:
        raise BagError(f"bag {output} cannot be written: {error}") from None
    copy = _Copy(partial, output.name)
    try:
        is_whole, notes = _copied(bag, copy)
        if copy.saved.total():
            partial.rename(output)
    except OSError as error:
        raise BagError(f"bag {output} cannot be written: {error}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return Recovery(
        {topic: copy.saved[topic] for topic in copy.topics},
        {topic: count for topic, count in (copy.known - copy.saved).items() if count > 0},
        is_whole,
        notes,
    )


def _copied(bag: Path, copy: _Copy) -> tuple[bool, tuple[str, ...]]:
    """Copy what can be read; return whether that is all, and what was wrong."""
    with ExitStack() as stack:
        try:
            files, notes = stack.enter_context(open_files(bag))
        except BagError as error:
            return False, (str(error),)
        with progress_bar("saving", sum(file.size for file in files)) as progress:
            for file in files:
                copy.add(file, progress)
        copy.finish()
        is_whole = not notes and not any(file.is_lossy for file in files)
        return is_whole, (*notes, *(note for file in files for note in file.notes))


class _Copy:
    """The new bag."""

    def __init__(self, directory: Path, name: str) -> None:
        self.topics: dict[str, TopicInfo] = {}
        self.saved: Counter[str] = Counter()  # messages of each topic
        self.known: Counter[str] = Counter()  # that there should be, as far as the files tell
        self._directory, self._name = directory, name
        self._files: list[FileInfo] = []
        self._custom_data: dict[str, str] = {}

    def add(self, file: McapFile, progress: Progress) -> None:
        """Copy all that can be read of a file to a new one."""
        info = FileInfo(f"{self._name}_{len(self._files)}.mcap")
        self._files.append(info)
        with (self._directory / info.name).open("xb") as stream:
            writer = Writer(stream, compression=CompressionType.ZSTD)
            writer.start(file.profile, f"ff_planner_ros {LIBRARY_IDENTIFIER}")
            for one in file.attachments:
                writer.add_attachment(
                    one.create_time, one.log_time, one.name, one.media_type, one.data
                )
            self._add_messages(file, writer, info, progress)
            for record in file.metadata:
                if record.name == ROSBAG2:
                    self._custom_data |= custom_data(record.metadata)
                else:
                    writer.add_metadata(record.name, record.metadata)
            self._custom_data |= {"recovered_from": file.path.name}
            words = {str(number): note for number, note in enumerate(file.notes, 1)}
            writer.add_metadata(RECORD, {"file": file.path.name, **words})
            writer.add_metadata(ROSBAG2, {"serialized_metadata": as_yaml(self._document())})
            writer.finish()

    def finish(self) -> None:
        """Write `metadata.yaml`."""
        text = as_yaml({"rosbag2_bagfile_information": self._document()})
        (self._directory / "metadata.yaml").write_text(text, encoding="utf-8")

    def _add_messages(
        self, file: McapFile, writer: Writer, info: FileInfo, progress: Progress
    ) -> None:
        numbers: dict[int, int] = {}  # of the channels, in the new file
        for channel in file.channels:
            self._register(file, channel, writer, numbers)
        for block in sorted(file.blocks, key=lambda block: block.offset):
            for raw in file.messages(block):
                self._register(file, raw.channel, writer, numbers)
                topic = file.channels[raw.channel].topic
                writer.add_message(
                    numbers[raw.channel],
                    raw.log_time_ns,
                    raw.cdr,
                    raw.publish_time_ns,
                    self.saved[topic],
                )
                self.saved[topic] += 1
                self.topics[topic].message_count += 1
                info.count(raw.log_time_ns)
            progress(block.length)

    def _register(
        self, file: McapFile, number: int, writer: Writer, numbers: dict[int, int]
    ) -> None:
        if number in numbers:
            return
        channel = file.channels[number]
        schema = file.schemas.get(channel.schema_id)
        schema_number = (
            writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
        )
        numbers[number] = writer.register_channel(
            channel.topic, channel.message_encoding, schema_number, channel.metadata
        )
        self.known[channel.topic] += file.counts[number]
        if channel.topic not in self.topics:
            digest = channel.metadata.get("topic_type_hash", "")
            self.topics[channel.topic] = TopicInfo(
                schema.name if schema else "", digest, _parsed_profiles(channel)
            )

    def _document(self) -> dict[str, Any]:
        return metadata(self._files, self.topics, self._custom_data)


def _parsed_profiles(channel: Channel) -> Any:
    try:
        written = channel.metadata.get("offered_qos_profiles", "")
        return yaml_document(written, "offered_qos_profiles", "damaged") or []
    except InvalidInput:
        return []
