"""`ff-planner verify` executes plans in the engines of other distributions, too."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any

import pytest
from robots import LEMUR_SCENARIO

from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.analysis.plan_document import planned_motion, planned_scene
from ff_planner_ros.cli import main
from ff_planner_ros.common import plug_ins
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.simulation.deviation import Deviation
from ff_planner_ros.simulation.other_engines import ENGINES

MODULE = """
from ff_planner_ros.simulation.deviation import Deviation
from ff_planner_ros.simulation.other_engines import Flown

OFF, APART, ASKED = Deviation(0.0, 0.0, 0.0, 0.0), 0.0123, []


def flown(robot, trajectory, scene, parts):
    ASKED.append((robot.joints, len(trajectory.time), len(scene.obstacles), parts))
    return Flown("Foreign 1.2", OFF, "link_2/c1", 1.5, APART)
"""
NAMES = ("foreign", "lacking")
Install = Callable[..., Any]


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("answers") / "answer.json"
    assert main(["plan", str(LEMUR_SCENARIO), "--json", str(file)]) == 0
    return file


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a distribution that brings these engines, as pip does, and return its module."""

    def installed(*engines: str) -> Any:
        info = tmp_path / "foreign-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1.2\n")
        lines = [f"[{ENGINES}]", *engines]
        (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
        (tmp_path / "foreign_engine.py").write_text(MODULE)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "foreign_engine", raising=False)
        import foreign_engine

        return foreign_engine

    def ours(group: str) -> EntryPoints:  # and none that this environment has, as Drake
        return EntryPoints(one for one in entry_points(group=group) if one.name in NAMES)

    monkeypatch.setattr(plug_ins, "_entry_points", ours)
    return installed


def test_it_is_told_beside_the_plan(
    install: Install, answer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine = install("foreign = foreign_engine:flown")
    assert main(["verify", str(answer)]) == 0
    shown, said = capsys.readouterr()
    zeros = r" +0\.0000" * 4
    assert re.search(rf"Foreign 1\.2{zeros} +link_2/c1 +1\.500 +12\.30  no\n", shown)
    robot, motion = planned_motion(document := json.loads(answer.read_text()))
    scene = planned_scene(document)
    closest = nearest(with_bodies(robot), motion, scene.obstacles)
    assert closest is not None
    cells = closest.pair, f"{closest.time:.3f}", f"{1e3 * closest.distance:.2f}", "no"
    assert re.search(rf"as planned +{' +'.join(map(re.escape, cells))}\n", shown)
    assert [(robot.joints, len(motion.time), 3, 1)] == engine.ASKED
    assert "verdict: passed" in shown
    assert "only" not in said


@pytest.mark.parametrize(
    ("change", "cells"),
    [
        ({"APART": -0.0005}, r"-0\.50  yes"),
        ({"OFF": Deviation(0.0011, 0.0, 0.0, 0.0)}, r"12\.30  no"),
    ],
)
def test_what_does_not_pass_there_fails(
    install: Install,
    answer: Path,
    change: dict[str, Any],
    cells: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    engine = install("foreign = foreign_engine:flown")
    for name, value in change.items():
        monkeypatch.setattr(engine, name, value)
    assert main(["verify", str(answer)]) == 3
    shown = capsys.readouterr().out
    assert re.search(cells, shown)
    assert "verdict: failed: in Foreign 1.2 the plan does not come true, or bodies touch" in shown


def test_what_did_not_come_true_in_mujoco_is_executed_nowhere_else(
    install: Install, answer: Path, tmp_path: Path
) -> None:
    engine = install("foreign = foreign_engine:flown")
    document = json.loads(answer.read_text())
    for row in document["joint_torques"]:
        row[3] *= 1.02
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(document))
    assert main(["verify", str(wrong)]) == 3
    assert engine.ASKED == []


def test_an_engine_that_lacks_something_or_cannot_execute_the_plan_is_told_and_mujoco_counts(
    install: Install,
    answer: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    engine = install("foreign = foreign_engine:flown", "lacking = foreign_engine:nothing")

    def refuse(*_: object) -> None:
        raise FfPlannerError(Status.UNSUPPORTED, "Foreign knows no rails")

    monkeypatch.setattr(engine, "flown", refuse)
    assert main(["verify", str(answer)]) == 0
    shown, said = capsys.readouterr()
    assert "note: engine lacking is foreign_engine:nothing: its entry point cannot be" in said
    assert "note: Foreign knows no rails" in said
    assert "in other engines" not in shown
    assert "verdict: passed" in shown


def test_an_engine_that_is_not_installed_is_told_where_it_is_asked_for_alone(
    install: Install, answer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install("foreign = foreign_engine:flown", "lacking = no_such_package:flown")
    assert main(["verify", str(answer)]) == 0
    shown, said = capsys.readouterr()
    assert "Foreign 1.2" in shown
    assert said == ""
    assert main(["verify", str(answer), "--engine", "lacking"]) == 2
    assert "--engine lacking is no_such_package:flown: its entry" in capsys.readouterr().err
    assert main(["verify", str(answer), "--engine", "unknown"]) == 2
    assert "entry points of ff_planner_ros.engines: foreign, lacking" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["foreign", "lacking"])
def test_of_several_engines_the_one_that_is_asked_for_executes_the_plan(
    name: str, install: Install, answer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine = install("foreign = foreign_engine:flown", "lacking = foreign_engine:flown")
    assert main(["verify", str(answer), "--engine", name]) == 0
    assert len(engine.ASKED) == 1
    assert "Foreign 1.2" in capsys.readouterr().out


def test_without_another_engine_mujoco_counts(
    install: Install, answer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install()
    assert main(["verify", str(answer)]) == 0
    shown, said = capsys.readouterr()
    assert said == ""
    assert "in other engines" not in shown
