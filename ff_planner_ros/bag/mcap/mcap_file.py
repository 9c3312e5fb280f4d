"""One MCAP file: what is in it, by its index or by reading all of it, and its messages."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Container, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema
from mcap.summary import Summary

from ff_planner_ros.bag.mcap.records import FRAME, LARGEST, chunk_in, inflated, parsed
from ff_planner_ros.common.shown import printable
from ff_planner_ros.errors import BagError

Progress = Callable[[int], None]  # called with the number of bytes just read

_MAGIC = b"\x89MCAP0\r\n"  # an MCAP file starts and ends with it
_FOOTER = struct.Struct("<9xQQI8s")  # start of the summary, of its offsets, checksum, magic
_END = (Opcode.DATA_END, 4)  # of the records; the index follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time
_DOCUMENTS = (Opcode.ATTACHMENT, Opcode.METADATA)
_WINDOW, _OVERLAP = 1 << 20, 64  # [bytes] searched at once; what may reach into the next ones
_LONGEST_RUN = 1 << 20  # [bytes] of messages outside of chunks that are read at once
# Most records in a block beyond one per byte: however well messages are compressed, the time of
# each takes a byte. A few kilobytes must not take minutes to read.
_RECORDS_FOR_NOTHING = 50_000
_MOST_CHANNELS = 4_000  # of a file: more topics than any system of robots has
_MOST_NOTES = 100  # on a file: what is damaged everywhere need not be told everywhere
_LONGEST_REASON = 120  # [characters] of a library, in a note that is read


class RawMessage(NamedTuple):
    """A message of a file, not decoded."""

    channel: int
    log_time_ns: int
    publish_time_ns: int
    cdr: bytes


class Block(NamedTuple):
    """A piece of a file that holds messages: a chunk, or a run of messages outside of chunks."""

    offset: int  # of its first record in the file
    length: int  # of all its records [bytes]
    is_chunk: bool
    start_ns: int = 0  # no message in it has an earlier log time
    channels: frozenset[int] = frozenset()  # of its messages; empty: not known


class McapFile:
    """The content of an open file; the messages of its blocks are read on demand."""

    def __init__(self, path: Path, stream: BinaryIO, progress: Progress) -> None:
        """Find out what is in a file; without a sound index, all of it is read at once.

        Raises:
            BagError: The file is no MCAP file, or the disk fails.
        """
        self.path, self._stream = path, stream
        self.size = os.fstat(stream.fileno()).st_size  # [bytes]
        self.profile = self.library = ""  # of the file, `ros2`; that wrote it
        self.schemas: dict[int, Schema] = {}  # by number
        self.channels: dict[int, Channel] = {}  # by number
        self.blocks: list[Block] = []  # where the messages are
        self.counts: Counter[int] = Counter()  # messages of each channel
        self.start_ns: int | None = None  # earliest log time; None without messages
        self.end_ns: int | None = None  # latest log time; None without messages
        self.attachments: list[Attachment] = []  # in the order of the file
        self.metadata: list[Metadata] = []  # in the order of the file
        self.damaged: set[Block] = set()  # what cannot be read
        self.notes: list[str] = []  # what is wrong with the file
        self.is_lossy = False  # whether something that is or was in it cannot be read
        self._documents_size = 0  # of attachments and metadata [bytes]
        if self.size < len(_MAGIC) or self._bytes_at(0, len(_MAGIC)) != _MAGIC:
            raise BagError(f"bag {path} is no MCAP file")
        try:
            header, summary = self._index()
        except BagError:
            raise
        except Exception as error:  # where bytes are damaged, the library trips over their meaning
            self.note(f"{_in_words(error)}; it was read from its start as far as it goes")
            self._read_all(progress)
        else:
            self._take(header)
            self._take_index(summary)

    def messages(
        self,
        block: Block,
        wanted: Container[int] | None = None,
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
            found = self._messages(block, wanted)
            return [message for message in found if only is None or only(message.cdr)]
        except BagError:
            raise
        except Exception as error:  # as in the index
            if block not in self.damaged:
                self.damaged.add(block)
                kind = "chunk" if block.is_chunk else "message"
                self._lose(f"the {kind} at byte {block.offset} is damaged: {_in_words(error)}")
            return []

    def note(self, text: str) -> None:
        """Note what is wrong with the file, once."""
        note = printable(f"{self.path.name}: {text}")
        if note not in self.notes and len(self.notes) <= _MOST_NOTES:
            more = f"{self.path.name}: there are more faults like these"
            self.notes.append(note if len(self.notes) < _MOST_NOTES else more)

    def _lose(self, text: str) -> None:
        self.is_lossy = True
        self.note(text)

    def _index(self) -> tuple[Header, Summary]:
        """Return the header and the summary of a file whose index is complete.

        Raises:
            Exception: There is no index, or it cannot be trusted; any error of the library.
        """
        footer_at = self.size - _FOOTER.size
        tail = self._bytes_at(footer_at, _FOOTER.size) if footer_at > 0 else b""
        if not tail.endswith(_MAGIC):
            raise ValueError("it has no end: its recorder still writes, or was killed")
        start, _, checksum, _ = _FOOTER.unpack(tail)
        if start == 0:
            raise ValueError("it has no index")
        summary = self._bytes_at(start, self.size - len(_MAGIC) - start)
        if checksum not in (0, zlib.crc32(summary[:-4])):  # zero: there is none
            raise ValueError("its index is damaged")
        reader = SeekingReader(self._stream, record_size_limit=LARGEST)
        header, found = reader.get_header(), reader.get_summary()
        told = found and found.statistics
        if (
            not (found and told)
            or not told.channel_count <= len(found.channels) <= _MOST_CHANNELS
            or any(
                c.schema_id and c.schema_id not in found.schemas for c in found.channels.values()
            )
            or (told.message_count and not found.chunk_indexes)
        ):
            raise ValueError("its index is not complete")
        places = sorted((one.chunk_start_offset, one.chunk_length) for one in found.chunk_indexes)
        if any(offset + length > after for (offset, length), (after, _) in pairwise(places)):
            raise ValueError("its index names a part of the file twice")
        return header, found

    def _take_index(self, summary: Any) -> None:
        self.schemas, self.channels = summary.schemas, summary.channels
        for one in summary.chunk_indexes:
            channels = frozenset(one.message_index_offsets)
            place = one.chunk_start_offset, one.chunk_length
            self.blocks.append(Block(*place, True, one.message_start_time, channels))
        told = summary.statistics
        self.counts.update(told.channel_message_counts)
        if told.message_count:
            self.start_ns, self.end_ns = told.message_start_time, told.message_end_time
        for one in (*summary.attachment_indexes, *summary.metadata_indexes):
            try:
                opcode, length = FRAME.unpack(self._bytes_at(one.offset, FRAME.size))
                if opcode not in _DOCUMENTS:
                    raise ValueError("another record is there")
                self._take_record(opcode, one.offset, length)
            except BagError:
                raise
            except Exception as error:
                self._lose(f"{one.name!a} at byte {one.offset} is damaged: {_in_words(error)}")

    def _read_all(self, progress: Progress) -> None:
        """Go from record to record, and where that leads astray on to the next chunk."""
        position = len(_MAGIC)
        while position < self.size:
            end = self.size  # where the search ends
            try:
                opcode, length = FRAME.unpack(self._bytes_at(position, FRAME.size))
                if (opcode, length) == _END:
                    return
                following = position + FRAME.size + length
                if opcode not in (0, Opcode.CHUNK):  # the length of zeros is wrong, and this may be
                    end = min(following, self.size)
                self._take_record(opcode, position, length)
                end = following
            except BagError:
                raise
            except Exception as error:
                end = self._next_chunk(position + 1, end)
                self._lose(f"from byte {position} to {end} is no whole record: {_in_words(error)}")
            progress(end - position)
            position = end

    def _next_chunk(self, start: int, end: int) -> int:
        """Return where the next whole chunk begins; the end, if there is none before."""
        for position in range(start, end, _WINDOW):
            rest = self.size - position
            window = min(min(_WINDOW, end - position) + _OVERLAP, rest)
            found = chunk_in(self._bytes_at(position, window), rest)
            if found is not None and position + found < end:
                return position + found
        return end

    def _take_record(self, opcode: int, offset: int, length: int) -> None:
        """Take a record before the index into the content.

        Raises:
            Exception: The record is damaged, or there is too much of it; any error of the library.
        """
        if opcode in _DOCUMENTS:
            self._documents_size += length
            if self._documents_size > LARGEST:
                raise ValueError(f"all documents together are larger than {LARGEST >> 20} MiB")
        if opcode != Opcode.MESSAGE:
            self._take(parsed(self._bytes_at(offset, FRAME.size + length)))
        if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
            self._take_block(Block(offset, FRAME.size + length, opcode == Opcode.CHUNK))

    def _take(self, record: Any) -> None:
        match record:
            case Header():
                self.profile, self.library = record.profile, record.library
            case Schema():
                self.schemas.setdefault(record.id, record)
            case Channel():
                if record.schema_id and record.schema_id not in self.schemas:
                    raise ValueError(f"schema {record.schema_id} of a channel is described nowhere")
                if len(self.channels) >= _MOST_CHANNELS and record.id not in self.channels:
                    raise ValueError(f"there are more than {_MOST_CHANNELS} channels")
                self.channels.setdefault(record.id, record)
            case Attachment():
                self.attachments.append(record)
            case Metadata():
                self.metadata.append(record)

    def _take_block(self, block: Block) -> None:
        """Count the messages of a block; one that is outside of chunks goes into a run of them."""
        found = self.messages(block)
        if not found:
            return
        times_ns = [message.log_time_ns for message in found]
        counts = Counter(message.channel for message in found)
        start_ns, channels = min(times_ns), frozenset(counts)
        self.counts += counts
        self.start_ns = start_ns if self.start_ns is None else min(start_ns, self.start_ns)
        self.end_ns = max(*times_ns, self.end_ns or 0)
        offset, length = block.offset, block.length
        run = self.blocks[-1] if self.blocks and not block.is_chunk else block
        if not run.is_chunk and run.offset + run.length == offset and run.length < _LONGEST_RUN:
            self.blocks.pop()
            offset, length = run.offset, run.length + length
            start_ns, channels = min(run.start_ns, start_ns), run.channels | channels
        self.blocks.append(Block(offset, length, block.is_chunk, start_ns, channels))

    def _messages(self, block: Block, wanted: Container[int] | None) -> Iterator[RawMessage]:
        """Yield the messages of a block; its channels are added to those of the file.

        Raises:
            Exception: The block is damaged; any error of the library.
        """
        records = self._bytes_at(block.offset, block.length)
        most = _RECORDS_FOR_NOTHING + block.length
        if block.is_chunk:
            chunk: Chunk = parsed(records)
            records = inflated(chunk)
        position, count = 0, 0
        # Not by the library, which takes four times as long and holds all records at once.
        while position < len(records):
            opcode, length = FRAME.unpack_from(records, position)
            start, body = position, position + FRAME.size
            position, count = body + length, count + 1
            if position > len(records):
                raise ValueError("a record in it is longer than what is left")
            if count > most:
                raise ValueError("there are more records in it than recorders write")
            if opcode == Opcode.MESSAGE:
                if length < _MESSAGE.size:
                    raise ValueError("a message in it is too short")
                channel, _, log_time, publish_time = _MESSAGE.unpack_from(records, body)
                if channel not in self.channels:
                    raise ValueError(f"channel {channel} of a message is described nowhere")
                if wanted is None or channel in wanted:
                    cdr = records[body + _MESSAGE.size : position]
                    yield RawMessage(channel, log_time, publish_time, cdr)
            elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
                self._take(parsed(records[start:position]))

    def _bytes_at(self, offset: int, length: int) -> bytes:
        """Return bytes of the file.

        Raises:
            ValueError: The file ends before, or a record may not be that long.
            BagError: The disk fails.
        """
        if not 0 <= length <= FRAME.size + LARGEST:
            raise ValueError(f"its length is not from 0 to {LARGEST >> 20} MiB")
        if offset + length > self.size:
            raise ValueError("the file ends before")
        try:
            return os.pread(self._stream.fileno(), length, offset)
        except OSError as error:
            raise BagError(f"bag {self.path} cannot be read: {error.strerror}") from None


def _in_words(error: Exception) -> str:
    """Return the message of an error on damaged bytes; that of a library with its kind."""
    kind = "" if type(error) is ValueError else f"{type(error).__name__}: "
    return printable(f"{kind}{error}".removesuffix(": "), _LONGEST_REASON)
