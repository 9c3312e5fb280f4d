"""The commands about scenario and study files: check, schema."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import BAD_INPUT, SOLVED
from ff_planner_ros.commands.options import Add
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import InvalidInput

if TYPE_CHECKING:
    from ff_planner_ros.planning.scenario.scenario import Defaults

_OF_STUDIES = {"scenarios", "generated", "bag"}


def add_check(add: Add) -> None:
    """Add `check`."""
    check = add(
        "check",
        check_files,
        "list everything that is wrong with scenario or study files",
        description="Read scenario and study files and list all of their faults: line, key, value "
        "and what is allowed. Nothing is planned.",
        epilog="Exit code: 0 nothing is wrong, 2 something is.",
    )
    check.add_argument("files", type=Path, nargs="+", metavar="FILE")
    parameters_help = "the node's parameters: they count where a scenario does not say"
    check.add_argument("--parameters", type=Path, metavar="FILE", help=parameters_help)


def check_files(options: Namespace) -> int:
    """Print every fault of scenario and study files, or that they have none."""
    from ff_planner_ros.common.yaml_file import located
    from ff_planner_ros.parameters import load_parameters
    from ff_planner_ros.planning.scenario.scenario import Defaults

    parameters = load_parameters(options.parameters)
    defaults = Defaults(parameters.planner)
    if options.parameters is not None:
        defaults = parameters.of_scenarios()
    code = SOLVED
    for path in options.files:
        try:
            print_notes(_load(path, defaults, options.parameters))
            print(f"{path}: nothing is wrong with it")
        except InvalidInput as error:
            code = BAD_INPUT
            for one in located(path, error).faults:
                print(one)
    return code


def _load(path: Path, defaults: Defaults, parameters: Path | None) -> tuple[str, ...]:
    """Read a study, which has no robot but sources, or else a scenario; return notes on it."""
    from ff_planner_ros.common.yaml_file import read_yaml

    document = read_yaml(path)
    if isinstance(document, dict) and "robot" not in document and _OF_STUDIES & document.keys():
        from ff_planner_ros.campaign.study import load_study

        notes = load_study(path).notes
        own = f"{path} is a study, which names its own parameters"
        return notes if parameters is None else (*notes, own)
    from ff_planner_ros.planning.scenario.scenario import load_task
    from ff_planner_ros.planning.task.notes import notes_on_files

    return notes_on_files(load_task(path, defaults))


def add_schema(add: Add) -> None:
    """Add `schema`."""
    schema = add(
        "schema",
        print_schema,
        "print the JSON Schema of scenario or study files, for editors",
        description="Print the JSON Schema of scenario or study files, by which an editor "
        "completes and checks them. The package has both in config/schemas.",
    )
    schema.add_argument("file", nargs="?", choices=("scenario", "study"), default="scenario")


def print_schema(options: Namespace) -> int:
    """Print the JSON Schema of a kind of file."""
    if options.file == "study":
        from ff_planner_ros.campaign.study import study_schema as schema
    else:
        from ff_planner_ros.planning.scenario.scenario import scenario_schema as schema
    print(json.dumps(schema(), indent=1))
    return SOLVED
