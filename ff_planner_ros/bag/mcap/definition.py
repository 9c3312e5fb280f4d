"""Complete definitions of message types, with which a bag is read without their packages."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ff_planner_ros.common.share import installation_prefixes
from ff_planner_ros.errors import BagError
from ff_planner_ros.messages.service_events import recorded_name

ENCODING = "ros2msg"  # of every definition here, in the words of MCAP

_TYPE_NAME = re.compile(
    r"\w+/(msg/\w+|srv/\w+_(Event|Request|Response)"
    r"|action/[A-Za-z0-9]+_(FeedbackMessage|(SendGoal|GetResult)_Event))"
)
_PRIMITIVE = re.compile(r"bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string")
_CONSTANT = re.compile(r"\S+\s+[A-Z][A-Z0-9_]*\s*=")
_SEPARATOR = "=" * 80
_GOAL_ID, _TIME = "unique_identifier_msgs/UUID goal_id", "builtin_interfaces/Time stamp"
# As rosidl fills a structure without fields
_NO_FIELDS = "uint8 structure_needs_at_least_one_member"


@dataclass(frozen=True)
class Definition:
    """The complete definition of a message type: its own text and that of all types it holds."""

    name: str  # of the type, as a bag writes it: `package/msg/Name`
    text: str  # `ros2msg`, concatenated as in rosbag2's `message_definition_encoding.md`
    hash: str  # of the type: RIHS01 of REP 2011


def message_definition(type_name: str) -> Definition:
    """Return the complete definition of a message type, from the ament share directories.

    Types are named `package/msg/Name`, `package/srv/Name_Event`, `_Request`, `_Response`, or
    `package/action/Name_FeedbackMessage`, `_SendGoal_Event`, `_GetResult_Event`.

    A part of a service or an action is given as the message that has the same bytes:
    `package/srv/Name_Event` is `package/msg/NameEvent`. mcap-ros2-support reads nothing but
    `ros2msg`, and like other readers of it refuses a name of a message with an underscore; the
    `.srv` file that rosbag2 itself stores does not define the event.

    Raises:
        BagError: The name is of another form, or the type is not installed.
    """
    package, kind, name = _split(type_name)
    if kind == "msg":
        held = _gather({}, f"{package}/{name}")
        return Definition(type_name, _concatenated(held), _installed_hash(package, name))
    own = {f"{package}/{part}": text for part, text in _parts(package, kind, name).items()}
    recorded = recorded_name(type_name)
    # `char` is a `uint8` in ROS 2, and not for every reader.
    held = {
        one: re.sub(r"^char\b", "uint8", text, flags=re.MULTILINE)
        for one, text in _gather(own, recorded.replace("/msg/", "/")).items()
    }
    text = _concatenated(held)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, recorded))
    return Definition(recorded, text, store.hash_rihs01(recorded))


def _installed_hash(package: str, name: str) -> str:
    hashes = json.loads(_installed(f"{package}/msg/{name}.json"))["type_hashes"]
    wanted = f"{package}/msg/{name}"
    return str(next(one["hash_string"] for one in hashes if one["type_name"] == wanted))


def _split(type_name: str) -> list[str]:
    if _TYPE_NAME.fullmatch(type_name) is None:
        raise BagError(
            f"message type is {type_name!r}: it must be package/msg/Name, package/srv/Name_Event, "
            "_Request or _Response, or package/action/Name_FeedbackMessage, _SendGoal_Event or "
            "_GetResult_Event"
        )
    return type_name.split("/")


def _concatenated(texts: dict[str, str]) -> str:
    """Return definitions as one; the first is that of the type itself."""
    root, *held = texts.items()
    sections = [f"{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in held]
    return "\n".join([root[1], *sections])


def _gather(own: dict[str, str], root: str) -> dict[str, str]:
    """Return the text of `root` and of every type that it holds, directly or not.

    Args:
        own: Texts of types that are not installed as messages.
    """
    texts: dict[str, str] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = own[name] if name in own else _msg_text(name)
            waiting += _types_in_msg(name, texts[name])
    return texts


def _parts(package: str, kind: str, name: str) -> dict[str, str]:
    """Return the definitions of a service's or action's parts, by their names as messages."""
    stem = name.partition("_")[0] if kind == "action" else name.rpartition("_")[0]
    written = _installed(f"{package}/{kind}/{stem}.{kind}")
    sections = [
        text if _has_fields(text) else f"{text}\n{_NO_FIELDS}"
        for text in re.split(r"^---[ \t]*$", written, flags=re.MULTILINE)
    ]
    if kind == "srv":
        return _service_parts(stem, *sections)
    goal, result, feedback = (f"{stem}{part}" for part in ("Goal", "Result", "Feedback"))
    return {
        **dict(zip((goal, result, feedback), sections, strict=True)),
        # What ROS itself makes of an action: https://design.ros2.org/articles/actions.html
        f"{stem}FeedbackMessage": f"{_GOAL_ID}\n{feedback} feedback\n",
        **_service_parts(
            f"{stem}SendGoal", f"{_GOAL_ID}\n{goal} goal\n", f"bool accepted\n{_TIME}\n"
        ),
        **_service_parts(f"{stem}GetResult", f"{_GOAL_ID}\n", f"int8 status\n{result} result\n"),
    }


def _service_parts(stem: str, request: str, response: str) -> dict[str, str]:
    event = (
        "service_msgs/ServiceEventInfo info\n"
        f"{stem}Request[<=1] request\n{stem}Response[<=1] response\n"
    )
    return {f"{stem}Event": event, f"{stem}Request": request, f"{stem}Response": response}


def _has_fields(text: str) -> bool:
    return not all(_CONSTANT.match(line) for line in _statements(text))


def _msg_text(name: str) -> str:
    package, stem = name.split("/")
    return _installed(f"{package}/msg/{stem}.msg")


def _statements(text: str) -> list[str]:
    """Return the lines of a definition without comments, fields and constants."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    return [line for line in lines if line]


def _types_in_msg(name: str, text: str) -> list[str]:
    types = []
    for line in _statements(text):
        field_type = re.split(r"[\[<]", line.split()[0])[0]
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
