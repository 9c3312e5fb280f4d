"""How far apart a scenario is before it is planned, as `ff-planner check` tells and pages draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance
from robots import CONFIG

from ff_planner_ros.analysis.drawing.before_plan import figure_before_plan
from ff_planner_ros.analysis.scene_distances import gaps_at_goal, gaps_at_start
from ff_planner_ros.cli import main
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.configuration import configuration

SCENARIOS = CONFIG / "scenarios"


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    return load_scenario(SCENARIOS / "panel_capture.yaml")


def test_the_distances_at_the_start_are_those_of_coal(problem: PlanningProblem) -> None:
    robot, gaps = problem.robot, gaps_at_start(problem)
    q, _ = configuration(robot, problem.start)
    places = dict(zip([one.name for one in robot.bodies], body_placements(robot, q), strict=True))
    solids = {one.name: one.solid for one in robot.bodies}
    for one in (one for one in problem.obstacles if not one.is_sphere):
        rotation, position = (each[0] for each in one.motion.poses(np.zeros(1)))
        there, solid = pin.SE3(rotation, position), one.solid.geometry
        truth = {
            name: coal_distance(solids[name], place, solid, there) for name, place in places.items()
        }
        (gap,) = [gap for gap in gaps if gap.other == one.id]
        assert gap.distance == pytest.approx(min(truth.values()), abs=1e-6)
        assert gap.body == min(truth, key=truth.__getitem__)
        assert np.linalg.norm(gap.ends[0] - gap.ends[1]) == pytest.approx(gap.distance, abs=1e-5)
    assert [gap.distance for gap in gaps] == sorted(gap.distance for gap in gaps)
    # Beside the obstacles there is one of two bodies of the robot, the nearest.
    (own,) = [gap for gap in gaps if gap.other in places]
    pairs = [tuple(robot.bodies[k].name for k in pair) for pair in robot.pairs]
    truth = [coal_distance(solids[a], places[a], solids[b], places[b]) for a, b in pairs]
    assert own.distance == pytest.approx(min(truth), abs=1e-6)


def test_the_tool_at_the_goal_touches_what_it_grasps_and_what_it_may(
    problem: PlanningProblem,
) -> None:
    gaps = gaps_at_goal(problem)
    assert gaps is not None
    nearest, second, *_ = gaps
    assert (nearest.body, nearest.other, nearest.allowed) == ("link_7", "ring_0", True)
    assert nearest.distance < 0.0 < second.distance
    assert not second.allowed
    still = np.zeros(3)
    turned = replace(
        problem.target,
        orientation=Orientation.FREE,
        angular_velocity=still,
        angular_acceleration=still,
    )
    assert gaps_at_goal(replace(problem, target=turned, target_body=None)) is None


def test_the_page_shows_robot_obstacles_goal_and_how_they_move(problem: PlanningProblem) -> None:
    start, goal = gaps_at_start(problem), gaps_at_goal(problem)
    figure = figure_before_plan(problem, start, goal or ())
    names = [trace.name for trace in figure.data]
    assert names.count("obstacles") == len(problem.obstacles)
    assert {"robot at the start", "arm at the start", "tool at the goal", "goal"} <= set(names)
    assert f"link_7/ring_0, {1e3 * goal[0].distance:.1f} mm at the goal" in names
    last = figure.frames[-1]
    assert float(last.name) == problem.duration
    (ring,) = [one for one in problem.obstacles if one.id == "ring_0"]
    number = problem.obstacles.index(ring)
    drawn = np.array([last.data[number][axis] for axis in "xyz"]).mean(axis=1)
    place = ring.motion.poses(np.array([problem.duration]))[1][0]
    np.testing.assert_allclose(drawn, place, atol=1e-3)
    (tool,) = [trace for trace in figure.data if trace.name == "tool at the goal"]
    middle = np.array([tool[axis] for axis in "xyz"]).mean(axis=1)
    assert np.linalg.norm(middle - problem.target.position) == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("panel_capture", "link_7/ring_0         -0.0250  may touch near the goal"),
        ("lemur_capture", "At the goal: not known, the tool has no shape"),
        ("planar_capture", "Of the tool at the goal, after 12 s\nnearest"),
    ],
)
def test_a_check_prints_the_distances(
    name: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(SCENARIOS / f"{name}.yaml")]) == 0
    printed = capsys.readouterr().out
    assert "At the start\nnearest" in printed
    assert told in printed
