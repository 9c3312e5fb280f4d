"""Scenarios and studies are checked as a whole: by `ff-planner check`, and by editors."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from robots import LEMUR_SCENARIO
from test_scenario import MISSING, SCENARIO, saved

from ff_planner_ros.campaign.study import study_schema
from ff_planner_ros.cli import main
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.scenario.scenario import scenario_schema

CONFIG = share_directory() / "config"
SHIPPED = [path for kind in ("scenarios", "studies") for path in sorted(CONFIG.glob(f"{kind}/*"))]
SCHEMA = scenario_schema()
SCHEMAS = {"scenario": SCHEMA, "study": study_schema()}

# By text: what is replaced in the paper's capture, and what is said of it.
FAULTS = {
    "linear_velocity: [0.02, 0.0, 0.05]": (
        "linear_velocity: [0.02, 0.0]",
        "{line}: chaser.linear_velocity is [0.02 0.  ]: it must have 3 entries, not 2",
    ),
    "quaternion_xyzw: [0.0, 0.0, 0.0, 1.0]": (
        "quaternion_xyzw: [0.0, 0.0, 0.0, 2.0]",
        "{line}: chaser.quaternion_xyzw is [0.0, 0.0, 0.0, 2.0]: its norm must be 1 within 0.001",
    ),
    "duration: 10.0": ("duration: ten", "{line}: duration is 'ten': it must be a number"),
    "radius: 0.15": ("radius: -1, colour: red", "{line}: obstacles[1].colour is unknown: known"),
    "center: [1.2, 0.7, 0.7]": ("center: [1, 2, x]", "{line}: obstacles[1].center[2] is 'x': it"),
    "{id: c3": ("{id: c1", "{line}: obstacles[2].id is c1: it must be unique"),
    "chaser_attitude: 0.0": (
        "chaser_attitude: -1",
        "{line}: objective.chaser_attitude is -1.0: it",
    ),
}


@pytest.mark.law("FILE-03")
def test_every_fault_of_a_file_is_listed_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robots = str(LEMUR_SCENARIO.parents[1] / "robots")
    text = LEMUR_SCENARIO.read_text().replace("../robots", robots)
    expected = []
    for good, (bad, told) in FAULTS.items():
        line = text[: text.index(good)].count("\n") + 1
        text = text.replace(good, bad, 1)
        expected.append(told.format(line=line))
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    assert main(["check", str(LEMUR_SCENARIO), str(path)]) == 2
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == f"{LEMUR_SCENARIO}: nothing is wrong with it"
    lines = [one for one in rest if one.startswith(f"{path}:")]
    for told in expected:
        assert [one for one in lines if told in one], f"{told} is not in {lines}"
    assert len(lines) == len(expected) + 1  # the radius of the sphere that has a colour


def test_every_list_that_has_not_one_number_for_each_joint_is_a_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robots = str(LEMUR_SCENARIO.parents[1] / "robots")
    document = yaml.safe_load(LEMUR_SCENARIO.read_text().replace("../robots", robots))
    numbers = {"position": [0.0] * 6, "velocity": [0.0] * 8, "acceleration": [0.0]}
    row = [[0.0] * 7, [0.0] * 7]
    running = {"time": [0.0, 1.0], "positions": [[0.0] * 7, [0.0] * 5]}
    document |= {
        "joints": numbers,
        "limits": {"acceleration": [1.0, 1.0]},
        "running": running | {"velocities": row, "accelerations": row},
    }
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(document))
    assert main(["check", str(path)]) == 2
    told = capsys.readouterr().out
    for field, found in (
        *((f"joints.{name}", len(given)) for name, given in numbers.items()),
        ("limits.acceleration", 2),
        ("running.positions[1]", 5),
    ):
        assert re.search(rf"^\S+:\d+: {re.escape(field)} is .* 7 entries, not {found}$", told, re.M)
    assert told.count("\n") == 5


def test_of_a_thousand_faults_a_command_tells_a_screen_and_check_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.yaml"
    document = yaml.safe_load(LEMUR_SCENARIO.read_text()) | {"obstacles": [1.0] * 1000}
    document["robot"]["urdf"] = str(LEMUR_SCENARIO.parent / document["robot"]["urdf"])
    file.write_text(yaml.safe_dump(document))
    assert main(["plan", str(file)]) == 2
    *faults, last = capsys.readouterr().err.splitlines()
    assert [line[: len("ff-planner: obs")] for line in faults] == ["ff-planner: obs"] * 20
    assert last == "ff-planner: and 980 more, which `ff-planner check` lists"
    assert main(["check", str(file)]) == 2
    assert len(capsys.readouterr().out.splitlines()) == 1000


def test_a_file_without_faults_is_sound(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", *map(str, SHIPPED)]) == 0
    assert capsys.readouterr().out.count("nothing is wrong") == len(SHIPPED)


def test_a_scenario_that_is_not_there_is_a_fault_of_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path / "gone.yaml")]) == 2
    assert "No such file" in capsys.readouterr().out


def test_a_campaign_tells_every_fault_of_a_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump({"robot": {"urdf": 7}, "duration": "long"}))
    (tmp_path / "study.yaml").write_text("scenarios: [bad.yaml]")
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    assert main(["campaign", str(study), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    for field in ("robot.base_link is missing", "duration is 'long'", "chaser is missing"):
        assert field in told


# A study that is wrong, and what is said of it, by line.
BAD_STUDY = """scenarios: lemur.yaml
generated: {kind: hard, robots: [r2], count: 0}
variations:
  grid: {duration: [], points: {by: 3}, robot.urdf: [a]}
  random: {count: 1}
