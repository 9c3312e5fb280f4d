"""The parameters of the node, declared on a real one."""

from __future__ import annotations

import math
import re
import threading
from array import array
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import ParameterType, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_processes import DEADLINE, private_domain

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters, default_values
from ff_planner_ros.planning.problem import limits
from ff_planner_ros.planning.problem.settings import STRICT_IF_LOW_NOT_ZERO
from ff_planner_ros.ros import parameters as module
from ff_planner_ros.ros.parameters import (
    _AT_START,
    _WHILE_CONFIGURED,
    LiveParameters,
    stricter_since,
    value_of,
)

BUILT_IN = {"use_sim_time", "start_type_description_service"}


pytestmark = pytest.mark.usefixtures("ros")


@pytest.fixture
def ros() -> Iterator[None]:
    with private_domain():
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def declare_parameters(node: Node) -> NodeParameters:
    return LiveParameters(node).current


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
        assert descriptor.additional_constraints, name
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
        ({"points": 4}, ("points is 4", "at least 5", "at most 10000")),
        ({"points": 12.5}, ("points is 12.5", "a whole number")),
        ({"state_max_age": 1}, ("state_max_age is 1", "decimal point")),
        ({"state_max_age": -0.1}, ("state_max_age is -0.1", "at least 0", "[s]")),
        ({"state_max_age": float("nan")}, ("state_max_age is nan",)),
        ({"bag__flush_interval": 0.0}, ("bag.flush_interval is 0.0", "at least 0.01")),
        ({"bag__max_size": 999_999}, ("bag.max_size is 999999", "0, for never", "1000000")),
        ({"bag__max_size": -1}, ("bag.max_size is -1", "at least 0")),
        ({"bag__max_duration": -1.0}, ("bag.max_duration is -1.0", "at least 0")),
        ({"inertial_frame": 3}, ("inertial_frame is 3", "text")),
        ({"limits__velocity": "fast"}, ("limits.velocity is fast", "from_urdf or none")),
        ({"when_busy": "queue"}, ("when_busy is 'queue'", "reject or preempt")),
        ({"end_behaviour": "stop"}, ("end_behaviour is 'stop'", "stop_joints")),
        ({"state_source": "gps"}, ("state_source is 'gps'", "chaser_state or odometry")),
        ({"qos__obstacles__depth": 0}, ("qos.obstacles.depth is 0", "at least 1")),
        ({"autostart": "yes"}, ("autostart is 'yes'", "true or false")),
        ({"time_budget": 0.0}, ("time_budget is 0.0", "at least 0.001", "[s]")),
        ({"planner__max_iterations": 0}, ("planner.max_iterations is 0", "at least 1")),
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


def test_ros_own_words_for_a_quality_of_service_stand_for_ours() -> None:
    overrides = {
        "qos_overrides./one/chaser_state.subscription.depth": 3,
        "qos_overrides./one/joint_trajectory.publisher.reliability": "best_effort",
    }
    qos = declare_parameters(_overridden(overrides)).qos
    assert (qos.chaser_state.depth, qos.joint_trajectory.reliability) == (3, "best_effort")


@pytest.mark.parametrize(
    "name",
    [
        "/chaser_state.subscription.depth",  # in another namespace
        "/one/chaser_state.publisher.depth",
        "/one/chaser_state.subscription.deadline",
        "/one/markers.publisher.depth",
    ],
)
def test_an_override_that_nobody_would_read_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput, match=rf"^qos_overrides\.{name} is given: it must be of a"):
        declare_parameters(_overridden({f"qos_overrides.{name}": 1}))


def test_a_change_at_run_time_counts_from_the_next_plan_on() -> None:
    node = _node()
    live = LiveParameters(node)
    before = live.current
    changes = [
        Parameter("state_max_age", value=2.0),
        Parameter("planner.starts", value=3),
        Parameter("odometry.sensor_position_in_chaser", value=[1.0, 2.0, 3.0]),
    ]
    (result,) = {item.successful for item in node.set_parameters(changes)}
    assert result
    assert live.current.state_max_age == 2.0
    assert live.current.planner.starts == 3
    assert live.current.odometry.sensor_position_in_chaser == (1.0, 2.0, 3.0)
    assert live.current.points == before.points
    assert before.state_max_age == 0.5, "a plan that is being made keeps what it began with"


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
    live = LiveParameters(node)
    before = live.current
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    for word in words:
        assert word in result.reason
    assert live.current == before


