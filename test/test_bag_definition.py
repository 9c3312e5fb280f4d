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
    "ff_planner_msgs/msg/Exchange",
    "ff_planner_msgs/msg/Scene",
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
        "std_srvs/srv/SetBool_Event",
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
