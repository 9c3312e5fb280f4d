"""Finds the content of an MCAP file by its index or, without a sound one, by reading all of it."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Statistics,
)

from ff_planner_ros.bag.mcap.mcap_file import Block, McapFile
from ff_planner_ros.bag.mcap.mcap_records import (
    COMPRESSION_AT,
    FRAME,
    LARGEST,
    chunk_of,
    in_words,
    parsed,
    unreadable,
)
from ff_planner_ros.errors import BagError

MAGIC = b"\x89MCAP0\r\n"  # an MCAP file starts and ends with it
Progress = Callable[[int], None]  # called with the number of bytes just read

_FOOTER = struct.Struct("<QQI")  # start of the summary, of its offsets, its checksum
_ENDS = ((Opcode.DATA_END, 4), (Opcode.FOOTER, _FOOTER.size))  # with their lengths
_TAIL = FRAME.size + _FOOTER.size + len(MAGIC)
_COMPRESSION = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")  # stands in the head of a chunk,
_CHUNK_HEAD = 64  # [bytes] which is not longer than this
_WINDOW, _OVERLAP = 1 << 20, 8  # [bytes] searched at once; what may reach into the next ones
_LONGEST_RUN = 1 << 20  # [bytes] of messages outside of chunks that are read at once


def open_mcap(path: Path, stream: BinaryIO, progress: Progress) -> McapFile:
    """Return the content of an MCAP file; its blocks are read later.

    Args:
        stream: The open file; must stay open as long as blocks are read.
        progress: Called while a file without an index is read to its end.

    Raises:
        BagError: The file is no MCAP file, or the disk fails.
    """
    try:
        size = os.fstat(stream.fileno()).st_size
        if os.pread(stream.fileno(), len(MAGIC), 0) != MAGIC:
            raise BagError(f"bag {path} is no MCAP file")
        file = McapFile(path, stream, size)
        try:
            _by_index(file)
        except _NoIndex as reason:
            file = McapFile(path, stream, size)
            file.note(f"{reason}; it was read from its start as far as it goes")
            _by_reading(file, progress)
    except OSError as error:
        raise unreadable(path, error) from None
    return file


class _NoIndex(Exception):
    """There is no index, or it cannot be trusted; says why."""


def _by_index(file: McapFile) -> None:
    tail = file.bytes_at(file.size - _TAIL, _TAIL) if file.size > _TAIL else b""
    if not tail.endswith(MAGIC):
        raise _NoIndex("it has no end: its recorder still writes, or was killed")
    if FRAME.unpack_from(tail) != (Opcode.FOOTER, _FOOTER.size):
        raise _NoIndex("its end is damaged")
    start, _, checksum = _FOOTER.unpack_from(tail, FRAME.size)
    if start == 0:
        raise _NoIndex("it has no index")
    try:
        summary = file.bytes_at(start, file.size - len(MAGIC) - start)
        if checksum not in (0, zlib.crc32(summary[:-4])):  # zero: there is none
            raise ValueError("the checksum is another")
        statistics = _take_summary(file, summary)
        _take_header(file, _body_at(file, len(MAGIC)))
    except (_NoIndex, OSError):
        raise
    except Exception as error:  # where bytes are damaged, the library trips over their meaning
        raise _NoIndex(f"its index is damaged ({in_words(error)})") from None
    if len(file.channels) < statistics.channel_count:
        raise _NoIndex("its index does not list the channels")
    if statistics.message_count and not file.blocks:
        raise _NoIndex("its index does not say where the messages are")
    file.counts.update(statistics.channel_message_counts)
    if statistics.message_count:
        file.start_ns, file.end_ns = statistics.message_start_time, statistics.message_end_time


def _take_summary(file: McapFile, summary: bytes) -> Statistics:
    statistics: Statistics | None = None
    position = 0
    documents: list[tuple[int, int]] = []  # offset and opcode of attachments and metadata
    while position < len(summary):
        opcode, length = FRAME.unpack_from(summary, position)
        body = summary[position + FRAME.size : position + FRAME.size + length]
        position += FRAME.size + length
        match opcode:
            case Opcode.SCHEMA | Opcode.CHANNEL:
                file.describe(opcode, body)
            case Opcode.STATISTICS:
                statistics = parsed(Statistics, body)
            case Opcode.CHUNK_INDEX:
                file.blocks.append(_indexed_block(parsed(ChunkIndex, body)))
            case Opcode.ATTACHMENT_INDEX:
                documents.append((parsed(AttachmentIndex, body).offset, Opcode.ATTACHMENT))
            case Opcode.METADATA_INDEX:
                documents.append((parsed(MetadataIndex, body).offset, Opcode.METADATA))
    if statistics is None:
        raise _NoIndex("its index has no statistics")
    _take_documents(file, documents)
    return statistics


def _take_documents(file: McapFile, documents: list[tuple[int, int]]) -> None:
    """Read attachments and metadata at the places that the index names.

    Raises:
        Exception: There are others, or a place is named twice: few bytes would become many.
    """
    places = [(block.offset, block.length) for block in file.blocks]
    for offset, opcode in documents:
        found, length = FRAME.unpack(file.bytes_at(offset, FRAME.size))
        if found != opcode:
            raise ValueError(f"at byte {offset} is another record than it says")
        places.append((offset, FRAME.size + length))
    places.sort()
    for (offset, length), (following, _) in pairwise(places):
        if offset + length > following:
            raise ValueError(f"it names byte {following} more than once")
    for offset, opcode in documents:
        _take_document(file, opcode, offset)


def _take_document(file: McapFile, opcode: int, offset: int) -> None:
    """Read an attachment or metadata; all together must fit the memory."""
    body = _body_at(file, offset)
    file.documents_size += len(body)
    if file.documents_size > LARGEST:
        file.lose(f"the documents are larger than {LARGEST >> 20} MiB: one of them is left out")
    elif opcode == Opcode.ATTACHMENT:
        _take_attachment(file, body)
    else:
        file.metadata.append(parsed(Metadata, body))


def _indexed_block(index: ChunkIndex) -> Block:
    offset, length = index.chunk_start_offset, index.chunk_length
    channels = frozenset(index.message_index_offsets) or None  # the index of a chunk is optional
    return Block(offset, length, index.message_start_time, channels, is_chunk=True)


def _body_at(file: McapFile, offset: int) -> bytes:
    _, length = FRAME.unpack(file.bytes_at(offset, FRAME.size))
    return file.bytes_at(offset + FRAME.size, length)


def _take_header(file: McapFile, body: bytes) -> None:
    header: Header = parsed(Header, body)
    file.profile, file.library = header.profile, header.library


def _take_attachment(file: McapFile, body: bytes) -> None:
    attachment: Attachment = parsed(Attachment, body)
    (checksum,) = struct.unpack("<I", body[-4:])
    if checksum in (0, zlib.crc32(body[:-4])):
        file.attachments.append(attachment)
    else:
        file.lose(f"the attachment {attachment.name!a} is damaged")


def _by_reading(file: McapFile, progress: Progress) -> None:
    """Go from record to record, and where that leads astray on to the next chunk."""
    position = len(MAGIC)
    while position + FRAME.size <= file.size:
        opcode, length = FRAME.unpack(file.bytes_at(position, FRAME.size))
        if (opcode, length) in _ENDS:
            return
        end = position + FRAME.size + length
        if opcode == 0 or end > file.size:
            astray, position = position, _next_chunk(file, position + 1)
            if position < file.size:
                file.lose(f"from byte {astray} to {position} there are no records")
            elif opcode == Opcode.CHUNK:
                cut = Block(astray, file.size - astray, 0, None, is_chunk=True)
                file.leave_out(cut, "is cut")
            else:
                file.lose(f"from byte {astray} on there is no whole record")
            progress(position - astray)
            continue
        is_chunk = opcode == Opcode.CHUNK
        _take_record(file, opcode, Block(position, end - position, 0, None, is_chunk))
        progress(end - position)
        position = end
    if position < file.size:
        file.lose(f"from byte {position} on there is no whole record")


def _next_chunk(file: McapFile, start: int) -> int:
    """Return where the next whole chunk that is compressed begins; the size, if there is none."""
    position = start - _WINDOW
    while (position := _next_data(file, position + _WINDOW)) < file.size:
        window = file.bytes_at(position, min(_WINDOW + _OVERLAP, file.size - position))
        for match in _COMPRESSION.finditer(window):
            offset = position + match.start() - COMPRESSION_AT
            if offset >= start and _is_chunk(file, offset):
                return offset
    return file.size


def _next_data(file: McapFile, position: int) -> int:
    """Return where the file goes on behind a hole, which reads as zeros and may be terabytes."""
    try:
        return os.lseek(file.stream.fileno(), position, os.SEEK_DATA)
    except OSError:  # there is none
        return file.size


def _is_chunk(file: McapFile, offset: int) -> bool:
    try:
        opcode, length = FRAME.unpack(file.bytes_at(offset, FRAME.size))
        head = file.bytes_at(offset, _CHUNK_HEAD)
        chunk, size = chunk_of(head)
    except ValueError:
        return False
    whole = FRAME.size + length == len(head) - len(chunk.data) + size
    return bool(opcode == Opcode.CHUNK and whole) and offset + FRAME.size + length <= file.size


def _take_record(file: McapFile, opcode: int, block: Block) -> None:
    try:
        match opcode:
            case Opcode.CHUNK | Opcode.MESSAGE:
                _take_block(file, block)
            case Opcode.HEADER:
                _take_header(file, _body_at(file, block.offset))
            case Opcode.SCHEMA | Opcode.CHANNEL:
                file.describe(opcode, _body_at(file, block.offset))
            case Opcode.ATTACHMENT | Opcode.METADATA:
                _take_document(file, opcode, block.offset)
    except (BagError, OSError):
        raise
    except Exception as error:  # as in the index
        file.lose(f"the record at byte {block.offset} is damaged: {in_words(error)}")


def _take_block(file: McapFile, block: Block) -> None:
    """Count the messages of a chunk, or take one that is outside of chunks into a run of them."""
    found = file.messages(block, None)
    if not found:
        return
    times_ns = [message.log_time_ns for message in found]
    start_ns, end_ns = min(times_ns), max(times_ns)
    counts = Counter(message.channel for message in found)
    file.counts += counts
    file.start_ns = min(start_ns, start_ns if file.start_ns is None else file.start_ns)
    file.end_ns = max(end_ns, file.end_ns or 0)
    offset, length, channels = block.offset, block.length, frozenset(counts)
    if not block.is_chunk and file.blocks and _goes_on(file.blocks[-1], offset):
        run = file.blocks.pop()
        offset, length = run.offset, run.length + length
        start_ns, channels = min(start_ns, run.start_ns), channels | (run.channels or frozenset())
    file.blocks.append(Block(offset, length, start_ns, channels, block.is_chunk))


def _goes_on(run: Block, offset: int) -> bool:
    """Whether the messages outside of chunks go on at an offset."""
    is_next = not run.is_chunk and run.offset + run.length == offset
    return is_next and run.length < _LONGEST_RUN
