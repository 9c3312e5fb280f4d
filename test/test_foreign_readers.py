"""Bags in the hands of readers that know neither ROS nor us: Foxglove's libraries and others."""

from __future__ import annotations

import array
import json
import random
import re
import shutil
import subprocess
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import ChaserState, Exchange, TargetBody
from lifecycle_msgs.msg import TransitionEvent
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rcl_interfaces.msg import ParameterEvent
from rosbags.convert.converter import convert
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    NamespacedType,
)
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.bag import read_plans
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.ros.messages.interfaces import type_name

LIBRARIES = Path(__file__).with_name("foxglove")
GOLDEN = Path(__file__).parent / "golden_bags" / "node"
PAGE = Path(__file__).parent.parent / "docs" / "reference" / "bag.md"
# Texts, arrays, constants, and messages in messages
KINDS = [
    *(ChaserState, TargetBody, Exchange, JointTrajectory, MarkerArray),
    *(DiagnosticArray, TransitionEvent, ParameterEvent),
]


@pytest.fixture(scope="module")
def filled() -> list[Any]:
    """Messages of every kind, something in each field."""
    chance = random.Random(13)
    return [message(kind, chance) for kind in KINDS for _ in range(2)]


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
        setattr(made, name, value(slot_type, chance))
    return made


def value(slot_type: Any, chance: random.Random) -> Any:
    match slot_type:
        case NamespacedType():
            kind = getattr(import_module(".".join(slot_type.namespaces)), slot_type.name)
            return message(kind, chance)
        case AbstractNestedType():
            count = slot_type.size if isinstance(slot_type, Array) else chance.randrange(3)
            count = min(count, getattr(slot_type, "maximum_size", count))
            return [value(slot_type.value_type, chance) for _ in range(count)]
        case AbstractString():
            return "".join(chance.choices("aä軌 ", k=chance.randrange(9)))
        case BasicType(typename="octet"):
            return bytes([chance.randrange(100)])
        case BasicType(typename="boolean"):
            return chance.random() < 0.5
        case BasicType(typename="uint8"):
            return chance.randrange(256)
        case BasicType(typename="float" | "double"):
            return chance.randrange(-1000, 1000) / 8
    return chance.randrange(100)


def plain(told: Any) -> Any:
    """Return a message as JSON has it."""
    if hasattr(told, "get_fields_and_field_types"):
        names = told.get_fields_and_field_types()
        return {name: plain(getattr(told, name)) for name in names}
    if isinstance(told, bytes):
        return told[0]
    if isinstance(told, str | bool | int | float):
        return told
    return [plain(one) for one in told] if not hasattr(told, "tolist") else told.tolist()


def plain_of_mcap_ros2(told: Any) -> Any:
    """Return what mcap-ros2-support has read as JSON has it."""
    if isinstance(told, SimpleNamespace):
        return {name: plain_of_mcap_ros2(getattr(told, name)) for name in told.__slots__}
    if isinstance(told, list | tuple | array.array | bytes):
        return [plain_of_mcap_ros2(one) for one in told]
    return told


@pytest.mark.law("BAG-04")
def test_mcap_ros2_support_reads_every_message_as_it_was_told(bag: Path, filled: list[Any]) -> None:
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = [(channel.topic, one) for _, channel, _, one in reader.iter_decoded_messages()]
    assert [name for name, _ in read] == [topic(type(told)) for told in filled]
    for (name, one), told in zip(read, filled, strict=True):
        assert plain_of_mcap_ros2(one) == plain(told), name


def plain_of_rosbags(told: Any) -> Any:
    """Return what rosbags has read as JSON has it."""
    if is_dataclass(told):
        # Constants and the name of the type are fields there, too.
        names = [one.name for one in fields(told) if re.fullmatch(r"[a-z]\w*", one.name)]
        return {name: plain_of_rosbags(getattr(told, name)) for name in names}
    if hasattr(told, "tolist"):
        return told.tolist()
    return [plain_of_rosbags(one) for one in told] if isinstance(told, list) else told


@pytest.mark.law("BAG-04")
def test_rosbags_reads_every_message_as_it_was_told(bag: Path, filled: list[Any]) -> None:
    with AnyReader([bag]) as reader:
        read = [
            (connection.topic, reader.deserialize(cdr, connection.msgtype))
            for connection, _, cdr in reader.messages()
        ]
    assert [name for name, _ in read] == [topic(type(told)) for told in filled]
    for (name, one), told in zip(read, filled, strict=True):
        assert plain_of_rosbags(one) == plain(told), name


def test_the_example_of_the_docs_prints_every_answer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    (file,) = GOLDEN.glob("*.mcap")
    monkeypatch.chdir(GOLDEN)
    exec(example.replace("run_0.mcap", file.name), {})
    told = [line.split(" ", 2) for line in capsys.readouterr().out.splitlines()]
    assert [plan_id for plan_id, door, _ in told if door != "publish_plan"] == [
        plan.plan_id for plan in read_plans(GOLDEN)
    ]


@pytest.mark.law("BAG-04")
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
    assert [one["type"] for one in read] == [type_name(type(t)) for t in filled]
    for one, told in zip(read, filled, strict=True):
        assert not one["rest"], one["type"]
        assert one["content"] == plain(told), one["type"]


@pytest.mark.ci
def test_rosbags_converts_every_topic_to_sqlite3_and_back(bag: Path, tmp_path: Path) -> None:
    converted(bag, tmp_path / "sqlite3", "sqlite3")
    converted(tmp_path / "sqlite3", tmp_path / "back", "mcap")
    with open_bag(bag) as before, open_bag(tmp_path / "back") as after:
        kept = [(one.topic, one.type_name, one.log_time_ns, one.cdr) for one in before.messages()]
        assert kept
        found = [(one.topic, one.type_name, one.log_time_ns, one.cdr) for one in after.messages()]
        assert found == kept
        (told,) = {type(content).__name__ for _, content in after.decoded(type_name(ChaserState))}
        assert told.endswith("ChaserState")
        assert after.notes == ()


def converted(source: Path, target: Path, storage: str) -> None:
    """Convert a bag as `rosbags-convert` does."""
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
        exclude_msgtypes=(),
        include_msgtypes=(),
    )
