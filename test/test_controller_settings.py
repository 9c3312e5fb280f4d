"""What the parameters of a joint_trajectory_controller mean to plans."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from rclpy.parameter import Parameter

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.ros.outputs.controller_settings import ControllerSettings

JOINTS = ("shoulder", "elbow")
DEFAULTS: dict[str, Any] = {
    "allow_nonzero_velocity_at_trajectory_end": True,
    "joints": list(JOINTS),
    "command_interfaces": ["position", "velocity"],
    "state_interfaces": ["position", "velocity"],
    "constraints.goal_time": 0.5,
    "constraints.stopped_velocity_tolerance": 0.01,
    **{f"constraints.{joint}.{what}": 0.0 for joint in JOINTS for what in ("trajectory", "goal")},
}


def told(own: dict[str, Any], **changes: Any) -> tuple[dict[str, Any], list[str]]:
    """What is learned of a controller, and the warnings."""
    values = DEFAULTS | {name.replace("__", "."): value for name, value in changes.items()}
    node, learned = Mock(), dict[str, Any]()

    def answered(request: Any) -> Any:
        found = [
            Parameter(name, value=values[name]).get_parameter_value() for name in request.names
        ]
        done = SimpleNamespace(result=lambda: SimpleNamespace(values=found))
        return SimpleNamespace(add_done_callback=lambda then: then(done))

    node.create_client.return_value.call_async = answered
    parameters = replace(load_parameters().controller, from_node="/arm", **own)
    ControllerSettings(node, parameters, JOINTS, learned.update).look()
    warnings = node.get_logger.return_value.warning.call_args_list
    return learned, [str(call.args[0]) for call in warnings]


@pytest.mark.parametrize(
    ("changes", "tolerance"),
    [
        ({}, 0.01),
        ({"constraints__goal_time": 0.0}, 0.0),
        ({"state_interfaces": ["position"]}, 0.0),
        ({"command_interfaces": ["position"]}, 0.0),
        ({"command_interfaces": ["effort"]}, 0.01),
        ({"constraints__stopped_velocity_tolerance": 0.0}, 0.0),
    ],
)
def test_ends_are_held_to_rest_only_by_a_controller_that_sees_rates_and_gives_up(
    changes: dict[str, Any], tolerance: float
) -> None:
    learned, _ = told({}, **changes)
    assert learned["controller.stopped_velocity_tolerance"] == tolerance


@pytest.mark.parametrize(
    ("own", "limit", "warned"),
    [
        ({"path_tolerance": 0.05}, 0.01, True),
        ({"path_tolerance": -1.0}, 0.01, True),
        ({"path_tolerance": 0.005}, 0.01, False),
        ({}, 0.01, False),
        ({"path_tolerance": 0.05}, 0.0, False),
        ({"path_tolerance": 0.05, "hand_over": "topic"}, 0.01, False),
    ],
)
def test_a_tolerance_that_takes_the_place_of_a_tighter_one_is_warned_of(
    own: dict[str, Any], limit: float, warned: bool
) -> None:
    _, warnings = told({"hand_over": "action"} | own, constraints__elbow__trajectory=limit)
    assert bool(warnings) == warned
    if warned:
        assert "controller.path_tolerance" in warnings[0]
        assert "0.01 (elbow)" in warnings[0]


@pytest.mark.parametrize("name", ["path_tolerance", "goal_tolerance", "goal_time_tolerance"])
def test_a_tolerance_for_which_the_controller_would_take_none_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput, match=rf"controller\.{name} is -0\.5: .* -1\.0"):
        replace(load_parameters().controller, **{name: -0.5})


def test_with_the_action_no_end_is_refused_for_the_tolerance_is_left_out() -> None:
    parameters = replace(load_parameters().controller, stopped_velocity_tolerance=0.01)
    assert parameters.of(JOINTS).stopped_velocity_tolerance == 0.01
    handed = replace(parameters, hand_over="action")
    assert handed.of(JOINTS).stopped_velocity_tolerance == 0.0
