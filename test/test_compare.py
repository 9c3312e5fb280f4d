"""`ff-planner compare`, as a user types it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from robots import LEMUR_SCENARIO, LEMUR_URDF

from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.cli import main
from ff_planner_ros.commands import compare
from ff_planner_ros.errors import NoPlanFound, Status

METHODS = [
    "straight line", "APF", "min(L)", "min(L), joint splines", "min(Theta)",
    "min(Theta), joint splines", "L + 50 Theta", "fixed base", "zero momentum",
]  # fmt: skip
NAMES = (
    *("end_effector", "chaser_pose", "chaser_velocity", "clearance"),
    *("joint_angles", "joint_rates", "joint_torques"),
)
PICTURES = {f"{name}.{kind}" for name in NAMES for kind in ("png", "pdf")} | {"scene.html"}
SENTENCE = "the inertias of the paper's arm are not public"


@pytest.fixture
def scenario(tmp_path: Path) -> Callable[..., Path]:
    """A copy of the capture on few points, with some values replaced."""

    def write(**changes: object) -> Path:
        content = yaml.safe_load(LEMUR_SCENARIO.read_text()) | {"points": 13} | changes
        content["robot"]["urdf"] = str(LEMUR_URDF)
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return write


def rows(printed: str, header: str) -> dict[str, list[str]]:
    """Cells by first column of the table under a header."""
    lines = printed.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(header))
    end = next(k for k in range(begin, len(lines)) if "  " not in lines[k])
    cells = [[cell for cell in line.split("  ") if cell] for line in lines[begin + 1 : end]]
    return {row[0]: [cell.strip() for cell in row[1:]] for row in cells}


@pytest.mark.nightly
def test_the_papers_capture_gives_table_ratios_figures_and_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(LEMUR_SCENARIO), "--output", str(tmp_path / "new")]) == 0
    printed = capsys.readouterr().out
    table = rows(printed, "method")
    assert list(table) == METHODS
    path, attitude, clearance, miss = (
        {method: float(cells[k]) for method, cells in table.items()} for k in (0, 1, 2, 4)
    )
    # lemur.md: 1.2239 rad, 13.12 deg, -0.1399 m with another rule for the integrals.
    assert path["straight line"] == pytest.approx(1.2196, abs=1e-3)
    assert attitude["straight line"] == pytest.approx(13.1, abs=0.1)
    assert clearance["straight line"] == pytest.approx(-140.0, abs=1.0)
    in_papers_family = ("APF", "min(L)", "min(Theta)", "L + 50 Theta")
    assert path["min(L)"] == min(path[method] for method in in_papers_family)
    # A sketch of joint splines gave joint paths that were 2 to 5 % shorter.
    assert 0.94 < path["min(L), joint splines"] / path["min(L)"] < 0.98
    others = [attitude[method] for method in METHODS if "joint splines" not in method]
    assert attitude["min(Theta)"] == min(others)
    assert path["min(L)"] < path["L + 50 Theta"] < path["min(Theta)"]
    assert attitude["min(Theta)"] < attitude["L + 50 Theta"] < attitude["min(L)"]
    for method in METHODS:
        planned = method not in ("fixed base", "zero momentum")
        assert (miss[method] < 1.0) == planned
        assert (table[method][-1] == "passed") == (planned and method != "straight line")
    assert "\nstraight line: the link from joint_4 to joint_5 is 0.14 m inside" in printed
    ratios = rows(printed, "ratio")
    assert len(ratios) == 6
    shorter = ratios["joint path, min(L) / straight line"]
    assert shorter[0] == "0.974"
    assert float(shorter[1]) == pytest.approx(path["min(L)"] / path["straight line"], abs=1e-3)
    assert SENTENCE in " ".join(printed.split())
    assert {path.name for path in (tmp_path / "new").iterdir()} == PICTURES
    for name in NAMES:
        assert str(tmp_path / "new" / f"{name}.png") in printed
    assert str(tmp_path / "new" / "scene.html") in printed


@pytest.mark.nightly
def test_where_a_method_fails_the_others_are_compared_all_the_same(
    scenario: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_plan(*_: object) -> None:
        raise NoPlanFound(Status.COLLISION, "no plan found: the link is inside obstacle c1")

    monkeypatch.setattr(compare, "plan", no_plan)
    monkeypatch.setattr(compare, "zero_momentum", no_plan)
    monkeypatch.setattr(compare, "fixed_base", straight_line)
    assert main(["compare", str(scenario()), "--output", str(tmp_path / "new")]) == 0
    printed = capsys.readouterr().out
    table = rows(printed, "method")
    assert list(table) == METHODS
    for method in ("min(L)", "min(Theta)", "L + 50 Theta", "zero momentum"):
        assert table[method][:6] == ["-"] * 6
        assert table[method][-1] == "collision"
        assert f"\n{method}: no plan found: the link is inside obstacle c1" in printed
    assert float(table["straight line"][0]) > 1.0
    assert {path.name for path in (tmp_path / "new").iterdir()} == PICTURES
    assert "ratio" not in printed
    assert SENTENCE not in " ".join(printed.split())


def test_where_every_method_fails_the_table_says_why_and_the_exit_code_is_3(
    scenario: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_plan(*_: object, **__: object) -> None:
        raise NoPlanFound(Status.SINGULAR, "the arm is in a dynamic singularity")

    names = ("straight_line", "artificial_potential_field", "plan", "fixed_base", "zero_momentum")
    for name in names:
        monkeypatch.setattr(compare, name, no_plan)
    assert main(["compare", str(scenario()), "--output", str(tmp_path / "new")]) == 3
    table = rows(capsys.readouterr().out, "method")
    assert {cells[-1] for cells in table.values()} == {"singular"}
    assert list((tmp_path / "new").iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "code", "message"),
    [
        ({"obstacles": [{"id": "c9", "center": [0.2, 0.1, 0.7], "radius": 0.2}]}, 2, "c9"),
        ({"target": {"position": [9.0, 0, 0], "euler_xyz_deg": [0, 0, 0]}}, 3, "target.position"),
        ({"duration": -1.0}, 2, "duration"),
    ],
)
def test_a_question_that_no_method_may_answer_is_refused_once_and_at_once(
    changes: dict[str, object],
    code: int,
    message: str,
    scenario: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = scenario(**changes)
    assert main(["compare", str(path), "--output", str(tmp_path / "new")]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert len(captured.err.splitlines()) == 1


def test_an_output_directory_that_cannot_be_made_is_refused_before_anything_is_planned(
    scenario: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(scenario()), "--output", "/dev/null/new"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "/dev/null/new" in captured.err
