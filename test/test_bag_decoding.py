"""Decoding by the definitions that a bag itself carries."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ff_planner_msgs.msg import (
    ChaserState,
    Exchange,
    Plan,
    PlanAnswer,
    PlanMetrics,
    PlanRequest,
    SearchOptions,
)
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterEvent
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.bag.mcap.decoding import decoder
from ff_planner_ros.bag.mcap.definition import message_definition
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.messages.interfaces import type_name


def exchange() -> Exchange:
    request = PlanRequest(duration=10.0, search=SearchOptions(points=50))
    request.start_state = [ChaserState(joint_names=["a"], joint_positions=[1.5])]
    request.limits.chaser_rotation = [0.5]
    point = JointTrajectoryPoint(positions=[1.0, 2.0])
    motion = JointTrajectory(joint_names=["a", "b"], points=[point])
    answer = PlanAnswer(
        plans=[Plan(joint_trajectory=motion)],
        metrics=[PlanMetrics(peak_joint_torques=[0.5, 0.25])],
    )
    return Exchange(plan_id="p", request=[request], task="{}", answer=[answer])


def parameter_event() -> ParameterEvent:
    parameter = Parameter(name="p")
    parameter.value.byte_array_value = [b"\x00", b"\xff"]
    parameter.value.bool_array_value = [True, False]
    parameter.value.integer_array_value = array.array("q", [1, -2])
    parameter.value.string_array_value = ["one", "zwölf"]
    return ParameterEvent(node="/n", changed_parameters=[parameter])


MESSAGES = [
    String(data="hello"),
    exchange(),
    parameter_event(),
    Odometry(),
    JointState(name=["a"], position=[0.5], effort=[-1.0]),
    GoalStatusArray(status_list=[GoalStatus(status=5)]),
    DiagnosticArray(
        status=[DiagnosticStatus(level=b"\x02", values=[KeyValue(key="k", value="v")])]
    ),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_comes_back_as_it_was(message: Any) -> None:
    name = type_name(type(message))
    definition = message_definition(name)
    decode = decoder(definition.name, "ros2msg", definition.text.encode())
    assert plain(decode(encode(message)), message) == plain(message, message)


def plain(value: Any, message: Any) -> Any:
    """Return a message as mappings, lists and numbers, with the fields of another one."""
    if hasattr(message, "get_fields_and_field_types"):
        names = message.get_fields_and_field_types()
        return {name: plain(getattr(value, name), getattr(message, name)) for name in names}
    if isinstance(message, bytes):  # a `byte`, which others take for a number, with or without sign
        return (value[0] if isinstance(value, bytes) else int(value)) % 256
    if isinstance(message, str | int | float | np.number):
        return value
    assert len(value) == len(message)
    return [plain(*pair) for pair in zip(value, message, strict=True)]


@pytest.mark.parametrize(
    ("name", "encoding", "text", "reason"),
    [
        ("a/msg/B", "protobuf", b"", "its definition is in 'protobuf'; known are ros2msg and ros2"),
        ("a/msg/B", "ros2msg", b"int8 y\nint32[ x", "cannot be read: 'int32\\[ x' is not under"),
        ("a/msg/B", "ros2msg", b"Foo x\n", "it holds the type 'a/msg/Foo', and does not define it"),
        ("a/msg/B", "ros2msg", b"B x\n", "cannot be read: a type contains itself"),
        ("a/msg/B", "ros2idl", b"\xff\xfe", "cannot be read: it is no definition of a message"),
        ("a/msg/B", "ros2idl", b"module a { };", "cannot be read: '};' is not understood"),
        ("a/msg/B", "ros2msg", b"uint8[0] x", "holds an array of no elements"),
        ("a/msg/B", "ros2msg", b"string[6000] x\nstring[6000] y", "more than 10000 elements"),
        ("a/msg/B\nimport os", "ros2msg", b"int32 x", "is no name of a message type"),
    ],
)
def test_a_definition_that_is_none_is_refused(
    name: str, encoding: str, text: bytes, reason: str
) -> None:
    decode = decoder(name, encoding, text)
    with pytest.raises(BagError, match=reason):
        decode(bytes(8))


@pytest.mark.parametrize("line_end", ["\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["ros2msg", "ros2idl"])
def test_lines_of_a_definition_may_end_as_on_any_system(encoding: str, line_end: str) -> None:
    """In a comment as well, which ends with its line."""
    bar = "=" * 80
    text = {
        "ros2msg": f"Part part  # of another type\nuint8 y\n{bar}\nMSG: a/Part\nint32 x\n",
        "ros2idl": f"{bar}\nIDL: a/msg/B\nmodule a {{ module msg {{  // ours\nstruct B {{\n"
        f"a::msg::Part part;\nuint8 y;\n}}; }}; }};\n{bar}\nIDL: a/msg/Part\n"
        "module a { module msg {\nstruct Part {\nint32 x;\n}; }; };\n",
    }[encoding]
    cdr = b"\x00\x01\x00\x00\x05\x00\x00\x00\x07"
    told = decoder("a/msg/B", encoding, text.replace("\n", line_end).encode())(cdr)
    assert (told.part.x, told.y) == (5, 7)


@pytest.mark.parametrize("cdr", [b"", b"\x00\x01", b"\x00\x01\x00\x00\xff\xff\xff\xff", bytes(40)])
def test_bytes_that_do_not_fit_are_refused(cdr: bytes) -> None:
    decode = decoder("a/msg/B", "ros2msg", b"string[] x\n")
    with pytest.raises(BagError, match="does not fit its definition"):
        decode(cdr)
