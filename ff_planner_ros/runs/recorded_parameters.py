"""Parameters of a recorded node: as attached to its bag, and as they changed afterwards."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue

from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import BagError, InvalidInput, Status
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters, default_values
from ff_planner_ros.parameters.values import flattened, parameters_of, replaced
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.runs.installed import as_installed

_ATTACHED = "parameters.yaml"
# Where a message has the value of a parameter, by its type; rclpy, which knows this too, loads a
# middleware.
_FIELD_OF_TYPE = {
    getattr(ParameterType, f"PARAMETER_{kind}"): f"{kind.lower()}_value"
    for kind in (
        *("BOOL", "INTEGER", "DOUBLE", "STRING"),
        *("BYTE_ARRAY", "BOOL_ARRAY", "INTEGER_ARRAY", "DOUBLE_ARRAY", "STRING_ARRAY"),
    )
}


class RecordedParameters:
    """The parameters of a recorded node at any time."""

    def __init__(self, bag: Bag, node: str) -> None:
        """Read the parameters of one node, given by its full name.

        Raises:
            BagError: The bag has no parameters attached, or invalid ones.
        """
        self.notes: list[str] = []  # what had to be assumed
        self._changes: list[tuple[int, NodeParameters]] = []
        self._at_start = self._attached(bag)
        self._read_changes(bag, node)

    def _read_changes(self, bag: Bag, node: str) -> None:
        current = self._at_start
        for message, event in bag.decoded(type_name(ParameterEvent)):
            if event.node != node:
                continue
            told = as_installed(event, ParameterEvent)
            values = [*told.new_parameters, *told.changed_parameters]
            try:
                for one in values:
                    current = replaced(current, one.name, _value(one.value))
            except (InvalidInput, TypeError) as error:
                raise BagError(f"bag {bag.path}: {message.topic}: {error}") from None
            self._changes.append((nanoseconds(told.stamp), current))

    def at(self, now_ns: int) -> NodeParameters:
        """Return the parameters at a time by the node's clock [ns]."""
        before = [values for stamp_ns, values in self._changes if stamp_ns <= now_ns]
        return before[-1] if before else self._at_start

    def _attached(self, bag: Bag) -> NodeParameters:
        try:
            written = bag.attachments[_ATTACHED]
            values = flattened(yaml_document(written, _ATTACHED, "damaged"))
        except KeyError:
            raise BagError(f"bag {bag.path} has no {_ATTACHED} attached, or an empty one") from None
        except (InvalidInput, TypeError, ValueError):
            raise BagError(f"bag {bag.path}: its {_ATTACHED} holds no parameters") from None
        assumed = default_values()
        unknown = [name for name in values if name not in assumed]
        if unknown:
            names = ", ".join(unknown)
            self.notes.append(f"parameters that this version does not know are left out: {names}")
        missing = [name for name in assumed if name not in values]
        if missing:
            names = ", ".join(_shortened(missing))
            self.notes.append(
                f"parameters that are not in the bag, taken as in this version: {names}"
            )
        try:
            return parameters_of({**assumed, **values})
        except (InvalidInput, TypeError, ValueError, AttributeError) as error:
            raise BagError(f"bag {bag.path}: its {_ATTACHED}: {error}") from None


def _value(message: ParameterValue) -> Any:
    """Return a parameter's value; an array becomes a tuple, and a value not set None."""
    if message.type == ParameterType.PARAMETER_NOT_SET:
        return None
    if message.type not in _FIELD_OF_TYPE:
        allowed = f"it must be a type of ParameterType.msg, 0 to {max(_FIELD_OF_TYPE)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "value.type", message.type, allowed)
    value = getattr(message, _FIELD_OF_TYPE[message.type])
    return tuple(value) if message.type >= ParameterType.PARAMETER_BYTE_ARRAY else value


def _shortened(names: Sequence[str]) -> list[str]:
    """Return names of parameters, with `group.*` for each group of which all are among them."""

    def members(group: str, of: Iterable[str]) -> int:
        return sum(name.startswith(f"{group}.") for name in of)

    words: list[str] = []
    for name in names:
        group, dot, _ = name.partition(".")
        whole = dot and members(group, names) == members(group, DECLARATIONS)
        words.append(f"{group}.*" if whole else name)
    return list(dict.fromkeys(words))
