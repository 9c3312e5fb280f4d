"""The planner's tunables."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml
from robots import CONFIG

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.settings import PlannerSettings, load_settings

FILE = CONFIG / "planner.yaml"
BLOCK = yaml.safe_load(FILE.read_text())["/**"]["ros__parameters"]["planner"]


def test_the_settings_are_those_of_the_parameters_file() -> None:
    settings = load_settings(FILE)
    assert {item.name: getattr(settings, item.name) for item in fields(settings)} == BLOCK


def test_every_setting_says_what_it_means() -> None:
    for item in fields(PlannerSettings):
        assert set(item.metadata) == {"description", "minimum", "maximum", "unit"}
        assert len(item.metadata["description"]) > 5


@pytest.mark.parametrize("name", BLOCK)
def test_the_ends_of_a_range_pass_and_what_lies_beyond_is_refused(name: str) -> None:
    settings = load_settings(FILE)
    metadata = next(item for item in fields(PlannerSettings) if item.name == name).metadata
    for bound, beyond in ((metadata["minimum"], -1), (metadata["maximum"], 1)):
        if bound is None:
            continue
        assert getattr(replace(settings, **{name: bound}), name) == bound
        with pytest.raises(InvalidInput, match=rf"planner\.{name} is .*: it must be at "):
            replace(settings, **{name: bound + beyond})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("clearance_margin", float("nan"), "planner.clearance_margin is "),
        ("clearance_margin", "2 mm", "planner.clearance_margin is '2 mm': it must be a number"),
        ("max_iterations", 10.5, "planner.max_iterations is 10.5: it must be a whole number"),
        ("max_iterations", True, "planner.max_iterations is True: it must be a whole number"),
    ],
)
def test_a_value_of_another_type_is_refused(name: str, value: object, message: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        replace(load_settings(FILE), **{name: value})
    assert str(refusal.value).startswith(message)


@pytest.mark.parametrize(
    ("found", "instead", "message"),
    [
        ("/**:", "/planner:", "/** is missing: "),
        ("ros__parameters:", "parameters:", "ros__parameters is missing: "),
        ("    planner:", "    solver:", "planner is missing: "),
        ("penalty_gain:", "penalty_gian:", "planner.penalty_gian is unknown: known are clear"),
        ("      penalty_gain: 2.5", "", "planner.penalty_gain is missing: it must be given"),
        ("max_iterations: 100", "max_iterations: 0", "planner.max_iterations is 0: it must be at"),
    ],
)
def test_a_parameters_file_with_a_fault_is_refused_by_name(
    tmp_path: Path, found: str, instead: str, message: str
) -> None:
    original = FILE.read_text()
    assert found in original
    path = tmp_path / "planner.yaml"
    path.write_text(original.replace(found, instead))
    with pytest.raises(InvalidInput) as refusal:
        load_settings(path)
    assert str(refusal.value).startswith(message)
