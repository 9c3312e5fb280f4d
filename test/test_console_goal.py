"""The console's fields of the goal: the chaser's attitude there, and a path to follow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dense_motion import arms, truth
from published_paths import p5
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.changes import GOAL, movable
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.serve import Served, serve
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.path.followed import curve_of
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.requests import request_of_task

DEFAULTS = Defaults(load_parameters().planner)
SCENARIOS = share_directory() / "config" / "scenarios"


class Console:
    """A page whose controls a test sets, as a browser does."""

    def __init__(self, served: Served) -> None:
        self.page, self._gui = served.page, served.server.gui

    @property
    def task(self) -> PlanningTask:
        assert self.page.task is not None
        return self.page.task

    def field(self, label: str) -> Any:
        every = self._gui._gui_input_handle_from_uuid.values()
        return next(one for one in every if one.label == label)

    def set(self, label: str, value: Any) -> str:
        """Set a control as a client, and return what the page says then."""
        handle = self.field(label)
        handle.value = value
        for heard in handle._impl.update_cb:
            heard(SimpleNamespace(client=self, target=handle))
        said: str = self.page._progress.content
        return said


@pytest.fixture
def console(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Console]:
    """A page with a scenario file of a path, or that of the name which a test asks for."""
    file = SCENARIOS / f"{getattr(request, 'param', '')}.yaml"
    if not hasattr(request, "param"):
        shortest = replace(p5(300.0, 1e-3, 31), objective=Objective(1.0, 0.0))
        write_scenario(PlanningTask(shortest, DEFAULTS.settings), file := tmp_path / "path.yaml")
    entry = Entry("asked", load_task(file, DEFAULTS))
    served = serve(lambda server: Page(server, [entry]), "127.0.0.1", 8700)
    yield Console(served)
    served.server.stop()


@pytest.mark.parametrize("console", ["lemur_capture", "lemur_tumbling", "stow"], indirect=True)
def test_the_chaser_has_an_attitude_at_any_goal(console: Console) -> None:
    """Asked for in degrees, or by a quaternion, which is at first that of the start."""
    asked = console.task
    assert not console.field("angle at most [deg]").visible
    console.set("chaser at the goal", "rotated by at most")
    assert not console.field("attitude x y z w").visible
    console.set("angle at most [deg]", 0.5)
    assert console.task.problem.chaser_goal.rotation == pytest.approx(np.deg2rad(0.5))
    console.set("chaser at the goal", "at an attitude")
    goal, start = console.task.problem.chaser_goal, asked.problem.start
    assert console.field("attitude x y z w").visible
    assert goal.quaternion_xyzw == pytest.approx(start.quaternion_chaser_to_inertial_xyzw)
    console.set("attitude x y z w", "0, 0, 0.6, 0.8")
    goal = console.task.problem.chaser_goal
    assert goal.quaternion_xyzw == pytest.approx([0.0, 0.0, 0.6, 0.8])
    assert goal.tolerance == pytest.approx(np.deg2rad(0.5))
    for wrong, words in (("0 0 0 x", "it must be numbers"), ("0 0 0", "must have 4 entries")):
        said = console.set("attitude x y z w", wrong)
        assert said.startswith("not changed: target.chaser_quaternion_xyzw is ")
        assert words in said
        assert console.task.problem.chaser_goal is goal
    console.set("attitude x y z w", "0 0 0.6 0.8")
    console.set("chaser at the goal", "any attitude")
    assert console.task.digest == asked.digest


@pytest.mark.parametrize("console", ["lemur_capture"], indirect=True)
def test_an_attitude_that_is_asked_for_is_planned(console: Console) -> None:
    console.set("chaser at the goal", "rotated by at most")
    console.set("angle at most [deg]", 0.05)
    console.page.plan()
    while console.page.search is not None:
        console.page.search.wait()
    plan = console.page.chosen.plan
    assert plan is not None
    problem = console.task.problem
    first, last = Rotation.from_quat(truth(problem, plan.trajectory).q[[0, -1], 3:7])
    assert (first.inv() * last).magnitude() <= np.deg2rad(0.05) + 2e-6


def test_a_path_is_drawn_before_it_is_planned_and_afterwards(console: Console) -> None:
    problem = console.task.problem
    path = problem.path
    assert path is not None

    def drawn() -> np.ndarray:
        lines: Any = console.page._server.scene._handle_from_node_name["/shown/0/path"]
        return np.asarray(lines.points)

    true = curve_of(problem).at(np.linspace(0.0, path.duration, 201)).positions
    assert drawn()[:, 0] == pytest.approx(true[:-1], abs=1e-6)
    console.page.plan()
    while console.page.search is not None:
        console.page.search.wait()
    plan = console.page.chosen.plan
    assert plan is not None
    motion = truth(problem, plan.trajectory)
    places = arms(problem.robot, motion.q)[0][:, -1]
    away = np.linalg.norm(places - curve_of(problem).at(motion.time).positions, axis=1)
    assert away.max() <= path.position_tolerance
    assert drawn()[:, 1] == pytest.approx(true[1:], abs=1e-6)
    assert "/shown/0/way" in console.page._server.scene._handle_from_node_name


def test_a_path_is_written_back_as_it_was(console: Console, tmp_path: Path) -> None:
    """To a file and to a node, and after other changes."""
    asked = console.task
    path = asked.problem.path
    assert path is not None
    console.set("weight of joint path", 2.0)
    assert console.task.problem.path is path
    console.set("weight of joint path", 1.0)
    assert console.task.digest == asked.digest
    write_scenario(console.task, tmp_path / "again.yaml")
    assert load_task(tmp_path / "again.yaml", DEFAULTS).digest == asked.digest
    goal = request_of_task(console.task, "world").goal
    assert len(goal.path[0].poses) == len(path.points)
    text = console.field("path").value
    console.set("path", "")
    assert console.task.problem.path is None
    console.set("path", text)
    assert console.task.digest == asked.digest


def test_a_path_alone_says_where_and_when_its_end_is(console: Console) -> None:
    assert movable(console.task.problem) == ()
    assert not console.field("duration [s]").visible
    console.set("path", "")
    assert movable(console.task.problem) == (GOAL,)
    assert console.field("duration [s]").visible
    assert not console.field("off the path [mm]").visible


@pytest.mark.parametrize("console", ["lemur_capture"], indirect=True)
def test_a_path_is_pasted_as_a_table_of_its_points(console: Console) -> None:
    lines = (
        "0 1.2 0.5 0.6 0 0 0 1",
        "4, 1.3, 0.5, 0.6, 0, 0, 0.6, 0.8",
        "",
        "9 1.3 0.6 0.6 0 0 0 1",
    )
    console.set("path", "\n".join(lines))
    console.set("off the path [mm]", 2.0)
    console.set("off its orientation [deg]", 0.5)
    problem = console.task.problem
    path = problem.path
    assert path is not None
    assert path.times.tolist() == [0.0, 4.0, 9.0]
    assert path.positions[1] == pytest.approx([1.3, 0.5, 0.6])
    assert path.points[1].quaternion_xyzw == pytest.approx([0.0, 0.0, 0.6, 0.8])
    assert path.position_tolerance == pytest.approx(2e-3)
    assert path.orientation_tolerance == pytest.approx(np.deg2rad(0.5))
    assert problem.duration == 9.0
    assert problem.target.position == pytest.approx([1.3, 0.6, 0.6])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("0 1 2 3\n1 1 2", "target.path[1] is 1 1 2: a line must be time x y z [qx qy qz qw]"),
        ("0 1 2 3\n1 1 2 z", "target.path[1] is 1 1 2 z: it must be numbers"),
        ("0 1 2 3", "target.path is 1 points: it must have 2 to 10000 points"),
        ("0 1 2 3\n0 1 2 3", "target.path[1].time is 0.0: it must be later"),
        ("0 1 2 3\n1 1 2 3 0 0 0 2", "target.path[1].quaternion_xyzw"),
    ],
)
def test_a_table_that_is_no_path_is_refused_by_its_line(
    console: Console, table: str, words: str
) -> None:
    before = console.task
    assert f"not changed: {words}" in console.set("path", table)
    assert console.task is before


@pytest.mark.parametrize("console", ["lemur_tumbling", "stow"], indirect=True)
def test_a_goal_that_is_no_pose_has_no_path(console: Console) -> None:
    assert not console.field("path").visible
