"""Definitions of message types, complete: a bag that holds them is read without the types."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass

from ff_planner_ros.common.share import installation_prefixes
from ff_planner_ros.errors import BagError

_TYPE_NAME = re.compile(
    r"\w+/(msg/\w+|srv/\w+_(Event|Request|Response)"
    r"|action/[A-Za-z0-9]+_(FeedbackMessage|(SendGoal|GetResult)_Event))"
)
_PRIMITIVE = re.compile(r"bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string")
_INCLUDE = re.compile(r'^#include\s+["<](\S+)\.idl[">]\n', re.MULTILINE)
_STRING = re.compile(r'"((?:[^"\\]|\\.)*)"')
_COMMENT = re.compile(rf'@verbatim \(language="comment", text=((?:\s*{_STRING.pattern})+)\s*\)')
_SEPARATOR = "=" * 80


@dataclass(frozen=True)
class Definition:
    """The complete definition of a message type: its own text and that of all types it holds."""

    encoding: str  # `ros2msg` or `ros2idl`, as in an MCAP schema
    text: str  # the definitions, concatenated as in rosbag2's `message_definition_encoding.md`


def message_definition(type_name: str) -> Definition:
    """Return the complete definition of a message type, from the ament share directories.

    Types are named `package/msg/Name`, `package/srv/Name_Event`, `_Request`, `_Response`, or
    `package/action/Name_FeedbackMessage`, `_SendGoal_Event`, `_GetResult_Event`.

    A message is given as `ros2msg`, a part of a service or an action as `ros2idl`: readers of
    `ros2msg` refuse the underscore in `SetBool_Event` or expect it under `msg`, and the `.srv` file
    that rosbag2 itself stores does not define the event. The type itself is the first structure in
    the text: Foxglove's libraries take the first one, whatever its name.

    Raises:
        BagError: The name is of another form, or the type is not installed.
    """
    package, kind, name = _split(type_name)
    if kind == "msg":
        root, *held = _gather(f"{package}/{name}", _msg_text, _types_in_msg).items()
        sections = [f"{_SEPARATOR}\nMSG: {held_name}\n{text}" for held_name, text in held]
        return Definition("ros2msg", "\n".join([root[1], *sections]))
    installed = kind == "srv" and not name.endswith("_Event")
    root_name = f"{package}/srv/{_service(name)}" if installed else type_name
    root, *held = _gather(root_name, _idl_text, _types_in_idl).items()
    texts = [(root[0], _with_first(name, _idl(root[1]))), *((h, _idl(text)) for h, text in held)]
    parts = (f"{_SEPARATOR}\nIDL: {idl_name}\n{text}" for idl_name, text in texts)
    return Definition("ros2idl", "\n".join(parts))


def type_hash(type_name: str) -> str:
    """Return the hash of a message type (RIHS01 of REP 2011), from the ament share directories.

    Raises:
        BagError: The name is of another form, or the type is not installed.
    """
    package, kind, name = _split(type_name)
    stem = {"msg": name, "srv": _service(name), "action": name.partition("_")[0]}[kind]
    hashes = json.loads(_installed(f"{package}/{kind}/{stem}.json"))["type_hashes"]
    return str(next(one["hash_string"] for one in hashes if one["type_name"] == type_name))


def _split(type_name: str) -> list[str]:
    if _TYPE_NAME.fullmatch(type_name) is None:
        raise BagError(
            f"message type is {type_name!r}: it must be package/msg/Name, package/srv/Name_Event, "
            "_Request or _Response, or package/action/Name_FeedbackMessage, _SendGoal_Event or "
            "_GetResult_Event"
        )
    return type_name.split("/")


def _with_first(struct: str, idl: str) -> str:
    """Return the IDL of a module in a module, with one of its structures before the others."""
    modules = re.search(r"^module \w+ \{\n([^m\n].*\n)*module \w+ \{\n", idl, re.MULTILINE)
    own = re.search(rf"^([/@].*\n)*struct {struct} \{{(?s:.*?)\}};\n", idl, re.MULTILINE)
    if modules is None or own is None:
        raise BagError(f"the installed IDL of {struct} does not define it in its package and kind")
    begin, end = modules.end(), own.end()
    return idl[:begin] + own[0] + idl[begin : own.start()] + idl[end:]


def _idl(text: str) -> str:
    """Return IDL without includes, with comments for annotations and no blanks.

    It is complete as it is, and the reader of rosbags stops at an include; without the rest it
    reads ten times faster.
    """

    def comment(match: re.Match[str]) -> str:
        lines = (line.replace(r"\n", "").replace(r"\"", '"') for line in _STRING.findall(match[1]))
        return "\n".join(f"// {line}" for line in lines)

    return re.sub(r"\n\s+", "\n", _COMMENT.sub(comment, _INCLUDE.sub("", text))).lstrip()


def _service(part: str) -> str:
    return part.rpartition("_")[0]


def _gather(
    root: str, text_of: Callable[[str], str], types_in: Callable[[str, str], list[str]]
) -> dict[str, str]:
    """Return the text of `root` and of every type that it holds, directly or not."""
    texts: dict[str, str] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = text_of(name)
            waiting += types_in(name, texts[name])
    return texts


def _msg_text(name: str) -> str:
    package, stem = name.split("/")
    return _installed(f"{package}/msg/{stem}.msg")


def _types_in_msg(name: str, text: str) -> list[str]:
    types = []
    for line in text.splitlines():
        words = line.partition("#")[0].split()
        if words:
            field_type = re.split(r"[\[<]", words[0])[0]
            if not _PRIMITIVE.fullmatch(field_type):
                package = (field_type if "/" in field_type else name).split("/")[0]
                types.append(f"{package}/{field_type.split('/')[-1]}")
    return types


def _idl_text(name: str) -> str:
    # rosidl installs no file of a service's event, nor of what ROS itself makes of an action; a
    # message's name has no underscore.
    package, kind, stem = name.split("/")
    if kind == "action" and "_" in stem:
        return _action_idl(package, *stem.split("_")[:2])
    return _event_idl(name) if name.endswith("_Event") else _installed(f"{name}.idl")


def _action_idl(package: str, action: str, part: str) -> str:
    """Return what ROS makes of an action: https://design.ros2.org/articles/actions.html."""
    own = f"{package}::action::{action}"
    goal_id, time = "unique_identifier_msgs::msg::UUID goal_id;", "builtin_interfaces::msg::Time"
    structs = {
        "FeedbackMessage": {"FeedbackMessage": f"{goal_id} {own}_Feedback feedback;"},
        "SendGoal": {
            "SendGoal_Request": f"{goal_id} {own}_Goal goal;",
            "SendGoal_Response": f"boolean accepted; {time} stamp;",
            "SendGoal_Event": _event_fields(f"{own}_SendGoal"),
        },
        "GetResult": {
            "GetResult_Request": goal_id,
            "GetResult_Response": f"int8 status; {own}_Result result;",
            "GetResult_Event": _event_fields(f"{own}_GetResult"),
        },
    }[part]
    written = "\n".join(f"    struct {action}_{n} {{ {text} }};" for n, text in structs.items())
    return f"""\
#include "builtin_interfaces/msg/Time.idl"
#include "service_msgs/msg/ServiceEventInfo.idl"
#include "unique_identifier_msgs/msg/UUID.idl"
#include "{package}/action/{action}.idl"

module {package} {{
  module action {{
{written}
  }};
}};
"""


def _event_fields(service: str) -> str:
    return (
        "service_msgs::msg::ServiceEventInfo info; "
        f"sequence<{service}_Request, 1> request; sequence<{service}_Response, 1> response;"
    )


def _event_idl(name: str) -> str:
    package, _, event = name.split("/")
    service = _service(event)
    return f"""\
#include "service_msgs/msg/ServiceEventInfo.idl"
#include "{package}/srv/{service}.idl"

module {package} {{
  module srv {{
    struct {event} {{
      {_event_fields(f"{package}::srv::{service}")}
    }};
  }};
}};
"""


def _types_in_idl(_name: str, text: str) -> list[str]:
    return _INCLUDE.findall(text)


def _installed(path: str) -> str:
    """Return the text of a file below `share` of the first prefix that has it."""
    prefixes = installation_prefixes()
    for prefix in prefixes:
        file = prefix / "share" / path
        if file.is_file():
            return file.read_text(encoding="utf-8")
    searched = ", ".join(map(str, prefixes))
    raise BagError(f"share/{path}, part of a message type, is below none of {searched}")
