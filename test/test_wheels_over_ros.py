"""Wheels in messages: what a state tells, what an answer tells, and a bag that is replayed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState
from recorded_requests import motions_in, only_request
from robots import CONFIG, LEMUR_SCENARIO

from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.values import default_values, parameters_of
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.model import Base
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.to_messages import plan_message, state_message
from ff_planner_ros.runs.differences import differences
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
SCENARIO = CONFIG / "scenarios/lemur_wheels.yaml"


@pytest.fixture(scope="module")
def solved() -> tuple[PlanningTask, Plan]:
    """A plan that its wheels hold back."""
    task = load_task(SCENARIO, Defaults(SETTINGS))
    return task, perform(task)


def test_a_state_tells_what_its_wheels_hold(solved: tuple[PlanningTask, Plan]) -> None:
    problem = solved[0].problem
    message = state_message(problem.start, problem.robot.joint_names, 1, "inertial")
    assert message.wheel_momenta.tolist() == [0.2, -0.5, 0.0]
    read = state_from_message(message, "chaser_state", problem.robot, "inertial")
    assert read.wheel_momenta is not None
    assert read.wheel_momenta.tolist() == [0.2, -0.5, 0.0]
    message.wheel_momenta = []
    read = state_from_message(message, "chaser_state", problem.robot, "inertial")
    assert read.wheel_momenta is None  # zero, to the planner
    message.wheel_momenta = [0.2]
    with pytest.raises(InvalidInput, match=r"chaser_state\.wheel_momenta .*3 entries"):
        state_from_message(message, "chaser_state", problem.robot, "inertial")


def test_an_answer_tells_what_the_wheels_hold_and_give(solved: tuple[PlanningTask, Plan]) -> None:
    task, plan = solved
    assert plan.wheels is not None
    answer = answer_of(plan, "plan_1", 0.1, None, 1, "inertial")
    read = plan_from_answer(answer).wheels
    assert read is not None
    np.testing.assert_array_equal(read.momenta, plan.wheels.momenta)
    np.testing.assert_array_equal(read.torques, plan.wheels.torques)
    assert not differences(answer, task, plan)
    other = replace(plan, wheels=replace(plan.wheels, momenta=plan.wheels.momenta + 1e-3))
    (found,) = differences(answer, task, other)
    assert found.quantity == "wheel_momenta"
    assert "wheel" in found.where
    free = perform(load_task(LEMUR_SCENARIO, Defaults(SETTINGS)))
    assert not plan_message(free, 1, "inertial").wheels


def test_a_recorded_plan_is_replayed_to_the_last_bit_exported_and_verified(
    solved: tuple[PlanningTask, Plan], tmp_path: Path
) -> None:
    task, plan = solved
    record_answer(tmp_path / "bag", task, plan, 0.1)
    assert replay(only_request(tmp_path / "bag")).verdict is Verdict.IDENTICAL
    (recorded,) = read_plans(tmp_path / "bag")
    columns = recorded.columns()
    assert plan.wheels is not None
    np.testing.assert_array_equal(columns["wheel_2_momentum_Nms"], plan.wheels.momenta[:, 1])
    np.testing.assert_array_equal(columns["wheel_3_torque_Nm"], plan.wheels.torques[:, 2])
    ((_, _, robot, motion, *_),) = motions_in(tmp_path / "bag")
    assert robot.base is Base.ATTITUDE_HELD
    assert robot.wheels is not None
    assert robot.wheels.momentum == (4.0, 4.0, 4.0)
    assert verify(robot, motion).passed


def test_parameters_say_which_wheels_a_node_plans_with() -> None:
    values = dict(default_values()) | {"robot.base": "attitude_held"}
    values |= {"robot.wheels.axes": [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0]}
    values |= {"robot.wheels.momentum": [5.0], "robot.wheels.torque": [0.1, 0.2, 0.3]}
    text = (CONFIG / "robots/lemur/lemur.urdf").read_text()
    robot = parameters_of(values).robot.load(text)
    assert robot.wheels is not None
    assert robot.wheels.axes.tolist() == [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    assert robot.wheels.momentum == (5.0, 5.0, 5.0)
    assert robot.wheels.torque == (0.1, 0.2, 0.3)
    for name, wrong in (("axes", [1.0, 0.0]), ("torque", [1.0, 2.0])):
        with pytest.raises(InvalidInput, match=rf"robot\.wheels\.{name}") as refused:
            parameters_of(values | {f"robot.wheels.{name}": wrong})
        assert refused.value.status is Status.WRONG_SIZE
    free = parameters_of(values | {"robot.base": "free_flyer"}).robot.load(text)
    assert free.wheels is None


def test_momenta_of_a_robot_without_wheels_are_refused() -> None:
    problem = load_scenario(LEMUR_SCENARIO)
    message: ChaserState = state_message(problem.start, problem.robot.joint_names, 1, "inertial")
    assert not message.wheel_momenta
    message.wheel_momenta = [0.1]
    with pytest.raises(InvalidInput, match="it must be empty: there are no wheels"):
        state_from_message(message, "chaser_state", problem.robot, "inertial")


@pytest.mark.ci
def test_a_weight_on_the_wheels_is_recorded_and_replayed(
    solved: tuple[PlanningTask, Plan], tmp_path: Path
) -> None:
    problem = replace(solved[0].problem, objective=Objective(1.0, 0.0, wheel_momentum=5.0))
    task = PlanningTask(problem, SETTINGS)
    plan = perform(task)
    assert max(plan.metrics.peak_wheel_momenta) < 0.8 * max(solved[1].metrics.peak_wheel_momenta)
    write_scenario(task, tmp_path / "weighted.yaml")
    assert load_task(tmp_path / "weighted.yaml", Defaults(SETTINGS)).digest == task.digest
    record_answer(tmp_path / "bag", task, plan, 0.1)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().problem.objective.wheel_momentum == 5.0
    assert replay(recorded).verdict is Verdict.IDENTICAL