methods:
  - {name: a, method: magic}
  - {name: a, set: 3}
keep: {trajectories: 3}
"""
OF_STUDY = (
    "1: scenarios is 'lemur.yaml': it must be a list",
    "2: generated.kind is 'hard': it must be ordinary, cluttered or bodies",
    "2: generated.robots[0] is r2: it must be lemur, ",
    "2: generated.count is 0: it must be from 1 to 10000000",
    "4: variations.grid.duration is empty: it must have one entry or more",
    "4: variations.grid.points.by is unknown: known are times, plus, ",
    "4: variations.grid is 'robot.urdf': a robot of another file is another scenario",
    "5: variations.random.seed is missing: it must be given",
    "5: variations.random.values is missing: it must be given",
    "7: methods[0].method is 'magic': it must be optimal, ",
    "8: methods[1].set is 3: it must hold values by keys of a scenario",
    "8: methods[1].name is a: it must be unique",
    "9: keep.trajectories is 3: it must be true or false",
)


def test_every_fault_of_a_study_is_listed_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(BAD_STUDY)
    assert main(["check", str(path)]) == 2
    lines = capsys.readouterr().out.splitlines()
    for line, told in zip(lines, OF_STUDY, strict=True):
        assert line.startswith(f"{path}:{told}")
    assert not jsonschema.Draft202012Validator(SCHEMAS["study"]).is_valid(yaml.safe_load(BAD_STUDY))


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_schema_that_is_installed_is_that_of_the_declarations(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMAS[kind])
    assert main(["check", "--schema", kind]) == 0
    installed = (CONFIG / "schemas" / f"{kind}.json").read_text(encoding="utf-8")
    assert capsys.readouterr().out == installed
    assert json.loads(installed) == SCHEMAS[kind]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_file_is_valid_by_the_schema_that_it_names(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    told, _, schema = text.splitlines()[0].partition("$schema=")
    assert told == "# yaml-language-server: "
    named = json.loads((path.parent / schema).read_text(encoding="utf-8"))
    jsonschema.validate(yaml.safe_load(text), named)


# Whether the schema alone refuses it, too.
BAD: list[tuple[str, Any, bool]] = [
    ("chaser", MISSING, True),
    ("chaser.position", [1.0, 2.0], True),
    ("chaser.quaternion_xyzw", [0.0, 0.0, 0.0, 2.0], False),
    ("joints.velocity", MISSING, True),
    ("joints.velocity", [0.0], False),
    ("joints.end_effector_at_rest", True, True),
    ("target.quaternion_xyzw", MISSING, True),
    ("target.euler_xyz_deg", [0.0, 0.0, 0.0], True),
    ("target.orientation", "loose", True),
    ("target_body", {}, True),
    ("duration", 0.0, True),
    ("duration", {"min": 1.0}, True),
    ("points", 4, True),
    ("points", 5.5, True),
    ("obstacles.0.radius", 0.0, True),
    ("obstacles.1.id", "mast", False),
    ("obstacles.0.colour", "blue", True),
    ("objective.chaser_attitude", -1.0, True),
    ("objective", {"joint_path_length": 0.0, "chaser_attitude": 0.0}, False),
    ("limits.velocity", "fast", True),
    ("limits.acceleration", [0.1, -0.1], True),
    ("parametrisation", "spline", True),
    ("robot.geometry", "cubes", True),
    ("robot.locked_joints", [1.0], True),
    ("planner", {"starts": 0}, True),
    ("planner", {"start": 3}, True),
    ("planner", {"robust": {"sigmas": 11.0}}, True),
    ("controller", {"effort_interface": True}, True),
    ("end_behaviour", "rest", True),
    ("start_after", -1.0, True),
    ("first_guess", [1.0, "x"], True),
]


@pytest.mark.parametrize(
    ("name", "value", "by_schema"),
    BAD,
    ids=[f"{name}={'missing' if value is MISSING else value}" for name, value, _ in BAD],
)
def test_what_the_schema_lets_pass_the_check_refuses(
    tmp_path: Path, name: str, value: Any, by_schema: bool
) -> None:
    (tmp_path / "lemur.urdf").write_text((CONFIG / "robots/lemur/lemur.urdf").read_text())
    path = saved(tmp_path, name, value)
    document = yaml.safe_load(path.read_text())
    assert jsonschema.Draft202012Validator(SCHEMA).is_valid(document) is not by_schema
    assert main(["check", str(path)]) == 2


@pytest.mark.parametrize(
    "change",
    [
        lambda one: (
            one["target"].update(orientation="free") or one["target"].pop("quaternion_xyzw")
        ),
        lambda one: one["joints"].update(end_effector_at_rest=False),
        lambda one: one.update(duration={"min": 5.0, "max": 9.0}),
        lambda one: one["limits"].update(acceleration="none", chaser_attitude=0.5),
        lambda one: one.update(controller="none"),
    ],
)
def test_what_the_check_lets_pass_is_valid_by_the_schema(
    tmp_path: Path, change: Callable[[Any], Any]
) -> None:
    (tmp_path / "lemur.urdf").write_text((CONFIG / "robots/lemur/lemur.urdf").read_text())
    path = saved(tmp_path)
    document = yaml.safe_load(path.read_text())
    change(document)
    document["target"].pop("angular_velocity")  # with orientation free none can be wanted
    document["target"].pop("angular_acceleration")
    path.write_text(yaml.safe_dump(document))
    jsonschema.validate(document, SCHEMA)
    assert main(["check", str(path)]) == 0


def test_every_key_of_the_tests_is_in_the_schema() -> None:
    assert SCENARIO.keys() <= SCHEMA["properties"].keys()


@pytest.mark.parametrize(
    ("told", "refused"),
    [
        (
            "points: 8500\nend_behaviour: hold_end_effector\npost_goal_duration: 2.0",
            "2 s: with its",
        ),
        ("points: 50\nend_behaviour: stop_joints\npost_goal_duration: -1.0", "-1.0: it must be"),
        ("points: 50\nend_behaviour: stop_joints\npost_goal_duration: 2100.0", "2100 s: with its"),
    ],
)
@pytest.mark.parametrize("command", ["check", "plan"])
def test_a_post_goal_segment_that_no_plan_can_have_is_refused_before_any_search(
    command: str,
    told: str,
    refused: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 10,000 points; by the same rule whoever asks."""
    monkeypatch.setattr(compiled.PathProgram, "at", None)  # nothing is searched
    file = tmp_path / "scenario.yaml"
    text = LEMUR_SCENARIO.read_text().replace("../robots", str(CONFIG / "robots"))
    file.write_text(text.replace("points: 50", told))
    assert main([command, str(file)]) == 2
    assert f"post_goal_duration is {refused}" in "".join(capsys.readouterr())
