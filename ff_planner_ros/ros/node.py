"""The process of the node `ff_planner`: its command line, signals, threads and a clean end."""

from __future__ import annotations

import gc
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.ros.planner_node import PlannerNode
from ff_planner_ros.ros.process import (
    CallbackExecutor,
    StopRequest,
    joining_ros,
    security_gap,
    spin_in_background,
)
from ff_planner_ros.ros.requests.solver import Solver

# One plans, one waits for it to make room, one cancels, one streams, one tells how the node is, one
# plays a plan, one publishes a plan that waited, one waits for the bag's disk.
_THREADS = 8
# For so long a thread keeps the interpreter while others wait for it [s]. Drawing a plan takes 30
# ms; with Python's 5 ms, each of the dozen times that an answer lets go of it meanwhile costs that.
_SWITCH_INTERVAL = 1e-3
_ROS_ARGUMENTS, _OF_PROGRAM, _PARAMETERS = "--ros-args", "--", "ros__parameters"
_FILE, _SINGLE = "--params-file", ("-p", "--param")
# Of a name: any names, or one; ROS has no others in it.
_WILD = {"**": r"(/\w+)*", "*": r"/\w+"}


def main(arguments: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, with ROS arguments; None: those of the process.

    Returns:
        Exit code: 0 stopped by a signal, 2 refused to start.
    """
    stop = StopRequest()
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        with joining_ros():
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        return _run(stop, sys.argv if arguments is None else arguments)
    except FfPlannerError as error:
        print(f"planner_node: {error}", file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()


def _run(stop: StopRequest, arguments: list[str]) -> int:
    with closing(Solver()) as solver:
        with joining_ros():
            node = PlannerNode(solver)
        if gap := security_gap():
            node.get_logger().warning(gap)
        for words in not_taken(arguments, node.get_fully_qualified_name()):
            node.get_logger().warning(in_log(words))
        executor = CallbackExecutor(num_threads=_THREADS)
        executor.add_node(node)
        try:
            if node.get_parameter("autostart").value and not _started(node):
                return 2
            # A full collection looks at all that is loaded, which stays to the end: half a second
            # on a busy machine, in which no request is read.
            gc.collect()
            gc.freeze()
            stop_spinning = spin_in_background(executor, node.get_logger())
            stop.wait()
            # The request in progress is answered, and the answer recorded.
            node.stop_planning(Status.SHUT_DOWN, "the planner was shut down")
            stop_spinning()
        finally:
            node.close()
    return 0


def _started(node: PlannerNode) -> bool:
    """Configure and activate; whether that worked, the node says if not."""
    node.trigger_configure()
    if node.refusal is None:
        node.trigger_activate()
    return node.refusal is None


def not_taken(arguments: Sequence[str], node: str) -> Iterator[str]:
    """Yield a sentence for each file or parameter on a command line that is not for a node.

    Args:
        node: Its full name.
    """
    for option, value in _given(arguments):
        if option == _FILE:
            names = list(_nodes_in(Path(value)))
            if names and not any(_is_for(name, node) for name in names):
                yield (
                    f"{value} has parameters of {', '.join(names)} and none of {node}: nothing of "
                    f"it was taken; for this node it must say {node}, or /**"
                )
        elif (of := re.match(r"([^:=]+):[^:=]+:=", value)) and not _is_for(of[1], node):
            yield (
                f"{option} {value} is a parameter of {of[1]} and not of {node}: it was not taken; "
                f"for this node leave out {of[1]}:"
            )


def _given(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield files and parameters among the arguments that are for ROS, with their options."""
    is_of_ros = False
    for option, value in zip(arguments, [*arguments[1:], ""], strict=True):
        is_of_ros = option == _ROS_ARGUMENTS or (is_of_ros and option != _OF_PROGRAM)
        if is_of_ros and option in (_FILE, *_SINGLE):
            yield option, value


def _nodes_in(file: Path) -> Iterator[str]:
    """Yield the names of nodes that a file has parameters of, as ROS puts them together."""
    try:
        document = yaml_document(file.read_text(encoding="utf-8"), str(file), "no YAML")
    except (InvalidInput, OSError, UnicodeError):
        return  # ROS has read it otherwise
    yield from _nodes(document, "")


def _nodes(part: Any, name: str) -> Iterator[str]:
    if isinstance(part, dict):
        if name and _PARAMETERS in part:
            yield name
        for key, value in part.items():
            if key != _PARAMETERS:
                yield from _nodes(value, f"{name}/{key}" if name else str(key))


def _is_for(name: str, node: str) -> bool:
    """Tell whether a name in a file, with wildcards, is that of a node."""
    parts = (part for part in name.split("/") if part)
    pattern = "".join(_WILD.get(part, f"/{re.escape(part)}") for part in parts)
    return re.fullmatch(pattern, node) is not None


if __name__ == "__main__":
    sys.exit(main())
