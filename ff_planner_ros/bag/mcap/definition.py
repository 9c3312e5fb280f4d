"""Complete definitions of message types, with which a bag is read without their packages."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

from ff_planner_ros.common.share import installation_prefixes
from ff_planner_ros.errors import BagError

ENCODING = "ros2msg"  # of every definition here, in the words of MCAP

_TYPE_NAME = re.compile(r"(\w+)/msg/(\w+)")
_PRIMITIVE = re.compile(r"bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string")
_SEPARATOR = "=" * 80


@dataclass(frozen=True)
class Definition:
    """The complete definition of a message type: its own text and that of all types it holds."""

    name: str  # of the type, as a bag writes it: `package/msg/Name`
    text: str  # `ros2msg`, concatenated as in rosbag2's `message_definition_encoding.md`
    hash: str  # of the type: RIHS01 of REP 2011


def message_definition(type_name: str) -> Definition:
    """Return the complete definition of a message type, `package/msg/Name`, as it is installed.

    Raises:
        BagError: The name is of another form, or the type is not installed.
    """
    named = _TYPE_NAME.fullmatch(type_name)
    if named is None:
        raise BagError(f"message type is {type_name!r}: it must be package/msg/Name")
    package, name = named.groups()
    texts = _gather(f"{package}/{name}")
    return Definition(type_name, _concatenated(texts), _installed_hash(package, name))


def _installed_hash(package: str, name: str) -> str:
    hashes = json.loads(_installed(f"{package}/msg/{name}.json"))["type_hashes"]
    wanted = f"{package}/msg/{name}"
    return str(next(one["hash_string"] for one in hashes if one["type_name"] == wanted))


def _concatenated(texts: dict[str, str]) -> str:
    """Return definitions as one; the first is that of the type itself."""
    root, *held = texts.items()
    sections = [f"{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in held]
    return "\n".join([root[1], *sections])


def _gather(root: str) -> dict[str, str]:
    """Return the text of `root` and of every type that it holds, directly or not."""
    texts: dict[str, str] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = _msg_text(name)
            waiting += _types_in_msg(name, texts[name])
    return texts


def _msg_text(name: str) -> str:
    package, stem = name.split("/")
    return _installed(f"{package}/msg/{stem}.msg")


def _types_in_msg(name: str, text: str) -> list[str]:
    """Return the types of the fields of a definition that are messages themselves."""
    types = []
    for line in text.splitlines():
        statement = line.partition("#")[0].split()
        field_type = re.split(r"[\[<]", statement[0])[0] if statement else "bool"
        if not _PRIMITIVE.fullmatch(field_type):
            package = (field_type if "/" in field_type else name).split("/")[0]
            types.append(f"{package}/{field_type.split('/')[-1]}")
    return types


def _installed(path: str) -> str:
    """Return the text of a file below `share` of the first prefix that has it."""
    prefixes = installation_prefixes()
    for prefix in prefixes:
        file = prefix / "share" / path
        if file.is_file():
            return file.read_text(encoding="utf-8")
    searched = ", ".join(map(str, prefixes))
    raise BagError(f"share/{path}, part of a message type, is below none of {searched}")