@pytest.mark.parametrize("name", ["robot.tip_link", "inertial_frame"])
def test_what_is_in_use_changes_only_while_the_node_is_unconfigured(name: str) -> None:
    node = _node()
    live = LiveParameters(node)
    live.configured = True
    (refused,) = node.set_parameters([Parameter(name, value="other")])
    assert not refused.successful
    assert f"{name} is in use" in refused.reason
    live.configured = False
    (taken,) = node.set_parameters([Parameter(name, value="other")])
    assert taken.successful
    assert node.get_parameter(name).value == "other"


@pytest.mark.parametrize("name", ["robot.urdf", "bag.directory"])
@pytest.mark.parametrize("allowed", [False, True])
def test_paths_are_those_of_the_start_unless_a_parameter_at_the_start_says_otherwise(
    name: str, allowed: bool
) -> None:
    node = _node(**{name.replace(".", "__"): "mine"}, allow_remote_paths=allowed)
    live = LiveParameters(node)
    for configured in (True, False):
        live.configured = configured
        (result,) = node.set_parameters([Parameter(name, value="/etc/passwd")])
        assert result.successful == (allowed and not configured), result
        if not result.successful:
            assert name in result.reason
            assert "'/etc/passwd'" in result.reason
            assert "'mine'" in result.reason
    (result,) = node.set_parameters([Parameter("allow_remote_paths", value=True)])
    assert not result.successful, "whoever can set parameters cannot allow it"


OF_ONE_NUMBER = tuple(f"limits.{name}" for name in limits.OF_ONE_NUMBER)
STRICT = {name: one.strictness for name, one in DECLARATIONS.items() if one.strictness}


@pytest.mark.law("NODE-17")
def test_every_tolerance_margin_and_limit_says_which_way_is_stricter() -> None:
    named = re.compile(
        r"tolerance|margin|threshold|horizon|(^|[._])(max|limits?)[._]|allow_|robust"
    )
    fixed = _WHILE_CONFIGURED + _AT_START
    # What bounds the search alone decides whether there is a plan, never which one passes.
    bounds_the_search = {"planner.max_iterations"}
    expected = {n for n in DECLARATIONS if named.search(n) and not n.startswith(fixed)}
    assert STRICT.keys() == expected - bounds_the_search


def _other_values(name: str) -> tuple[Any, Any]:
    """Return a looser and a stricter value than the default."""
    default = default_values()[name]
    if name in ("limits.velocity", "limits.effort"):
        return "none", None
    if name == "limits.acceleration":
        return None, [0.4]
    if default is False:  # allow_nonzero_velocity_at_trajectory_end
        return True, None
    if name in OF_ONE_NUMBER:
        return None, 0.4
    if default == 0.0:  # of planner.robust, and of what navigation leaves at a capture
        return None, 0.5
    more, less = default * 1.5, default * 0.5
    raised = name.startswith(
        ("planner.clearance_margin", "planner.singular_value_threshold", "planner.robust.")
    )
    return (less, more) if raised else (more, less)


@pytest.mark.law("NODE-17")
@pytest.mark.parametrize("name", STRICT)
def test_while_the_node_is_configured_it_is_only_tightened(name: str) -> None:
    node = _node()
    live = LiveParameters(node)
    default = default_values()[name]
    looser, stricter = _other_values(name)

    def set_to(value: Any) -> SetParametersResult:
        (result,) = node.set_parameters([Parameter(name, value=value)])
        now = tuple(value) if isinstance(value, list) else value
        assert value_of(live.current, name) == now or not result.successful
        return result

    live.configured = True
    assert set_to(default).successful, "the same value loosens nothing"
    for refused, than in ((looser, default), (default, stricter)):
        if refused is None or than is None:
            continue
        if than is stricter:
            assert set_to(stricter).successful
        result = set_to(refused)
        assert not result.successful
        assert result.reason.startswith(f"{name} is {str(refused).lower()}: it must be ")
        assert str(than).lower() in result.reason.partition(": ")[2]
        assert value_of(live.current, name) == (tuple(than) if type(than) is list else than)
    live.configured = False
    for value in (looser, stricter, default):
        assert value is None or set_to(value).successful


