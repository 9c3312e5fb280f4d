"""What the parameters of a joint_trajectory_controller mean to plans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from rclpy.parameter import Parameter

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.ros.outputs import controller_settings
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


class Future:
    """A future of an answer that came, failed (None) or was lost."""

    def __init__(self, values: list[Any] | None, *, lost: bool = False) -> None:
        self.values, self.lost = values, lost

    def add_done_callback(self, then: Callable[[Any], None]) -> None:
        if not self.lost:
            then(self)

    def exception(self) -> Exception | None:
        return RuntimeError("damaged") if self.values is None else None

    def result(self) -> Any:
        if self.values is None:
            raise RuntimeError("damaged")
        return SimpleNamespace(values=self.values)


def told(own: dict[str, Any], **changes: Any) -> tuple[dict[str, Any], list[str]]:
    """What is learned of a controller, and the warnings."""
    values = DEFAULTS | {name.replace("__", "."): value for name, value in changes.items()}
    node, learned = Mock(), dict[str, Any]()

    def answered(request: Any) -> Any:
        found = [
            Parameter(name, value=values[name]).get_parameter_value() for name in request.names
        ]
        return Future(found)

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


@pytest.mark.parametrize("first", [Future([], lost=True), Future([]), Future(None)])
def test_a_question_without_a_whole_answer_is_asked_again(
    first: Future, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, node, learned, asked = [0.0], Mock(), dict[str, Any](), list[list[str]]()
    monkeypatch.setattr(controller_settings.time, "monotonic", lambda: now[0])

    def answered(request: Any) -> Future:
        asked.append(request.names)
        if len(asked) <= 2:
            return first
        values = [Parameter(name, value=DEFAULTS[name]) for name in request.names]
        return Future([one.get_parameter_value() for one in values])

    node.create_client.return_value.call_async = answered
    parameters = replace(load_parameters().controller, from_node="/arm")
    settings = ControllerSettings(node, parameters, JOINTS, learned.update)
    for now[0] in (0.0, 4.9):
        settings.look()
        assert (len(asked), settings.read) == (2, None)
    for now[0] in (5.0, 10.0, 15.0):
        settings.look()
        assert len(asked) == 4
        assert learned["controller.stopped_velocity_tolerance"] == 0.01
    removed = node.create_client.return_value.remove_pending_request.call_args_list
    assert [call.args[0] for call in removed[:2]] == [first, first]
