"""Tests of ff_planner_ros.bag.mcap.definition, against the reader of rosbags."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ff_planner_ros.bag.mcap.definition import message_definition
from ff_planner_ros.errors import BagError

MESSAGES = [
    "std_msgs/msg/Empty",
    "std_msgs/msg/String",
    "nav_msgs/msg/Odometry",
    "trajectory_msgs/msg/JointTrajectory",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rcl_interfaces/msg/ParameterEvent",
    "rcl_interfaces/msg/Log",
    "ff_planner_msgs/msg/ChaserState",
    "ff_planner_msgs/msg/ObstacleSphereArray",
]
SERVICE_PARTS = [
    f"{service}_{part}"
    for service in (
        "std_srvs/srv/SetBool",
        "std_srvs/srv/Empty",
        "ff_planner_msgs/srv/PlanTrajectory",
    )
    for part in ("Event", "Request", "Response")
]


def types_defined_by(type_name: str) -> Typestore:
    definition = message_definition(type_name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition.text, definition.name))
    return store


@pytest.mark.parametrize("type_name", MESSAGES)
def test_a_definition_has_the_hash_that_the_installed_type_has(type_name: str) -> None:
    # rosbags computes the hash from the definition; a missing or wrong type cannot pass.
    definition = message_definition(type_name)
    assert definition.name == type_name
    assert types_defined_by(type_name).hash_rihs01(type_name) == definition.hash


@pytest.mark.parametrize("type_name", SERVICE_PARTS)
def test_a_part_of_a_service_is_defined_as_the_message_with_its_bytes(type_name: str) -> None:
    definition = message_definition(type_name)
    package, _, name = type_name.split("/")
    assert definition.name == f"{package}/msg/{name.replace('_', '')}"
    store = types_defined_by(type_name)
    assert store.hash_rihs01(definition.name) == definition.hash
    # What a part holds of messages is what is installed, to its hash.
    for held in sorted(set(store.fielddefs) - {definition.name}):
        if not held.endswith(("Request", "Response")) or held == "ff_planner_msgs/msg/PlanRequest":
            assert store.hash_rihs01(held) == message_definition(held).hash


def test_a_type_held_twice_is_defined_once() -> None:
    text = message_definition("nav_msgs/msg/Odometry").text
    assert text.count("MSG: geometry_msgs/Vector3\n") == 1
    assert text.count("MSG: std_msgs/Header\n") == 1


@pytest.mark.parametrize(
    "type_name",
    [
        "String",
        "std_msgs/String",
        "std_srvs/srv/SetBool",
        "std_msgs/msg/String/x",
        "/msg/String",
        "",
    ],
)
def test_a_name_of_another_form_is_refused(type_name: str) -> None:
    with pytest.raises(BagError, match="message type is") as caught:
        message_definition(type_name)
    assert repr(type_name) in str(caught.value)


@pytest.mark.parametrize("type_name", ["no_such_msgs/msg/Thing", "std_msgs/msg/NoSuchThing"])
def test_a_type_that_is_not_installed_is_refused(type_name: str) -> None:
    with pytest.raises(BagError, match=type_name):
        message_definition(type_name)


def test_a_service_keeps_its_constants_and_is_without_fields_only_where_it_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = tmp_path / "share" / "my_msgs" / "srv"
    service.mkdir(parents=True)
    (service / "Ask.srv").write_text("uint8 A=1  # only a constant\n---\nstring<=5 a 'x = y'\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}:/work")
    filler = "uint8 structure_needs_at_least_one_member"
    asked = message_definition("my_msgs/srv/Ask_Request").text
    assert asked == f"uint8 A=1  # only a constant\n\n{filler}"
    assert filler not in message_definition("my_msgs/srv/Ask_Response").text


def test_a_type_below_the_ament_path_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = tmp_path / "overlay" / "share" / "my_msgs" / "msg"
    directory.mkdir(parents=True)
    (directory / "Outer.msg").write_text("Inner[<=3] inners  # bounded\nstring<=5 name 'a#b'\n")
    (directory / "Inner.msg").write_text("float64[3] values\nbyte FLAG=1\nwstring w\n")
    hashes = [{"type_name": "my_msgs/msg/Outer", "hash_string": "RIHS01_"}]
    (directory / "Outer.json").write_text(json.dumps({"type_hashes": hashes}))
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'empty'}:{tmp_path / 'overlay'}")

    text = message_definition("my_msgs/msg/Outer").text

    assert text.startswith("Inner[<=3] inners")
    assert text.count("=" * 80 + "\nMSG: ") == 1
    assert "MSG: my_msgs/Inner\nfloat64[3] values" in text
