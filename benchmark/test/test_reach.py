"""The map of P5: its directions, its start, its limits, and what its command keeps."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.cli import main
from ff_planner_benchmark.gallery import reach
from ff_planner_benchmark.gallery.page import page
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.task.planning_task import PlanningTask

DOCS = Path(__file__).parents[2] / "docs"
START = (1.59, -0.3, 0.07, -1.52, 0.07, 1.42, -2.41)
LENGTHS = (0.12, 0.225, 0.225, 0.20, 0.20, 0.06, 0.06)


@pytest.fixture(scope="module")
def task() -> PlanningTask:
    return reach.task_of(load_parameters().planner)


def test_there_are_98_directions_of_which_none_is_before_another() -> None:
    units = reach.directions()
    np.testing.assert_allclose(np.linalg.norm(units, axis=1), 1.0, atol=1e-6)
    told = {tuple(unit) for unit in units.tolist()}
    assert len(told) == len(units) == 98
    for unit in told:
        for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
            assert tuple(sign * unit[k] + 0.0 for k, sign in zip(order, signs, strict=True)) in told


def test_the_arm_starts_where_the_table_of_its_links_has_it(task: PlanningTask) -> None:
    turned, place = Rotation.identity(), np.array([0.0, 0.0, 0.5])
    for axis, angle, length in zip("zyzyzyz", START, LENGTHS, strict=True):
        turned *= Rotation.from_euler(axis, angle)
        place = place + turned.apply([0.0, 0.0, length])
    # Their antenna of a gram moves the cube's centre of mass by 2 micrometres.
    np.testing.assert_allclose(reach._start(task.problem), place, atol=3e-6)


def test_the_cube_is_larger_in_collisions_alone(task: PlanningTask) -> None:
    robot = task.problem.robot
    cube, *_ = robot.bodies
    assert cube.radius == pytest.approx(0.52 * np.sqrt(3.0))
    base = robot.model.inertias[1]
    assert base.mass == pytest.approx(300.001)
    assert np.diag(base.inertia) == pytest.approx([50.0, 50.0, 50.0], abs=1e-3)


def test_each_limit_is_kept_to_its_reach_and_no_plan_is_found_beyond(task: PlanningTask) -> None:
    direction = reach.directions()[30]
    found = reach.reach(direction, task)
    near, middle, far = found.centimetres
    assert 15 <= near <= middle <= far <= 35
    assert all(turn <= limit for turn, limit in zip(found.turns, reach.LIMITS, strict=True))
    start = reach._start(task.problem)
    limited = replace(task, problem=replace(task.problem, points=25))
    plan = reach._plan(limited, start + near / 100.0 * direction, 2.0)
    assert plan is not None
    way = plan.trajectory.ee_positions[-1] - plan.trajectory.ee_positions[0]
    np.testing.assert_allclose(way, near / 100.0 * direction, atol=1e-3)
    # Farther than the arm is long from its shoulder, whatever the cube does.
    assert reach._plan(task, start + 1.5 * direction, 2.0) is None


def test_the_volume_is_that_of_the_cage_through_the_ends() -> None:
    units = reach.directions()
    hull = ConvexHull(units).volume
    assert reach.volume([1.0] * 98, units) == pytest.approx(hull, rel=1e-6)
    assert reach.volume([2.0] * 98, units) == pytest.approx(8.0 * hull, rel=1e-6)


def test_a_run_goes_on_with_what_its_file_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "figures.json"
    row = {"direction": [1.0, 0.0, 0.0], "reach_cm": [10, 20, 30], "turn_deg": [0.5, 1.0, 2.0]}
    rows = [row | {"plans": 9, "seconds": 4.0}]
    file.write_text(json.dumps({"problems": {"P1": {}}, "reach": {"rows": rows}}))
    assert main(["reach", "--directions", "1", "--json", str(file)]) == 0
    shown = capsys.readouterr().out
    assert "| 2 | 30 (24) | 30 (45) | 30 (75) | (0.585) |" in shown
    assert (
        "1 of 98 directions, 9 plans asked for, 4 s of one\nprocessor: 0.25 directions a second."
        in shown
    )
    assert main(["reach", "--directions", "99", "--json", str(file)]) == 2
    assert "--directions is 99: it must be from 1 to 98" in capsys.readouterr().err


def test_what_a_file_of_figures_has_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def found(direction: np.ndarray, _task: PlanningTask) -> reach.Reach:
        return reach.Reach(direction, (1, 2, 3), (0.1, 0.2, 0.3), 4, 0.5)

    monkeypatch.setattr(reach, "reach", found)
    file = tmp_path / "figures.json"
    file.write_text('{"problems": {"P1": {"plans": []}}, "machine": {}}')
    reach.write_figures(file, 98)
    figures = json.loads(file.read_text())
    assert figures["problems"] == {"P1": {"plans": []}}
    rows = np.array([row["direction"] for row in figures["reach"]["rows"]])
    assert {tuple(row) for row in rows.tolist()} == {
        tuple(row) for row in reach.directions().tolist()
    }


def test_the_page_has_the_map_below_the_other_plans_of_its_problem() -> None:
    row = {"direction": [1.0, 0.0, 0.0], "reach_cm": [10, 20, 30], "plans": 9, "seconds": 4.0}
    published = json.loads((DOCS / "published.json").read_text(encoding="utf-8"))
    text = page(published | {"reach": {"rows": [row]}})
    heading = "\n### How far the arm reaches while the chaser turns by little\n"
    assert text.index("\n## P5. ") < text.index(heading) < text.index("\n## P6. ")
