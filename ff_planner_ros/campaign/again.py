"""A row of the table as a scenario file, and the command that plans it again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ff_planner_ros.analysis.json_file import json_document
from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.campaign.run import CASES, PARAMETERS, scenario_directory
from ff_planner_ros.campaign.sources import (
    SCENARIO,
    URDF,
    content,
    generated_by_name,
    names_files,
    write,
)
from ff_planner_ros.campaign.table import below
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.changes import (
    SET,
    TIMES,
    Change,
    changed,
    is_inertia,
    require_key,
)
from ff_planner_ros.planning.scenario.scenario import Defaults
from ff_planner_ros.robot.model import read_urdf
from ff_planner_ros.robot.urdf.urdf_xml import read_shapes


def changes_of(row: Mapping[str, Any], column: str) -> dict[str, Any]:
    """Return the changed values in a column of a row, by key of the scenario.

    Raises:
        InvalidInput: The column is no JSON object, or a key is none of a scenario.
    """
    told = json_document(row[column], column, quoted(row[column]))
    if not isinstance(told, dict):
        allowed = "it must be values by keys of a scenario"
        raise InvalidInput(Status.OUT_OF_RANGE, column, quoted(row[column]), allowed)
    for key in told:
        require_key(column, key)
    return told


def case_directory(row: Mapping[str, Any], directory: Path) -> Path:
    """Return the directory of a case's scenario and page.

    Raises:
        InvalidInput: It would not be below the campaign's directory.
    """
    return below(directory, CASES, row["id"])


def scenario_again(row: Mapping[str, Any], directory: Path) -> Path:
    """Write the scenario of a row into its campaign's directory, and return its path.

    Raises:
        InvalidInput: The campaign's copy of its scenario is missing or malformed, or a path leads
            out of the campaign's directory.
        OSError: The file cannot be written.
    """
    try:
        document, urdf = _scenario(row, directory)
    except (AttributeError, LookupError, TypeError, ValueError, SyntaxError) as error:
        allowed = f"what the campaign kept of it makes no scenario ({type(error).__name__})"
        raise InvalidInput(Status.OUT_OF_RANGE, "scenario", row["source"], allowed) from None
    place = case_directory(row, directory)
    place.mkdir(parents=True, exist_ok=True)
    for name in (SCENARIO, URDF):
        below(place, name)
    return write(document, urdf, place)


def command_again(row: Mapping[str, Any], directory: Path, scenario: Path) -> str:
    """Return the command that plans the scenario of a row again.

    Raises:
        InvalidInput: The path of the campaign's parameters is a link.
    """
    words = ["ff-planner", "plan", str(scenario)]
    if row["planned_by"] != OPTIMAL:
        words += ["--method", row["planned_by"]]
    if (parameters := below(directory, PARAMETERS)).is_file():
        words += ["--parameters", str(parameters)]
    return shlex.join(words)


def defaults_of(directory: Path) -> Defaults:
    """Return the defaults of what a campaign's scenarios leave out.

    Raises:
        InvalidInput: The campaign's parameters are malformed, or their path is a link.
    """
    parameters = below(directory, PARAMETERS)
    if parameters.is_file():
        return load_parameters(parameters).of_scenarios()
    return Defaults(load_parameters().planner)


def _scenario(row: Mapping[str, Any], directory: Path) -> tuple[dict[str, Any], str]:
    """Return scenario and URDF of a row, with its changes applied."""
    defaults = defaults_of(directory)
    kept = scenario_directory(directory, row["source"])
    scenario, robot = (below(kept, name) for name in (SCENARIO, URDF))
    if scenario.is_file():
        document, urdf = read_yaml(scenario), read_urdf(robot)
        read_shapes(urdf)  # or else it is no URDF, or one that does harm
    else:
        document, urdf = content(generated_by_name(row["source"]), defaults)
    values = changes_of(row, "changes") | changes_of(row, "settings")
    if names_files(document):
        allowed = "a scenario of a campaign names no file but its URDF"
        raise InvalidInput(Status.UNSUPPORTED, "scenario", row["source"], allowed)
    # Values are as they came out; of an inertia as a whole that is its factor.
    changes = [Change(k, TIMES if is_inertia(k) else SET, value) for k, value in values.items()]
    document, urdf, _ = changed(document, urdf, changes)
    return document, urdf
