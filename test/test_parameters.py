"""The parameters of the node, declared on a real one."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from ros_processes import private_domain

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters, default_values
from ff_planner_ros.ros.parameters import _AT_START, ParameterServer
from ff_planner_ros.ros.qos import create_publisher, qos_profile
from ff_planner_ros.ros.topics import JOINT_TRAJECTORY, TRACKING_ERROR

# Of parameters that are not any number or text, another value than the default.
OTHER = {
    "robot.wheels.axes": [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    "robot.base": "planar",
    "robot.locked_joints": "rail: 0.2",
    "robot.geometry": "lines",
    "robot.inertia": "as_given",
    "robot.xacro_arguments": "prefix:=left_",
    "limits.velocity": "none",
    "limits.effort": "none",
    "bag.max_size": 2_000_000,
    "planner.search": "quick",
    "controller.hand_over": "action",
    "planner.plugins": "{}",
    "state_source": "odometry",
    "when_busy": "preempt",
    "end_behaviour": "none",
    "odometry.sensor_position_in_chaser": [0.1, 0.2, 0.3],
    "odometry.sensor_quaternion_in_chaser_xyzw": [1.0, 0.0, 0.0, 0.0],
}
BUILT_IN = {"use_sim_time", "start_type_description_service"}


pytestmark = pytest.mark.usefixtures("ros")


@pytest.fixture
def ros() -> Iterator[None]:
    with private_domain():
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def declare_parameters(node: Node) -> NodeParameters:
    return ParameterServer(node).fix()


def _node(**overrides: Any) -> Node:
    return Node(
        "test",
        parameter_overrides=[
            Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()
        ],
    )


def _flat(block: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in block.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{prefix}{name}."))
        else:
            flat[prefix + name] = value
    return flat


def test_a_bare_node_has_the_values_of_the_file() -> None:
    text = (share_directory() / "config" / "planner.yaml").read_text()
    expected = _flat(yaml.safe_load(text)["/**"]["ros__parameters"])
    node = _node()
    declare_parameters(node)
    declared = {name: item.value for name, item in node.get_parameters_by_prefix("").items()}
    plain = {k: list(v) if isinstance(v, array) else v for k, v in declared.items()}
    assert {k: v for k, v in plain.items() if k not in BUILT_IN} == expected


def test_every_parameter_says_what_it_is_and_what_it_may_be() -> None:
    node = _node()
    declare_parameters(node)
    for name in set(node.get_parameters_by_prefix("")) - BUILT_IN:
        descriptor = node.describe_parameter(name)
        assert descriptor.description, name
        assert descriptor.read_only or "fixed while" in descriptor.additional_constraints, name
        if descriptor.type == ParameterType.PARAMETER_DOUBLE:
            assert descriptor.floating_point_range, name
        if descriptor.type == ParameterType.PARAMETER_INTEGER:
            assert descriptor.integer_range, name
    assert "[s]" in node.describe_parameter("state_max_age").description
    assert "[m]" in node.describe_parameter("planner.clearance_margin").description


def test_overrides_go_before_the_file() -> None:
    parameters = declare_parameters(
        _node(points=12, robot__tip_link="tool", planner__penalty_gain=3.5)
    )
    assert parameters.points == 12
    assert parameters.robot.tip_link == "tool"
    assert parameters.planner.penalty_gain == 3.5


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"point": 12}, ("point is an unknown parameter", "points")),
        ({"planner__gain": 1.0}, ("planner.gain is an unknown parameter", "planner.penalty_gain")),
        ({"points": 4}, ("points is 4", "from 5 to 10000")),
        ({"points": 12.5}, ("points is 12.5", "a whole number")),
        ({"state_max_age": 1}, ("state_max_age is 1", "decimal point")),
        ({"state_max_age": -0.1}, ("state_max_age is -0.1", "at least 0 and at most 3600")),
        ({"state_max_age": float("nan")}, ("state_max_age is nan",)),
        ({"bag__flush_interval": 0.0}, ("bag.flush_interval is 0.0", "at least 0.01")),
        ({"bag__max_size": 999_999}, ("bag.max_size is 999999", "0, for never", "1000000")),
        ({"bag__max_size": -1}, ("bag.max_size is -1", "0 or more")),
        ({"bag__max_duration": -1.0}, ("bag.max_duration is -1.0", "not be negative")),
        ({"inertial_frame": 3}, ("inertial_frame is 3", "text")),
        ({"limits__velocity": "fast"}, ("limits.velocity is 'fast'", "from_urdf or none")),
        ({"when_busy": "queue"}, ("when_busy is 'queue'", "reject or preempt")),
        ({"end_behaviour": "stop"}, ("end_behaviour is 'stop'", "stop_joints")),
        ({"state_source": "gps"}, ("state_source is 'gps'", "chaser_state or odometry")),
        ({"autostart": "yes"}, ("autostart is 'yes'", "true or false")),
        ({"time_budget": 0.0}, ("time_budget is 0.0", "at least 0.001")),
        ({"planner__max_iterations": 0}, ("planner.max_iterations is 0", "from 1 to 10000")),
        ({"planner__penalty_gain": float("inf")}, ("planner.penalty_gain is",)),
    ],
)
def test_an_override_that_makes_no_sense_is_refused_by_name(
    overrides: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        declare_parameters(_node(**overrides))
    for word in words:
        assert word in str(refusal.value)


def test_overrides_of_ros_itself_are_left_alone() -> None:
    own = {"use_sim_time": True, "qos_overrides./clock.subscription.depth": 3}
    assert declare_parameters(_overridden(own)).points == 50


def _overridden(values: dict[str, Any]) -> Node:
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    return Node("test", namespace="/one", parameter_overrides=overrides)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("/chaser_state.subscription.depth", 3, "an unknown parameter: known are "),  # elsewhere
        ("/one/chaser_state.publisher.depth", 3, "an unknown parameter: known are "),
        ("/one/chaser_state.subscription.deadline", 3, "an unknown parameter: known are "),
        ("/one/chaser_state.subscription.depth", 0, "0: it must be from 1 to 10000"),
        ("/one/markers.publisher.depth", "many", "'many': it must be a whole number"),
        ("/one/markers.publisher.reliability", "Reliable", "'Reliable': it must be best_effort or"),
        ("/one/markers.publisher.durability", "", "'': it must be volatile or transient_local"),
    ],
)
def test_an_override_of_a_quality_of_service_that_makes_no_sense_is_refused(
    name: str, value: Any, words: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        declare_parameters(_overridden({f"qos_overrides.{name}": value}))
    assert str(refusal.value).startswith(f"qos_overrides.{name} is {words}")


def test_a_publisher_has_the_quality_of_service_of_its_overrides_and_keeps_it() -> None:
    name = "qos_overrides./one/tracking_error.publisher"
    node = _overridden({f"{name}.reliability": "best_effort", f"{name}.depth": 3})
    declare_parameters(node)
    for _ in ("configured", "configured again"):
        made = create_publisher(node, TRACKING_ERROR)
        (offered,) = node.get_publishers_info_by_topic("tracking_error")
        assert offered.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
        assert (made.qos_profile.depth, qos_profile(TRACKING_ERROR).depth) == (3, 10)
        node.destroy_publisher(made)


def test_an_override_names_a_topic_as_it_is_remapped() -> None:
    remapped = ["--ros-args", "-r", "joint_trajectory:=/arm/plan"]
    name = "qos_overrides./arm/plan.publisher.depth"
    node = Node("test", cli_args=remapped, parameter_overrides=[Parameter(name, value=3)])
    declare_parameters(node)
    assert create_publisher(node, JOINT_TRAJECTORY).qos_profile.depth == 3


def test_a_change_counts_from_the_next_configuration_on() -> None:
    node = _node()
    server = ParameterServer(node)
    before = server.fix()
    server.release()
    changes = [
        Parameter("state_max_age", value=2.0),
        Parameter("planner.starts", value=3),
        Parameter("odometry.sensor_position_in_chaser", value=[1.0, 2.0, 3.0]),
    ]
    (result,) = {item.successful for item in node.set_parameters(changes)}
    assert result
    assert server.fix() == replace(
        before,
        state_max_age=2.0,
        planner=replace(before.planner, starts=3),
        odometry=replace(before.odometry, sensor_position_in_chaser=(1.0, 2.0, 3.0)),
    )


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("state_max_age", -1.0, ("state_max_age",)),
        ("points", 12.5, ("INTEGER",)),
        ("when_busy", "queue", ("when_busy is 'queue'", "reject or preempt")),
        ("planner.starts", 0, ("planner.starts",)),
        ("autostart", False, ("read-only",)),
        ("odometry.sensor_quaternion_in_chaser_xyzw", [0.0, 0.0, 0.0, 2.0], ("norm",)),
    ],
)
def test_a_change_that_makes_no_sense_is_refused_and_changes_nothing(
    name: str, value: Any, words: tuple[str, ...]
) -> None:
    node = _node()
    server = ParameterServer(node)
    before = server.fix()
    server.release()
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    for word in words:
        assert word in result.reason
    assert server.fix() == before


def _another(default: Any) -> Any:
    if isinstance(default, str | list):
        return "other" if isinstance(default, str) else [0.5]
    return (
        not default
        if isinstance(default, bool)
        else default + (1 if isinstance(default, int) else 0.25)
    )


@pytest.mark.law("NODE-17")
@pytest.mark.parametrize("name", [name for name in DECLARATIONS if name not in _AT_START])
def test_while_the_node_is_configured_every_parameter_is_fixed(name: str) -> None:
    node = _node(allow_remote_paths=True)
    server = ParameterServer(node)
    before, other = server.fix(), OTHER.get(name) or _another(default_values()[name])
    (refused,) = node.set_parameters([Parameter(name, value=other)])
    assert not refused.successful
    shown = tuple(other) if isinstance(other, list) else other
    assert refused.reason.startswith(f"{name} is {shown!r}: it stays ")
    assert "is fixed while the node is configured" in refused.reason
    assert "deactivate and cleanup first" in refused.reason
    assert server.fix() == before
    server.release()
    (taken,) = node.set_parameters([Parameter(name, value=other)])
    assert taken.successful, taken.reason
    assert server.fix() != before


@pytest.mark.parametrize("name", ["robot.urdf", "bag.directory"])
@pytest.mark.parametrize("allowed", [False, True])
def test_paths_are_those_of_the_start_unless_a_parameter_at_the_start_says_otherwise(
    name: str, allowed: bool
) -> None:
    node = _node(**{name.replace(".", "__"): "mine"}, allow_remote_paths=allowed)
    server = ParameterServer(node)
    for configured in (True, False):
        if configured:
            server.fix()
        else:
            server.release()
        (result,) = node.set_parameters([Parameter(name, value="/etc/passwd")])
        assert result.successful == (allowed and not configured), result
        if not result.successful:
            assert name in result.reason
            assert "'/etc/passwd'" in result.reason
            assert "'mine'" in result.reason
    (result,) = node.set_parameters([Parameter("allow_remote_paths", value=True)])
    assert not result.successful, "whoever can set parameters cannot allow it"


def test_several_changes_at_once_are_refused_if_one_is() -> None:
    node = _node()
    server = ParameterServer(node)
    good, bad = Parameter("points", value=20), Parameter("when_busy", value="queue")
    result = node.set_parameters_atomically([good, bad])
    assert not result.successful
    assert "when_busy is 'queue'" in result.reason
    assert server.fix().points == default_values()["points"]


def test_parameters_of_ros_itself_may_change() -> None:
    node = _node()
    server = ParameterServer(node)
    (result,) = node.set_parameters([Parameter("use_sim_time", value=True)])
    assert result.successful
    assert server.fix() == ParameterServer(_node()).fix()
