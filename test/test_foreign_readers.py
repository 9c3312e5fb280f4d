"""Bags in the hands of readers that know neither ROS nor us: Foxglove's libraries and rosbags."""

from __future__ import annotations

import json
import random
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import ChaserState
from ff_planner_msgs.srv import PlanTrajectory
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters
from rosbags.convert.converter import convert
from rosbags.typesys import Stores, get_typestore
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    NamespacedType,
)
from std_srvs.srv import Empty, SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.bag.mcap.definition import message_definition
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.ros.messages.interfaces import GET_RESULT, SEND_GOAL, type_name

LIBRARIES = Path(__file__).with_name("foxglove")
# What a structure without fields has in IDL
DUMMY = "structure_needs_at_least_one_member"
IN_MESSAGES = [ChaserState, JointTrajectory, MarkerArray, ParameterEvent]
# Parts of services and actions, some of them empty, some with constants
OF_CALLS = [
    PlanTrajectory.Event,
    SEND_GOAL.Event,
    GET_RESULT.Event,
    PlanTrajectoryAction.Impl.FeedbackMessage,
    PlanTrajectory.Request,
    PlanTrajectory.Response,
    SetBool.Event,
    SetBool.Response,
    Empty.Event,
    Trigger.Event,
    ChangeState.Event,
    DescribeParameters.Event,
]


@pytest.fixture(scope="module")
def filled() -> list[Any]:
    """Messages of every kind, something in each field."""
    chance = random.Random(13)
    return [message(kind, chance) for kind in (*IN_MESSAGES, *OF_CALLS) for _ in range(2)]


