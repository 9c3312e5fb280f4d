"""A row of the table as a scenario file, and the command that plans it again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ff_planner_ros.campaign.changes import SET, TIMES, Change, changed, is_inertia
from ff_planner_ros.campaign.methods import FIXED_BASE, OPTIMAL, ZERO_MOMENTUM
from ff_planner_ros.campaign.run import PARAMETERS, scenario_directory
from ff_planner_ros.campaign.sources import SCENARIO, URDF, content, generated_by_name, write
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults
from ff_planner_ros.robot.model import read_urdf


def command_again(row: Mapping[str, Any], directory: Path) -> str:
    """Write the scenario of a row into its campaign's directory, and return the command.

    Raises:
        InvalidInput: What the campaign kept of its scenarios is not there any more.
        OSError: The file cannot be written.
    """
    parameters = directory / PARAMETERS
    defaults = Defaults(load_parameters().planner)
    if parameters.is_file():
        defaults = load_parameters(parameters).of_scenarios()
    kept = scenario_directory(directory, row["source"])
    if (kept / SCENARIO).is_file():
        document, urdf = read_yaml(kept / SCENARIO), read_urdf(kept / URDF)
    else:
        document, urdf = content(generated_by_name(row["source"]), defaults)
    values = json.loads(row["changes"]) | json.loads(row["settings"])
    # Values are as they came out; of an inertia as a whole that is its factor.
    changes = [Change(k, TIMES if is_inertia(k) else SET, value) for k, value in values.items()]
    document, urdf, _ = changed(document, urdf, changes)
    place = directory / "worst" / row["id"]
    place.mkdir(parents=True, exist_ok=True)
    path = shlex.quote(str(write(document, urdf, place)))
    method = row["planned_by"]
    if method in (FIXED_BASE, ZERO_MOMENTUM):
        return f"ff-planner compare {path}"
    words = f"ff-planner plan {path}"
    if method != OPTIMAL:
        words += f" --method {method}"
    if parameters.is_file():
        words += f" --parameters {shlex.quote(str(parameters))}"
    return words
