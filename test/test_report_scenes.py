"""Among what a plan of a bag is drawn, and what the node had heard of it by then."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np
import pytest
from answers import FRAME, answer_of
from rclpy.serialization import serialize_message

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem, Sphere
from ff_planner_ros.report import from_bag
from ff_planner_ros.report.plan_words import obstacle_table
from ff_planner_ros.ros.messages.to_messages import (
    obstacles_message,
    request_message,
    scene_message,
    target_body_message,
    time_message,
)
from ff_planner_ros.runs.recorded_inputs import Moment, heard

START = 1_000 * NANOSECONDS
VELOCITY = np.array([0.1, -0.2, 0.4])


@pytest.mark.parametrize("later", [2.0, -0.5])
def test_all_is_drawn_where_it_is_at_the_first_point_and_the_goal_at_the_time_chosen(
    monkeypatch: pytest.MonkeyPatch,
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    later: float,
) -> None:
    """Seen so long before, or after; of a range of durations the answer says which it was."""
    capture, seen_ns = tumbling.problem("tumbling", 0), START - round(later * NANOSECONDS)
    body = capture.target_body
    assert body is not None
    request = request_message(capture, FRAME)
    request.duration, request.duration_max = 5.0, 9.0
    request.target_body = [target_body_message(body, seen_ns, FRAME)]
    rock = Sphere("rock", np.array([1.0, -2.0, 3.0]), 0.3, VELOCITY)
    request.scene = [scene_message([rock], seen_ns, FRAME)]
    answer = answer_of(lemur_plan, start_ns=START)
    answer.plans[0].duration = 7.5
    answer.inputs.obstacles_stamp = answer.inputs.target_body_stamp = time_message(seen_ns)
    monkeypatch.setattr(from_bag, "reported_plan", lambda *told: told)
    exchange: Any = SimpleNamespace(request=request, response=answer)
    (drawn,) = from_bag._phases(exchange, lemur_capture.robot, {})
    _, _, (moved, *attached), scene, _ = drawn
    np.testing.assert_allclose(moved.center, rock.center + later * VELOCITY, atol=1e-9)
    assert [one.id for one in attached] == [one.id for one in body.obstacles]
    grasp = body.grasp(np.array([later + 7.5])).positions[0]
    np.testing.assert_allclose(scene.goal.position, grasp, rtol=0.0, atol=1e-8)


def test_a_message_of_the_moment_itself_was_heard(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", flush_interval=0.0) as writer:
        writer.add_topic("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", [])
        for time in (START - 1, START, START + 1):
            cdr = serialize_message(obstacles_message((), time, FRAME))
            writer.write("/obstacles", cdr, time, time)
    with open_bag(tmp_path / "run") as bag:
        (found,) = heard(bag, {"obstacles": "/obstacles"}, [Moment(START, {}, ("obstacles",))])
    assert found["obstacles"][-1].log_time_ns == START


def test_of_many_obstacles_those_are_listed_that_come_nearest_at_any_time(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """One flies past the end effector, and is farther away than all others before and after."""
    motion = lemur_plan.trajectory
    still = [
        Sphere(f"still {k}", motion.ee_positions[0] + [0.0, 0.0, 2.0 + 0.01 * k], 0.1)
        for k in range(24)
    ]
    velocity, past = np.array([0.0, 0.0, 5.0]), motion.ee_positions[25] + [0.5, 0.0, 0.0]
    flying = Sphere("flying", past - motion.time[25] * velocity, 0.1, velocity)
    made = obstacle_table(lemur_capture.robot, [*still, flying], motion)
    text = tostring(made, encoding="unicode")
    assert "flying" in text
    assert "The nearest 20 of 25." in text
