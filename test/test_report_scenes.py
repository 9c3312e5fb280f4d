"""Among what a plan of a bag is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import tostring

import numpy as np
from answers import answer_with, exchange, write_bag

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.objective import DurationRange
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem, with_capture_target
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.report.plan_words import obstacle_table

VELOCITY = np.array([0.1, -0.2, 0.4])


def test_a_plan_is_drawn_among_the_obstacles_of_its_task_and_the_goal_at_the_time_chosen(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    """Of a range of durations the answer says which it was."""
    capture = tumbling.problem("tumbling", 0)
    body, robot = capture.target_body, lemur_capture.robot
    assert body is not None
    rock = Obstacle.sphere("rock", np.array([1.0, -2.0, 3.0]), 0.3, VELOCITY)
    window, start = DurationRange(5.0, 9.0), lemur_capture.start
    problem = replace(capture, robot=robot, start=start, duration=9.0, duration_range=window)
    problem = with_capture_target(body, replace(problem, obstacles=(rock, *problem.obstacles)))
    answer = answer_with(lemur_plan)
    answer.plans[0].duration = 7.5
    text = task_json(PlanningTask(problem, load_parameters().planner))
    bag = write_bag(tmp_path / "run", exchange(answer, task=text))
    (request,) = report_of_bag(bag, 1).requests
    drawn = request.plan
    assert drawn is not None
    assert drawn.obstacles is not None
    assert drawn.goal is not None
    assert {one.id for one in drawn.obstacles} == {one.id for one in problem.obstacles}
    (moved,) = (one for one in drawn.obstacles if one.id == "rock")
    assert moved.is_sphere
    assert (moved.center.tolist(), moved.motion.velocity.tolist()) == (
        [1.0, -2.0, 3.0],
        VELOCITY.tolist(),
    )
    grasp = body.grasp(np.array([7.5])).positions[0]
    np.testing.assert_allclose(drawn.goal.position, grasp, rtol=0.0, atol=1e-8)


def test_of_many_obstacles_those_are_listed_that_come_nearest_at_any_time(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """One flies past the end effector, and is farther away than all others before and after."""
    motion = lemur_plan.trajectory
    still = [
        Obstacle.sphere(f"still {k}", motion.ee_positions[0] + [0.0, 0.0, 2.0 + 0.01 * k], 0.1)
        for k in range(24)
    ]
    velocity, past = np.array([0.0, 0.0, 5.0]), motion.ee_positions[25] + [0.5, 0.0, 0.0]
    flying = Obstacle.sphere("flying", past - motion.time[25] * velocity, 0.1, velocity)
    made = obstacle_table(lemur_capture.robot, [*still, flying], motion)
    text = tostring(made, encoding="unicode")
    assert "flying" in text
    assert "The nearest 20 of 25." in text
