"""Helpers to declare commands and options, and to refuse options that would be in vain."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ff_planner_ros.errors import InvalidInput, Status

if TYPE_CHECKING:
    from argparse import _ActionsContainer

# Given verb, function that runs it, summary and what else argparse takes, adds a verb and returns
# its parser.
Add: TypeAlias = Callable[..., ArgumentParser]

_PICTURES = (".svg", ".png")


def add_output(
    command: _ActionsContainer,
    option: str,
    metavar: str,
    words: str,
    require: Callable[[str, Path], None],
) -> None:
    """Add an option that names an output, which is tried before the command runs.

    Args:
        words: The help.
        require: One of the functions below.
    """
    action = command.add_argument(option, type=Path, metavar=metavar, help=words)
    outputs = command.get_default("outputs") or {}
    command.set_defaults(outputs={**outputs, action.dest: (option, require)})


def require_outputs(options: Namespace) -> None:
    """Refuse outputs that cannot be written, before the work for them is done.

    Raises:
        InvalidInput: One cannot.
    """
    for name, (option, require) in getattr(options, "outputs", {}).items():
        if (path := getattr(options, name)) is not None:
            require(option, path)


def require_file(option: str, path: Path) -> None:
    """Refuse a path to which no file can be written; one that is there is left as it is."""
    try:
        is_there = path.exists()
        if is_there and not (path.is_file() or path.is_dir()):
            return  # a pipe must not be opened twice
        place = path.resolve()  # and not the link that leads there
        with place.open("ab"):
            pass
        if not is_there:
            place.unlink()
    except (OSError, ValueError) as error:  # the latter: a character that no path can have
        raise _unwritable(option, path, getattr(error, "strerror", None) or error) from None


def require_picture(option: str, path: Path) -> None:
    """Refuse a path to which no file can be written, or that is none of a picture."""
    require_file(option, path)
    if path.suffix not in _PICTURES:
        allowed = f"it must end in {' or '.join(_PICTURES)}"
        raise InvalidInput(Status.UNSUPPORTED, option, path, allowed)


def require_directory(option: str, path: Path) -> None:
    """Refuse a path that is no directory which can be written to, or created with its parents."""
    try:
        path = path.resolve()
        there = next(one for one in (path, *path.parents) if one.exists())
        reason = "" if there.is_dir() else f"{there} is not a directory"
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error)
    else:
        if not reason and not os.access(there, os.W_OK | os.X_OK):
            reason = f"{there} is not to be written to"
    if reason:
        raise _unwritable(option, path, reason)


def require_new_file(option: str, path: Path) -> None:
    """Refuse a path that is there, or to which no file can be written."""
    _require_new(option, path)
    require_file(option, path)


def require_new_directory(option: str, path: Path) -> None:
    """Refuse a path that is there, or at which no directory can be created."""
    _require_new(option, path)
    require_directory(option, path)


def _require_new(option: str, path: Path) -> None:
    if os.path.lexists(path):
        allowed = "it exists already, and is not overwritten"
        raise InvalidInput(Status.UNSUPPORTED, option, path, allowed)


def _unwritable(option: str, path: Path, reason: object) -> InvalidInput:
    return InvalidInput(Status.UNSUPPORTED, option, path, f"it cannot be written: {reason}")


def refuse_given(options: Namespace, unused: Mapping[str, Any], allowed: str) -> None:
    """Refuse options that would be ignored.

    Args:
        unused: Their values if they are not given, by the names of their values.
        allowed: Where they count.

    Raises:
        InvalidInput: One of them is given.
    """
    for name, default in unused.items():
        if (value := getattr(options, name)) != default:
            option = f"--{name.replace('_', '-')}"
            raise InvalidInput(Status.UNSUPPORTED, option, value, allowed)