@pytest.fixture(scope="module")
def bag(filled: list[Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag with all of them, each type on a topic of its own."""
    directory = tmp_path_factory.mktemp("bags") / "run"
    with BagWriter(directory, flush_interval=1.0) as writer:
        for kind in dict.fromkeys(map(type, filled)):
            writer.add_topic(topic(kind), type_name(kind), [])
        for number, one in enumerate(filled):
            writer.write(topic(type(one)), encode(one), 10**18 + number, 10**18)
    return directory


def topic(kind: type) -> str:
    return f"/{type_name(kind)}"


def message(kind: Any, chance: random.Random) -> Any:
    """Return a message with numbers, texts and arrays in it, none of them rounded by JSON."""
    made = kind()
    for name, slot_type in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        setattr(made, name, value(slot_type, kind, chance))
    return made


def value(slot_type: Any, owner: Any, chance: random.Random) -> Any:
    match slot_type:
        case NamespacedType():
            beside = getattr(sys.modules[owner.__module__], slot_type.name, None)
            found = beside or getattr(import_module(".".join(slot_type.namespaces)), slot_type.name)
            return message(found, chance)
        case AbstractNestedType():
            count = slot_type.size if isinstance(slot_type, Array) else chance.randrange(3)
            count = min(count, getattr(slot_type, "maximum_size", count))
            return [value(slot_type.value_type, owner, chance) for _ in range(count)]
        case AbstractString():
            return "".join(chance.choices("aä軌 ", k=chance.randrange(9)))
        case BasicType(typename="octet"):
            return bytes([chance.randrange(100)])
        case BasicType(typename="boolean"):
            return chance.random() < 0.5
        case BasicType(typename="float" | "double"):
            return chance.randrange(-1000, 1000) / 8
    return chance.randrange(100)


def plain(told: Any) -> Any:
    """Return a message as JSON has it."""
    if hasattr(told, "get_fields_and_field_types"):
        names = told.get_fields_and_field_types()
        return {name: plain(getattr(told, name)) for name in names} or {DUMMY: 0}
    if isinstance(told, bytes):
        return told[0]
    if isinstance(told, str | bool | int | float):
        return told
    return [plain(one) for one in told] if not hasattr(told, "tolist") else told.tolist()


def first_structure(text: str) -> str:
    """Return the type that Foxglove takes a definition in IDL for.

    That is the first thing in it but for modules of constants, as in `MessageReader.ts` of
    rosmsg2-serialization.
    """
    text = re.sub(r"//.*|={80}\nIDL: .*", "", text)
    modules: list[str] = []
    for kind, name, end in re.findall(r"\b(module|struct) (\w+)|(\};)", text):
        if kind == "struct":
            return "/".join([*modules, name])
        if kind == "module":
            modules.append(name)
        elif end:
            modules.pop()
    raise AssertionError("there is no structure in it")


@pytest.mark.parametrize("kind", OF_CALLS, ids=type_name)
def test_the_first_structure_of_a_definition_is_the_type_itself(kind: type) -> None:
    definition = message_definition(type_name(kind))
    assert definition.encoding == "ros2idl"
    assert first_structure(definition.text) == type_name(kind)


@pytest.mark.ci
@pytest.mark.skipif(shutil.which("npm") is None, reason="there is no npm on this machine")
def test_foxglove_reads_every_message_to_its_last_byte(
    bag: Path, filled: list[Any], tmp_path: Path
) -> None:
    shutil.copytree(LIBRARIES, tmp_path / "foxglove")
    install = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts"]
    installed = subprocess.run(install, cwd=tmp_path / "foxglove", check=False)
    if installed.returncode:
        pytest.skip("npm cannot fetch Foxglove's libraries")
    (file,) = bag.glob("*.mcap")
    command = ["node", str(tmp_path / "foxglove" / "read_bag.cjs"), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # Foxglove names the fraction of a second as ROS 1 does.
    read = [json.loads(line.replace('"nsec"', '"nanosec"')) for line in done.stdout.splitlines()]
    assert [one["type"] for one in read] == [type_name(type(told)) for told in filled]
    for one, told in zip(read, filled, strict=True):
        assert not one["rest"], one["type"]
        assert one["content"] == plain(told), one["type"]


def converted(source: Path, target: Path, storage: str, leave_out: list[str]) -> None:
    """Convert a bag as `rosbags-convert` does with `--exclude-msgtype`."""
    convert(
        [source],
        target,
        dst_storage=storage,
        dst_version=9,
        compress=None,
        compress_mode="file",
        default_typestore=get_typestore(Stores.ROS2_JAZZY),
        typestore=None,
        exclude_topics=(),
        include_topics=(),
        exclude_msgtypes=leave_out,
        include_msgtypes=(),
    )


@pytest.mark.ci
def test_rosbags_converts_what_is_a_message_to_sqlite3_and_back(bag: Path, tmp_path: Path) -> None:
    parts = [type_name(kind) for kind in OF_CALLS]
    converted(bag, tmp_path / "sqlite3", "sqlite3", parts)
    converted(tmp_path / "sqlite3", tmp_path / "back", "mcap", [])
    with open_bag(bag) as before, open_bag(tmp_path / "back") as after:
        kept = [one for one in before.messages() if one.type_name not in parts]
        assert kept
        found = [(one.topic, one.type_name, one.log_time_ns, one.cdr) for one in after.messages()]
        assert found == [(one.topic, one.type_name, one.log_time_ns, one.cdr) for one in kept]
        (told,) = {type(content).__name__ for _, content in after.decoded(type_name(ChaserState))}
        assert told.endswith("ChaserState")
        assert after.notes == ()


@pytest.mark.parametrize("kind", [PlanTrajectory.Event, GET_RESULT.Event], ids=type_name)
def test_rosbags_does_not_convert_parts_of_services_and_actions(kind: type, tmp_path: Path) -> None:
    # It writes definitions of messages only, whatever it has read: docs/analysing_runs.md says so.
    with BagWriter(tmp_path / "run", flush_interval=1.0) as writer:
        writer.add_topic("/event", type_name(kind), [])
        writer.write("/event", encode(kind()), 1, 1)
    with pytest.raises(AssertionError):
        converted(tmp_path / "run", tmp_path / "sqlite3", "sqlite3", [])
