"""Read a bag: messages as they were written, byte by byte, and the documents kept with them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.reader import make_reader

from ff_planner_ros.bag.definition import type_hash
from ff_planner_ros.errors import BagError

_MAGIC = b"\x89MCAP0\r\n"  # an MCAP file starts and ends with it


@dataclass(frozen=True)
class Recording:
    """What was asked for of a bag.

    Attributes:
        messages: As CDR, in the order of recording.
        attachments: Content of each attached document, by its file name.
    """

    messages: tuple[bytes, ...]
    attachments: Mapping[str, bytes]


def read_bag(bag: Path, type_name: str) -> Recording:
    """Return a bag's attachments and its messages of one type, whatever their topic.

    Args:
        bag: The directory, or its MCAP file.
        type_name: `package/msg/Name` or `package/srv/Name_Event`.

    Raises:
        BagError: The bag cannot be read, is not complete, is damaged, or was recorded with another
            definition of the type than is installed.
    """
    file = _file_of(bag)
    try:
        with file.open("rb") as stream:
            _require_complete(file, stream)
            return _recording(file, stream, type_name)
    except OSError as error:
        raise BagError(f"bag {file} cannot be read: {error.strerror}") from None


def _file_of(bag: Path) -> Path:
    if not bag.is_dir():
        return bag
    files = sorted(bag.glob("*.mcap"))
    if len(files) != 1:
        found = ", ".join(file.name for file in files) or "none"
        raise BagError(f"bag {bag} must hold one .mcap file; found: {found}")
    return files[0]


def _require_complete(file: Path, stream: BinaryIO) -> None:
    if stream.read(len(_MAGIC)) != _MAGIC:
        raise BagError(f"bag {file} is no MCAP file")
    stream.seek(-len(_MAGIC), os.SEEK_END)
    if stream.read() != _MAGIC:
        raise BagError(f"bag {file} has no end: its recorder still writes, or was killed")
    stream.seek(0)


def _recording(file: Path, stream: BinaryIO, type_name: str) -> Recording:
    try:
        reader = make_reader(stream, validate_crcs=True)
        of_type = [
            (channel.metadata.get("topic_type_hash"), message.data)
            for schema, channel, message in reader.iter_messages()
            if schema is not None and schema.name == type_name
        ]
        attachments = {item.name: item.data for item in reader.iter_attachments()}
    except Exception as error:  # where bytes are damaged, the library trips over what they mean
        reason = f"{type(error).__name__}: {error}"
        raise BagError(f"bag {file} is damaged: {reason}") from None
    if any(recorded_hash != type_hash(type_name) for recorded_hash, _ in of_type):
        raise BagError(f"bag {file} holds another version of {type_name} than is installed here")
    return Recording(tuple(data for _, data in of_type), attachments)
