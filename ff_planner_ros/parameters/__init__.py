"""Every parameter of the node, declared once, and its values."""

from ff_planner_ros.parameters.node import NodeParameters
from ff_planner_ros.parameters.values import DECLARATIONS, default_values, load_parameters

__all__ = ["DECLARATIONS", "NodeParameters", "default_values", "load_parameters"]
