"""Parsing of the records of an MCAP file, and messages on errors in them."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk

from ff_planner_ros.common import shown
from ff_planner_ros.errors import BagError

FRAME = struct.Struct("<BQ")  # of a record: opcode, length of what follows
_CHUNK = struct.Struct("<QQQII")  # start, end, size and checksum of its records, length of a name
_LENGTH = struct.Struct("<Q")
# Recorders end a chunk at a megabyte or when a larger message is in it. A damaged or a malicious
# length must not fill the memory: a hundred kilobytes may inflate to gigabytes.
LARGEST = 64 << 20  # [bytes] of a record, and of the records in a chunk
COMPRESSION_AT = FRAME.size + _CHUNK.size - 4  # [bytes] from the start of a chunk
_LONGEST_REASON = 120  # [characters] of a library, in a note that is read
_LONGEST_NOTE = 900  # [characters]


def chunk_of(record: bytes) -> tuple[Chunk, int]:
    """Return a chunk, and the size that its compressed records should have.

    The library's reader copies them twice more, and does not see that they are cut.

    Raises:
        Exception: The chunk is damaged, or cut before its records.
    """
    start_ns, end_ns, size, checksum, length = _CHUNK.unpack_from(record, FRAME.size)
    name_at = FRAME.size + _CHUNK.size
    (compressed_size,) = _LENGTH.unpack_from(record, name_at + length)
    chunk = Chunk(
        compression=record[name_at : name_at + length].decode(),
        data=record[name_at + length + _LENGTH.size :],
        message_end_time=end_ns,
        message_start_time=start_ns,
        uncompressed_crc=checksum,
        uncompressed_size=size,
    )
    return chunk, compressed_size


def records_in(chunk: Chunk) -> bytes:
    """Return the records in a chunk, decompressed, after a check of their checksum.

    Raises:
        Exception: The records are damaged, or larger than `LARGEST`.
    """
    match chunk.compression:
        case "":
            records = chunk.data
        case "zstd":
            records = _from_zstd(chunk)
        case "lz4":
            machine = lz4.frame.LZ4FrameDecompressor()
            records = machine.decompress(chunk.data, max_length=LARGEST)
            if not machine.eof:
                raise ValueError(f"it breaks off, or inflates to more than {LARGEST >> 20} MiB")
        case other:
            raise ValueError(f"its compression is {other!a}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(records)):  # zero: there is none
        raise ValueError("its checksum is another")
    return records


def _from_zstd(chunk: Chunk) -> bytes:
    size = zstandard.get_frame_parameters(chunk.data).content_size
    told = size if size != zstandard.CONTENTSIZE_UNKNOWN else chunk.uncompressed_size
    if told > LARGEST:
        raise ValueError(f"it inflates to more than {LARGEST >> 20} MiB")
    machine = zstandard.ZstdDecompressor(max_window_size=LARGEST)
    if size == told:
        return machine.decompress(chunk.data)
    records: bytes = machine.stream_reader(chunk.data).read(told + 1)
    if len(records) != told:
        raise ValueError(f"it does not inflate to {told} bytes")
    return records


def parsed(record_type: Any, body: bytes) -> Any:
    """Return a record of the library from its bytes without opcode and length.

    Raises:
        Exception: The record is damaged; any error of the library.
    """
    return record_type.read(ReadDataStream(BytesIO(body)))


def unreadable(path: Path, error: OSError | ValueError) -> BagError:
    """Return the error for a file that the operating system does not let us read."""
    reason = getattr(error, "strerror", None) or error
    return BagError(f"bag {path} cannot be read: {reason}")


def in_words(error: Exception) -> str:
    """Return the message of an error of a library on damaged bytes."""
    return printable(f"{type(error).__name__}: {error}".removesuffix(": "), _LONGEST_REASON)


def printable(text: str, longest: int = _LONGEST_NOTE) -> str:
    """Return a text of a bag on one line, without control characters."""
    return shown.printable(text, longest)
