"""One MCAP file: its channels, documents and blocks, and how messages are read from them."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from ff_planner_ros.bag.mcap.decoding import Decoder, decoder
from ff_planner_ros.bag.mcap.mcap_records import (
    FRAME,
    LARGEST,
    chunk_of,
    in_words,
    parsed,
    printable,
    records_in,
    unreadable,
)
from ff_planner_ros.errors import BagError

# Most records of a chunk: more would be nearly empty, and take more memory than the chunk.
_MOST_RECORDS = 500_000
# Most records of a file beyond one per byte: however well messages are compressed, the time of each
# takes a byte. A few kilobytes must not take minutes to read.
_RECORDS_FOR_NOTHING = 1_000_000
_MOST_CHANNELS = 4_000  # of a file: more topics than any system of robots has
_MOST_NOTES = 100  # on a file: what is damaged everywhere need not be told everywhere
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time


class RawMessage(NamedTuple):
    """A message of a file, not decoded."""

    channel: int
    log_time_ns: int
    publish_time_ns: int
    cdr: bytes


@dataclass(frozen=True)
class Block:
    """A piece of a file that holds messages: a chunk, or a run of messages outside of chunks."""

    offset: int  # of its first record in the file
    length: int  # of all its records [bytes]
    start_ns: int  # no message in it has an earlier log time
    channels: frozenset[int] | None  # of its messages; None: not known
    is_chunk: bool


@dataclass
class McapFile:
    """The content of a file, whose blocks are read on demand."""

    path: Path
    stream: BinaryIO  # open
    size: int  # of the file [bytes]
    profile: str = ""  # of the file; `ros2`
    library: str = ""  # that wrote the file
    schemas: dict[int, Schema] = field(default_factory=dict)  # by number
    channels: dict[int, Channel] = field(default_factory=dict)  # by number
    blocks: list[Block] = field(default_factory=list)  # where the messages are
    counts: Counter[int] = field(default_factory=Counter)  # messages of each channel
    start_ns: int | None = None  # earliest log time; None without messages
    end_ns: int | None = None  # latest log time; None without messages
    attachments: list[Attachment] = field(default_factory=list)  # in the order of the file
    metadata: list[Metadata] = field(default_factory=list)  # in the order of the file
    documents_size: int = 0  # of attachments and metadata [bytes]
    # Blocks that cannot be read, the one that is cut at the end included
    damaged: list[Block] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # what is wrong with the file
    is_lossy: bool = False  # whether something that is or was in it cannot be read
    _read: set[Block] = field(default_factory=set)  # the blocks that were read
    _records_read: int = 0  # in them
    _left_out: set[Block] = field(default_factory=set)  # the same as `damaged`
    _decoders: dict[int, Decoder | BagError] = field(default_factory=dict)

    def messages(
        self,
        block: Block,
        wanted: Container[int] | None,
        only: Callable[[bytes], bool] | None = None,
    ) -> list[RawMessage]:
        """Return the messages of a block; a damaged block has none, and makes a note.

        Args:
            wanted: Numbers of the channels to read; None: all.
            only: Returns whether a message with these bytes is wanted; None: all are.

        Raises:
            BagError: The disk fails.
        """
        try:
            records = self._records(block)
            heads = self.heads(records, is_new=block not in self._read)
            self._read.add(block)
            return [
                RawMessage(channel, log_time, publish_time, records[start:end])
                for channel, log_time, publish_time, start, end in heads
                if wanted is None or channel in wanted
                if only is None or only(records[start:end])
            ]
        except OSError as error:
            raise unreadable(self.path, error) from None
        except Exception as error:  # where bytes are damaged, the library trips over their meaning
            self.leave_out(block, f"is damaged: {in_words(error)}")
            return []

    def heads(
        self, records: bytes, is_new: bool = True
    ) -> Iterator[tuple[int, int, int, int, int]]:
        """Yield channel, log time, publish time, start and end of every message among records.

        Channels and schemas among them are added to those of the file.

        Args:
            is_new: Whether the records were not read before, and count towards the file's limit.

        Raises:
            Exception: The records are damaged; any error of the library.
        """
        position, end, count = 0, len(records), 0
        known = self.channels
        most = min(_MOST_RECORDS, _RECORDS_FOR_NOTHING + self.size - self._records_read * is_new)
        while position < end:
            count += 1
            self._records_read += is_new
            if count > most:
                raise ValueError("there are more records in it than recorders write")
            opcode, length = FRAME.unpack_from(records, position)
            start, position = position + FRAME.size, position + FRAME.size + length
            if position > end:
                raise ValueError("a record in it is longer than what is left")
            if opcode == Opcode.MESSAGE:
                if length < _MESSAGE.size:
                    raise ValueError("a message in it is too short")
                channel, _, log_time, publish_time = _MESSAGE.unpack_from(records, start)
                if channel not in known:
                    raise ValueError(f"channel {channel} of a message is described nowhere")
                yield channel, log_time, publish_time, start + _MESSAGE.size, position
            elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
                self.describe(opcode, records[start:position])

    def describe(self, opcode: int, body: bytes) -> None:
        """Add the channel or schema in the body of a record.

        Raises:
            Exception: The record is damaged; any error of the library.
        """
        if opcode == Opcode.SCHEMA:
            schema: Schema = parsed(Schema, body)
            self.schemas.setdefault(schema.id, schema)
            return
        channel: Channel = parsed(Channel, body)
        if len(self.channels) >= _MOST_CHANNELS and channel.id not in self.channels:
            raise ValueError(f"there are more than {_MOST_CHANNELS} channels")
        if channel.schema_id and channel.schema_id not in self.schemas:
            raise ValueError(f"schema {channel.schema_id} of a channel is described nowhere")
        self.channels.setdefault(channel.id, channel)

    def decoder_of(self, channel: Channel) -> Decoder:
        """Return the decoder of a channel's messages.

        Raises:
            BagError: The messages cannot be decoded.
        """
        if channel.id not in self._decoders:
            try:
                if channel.message_encoding != "cdr":
                    raise BagError(f"its messages are in {channel.message_encoding!a}, not in cdr")
                if channel.schema_id not in self.schemas:
                    raise BagError("the bag carries no definition of it")
                schema = self.schemas[channel.schema_id]
                self._decoders[channel.id] = decoder(schema.name, schema.encoding, schema.data)
            except BagError as error:
                self._decoders[channel.id] = error
        found = self._decoders[channel.id]
        if isinstance(found, BagError):
            raise found
        return found

    def bytes_at(self, offset: int, length: int) -> bytes:
        """Return bytes of the file.

        Raises:
            ValueError: The file ends before, or a record may not be that long.
        """
        if length > LARGEST:
            raise ValueError(f"it is larger than {LARGEST >> 20} MiB")
        if offset + length <= self.size:
            data = os.pread(self.stream.fileno(), length, offset)
            if len(data) == length:
                return data
        raise ValueError("the file ends before")

    def leave_out(self, block: Block, reason: str) -> None:
        """Mark a block as damaged, and note the reason."""
        if block not in self._left_out:
            self._left_out.add(block)
            self.damaged.append(block)
            kind = "chunk" if block.is_chunk else "message"
            self.lose(f"the {kind} at byte {block.offset} {reason}")

    def is_left_out(self, block: Block) -> bool:
        """Return whether a block was found to be damaged."""
        return block in self._left_out

    def lose(self, text: str) -> None:
        """Note that a part of the file is lost."""
        self.is_lossy = True
        self.note(text)

    def note(self, text: str) -> None:
        """Note what is wrong with the file, once."""
        if len(self.notes) >= _MOST_NOTES:
            return
        note = printable(f"{self.path.name}: {text}")
        if note not in self.notes:
            self.notes.append(note)
            if len(self.notes) == _MOST_NOTES:
                self.notes.append(f"{self.path.name}: there are more faults like these")

    def _records(self, block: Block) -> bytes:
        """Return the records in a block; a chunk's are decompressed and their checksum holds."""
        data = self.bytes_at(block.offset, block.length)
        if not block.is_chunk:
            return data
        chunk, _ = chunk_of(data)
        return records_in(chunk)
