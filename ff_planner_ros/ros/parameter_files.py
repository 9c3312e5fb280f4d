"""What a node was given of parameters, and ROS did not take, because it is for other nodes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import InvalidInput

_ROS_ARGUMENTS, _OF_PROGRAM, _PARAMETERS = "--ros-args", "--", "ros__parameters"
_FILE, _SINGLE = "--params-file", ("-p", "--param")
# Of a name: any names, or one; ROS has no others in it.
_WILD = {"**": r"(/\w+)*", "*": r"/\w+"}


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
    waiting = [("", document)]
    while waiting:
        name, part = waiting.pop(0)
        if not isinstance(part, dict):
            continue
        if name and _PARAMETERS in part:
            yield name
        inside: list[tuple[str, Any]] = [
            ("/".join(filter(None, (name, str(key)))), value)
            for key, value in part.items()
            if key != _PARAMETERS
        ]
        waiting = [*inside, *waiting]


def _is_for(name: str, node: str) -> bool:
    """Tell whether a name in a file, with wildcards, is that of a node."""
    parts = (part for part in name.split("/") if part)
    pattern = "".join(_WILD.get(part, f"/{re.escape(part)}") for part in parts)
    return re.fullmatch(pattern, node) is not None
