"""The demo of shapes: a client with panels and a ring is grasped, and nothing else is touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import coal_distance
from robots import CONFIG

from ff_planner_ros.analysis.drawing.figures import clearance_figure
from ff_planner_ros.analysis.drawing.plots import clearance_plot
from ff_planner_ros.analysis.extremes import distances
from ff_planner_ros.analysis.methods import SHORTEST
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.report.plan_words import obstacle_table
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
GRASPED = ("link_7", "ring_0")


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    return load_scenario(CONFIG / "scenarios" / "panel_capture.yaml")


@pytest.fixture(scope="module")
def plan(problem: PlanningProblem) -> Plan:
    return perform(PlanningTask(problem, SETTINGS))


def test_the_client_tumbles_at_3_deg_a_second_and_is_grasped_at_its_ring_between_the_panels(
    problem: PlanningProblem,
) -> None:
    body = problem.target_body
    assert body is not None
    rate = np.rad2deg(np.linalg.norm(body.angular_velocity))
    assert rate == pytest.approx(3.0, abs=0.05)
    places = {one.id: one.position for one in body.obstacles if hasattr(one, "position")}
    assert places["panel_right"][1] < body.grasp_position[1] < places["panel_left"][1]
    ring = [name for name in places if name.startswith("ring_")]
    assert len(ring) == 12
    assert (
        min(ring, key=lambda name: np.linalg.norm(places[name] - body.grasp_position)) == "ring_0"
    )
    assert problem.allowed_collisions == ("/".join(GRASPED),)


@pytest.mark.ci
def test_the_plan_passes_the_check_and_comes_true_in_mujoco(
    problem: PlanningProblem, plan: Plan
) -> None:
    assert [one.finding for one in failures(problem, plan, SETTINGS)] == []
    found = verify(problem.robot, plan.trajectory, scene_of(problem))
    assert found.passed
    assert found.pairs > 200
    # The tool does touch what it may, and that alone.
    touched = verify(
        problem.robot, plan.trajectory, replace(scene_of(problem), allowed_collisions=())
    )
    assert {one.pair for one in touched.contacts} == {"/".join(GRASPED)}


def test_what_may_be_touched_at_the_goal_is_drawn_as_no_collision(
    problem: PlanningProblem, plan: Plan
) -> None:
    """Neither in the figure nor in the report's plot; without the permission both would show it."""
    motions = {SHORTEST: plan.trajectory}
    (axes,) = clearance_figure(problem, motions).axes
    (curve,) = (line for line in axes.lines if len(line.get_xdata()) > 100)
    lowest = float(np.min(curve.get_ydata()))
    assert lowest == pytest.approx(1e3 * plan.metrics.min_clearance, abs=0.6)
    assert lowest > 0.0
    (drawn, _) = clearance_plot(problem.robot, problem.obstacles, motions, scene_of(problem)).data
    assert drawn.y.min() == pytest.approx(lowest)
    robot, obstacles = problem.robot, problem.obstacles
    assert distances(robot, obstacles, plan.trajectory).closest.min() < -1e-3
    table = obstacle_table(robot, obstacles, plan.trajectory, scene_of(problem))
    assert "-" not in [word[:1] for word in table.itertext()]


def test_nothing_else_is_touched_says_coal(problem: PlanningProblem, plan: Plan) -> None:
    robot, motion = problem.robot, plan.trajectory
    q, _ = from_trajectory(robot, motion)
    data, least = robot.model.createData(), {}
    bodies = [one for one in problem.obstacles if not one.is_sphere]
    poses = [one.motion.poses(motion.time) for one in bodies]
    for row, configuration in enumerate(q):
        pin.forwardKinematics(robot.model, data, configuration)
        for body in robot.bodies:
            at = data.oMi[body.joint] * body.placement_in_joint
            for one, (rotations, positions) in zip(bodies, poses, strict=True):
                there = pin.SE3(rotations[row], positions[row])
                found = coal_distance(body.solid, at, one.solid.geometry, there)
                pair = body.link, one.id
                least[pair] = min(least.get(pair, np.inf), found)
    assert {pair for pair, distance in least.items() if distance <= 0.0} == {GRASPED}


def test_what_is_grasped_must_be_named(problem: PlanningProblem) -> None:
    with pytest.raises(NoPlanFound, match="name link_7/ring_0 in allowed_collisions"):
        perform(PlanningTask(replace(problem, allowed_collisions=()), SETTINGS))
