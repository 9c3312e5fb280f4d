"""Drake as an engine of `ff-planner verify`, which finds it by the entry point of the benchmark."""

import math
import tomllib
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from robots import CONFIG, LEMUR_SCENARIO
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import captured, shapes
from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.cli import main
from ff_planner_ros.common import plug_ins
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.simulation.other_engines import ENGINES

pytestmark = pytest.mark.ci

pytest.importorskip("pydrake", reason="pip install './benchmark[drake]' brings Drake")
pytest.importorskip("mujoco")

EXACT = 1e-4  # [m]


def planned(problem):
    return perform(PlanningTask(problem, load_parameters().planner)).trajectory


def flown(*arguments):
    from ff_planner_benchmark.beside_mujoco import flown

    return flown(*arguments)


@pytest.fixture(scope="module")
def tumbling():
    """A capture with obstacles that are fixed to a body that tumbles, and its plan."""
    problem = load_scenario(CONFIG / "scenarios/lemur_tumbling.yaml")
    return problem, planned(problem)


@pytest.mark.law("PLAN-22")
def test_verify_executes_a_plan_in_drake_by_the_declared_entry_point(monkeypatch, capsys):
    project = Path(__file__).resolve().parents[1] / "pyproject.toml"
    declared = tomllib.loads(project.read_text())["project"]["entry-points"][ENGINES]
    found = EntryPoints(EntryPoint(name, value, ENGINES) for name, value in declared.items())
    monkeypatch.setattr(plug_ins, "_entry_points", lambda group: found.select(group=group))
    assert main(["verify", str(LEMUR_SCENARIO)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    (drake,) = [row for row in rows if row[:1] == ["Drake"]]
    (ours,) = [row for row in rows if row[:2] == ["as", "planned"]]
    assert drake[-1] == ours[-1] == "no"
    assert drake[-4] == ours[-4]
    assert float(drake[-2]) == pytest.approx(float(ours[-2]), abs=1e3 * EXACT)


@pytest.mark.law("PLAN-10", "PLAN-22")
def test_the_nearest_pair_is_that_of_the_plan(times):
    for number in range(times(3, 30)):
        problem = shapes.problem(number).problem
        robot, motion = problem.robot, planned(problem)
        found = flown(robot, motion, scene_of(problem), 1)
        closest = nearest(with_bodies(robot), motion, problem.obstacles)
        assert found.passed, number
        assert found.distance == pytest.approx(closest.distance, abs=EXACT), closest.words
        assert found.engine.startswith("Drake 1.")


def test_in_parts_it_is_the_same_among_obstacles_that_move(tumbling):
    problem, motion = tumbling
    whole, in_parts = (flown(problem.robot, motion, scene_of(problem), n) for n in (1, 4))
    assert (in_parts.pair, in_parts.time) == (whole.pair, whole.time)
    assert in_parts.distance == pytest.approx(whole.distance, abs=EXACT)
    assert in_parts.passed


def test_what_is_in_the_way_touches_but_for_pairs_that_may(tumbling):
    problem, motion = tumbling
    robot, row = with_bodies(problem.robot), len(motion.time) // 2
    there = Obstacle.sphere("there", motion.ee_positions[row], 0.01)
    found = flown(robot, motion, Scene([there]), 1)
    assert found.distance < 0.0
    assert not found.passed
    assert found.pair.endswith("/there")
    allowed = [
        name
        for link in {one.link for one in robot.bodies}
        for name in (f"{link}/there", f"there/{link}")[: 1 + len(link) % 2]
    ]
    rest = flown(robot, motion, Scene([there], allowed), 1)
    assert rest.passed
    assert "there" not in rest.pair
    # No pair at all: the arm of lines meets no obstacle.
    lines = load_scenario(LEMUR_SCENARIO)
    alone = flown(lines.robot, planned(lines), Scene(), 1)
    assert (alone.pair, alone.distance) == ("", math.inf)


def test_how_far_off_the_plan_it_is_has_the_chasers_attitude(tumbling):
    """A plan that says another attitude of the chaser than the torques make."""
    problem, motion = tumbling
    turned, angle = motion.chaser_quaternions_xyzw.copy(), 0.01
    turned[-1] = (Rotation.from_quat(turned[-1]) * Rotation.from_rotvec([angle, 0, 0])).as_quat()
    other = replace(motion, chaser_quaternions_xyzw=turned)
    off = flown(problem.robot, other, scene_of(problem), 1).deviation
    assert off.max_chaser_orientation_error == pytest.approx(angle, abs=1e-4)
    assert off.max_chaser_position_error < EXACT


@pytest.mark.nightly
def test_a_motion_that_diverges_with_few_samples_of_its_torques_comes_true_with_more():
    """The last phase of a capture, with the body as a payload."""
    task = captured.problem("whole capture", 0).task(load_parameters().planner)
    *_, (last, plan) = phase_tasks(task, perform(task))
    problem = last.problem
    assert flown(problem.robot, plan.trajectory, scene_of(problem), 1).passed


def test_a_robot_that_drake_refuses_is_told_in_words(tumbling, monkeypatch):
    from ff_planner_benchmark import beside_mujoco

    def refuse(*_):
        raise RuntimeError("no such joint")

    monkeypatch.setattr(beside_mujoco, "flown_in_drake", refuse)
    problem, motion = tumbling
    with pytest.raises(FfPlannerError, match="Drake cannot execute the plan: no such joint"):
        flown(problem.robot, motion, Scene(), 1)
