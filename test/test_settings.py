"""The planner's tunables."""

from __future__ import annotations

from dataclasses import asdict, replace

import pytest
import yaml
from robots import CONFIG

from ff_planner_ros.common.declared import declared
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.settings import PlannerSettings, RobustSettings

FILE = CONFIG / "planner.yaml"
BLOCK = yaml.safe_load(FILE.read_text())["/**"]["ros__parameters"]["planner"]
# Where first guesses come from, and what others require: no settings of the planner's.
del BLOCK["library"], BLOCK["plugins"]
NAMES = [*(name for name in BLOCK if name != "robust"), *(f"robust.{n}" for n in BLOCK["robust"])]


def test_the_settings_are_those_of_the_parameters_file() -> None:
    assert asdict(load_parameters().planner) == BLOCK


def test_every_setting_says_what_it_means() -> None:
    for one in (*declared(PlannerSettings).values(), *declared(RobustSettings).values()):
        assert len(one.sentence) > 5, one.name


@pytest.mark.parametrize("name", [name for name in NAMES if name != "search"])
def test_the_ends_of_a_range_pass_and_what_lies_beyond_is_refused(name: str) -> None:
    settings: PlannerSettings | RobustSettings = load_parameters().planner
    block, _, last = name.rpartition(".")
    if block:
        settings = load_parameters().planner.robust
    schema = declared(type(settings))[last].form.schema()
    for bound, beyond in ((schema.get("minimum"), -1), (schema.get("maximum"), 1)):
        if bound is None:
            continue
        assert getattr(replace(settings, **{last: bound}), last) == bound
        with pytest.raises(InvalidInput, match=rf"planner\.{name} is .*: it must (be|not) "):
            replace(settings, **{last: bound + beyond})


@pytest.mark.parametrize("value", ["deep", "", -1, 2.5, True])
def test_a_depth_that_is_none_is_refused(value: object) -> None:
    with pytest.raises(InvalidInput, match=r"planner\.search is .*quick, normal or thorough"):
        replace(load_parameters().planner, search=value)  # type: ignore[arg-type]


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
        replace(load_parameters().planner, **{name: value})
    assert str(refusal.value).startswith(message)
