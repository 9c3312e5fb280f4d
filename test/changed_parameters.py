"""Parameters with one value changed."""

from __future__ import annotations

from typing import Any

from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.values import parameters_of, values_of


def replaced(parameters: NodeParameters, name: str, value: Any) -> NodeParameters:
    """Return parameters with one value replaced, by its full name."""
    return parameters_of(values_of(parameters) | {name: value})
