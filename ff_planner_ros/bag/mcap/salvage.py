"""Saves messages of a chunk that breaks off."""

from __future__ import annotations

from contextlib import suppress

import zstandard

from ff_planner_ros.bag.mcap.mcap_file import Block, McapFile, RawMessage
from ff_planner_ros.bag.mcap.mcap_records import LARGEST, chunk_of

_PIECE = 1024  # [bytes] that are decompressed at once where it may break off


def salvaged(file: McapFile, block: Block) -> list[RawMessage]:
    """Return the messages of a damaged chunk that come before it breaks off.

    They are without a checksum: each must fit its definition, and what comes after one that does
    not is left out. A chunk that does not break off and has a wrong checksum is left out whole:
    it is not known which of its messages is wrong.
    """
    found: list[RawMessage] = []
    with suppress(Exception):  # it ends where the bytes make no sense any more
        records = _records_before_the_break(file, block) if block.is_chunk else b""
        for channel, log_time, publish_time, start, end in file.heads(records):
            cdr = records[start:end]
            file.decoder_of(file.channels[channel])(cdr)
            found.append(RawMessage(channel, log_time, publish_time, cdr))
    if found:
        file.note(
            f"of the chunk at byte {block.offset}, {len(found)} messages were saved, unchecked"
        )
    return found


def _records_before_the_break(file: McapFile, block: Block) -> bytes:
    chunk, _ = chunk_of(file.bytes_at(block.offset, block.length))
    size = min(chunk.uncompressed_size, LARGEST)
    records = bytearray(chunk.data if chunk.compression == "" else b"")
    if chunk.compression == "zstd":
        machine = zstandard.ZstdDecompressor(max_window_size=LARGEST).decompressobj()
        with suppress(zstandard.ZstdError):
            for start in range(0, len(chunk.data), _PIECE):
                records += machine.decompress(chunk.data[start : start + _PIECE])
                if len(records) >= size or machine.eof:
                    break
    return b"" if len(records) >= size else bytes(records)
