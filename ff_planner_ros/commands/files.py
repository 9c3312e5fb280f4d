"""The commands about scenario and study files: check, schema."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ff_planner_ros.commands import BAD_INPUT, SOLVED
from ff_planner_ros.common.yaml_file import located, read_yaml
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task, scenario_schema

_OF_STUDIES = {"scenarios", "generated", "bag"}


def check_files(options: argparse.Namespace) -> int:
    """Print every fault of scenario and study files, or that they have none."""
    parameters = load_parameters(options.parameters)
    defaults = Defaults(parameters.planner)
    if options.parameters is not None:
        defaults = parameters.of_scenarios()
    code = SOLVED
    for path in options.files:
        try:
            _load(path, defaults)
            print(f"{path}: nothing is wrong with it")
        except InvalidInput as error:
            code = BAD_INPUT
            for one in located(path, error).faults:
                print(one)
    return code


def _load(path: Path, defaults: Defaults) -> None:
    """Read a study, which has no robot but sources, or else a scenario."""
    document = read_yaml(path)
    if isinstance(document, dict) and "robot" not in document and _OF_STUDIES & document.keys():
        from ff_planner_ros.campaign.study import load_study

        load_study(path)
    else:
        load_task(path, defaults)


def print_schema(options: argparse.Namespace) -> int:
    """Print the JSON Schema of a kind of file."""
    schema = scenario_schema
    if options.file == "study":
        from ff_planner_ros.campaign.study import study_schema

        schema = study_schema
    print(json.dumps(schema(), indent=1))
    return SOLVED
