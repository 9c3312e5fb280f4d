"""Reads the controller's own parameters, if `controller.from_node` names its node."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter

from ff_planner_ros.parameters.controller import ERASED, ControllerParameters, HandOver

NOT_AT_END = "allow_nonzero_velocity_at_trajectory_end"
INTERFACES, JOINTS = "command_interfaces", "joints"
STATES = "state_interfaces"
_EFFORT, _VELOCITY = "effort", "velocity"
GOAL_TIME, STOPPED = "constraints.goal_time", "constraints.stopped_velocity_tolerance"
# A controller's constraint of each joint, and the planner's parameter that replaces it in a goal.
_LIMITS = {"trajectory": "path_tolerance", "goal": "goal_tolerance"}
# In front of the planner's own names.
_OWN = "controller."
_PATIENCE = 5.0  # time after which a question without an answer is asked again [s]


class ControllerSettings:
    """Asks a controller's node for its parameters, until it has answered."""

    def __init__(
        self,
        node: Node,
        settings: ControllerParameters,
        joints: Sequence[str],
        learn: Callable[[Mapping[str, Any]], None],
    ) -> None:
        """Create the client of the node's service; `look` asks.

        Args:
            joints: Names of the joints that plans move.
            learn: Called with values of the planner's parameters, from the controller's.
        """
        self._node, self._logger, self._learn = node, node.get_logger(), learn
        self._settings, self._joints = settings, joints
        self.controller = controller = settings.from_node  # empty: nobody is asked
        # What was read, by name; None: nothing yet
        self.read: Mapping[str, Any] | None = None
        self._next = -math.inf  # when it may be asked again, by the monotonic clock [s]
        self._answered = set[str]()  # first name of each list of names that was answered
        self._pending = list[Any]()  # futures of the last questions
        self._told = set[str]()  # warnings in the log
        self._client = (
            node.create_client(
                GetParameters,
                f"{controller}/get_parameters",
                callback_group=MutuallyExclusiveCallbackGroup(),
            )
            if controller
            else None
        )

    @property
    def complaint(self) -> str:
        """What keeps the controller from taking any plan, in words; empty: nothing."""
        joints = (self.read or {}).get(JOINTS)
        if joints is None or set(joints) == set(self._joints):
            return ""
        return f"its joints are {', '.join(joints)}, and plans move {', '.join(self._joints)}"

    def look(self) -> None:
        """Ask for what has not been answered, if the controller's node is there."""
        client, now = self._client, time.monotonic()
        if client is None or now < self._next or not client.service_is_ready():
            return
        self._next = now + _PATIENCE
        for future in self._pending:
            client.remove_pending_request(future)
        constraints = [f"constraints.{joint}.{what}" for joint in self._joints for what in _LIMITS]
        own = [NOT_AT_END, INTERFACES, JOINTS, STATES, GOAL_TIME, STOPPED]
        questions = (own, self._taken), (constraints, self._compared)
        self._pending = [
            self._ask(client, names, then)
            for names, then in questions
            if names[0] not in self._answered
        ]

    def close(self) -> None:
        """Remove the client from the node."""
        if self._client is not None:
            self._node.destroy_client(self._client)

    def _ask(self, client: Any, names: list[str], then: Callable[[dict[str, Any]], None]) -> Any:
        def answer(future: Any) -> None:
            error = future.exception()
            if error is not None:
                self._warn_once(f"{self.controller} did not tell its parameters: {error}")
                return
            values = future.result().values
            if len(values) != len(names):  # rclcpp tells nothing if it lacks one of them
                self._warn_once(f"{self.controller} has not all of {', '.join(names)}")
                return
            self._answered.add(names[0])
            then(
                {
                    name: value
                    for name, one in zip(names, values, strict=True)
                    if (value := Parameter.from_parameter_msg(_named(name, one)).value) is not None
                }
            )

        future = client.call_async(GetParameters.Request(names=names))
        future.add_done_callback(answer)
        return future

    def _warn_once(self, words: str) -> None:
        if words not in self._told:
            self._told.add(words)
            self._logger.warning(words)

    def _taken(self, values: dict[str, Any]) -> None:
        told: dict[str, Any] = {}
        if NOT_AT_END in values:
            told[f"{_OWN}{NOT_AT_END}"] = values[NOT_AT_END]
        if INTERFACES in values:
            told[f"{_OWN}effort_interface"] = _EFFORT in values[INTERFACES]
        if STOPPED in values:
            told[f"{_OWN}stopped_velocity_tolerance"] = _held_against_ends(values)
        self._add(values)
        self._learn(told)
        said = ", ".join(f"{name}: {value}" for name, value in told.items())
        self._logger.info(f"{self.controller} says {said}")
        if self.complaint:
            self._logger.error(f"{self.controller} takes no plan: {self.complaint}")

    def _compared(self, values: dict[str, Any]) -> None:
        """Warn of tolerances that looser ones of the planner replace."""
        self._add(values)
        for what, name in _LIMITS.items():
            own = getattr(self._settings, name)
            strict = [
                f"{limit:g} ({joint})"
                for joint in self._joints
                if (limit := values.get(f"constraints.{joint}.{what}", 0.0)) > 0.0
                and (own == ERASED or own > limit)
            ]
            if strict and self._settings.hand_over == HandOver.ACTION:
                self._logger.warning(
                    f"{_OWN}{name}, {own:g}, takes the place of the tighter constraints.*.{what} "
                    f"of {self.controller}: {', '.join(strict)}"
                )

    def _add(self, values: dict[str, Any]) -> None:
        self.read = {**(self.read or {}), **values}


def _held_against_ends(values: Mapping[str, Any]) -> float:
    """Return the rate at the end above which a plan is given up [rad/s]; 0: at none."""
    sees = _VELOCITY in values.get(STATES, ()) and not {_VELOCITY, _EFFORT}.isdisjoint(
        values.get(INTERFACES, ())
    )
    gives_up = sees and values.get(GOAL_TIME, 0.0) > 0.0
    return max(0.0, values[STOPPED]) if gives_up else 0.0


def _named(name: str, value: ParameterValue) -> ParameterMessage:
    return ParameterMessage(name=name, value=value)
