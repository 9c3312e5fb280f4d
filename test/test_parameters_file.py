"""Parameters files without a node: read whole, strictly, and merged with the defaults."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from changed_parameters import replaced
from planner_yaml import planner_yaml
from robots import CONFIG, LEMUR_SCENARIO

from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import DECLARATIONS, load_parameters
from ff_planner_ros.parameters.robot import LimitParameters
from ff_planner_ros.parameters.values import checked, flattened
from ff_planner_ros.planning.problem.limits import OF_ONE_NUMBER, Limits

FILE = CONFIG / "planner.yaml"


def test_the_file_of_defaults_is_written_from_the_declarations() -> None:
    assert FILE.read_text(encoding="utf-8") == planner_yaml(), "run tools/planner_yaml.py"
    assert flattened(yaml.safe_load(planner_yaml())).keys() == DECLARATIONS.keys()
    assert load_parameters(FILE) == load_parameters()


def test_a_file_of_some_parameters_leaves_the_others_at_their_defaults(tmp_path: Path) -> None:
    path = tmp_path / "some.yaml"
    path.write_text(
        "/**: {ros__parameters: {planner: {starts: 3}, limits.velocity: none}}\n"
        "ff_planner: {ros__parameters: {points: 30, odometry: "
        "{sensor_position_in_chaser: [1, 2.0, 3.0]}}}\n"
    )
    expected = load_parameters()
    for name, value in (
        ("planner.starts", 3),
        ("limits.velocity", "none"),
        ("points", 30),
        ("odometry.sensor_position_in_chaser", (1.0, 2.0, 3.0)),
    ):
        expected = replaced(expected, name, value)
    assert load_parameters(path) == expected


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            "{planer: {starts: 3}}",
            "planer.starts is an unknown parameter: known are .*starts",
        ),
        ("{planner: {start: 3}}", "planner.start is an unknown parameter"),
        ("{planner: {starts: 2.5}}", "planner.starts is 2.5: it must be a whole number"),
        ("{planner: {starts: true}}", "planner.starts is True"),
        ("{points: 4}", "points is 4: it must be from 5 to 10000"),
        ("{state_max_age: .nan}", "state_max_age is nan"),
        ("{time_budget: soon}", "time_budget is 'soon': it must be a number"),
        ("{limits: {chaser_attitude: -0.1}}", "limits.chaser_attitude is -0.1"),
        ("{limits: {chaser_rotation: -0.1}}", "limits.chaser_rotation is -0.1"),
        ("{limits: {velocity: fast}}", "limits.velocity is 'fast': it must be from_urdf or"),
        ("{limits: 3}", "limits is 3"),
        ("{autostart: 1}", "autostart is 1: it must be true or false"),
        ("{odometry: {sensor_position_in_chaser: 1.0}}", "sensor_position_in_chaser is 1.0"),
        ("{odometry: {sensor_position_in_chaser: [1.0]}}", "sensor_position_in_chaser"),
        ("{end_behaviour: stop}", "end_behaviour is 'stop'"),
        ("[1]", "ros__parameters"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_by_name(
    tmp_path: Path, parameters: str, words: str
) -> None:
    path = tmp_path / "planner.yaml"
    path.write_text(f"/**: {{ros__parameters: {parameters}}}")
    with pytest.raises(InvalidInput, match=words):
        load_parameters(path)


@pytest.mark.parametrize("text", ["planner: {starts: 3}", "/**: {planner: {starts: 3}}", "- 1"])
def test_a_file_that_is_not_as_ros_expects_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "planner.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInput):
        load_parameters(path)


def test_a_parameter_in_a_group_and_by_its_whole_name_is_refused_unless_for_two_nodes(
    tmp_path: Path,
) -> None:
    path, name = tmp_path / "planner.yaml", "planner.starts"
    whole, grouped = {name: 3}, {"planner": {"starts": 4}}
    for node, told in (("/**", whole | grouped), ("ff_planner", grouped | whole)):
        path.write_text(yaml.safe_dump({node: {"ros__parameters": told}}))
        with pytest.raises(InvalidInput, match=f"^{name} is given twice: give it once"):
            load_parameters(path)
    of_each = {"/**": {"ros__parameters": whole}, "ff_planner": {"ros__parameters": grouped}}
    path.write_text(yaml.safe_dump(of_each))
    assert load_parameters(path).planner.starts == 4


@pytest.mark.parametrize("value", ["deep", "", -1, 1.5, True])
def test_a_depth_that_is_none_is_refused(value: Any) -> None:
    with pytest.raises(InvalidInput, match=r"planner\.search is .* quick, normal or thorough"):
        checked("planner.search", value)


def test_a_value_is_returned_as_declared() -> None:
    assert checked("time_budget", 3) == 3.0
    assert isinstance(checked("time_budget", 3), float)
    assert checked("odometry.sensor_position_in_chaser", [1, 2, 3]) == (1.0, 2.0, 3.0)


def limiting(*words: Any, **numbers: float) -> LimitParameters:
    """Return limits with some of those of one number."""
    return LimitParameters(*words, **dict.fromkeys(OF_ONE_NUMBER, 0.0) | numbers)


def test_no_limit_of_the_attitude_is_an_infinite_one() -> None:
    assert limiting("none", (0.0,), "none").limits() == Limits(False, math.inf, None, False)
    assert limiting("from_urdf", (), "from_urdf", chaser_attitude=0.2).limits() == Limits(True, 0.2)
    rotating = limiting("from_urdf", (), "from_urdf", chaser_rotation=0.3).limits()
    assert rotating == Limits(True, chaser_rotation=0.3)
    each = limiting("from_urdf", (0.5, 0.25), "from_urdf", chaser_attitude=0.2).limits()
    assert each.joint_accelerations == (0.5, 0.25)


def test_a_plan_takes_what_the_scenario_does_not_say_from_the_whole_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters, file = tmp_path / "planner.yaml", tmp_path / "answer.json"
    parameters.write_text(
        "/**: {ros__parameters: {end_behaviour: stop_joints, post_goal_duration: 1.5}}"
    )
    command = ["plan", str(LEMUR_SCENARIO), "--json", str(file)]
    assert main([*command, "--parameters", str(parameters)]) == 0
    answer = json.loads(file.read_text())
    assert answer["limits"] == {
        "position": "from_urdf",
        "velocity": "from_urdf",
        "acceleration": "none",
        "effort": "from_urdf",
        "chaser_attitude": "none",
    }
    assert answer["time"][-1] == 11.5
    (kept,) = (li for li in capsys.readouterr().out.splitlines() if li.startswith("limits kept"))
    assert kept.split("  ")[-1].strip() == "joint positions, joint velocities, joint torques"
    assert main(command) == 0
    answer = json.loads(file.read_text())
    assert (answer["limits"]["velocity"], answer["time"][-1]) == ("none", 10.0)
    parameters.write_text("/**: {ros__parameters: {time_budget: 0.001}}")
    assert main([*command, "--parameters", str(parameters)]) == 3
    assert "the time budget of 0.001 s is used up" in capsys.readouterr().err
