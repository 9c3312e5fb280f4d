"""Records of an MCAP file from their bytes, and words for what is wrong with them."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.records import Chunk

from ff_planner_ros.errors import BagError

FRAME = struct.Struct("<BQ")  # of a record: opcode, length of what follows
_CHUNK = struct.Struct("<QQQII")  # start, end, size and checksum of its records, length of a name
_LENGTH = struct.Struct("<Q")
COMPRESSION_AT = FRAME.size + _CHUNK.size - 4  # [bytes] from the start of a chunk
_LONGEST_REASON = 120  # [characters] of a library, in a note that is read
_LONGEST_NOTE = 1000  # [characters]


def chunk_of(record: bytes) -> tuple[Chunk, int]:
    """Return a chunk, and the size that its compressed records should have.

    The library's reader copies them twice more, and does not see that they are cut.

    Raises:
        Exception: It is damaged, or cut before its records.
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


def parsed(record_type: Any, body: bytes) -> Any:
    """Return a record of the library from its bytes without opcode and length.

    Raises:
        Exception: It is damaged; whatever the library trips over.
    """
    return record_type.read(ReadDataStream(BytesIO(body)))


def unreadable(path: Path, error: OSError) -> BagError:
    """Return the error for a file that the system does not let us read."""
    return BagError(f"bag {path} cannot be read: {error.strerror or error}")


def in_words(error: Exception) -> str:
    """Return what a library says of damaged bytes."""
    return printable(f"{type(error).__name__}: {error}".removesuffix(": "), _LONGEST_REASON)


def printable(text: str, longest: int = _LONGEST_NOTE) -> str:
    """Return a text of a bag on one line, without control characters."""
    shown = "".join(character if character.isprintable() else "?" for character in text)
    return shown if len(shown) <= longest else f"{shown[:longest]}..."