def test_no_joint_is_given_more_acceleration_while_the_node_is_configured() -> None:
    node = _node(limits__acceleration=[0.5, 0.3])
    live = LiveParameters(node)
    live.configured = True

    def is_taken(*limits: float) -> bool:
        (result,) = node.set_parameters([Parameter("limits.acceleration", value=list(limits))])
        assert result.successful or "limits may only be tightened" in result.reason
        return bool(result.successful)

    assert not is_taken(0.6, 0.3)
    assert not is_taken(0.4, 0.31)
    assert not is_taken(0.0)
    assert not is_taken(0.4)
    assert not is_taken(0.1, 0.1, 0.1)
    before = live.current
    assert is_taken(0.5, 0.2)
    assert stricter_since(before, live.current) == ["limits.acceleration"]
    assert is_taken(0.2)
    assert not is_taken(0.2, 0.21)
    (none,) = node.set_parameters([Parameter("limits.acceleration", value=[-0.1])])
    assert not none.successful
    assert "limits.acceleration[0] is -0.1: it must be greater than 0" in none.reason


def test_two_threads_that_set_parameters_at_once_lose_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller's own parameters are taken over in another thread than a client's."""
    live, within, other_is_through = LiveParameters(_node()), threading.Event(), threading.Event()
    change = module.changed

    def slow(parameters: NodeParameters, changes: list[Parameter]) -> NodeParameters:
        found = change(parameters, changes)
        if changes[0].name == "points":
            within.set()
            other_is_through.wait(0.5)  # it comes to its end only if nothing keeps it out
        return found

    def other() -> None:
        within.wait(DEADLINE)
        live._take([Parameter("state_max_age", value=2.0)])
        other_is_through.set()

    monkeypatch.setattr(module, "changed", slow)
    thread = threading.Thread(target=other)
    thread.start()
    live._take([Parameter("points", value=20)])
    thread.join(DEADLINE)
    assert (live.current.points, live.current.state_max_age) == (20, 2.0)


def test_several_changes_at_once_are_refused_if_one_loosens() -> None:
    node = _node()
    live = LiveParameters(node)
    live.configured = True
    before = live.current
    strict, loose = (
        Parameter("planner.position_tolerance", value=5e-4),
        Parameter("planner.orientation_tolerance", value=5e-3),
    )
    result = node.set_parameters_atomically([strict, loose])
    assert not result.successful
    assert "planner.orientation_tolerance is 0.005" in result.reason
    assert live.current == before


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_a_number_that_is_none_loosens_nothing(value: float) -> None:
    node = _node()
    live = LiveParameters(node)
    live.configured = True
    for name in STRICT.keys() - {"limits.velocity"}:
        if DECLARATIONS[name].form.schema()["type"] == "number" and name not in (
            "planner.clearance_margin",
            "planner.singular_value_threshold",
        ):
            (result,) = node.set_parameters([Parameter(name, value=value)])
            unlimited = value == math.inf and STRICT[name] is STRICT_IF_LOW_NOT_ZERO
            assert result.successful == unlimited, (name, result)


def test_it_is_known_which_rules_are_stricter_than_they_were() -> None:
    node = _node()
    live = LiveParameters(node)
    before = live.current
    changes = {"planner.clearance_margin": 0.01, "state_max_age": 1.0, "points": 40}
    node.set_parameters([Parameter(name, value=value) for name, value in changes.items()])
    assert stricter_since(before, live.current) == ["planner.clearance_margin"]
    assert stricter_since(live.current, before) == ["state_max_age"]


def test_parameters_of_ros_itself_may_change() -> None:
    node = _node()
    live = LiveParameters(node)
    (result,) = node.set_parameters([Parameter("use_sim_time", value=True)])
    assert result.successful
    assert live.current == LiveParameters(_node()).current
