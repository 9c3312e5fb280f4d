"""The verbs about scenario and study files: check, schema."""

from __future__ import annotations

from pathlib import Path

from ff_planner_ros.commands.verbs import Add


def add_check(add: Add) -> None:
    """Add `check`."""
    check = add(
        "check",
        "ff_planner_ros.commands.files:check_files",
        "list everything that is wrong with scenario or study files",
        description="Read scenario and study files and list all of their faults: line, key, value "
        "and what is allowed. Nothing is planned.",
        epilog="Exit code: 0 nothing is wrong, 2 something is.",
    )
    check.add_argument("files", type=Path, nargs="+", metavar="FILE")
    parameters_help = "the node's parameters: they count where a scenario does not say"
    check.add_argument("--parameters", type=Path, metavar="FILE", help=parameters_help)


def add_schema(add: Add) -> None:
    """Add `schema`."""
    schema = add(
        "schema",
        "ff_planner_ros.commands.files:print_schema",
        "print the JSON Schema of scenario or study files, for editors",
        description="Print the JSON Schema of scenario or study files, by which an editor "
        "completes and checks them. The package has both in config/schemas.",
    )
    schema.add_argument("file", nargs="?", choices=("scenario", "study"), default="scenario")
