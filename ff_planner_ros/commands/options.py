"""Helpers to declare commands and options."""

from __future__ import annotations

import sys
from argparse import SUPPRESS, Action, ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any, TypeAlias

# Given verb, function that runs it, summary and what else argparse takes, adds a verb and returns
# its parser.
Add: TypeAlias = Callable[..., ArgumentParser]


def add_renamed(command: ArgumentParser, old: str, new: Action) -> None:
    """Keep an option's old name as a deprecated alias, which prints a note on the new one."""
    allowed: dict[str, Any] = {"nargs": new.nargs, "type": new.type, "choices": new.choices}

    class Renamed(Action):
        def __call__(self, parser: ArgumentParser, namespace: Namespace, *given: Any) -> None:
            print(f"ff-planner: note: {old} is deprecated: say {_name(new)}", file=sys.stderr)
            new(parser, namespace, *given)

    command.add_argument(
        old, action=Renamed, dest=new.dest, default=SUPPRESS, help=SUPPRESS, **allowed
    )


def _name(option: Action) -> str:
    return option.option_strings[0]
