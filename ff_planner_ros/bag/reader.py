"""Reads a bag: topics, documents and messages, serialised or decoded by its own definitions."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mcap.records import Channel

from ff_planner_ros.bag.files import open_files
from ff_planner_ros.bag.mcap.decoding import ENCODINGS, decoder
from ff_planner_ros.bag.mcap.mcap_file import Block, McapFile, RawMessage
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.errors import BagError


@dataclass(frozen=True)
class Message:
    """A message of a bag, not decoded."""

    topic: str
    type_name: str  # `package/msg/Name`
    log_time_ns: int  # when it was received, since the epoch
    publish_time_ns: int  # when it was published, since the epoch
    cdr: bytes


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str  # resolved, with its leading slash
    type_name: str  # of its messages
    message_count: int  # in the whole bag
    type_hash: str  # RIHS01; empty: not in the bag


class Bag:
    """A bag open for reading; made by `open_bag`."""

    def __init__(self, path: Path, files: Sequence[McapFile], notes: Sequence[str]) -> None:
        """Combine the contents of files: at least one, open, in order."""
        self._mcap_files, self._notes = files, list(notes)
        self.path = path  # as given to `open_bag`
        self.files = tuple(file.path for file in files)
        self.library = files[0].library  # that wrote it
        # By file name and by name of the record; of several records the last
        self.attachments: Mapping[str, bytes] = MappingProxyType(
            {one.name: one.data for file in files for one in file.attachments}
        )
        self.metadata: Mapping[str, Mapping[str, str]] = MappingProxyType(
            {one.name: MappingProxyType(one.metadata) for file in files for one in file.metadata}
        )
        # Log times of the first and last message, since the epoch; zero without messages
        self.start_ns = min((one.start_ns for one in files if one.start_ns is not None), default=0)
        self.end_ns = max((one.end_ns for one in files if one.end_ns is not None), default=0)
        self.topics = self._all_topics()  # by name
        self.message_count = sum(topic.message_count for topic in self.topics.values())
        for file in files:
            if file.profile != "ros2":
                file.note(f"its profile is {file.profile!a}, not ros2")
            for schema in file.schemas.values():
                if schema.encoding not in ENCODINGS:
                    file.note(f"{schema.name} is defined in {schema.encoding!a}: it is not decoded")

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(file.size for file in self._mcap_files)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with the bag, as far as it is known by now."""
        return (*self._notes, *(note for file in self._mcap_files for note in file.notes))

    def note(self, text: str) -> None:
        """Note what is wrong with the bag, once."""
        if text not in self._notes:
            self._notes.append(text)

    def damaged_blocks(self) -> list[tuple[str, Block]]:
        """Read all blocks; return those that are damaged, with the names of their files, in order.

        Raises:
            BagError: The disk fails.
        """
        with progress_bar("checking", self.size) as progress:
            for file in self._mcap_files:
                for block in sorted(file.blocks):
                    file.messages(block, ())
                    progress(block.length)
        return [
            (file.path.name, block) for file in self._mcap_files for block in sorted(file.damaged)
        ]

    def messages(
        self, *types_or_topics: str, only: Callable[[bytes], bool] | None = None
    ) -> Iterator[Message]:
        """Yield messages of some types or topics (none: all) by log time, across the files.

        What is damaged is left out, and makes a note.

        Args:
            only: Returns whether a message with these bytes is wanted; None: all are. Unwanted
                messages cost little time.

        Raises:
            BagError: The disk fails.
        """
        for _, _, message in self._in_order(set(types_or_topics), only):
            yield message

    def decoded(
        self, *type_names: str, only: Callable[[bytes], bool] | None = None
    ) -> Iterator[tuple[Message, Any]]:
        """Yield the messages of some types with their content, by the bag's own definitions.

        What is damaged or does not fit its definition is left out, and makes a note.

        Raises:
            BagError: The disk fails.
        """
        for file, channel, message in self._in_order(set(type_names), only):
            try:
                content = _content(file, channel, message.cdr)
            except BagError as error:
                file.note(f"{message.topic} ({message.type_name}): {error}")
            else:
                yield message, content

    def decode(self, message: Message) -> Any:
        """Return the content of one of the `messages`, by the bag's own definition.

        Raises:
            BagError: The definition cannot be read, or the message does not fit it.
        """
        for file in self._mcap_files:
            for channel in file.channels.values():
                if (channel.topic, _type_name(file, channel)) == (message.topic, message.type_name):
                    return _content(file, channel, message.cdr)
        raise BagError(f"{message.topic} is no topic of {self.path}")

    def _in_order(
        self, wanted: set[str], only: Callable[[bytes], bool] | None = None
    ) -> Iterator[tuple[McapFile, Channel, Message]]:
        """Merge the blocks of all files; each is read when the first of its messages is due."""
        heap: list[tuple[int, int, int, int, Block | RawMessage]] = []
        channels = [_channels_of(file, wanted) if wanted else None for file in self._mcap_files]
        for number, file in enumerate(self._mcap_files):
            heap += (
                (block.start_ns, number, block.offset, -1, block)
                for block in file.blocks
                if _may_hold(block, channels[number])
            )
        heapq.heapify(heap)
        while heap:
            _, number, offset, _, item = heapq.heappop(heap)
            file = self._mcap_files[number]
            if isinstance(item, RawMessage):
                channel = file.channels[item.channel]
                yield file, channel, Message(channel.topic, _type_name(file, channel), *item[1:])
                continue
            for index, raw in enumerate(file.messages(item, channels[number], only)):
                heapq.heappush(heap, (raw.log_time_ns, number, offset, index, raw))

    def _all_topics(self) -> Mapping[str, Topic]:
        topics: dict[str, Topic] = {}
        for file in self._mcap_files:
            for number, channel in file.channels.items():
                count, type_name = file.counts[number], _type_name(file, channel)
                known = topics.get(channel.topic)
                if known is None:
                    type_hash = channel.metadata.get("topic_type_hash", "")
                    known = Topic(channel.topic, type_name, 0, type_hash)
                elif known.type_name != type_name:
                    file.note(f"{channel.topic} is of {type_name}, and of {known.type_name}, too")
                topics[channel.topic] = replace(known, message_count=known.message_count + count)
        return MappingProxyType(topics)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag for reading, a directory or one MCAP file.

    A file without an index is read to its end at once.

    Raises:
        BagError: There is no bag, or nothing of it can be read.
    """
    with open_files(path) as (files, notes):
        yield Bag(path, files, notes)


def _channels_of(file: McapFile, wanted: set[str]) -> set[int]:
    return {
        number
        for number, channel in file.channels.items()
        if channel.topic in wanted or _type_name(file, channel) in wanted
    }


def _may_hold(block: Block, channels: set[int] | None) -> bool:
    return not block.channels or channels is None or not block.channels.isdisjoint(channels)


def _content(file: McapFile, channel: Channel, cdr: bytes) -> Any:
    """Return the content of a message of a channel.

    Raises:
        BagError: The message cannot be decoded.
    """
    if channel.message_encoding != "cdr":
        raise BagError(f"its messages are in {channel.message_encoding!a}, not in cdr")
    if channel.schema_id not in file.schemas:
        raise BagError("the bag carries no definition of it")
    schema = file.schemas[channel.schema_id]
    return decoder(schema.name, schema.encoding, schema.data)(cdr)


def _type_name(file: McapFile, channel: Channel) -> str:
    schema = file.schemas.get(channel.schema_id)
    return schema.name if schema else ""
