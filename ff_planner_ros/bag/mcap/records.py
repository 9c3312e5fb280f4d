"""Records of an MCAP file, parsed by the library `mcap` within bounds that it does not have."""

from __future__ import annotations

import re
import struct
import zlib
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Chunk
from mcap.stream_reader import StreamReader

FRAME = struct.Struct("<BQ")  # of a record: opcode, length of what follows
# Recorders end a chunk at a megabyte or when a larger message is in it. A damaged or a malicious
# length must not fill the memory: a hundred kilobytes may inflate to gigabytes.
LARGEST = 64 << 20  # [bytes] of a record, and of the records in a chunk

_NO_CHECKSUM = bytes(4)
# The head of a chunk: length of the record, 28 bytes, compression, length of the rest.
_CHUNK = re.compile(rb"\x06(?=(.{8}).{28}(\x04\0\0\0zstd|\x03\0\0\0lz4|\0{4})(.{8}))", re.DOTALL)


def parsed(record: bytes) -> Any:
    """Return a record from its bytes, a chunk as a whole.

    Raises:
        Exception: The record is damaged or of an unknown kind; any error of the library.
    """
    reader = StreamReader(BytesIO(record), skip_magic=True, emit_chunks=True)
    found = next(reader.records)
    # The library sees neither that a part ends before its record nor the checksum of an attachment.
    builder = RecordBuilder()
    found.write(builder)
    written = builder.end()
    if len(written) != len(record):
        raise ValueError("its lengths do not agree")
    if isinstance(found, Attachment) and record[-4:] not in (written[-4:], _NO_CHECKSUM):
        raise ValueError("its checksum is another")
    return found


def inflated(chunk: Chunk) -> bytes:
    """Return the records in a chunk, decompressed.

    Raises:
        Exception: The records are damaged, or larger than `LARGEST`; any error of the library.
    """
    size = chunk.uncompressed_size
    if size > LARGEST:
        raise ValueError(f"it inflates to more than {LARGEST >> 20} MiB")
    match chunk.compression:  # the library inflates whatever there is
        case "":
            records = chunk.data
        case "zstd":
            machine = zstandard.ZstdDecompressor(max_window_size=LARGEST)
            records = machine.stream_reader(chunk.data).read(size + 1)
        case "lz4":
            records = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        case other:
            raise ValueError(f"its compression is {other!a}")
    if len(records) != size:
        raise ValueError(f"it does not inflate to {size} bytes")
    if chunk.uncompressed_crc not in (0, zlib.crc32(records)):  # zero: there is none
        raise ValueError("its checksum is another")
    return records


def chunk_in(data: bytes, size: int) -> int | None:
    """Return where the first chunk in data begins whose lengths agree; None: there is none.

    Args:
        size: How far it may reach from the start of the data, and behind their end [bytes].
    """
    for match in _CHUNK.finditer(data):
        length, rest = (int.from_bytes(match[number], "little") for number in (1, 3))
        is_whole = length == 28 + len(match[2]) + 8 + rest
        if is_whole and match.start() + FRAME.size + length <= size:
            return match.start()
    return None
