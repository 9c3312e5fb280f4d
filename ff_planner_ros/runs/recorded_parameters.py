"""The parameters of a recorded node: as attached to its bag, and as they changed afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter

from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.planning.yaml_file import read_yaml
from ff_planner_ros.ros.messages.from_messages import nanoseconds
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.parameters import NodeParameters, changed, parameters_from_values
from ff_planner_ros.runs.installed import as_installed
from ff_planner_ros.share import share_directory

_ATTACHED = "parameters.yaml"


class RecordedParameters:
    """What the parameters were at any time of a run.

    Attributes:
        notes: What had to be assumed, in words.
    """

    def __init__(self, bag: Bag, node: str) -> None:
        """Read them.

        Args:
            node: Full name of the node whose parameters are wanted.

        Raises:
            BagError: The bag does not hold them, or holds what is none.
        """
        self.notes: list[str] = []
        self._at_start = self._attached(bag)
        self._changes: list[tuple[int, NodeParameters]] = []
        current = self._at_start
        for message, event in bag.decoded(type_name(ParameterEvent)):
            if event.node != node:
                continue
            told = as_installed(event, ParameterEvent)
            values = [*told.new_parameters, *told.changed_parameters]
            try:
                current = changed(current, [Parameter.from_parameter_msg(one) for one in values])
            except (InvalidInput, TypeError) as error:
                raise BagError(f"bag {bag.path}: {message.topic}: {error}") from None
            self._changes.append((nanoseconds(told.stamp), current))

    def at(self, now_ns: int) -> NodeParameters:
        """Return the parameters at a time.

        Args:
            now_ns: By the node's clock [ns].
        """
        before = [values for stamp_ns, values in self._changes if stamp_ns <= now_ns]
        return before[-1] if before else self._at_start

    def _attached(self, bag: Bag) -> NodeParameters:
        try:
            document = yaml.safe_load(bag.attachments[_ATTACHED])
            values = dict(document["/**"]["ros__parameters"])
        except KeyError:
            raise BagError(f"bag {bag.path} has no {_ATTACHED} attached, or an empty one") from None
        except (yaml.YAMLError, TypeError, ValueError):
            raise BagError(f"bag {bag.path}: its {_ATTACHED} holds no parameters") from None
        # `ff-planner plan --bag` attaches only what it uses; its plans start at once.
        values.setdefault("planning_allowance", 0.0)
        known = read_yaml(share_directory() / "config" / "planner.yaml")["/**"]["ros__parameters"]
        complete, unknown = _merged(known, values, "")
        if unknown:
            names = ", ".join(unknown)
            self.notes.append(f"parameters that this version does not know are left out: {names}")
        try:
            return parameters_from_values(complete)
        except (InvalidInput, TypeError, ValueError, AttributeError) as error:
            raise BagError(f"bag {bag.path}: its {_ATTACHED}: {error}") from None


def _merged(
    known: Mapping[str, Any], values: Mapping[str, Any], prefix: str
) -> tuple[dict[str, Any], list[str]]:
    """Return values where there are any, else what is known; and the names that are not known."""
    merged: dict[str, Any] = {}
    unknown = [f"{prefix}{name}" for name in values if name not in known]
    for name, default in known.items():
        value = values.get(name, default)
        if isinstance(default, dict) and isinstance(value, dict):
            merged[name], strange = _merged(default, value, f"{prefix}{name}.")
            unknown += strange
        else:
            merged[name] = value
    return merged, unknown
