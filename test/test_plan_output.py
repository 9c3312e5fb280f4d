"""What the node remembers and streams of the last plan, without a node."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from changed_parameters import replaced
from drawn_plans import DURATION, drawn_plan
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.lifecycle import LifecycleNode
from robots import random_state

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.planning.motion.plan import Plan, WheelMotion
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs import execution
from ff_planner_ros.ros.outputs.controller import Ended
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.plan_output import PlanOutput, PublishedPlan

START = 1_000 * NANOSECONDS
LAST = START + round(DURATION * NANOSECONDS)


class Output:
    """An output whose publishers keep what is published, by topic, and whose clock is set."""

    def __init__(self, robot: Robot, parameters: NodeParameters | None = None) -> None:
        self.now_ns, self.heard = START, dict[str, list[Any]]()
        node = Mock(spec=LifecycleNode)
        node.get_clock.return_value.now = lambda: SimpleNamespace(
            nanoseconds=self.now_ns, to_msg=lambda: time_message(self.now_ns)
        )

        def publisher(_: Any, topic: str, __: Any, **___: Any) -> Any:
            kept = self.heard.setdefault(topic, [])
            return SimpleNamespace(publish=kept.append)

        node.create_lifecycle_publisher.side_effect = publisher
        parameters = replace(parameters or load_parameters(), inertial_frame="inertial")
        self.robot, self.output = robot, PlanOutput(node, robot, parameters)

    def publish(
        self,
        plan: Plan,
        plan_id: str,
        start_ns: int = START,
        body: TargetBody | None = None,
        previous_plan_id: str = "",
    ) -> None:
        scene, frame = Scene(target_body=body), "inertial"
        made = MadePlan(
            *(plan_id, plan, start_ns, "none", self.robot, scene, frame, previous_plan_id)
        )
        self.output.publish(made, made.written(), "me")


@pytest.fixture
def output(lemur: Robot) -> Output:
    return Output(lemur)


@pytest.fixture
def plan(lemur: Robot) -> Plan:
    return drawn_plan(lemur, seed=4)


def running(output: Output) -> PublishedPlan:
    assert output.output.published is not None
    return output.output.published


@pytest.mark.parametrize("takes", [True, False])
def test_torques_go_to_a_controller_that_takes_them(lemur: Robot, plan: Plan, takes: bool) -> None:
    output = Output(lemur, replaced(load_parameters(), "controller.effort_interface", takes))
    output.publish(plan, "run.1")
    (told,) = output.heard["joint_trajectory"]
    wanted = plan.trajectory.joint_torques.tolist() if takes else [[]] * len(told.points)
    assert [point.effort.tolist() for point in told.points] == wanted
    positions = [point.positions.tolist() for point in told.points]
    assert positions == plan.trajectory.joint_positions.tolist()


@pytest.mark.parametrize(
    ("time_ns", "runs"), [(START - 1, False), (START, True), (LAST, True), (LAST + 1, False)]
)
def test_a_plan_runs_from_its_first_to_its_last_point(
    output: Output, plan: Plan, time_ns: int, runs: bool
) -> None:
    output.publish(plan, "run.1")
    found = running(output).at(time_ns)
    assert found is (running(output) if runs else None)


def test_its_goal_is_where_its_tail_begins(output: Output, plan: Plan) -> None:
    output.publish(plan, "run.1")
    assert running(output).seconds_to_goal == DURATION
    output.publish(replace(plan, duration=7.0), "run.2")
    assert running(output).seconds_to_goal == 7.0


@pytest.mark.parametrize("since", [-3.0, 0.0, 4.0])
def test_its_joints_move_by_the_clock_of_who_asks(output: Output, plan: Plan, since: float) -> None:
    output.publish(plan, "run.1")
    motion = running(output).motion(START + round(since * NANOSECONDS))
    np.testing.assert_allclose(motion.time, plan.trajectory.time - since, atol=1e-9)
    np.testing.assert_array_equal(motion.positions, plan.trajectory.joint_positions)


def test_a_plan_that_takes_over_remembers_the_one_before_until_then_and_no_other(
    output: Output, plan: Plan
) -> None:
    output.publish(plan, "run.1")
    output.publish(plan, "run.2", START + NANOSECONDS, previous_plan_id="run.1")
    last = running(output)
    assert last.before is not None
    for time_ns, plan_id in ((START, "run.1"), (START + NANOSECONDS, "run.2")):
        found = last.at(time_ns)
        assert found is not None
        assert found.plan_id == plan_id
    output.now_ns = START + NANOSECONDS
    output.publish(plan, "run.3", START + 2 * NANOSECONDS, previous_plan_id="run.2")
    third = running(output)
    assert third.before is not None
    assert third.before.plan_id == "run.2"
    assert third.before.before is None, "a flight of an hour would keep thousands of plans"
    output.publish(plan, "run.4", START + 3 * NANOSECONDS, previous_plan_id="run.1")
    assert running(output).before is None, "run.3 is not what the joints follow"
    output.publish(plan, "run.5", START + 4 * NANOSECONDS)
    assert running(output).before is None


def test_plans_that_are_published_for_later_remember_all_that_are_followed_until_then(
    output: Output, plan: Plan
) -> None:
    output.publish(plan, "run.1")
    for number in (2, 3):
        start_ns = START + number * NANOSECONDS
        output.publish(plan, f"run.{number}", start_ns, previous_plan_id=f"run.{number - 1}")
    # Published for an earlier start, it takes the place of the two that have not begun.
    for plan_id, before, told in (
        ("run.3", "run.2", ["run.1", "run.2", "run.3"]),
        ("run.4", "run.1", ["run.1", "run.4", "run.4"]),
    ):
        if plan_id == "run.4":
            start_ns = START + NANOSECONDS + 1
            output.publish(plan, plan_id, start_ns, previous_plan_id=before)
        last = running(output)
        found = [last.at(START + number * NANOSECONDS) for number in (1, 2, 3)]
        assert [one.plan_id if one is not None else "" for one in found] == told


_REPLACED = Ended("another goal", error_code=-1, is_replaced=True)
_FAILED = Ended("path tolerance", error_code=-4)


@pytest.mark.parametrize("follows", ["run.1", ""])
@pytest.mark.parametrize(
    ("said", "left"),
    [
        ([("run.2", Ended("refused"))], ["run.1"]),
        ([("run.1", _FAILED)], ["run.2"]),
        ([("run.1", _FAILED), ("run.2", Ended("refused"))], []),
        # A controller that accepts the second drops the first, before the second starts.
        ([("run.2", None), ("run.1", _REPLACED)], ["run.1", "run.2"]),
        ([("run.2", None), ("run.1", _REPLACED), ("run.2", _FAILED)], []),
        ([("run.2", None), ("run.2", _FAILED), ("run.1", _REPLACED)], []),
        # The node is deactivated before the second is sent.
        ([("", None)], ["run.1"]),
    ],
)
def test_of_two_plans_the_controller_says_which_is_active(
    lemur: Robot,
    plan: Plan,
    monkeypatch: pytest.MonkeyPatch,
    follows: str,
    said: list[tuple[str, Ended | None]],
    left: list[str],
) -> None:
    monkeypatch.setattr(execution, "ControllerClient", Mock())
    output = Output(lemur, replaced(load_parameters(), "controller.hand_over", "action"))
    controller: Any = output.output.execution.controller
    start_ns = START + 5 * NANOSECONDS
    output.publish(plan, "run.1")
    output.output.execution.look()
    controller.send.call_args.args[1]()  # it is accepted, and starts
    output.output.execution.look()
    output.publish(plan, "run.2", start_ns, previous_plan_id=follows)
    if said[0][0]:
        output.now_ns = start_ns - NANOSECONDS // 100
        output.output.execution.look()
        answers = {
            f"run.{one}": call.args for one, call in enumerate(controller.send.call_args_list, 1)
        }
        for plan_id, ended in said:
            _, accept, end = answers[plan_id]
            end(ended) if ended else accept()
    else:
        output.output.execution.withdraw("not active")
    last = output.output.published
    assert (None if last is None else last.plan_id) == (left[-1] if left else None)
    assert output.output.is_streamed == bool(left)
    runs = [one for one in left if one == "run.1" and (follows or left[-1] == one)]
    running = None if last is None else last.at(output.now_ns)
    assert ([] if running is None else [running.plan_id]) == runs
    output.output.stream(None)
    assert len(output.heard["predicted_chaser_pose"]) == len(runs), "what runs is predicted"


def test_a_plan_for_later_follows_what_still_runs_when_the_one_between_is_aborted(
    output: Output, plan: Plan
) -> None:
    output.publish(plan, "run.1")
    for number in (2, 3):
        start_ns = START + number * NANOSECONDS
        output.publish(plan, f"run.{number}", start_ns, previous_plan_id=f"run.{number - 1}")
    output.output.execution._aborted("run.2")
    found = [running(output).at(START + number * NANOSECONDS) for number in (1, 2, 3)]
    assert [one.plan_id if one is not None else "" for one in found] == ["run.1", "run.1", "run.3"]


def test_who_hears_a_plan_hears_whose_it_is_and_when_it_begins(output: Output, plan: Plan) -> None:
    output.now_ns = START - NANOSECONDS
    output.publish(plan, "run.1")
    (told,) = output.heard["published_plan"]
    assert (told.plan_id, told.requester, told.end_behaviour) == ("run.1", "me", "none")
    assert nanoseconds(told.start_time) == START
    assert nanoseconds(told.header.stamp) == START - NANOSECONDS
    assert [told.joint_trajectory] == output.heard["joint_trajectory"]
    path: Path = output.heard["predicted_chaser_path"][0]
    stamps = [nanoseconds(pose.header.stamp) - START for pose in path.poses]
    np.testing.assert_allclose(np.array(stamps) / 1e9, plan.trajectory.time, atol=1e-9)
    assert output.heard["predicted_target_path"] == []


def test_a_state_is_held_against_where_the_plan_had_the_chaser_when_it_was_measured(
    output: Output, plan: Plan, lemur: Robot
) -> None:
    """However late it is heard of."""
    output.publish(plan, "run.1")
    motion, point = plan.trajectory, 17
    measured_ns = START + round(float(motion.time[point]) * NANOSECONDS)
    off = np.array([-0.02, 0.0, 0.0])
    state = replace(
        random_state(lemur, np.random.default_rng(2)),
        position_chaser_in_inertial=motion.chaser_positions[point] + off,
        quaternion_chaser_to_inertial_xyzw=motion.chaser_quaternions_xyzw[point],
    )
    output.now_ns = measured_ns + NANOSECONDS
    output.output.stream(Snapshot(state, measured_ns, "chaser_state"))
    (told,) = output.heard["tracking_error"]
    assert (told.plan_id, nanoseconds(told.header.stamp)) == ("run.1", measured_ns)
    assert told.position == pytest.approx(0.02, abs=1e-6)
    assert told.angle == pytest.approx(0.0, abs=1e-6)
    assert output.output.tracking
    (pose,) = output.heard["predicted_chaser_pose"]
    assert nanoseconds(pose.header.stamp) == output.now_ns
    output.output.stream(Snapshot(state, START - 1, "chaser_state"))
    assert not output.output.tracking, "the plan did not run then"
    output.output.stream(None)
    assert len(output.heard["tracking_error"]) == 1
    # A plan that has come to its end runs no second time, either.
    output.now_ns = running(output).end_ns + NANOSECONDS
    output.output.execution.look()
    output.now_ns = measured_ns + NANOSECONDS
    output.output.forget("the clock jumped")
    output.output.stream(Snapshot(state, measured_ns, "chaser_state"))
    assert len(output.heard["predicted_chaser_pose"]) == 3
    assert len(output.heard["tracking_error"]) == 1


def test_of_a_capture_the_way_of_the_body_and_the_way_to_the_grasp_are_told(lemur: Robot) -> None:
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    output, plan = Output(lemur), drawn_plan(lemur, seed=4)
    output.publish(plan, "run.1", body=body)
    assert len(output.heard["predicted_target_path"]) == 1
    output.now_ns = START + round(float(plan.trajectory.time[9]) * NANOSECONDS)
    output.output.stream(None)
    (pose,) = output.heard["predicted_relative_pose"]
    assert isinstance(pose, PoseStamped)
    there = body.after(float(plan.trajectory.time[9])).grasp(np.zeros(1))
    way = there.rotations[0].T @ (plan.trajectory.ee_positions[9] - there.positions[0])
    told = pose.pose.position
    np.testing.assert_allclose([told.x, told.y, told.z], way, atol=1e-7)


def test_what_the_wheels_should_hold_and_give_now_is_told_while_a_plan_runs(lemur: Robot) -> None:
    output, plan = Output(lemur), drawn_plan(lemur, seed=4)
    time = plan.trajectory.time
    # A momentum that is a cubic of the time is met between the points, too.
    momenta, torques = time[:, None] ** 3 * [1.0, -2.0], 3.0 * time[:, None] ** 2 * [1.0, -2.0]
    output.publish(plan, "run.1")
    output.output.stream(None)
    assert (
        "predicted_wheel_momentum" not in output.heard
        or not output.heard["predicted_wheel_momentum"]
    )
    output.publish(replace(plan, wheels=WheelMotion(momenta, torques)), "run.2")
    seconds = float(time[9] + time[10]) / 2.0
    output.now_ns = START + round(seconds * NANOSECONDS)
    output.output.stream(None)
    (told,) = output.heard["predicted_wheel_momentum"]
    assert nanoseconds(told.header.stamp) == output.now_ns
    assert told.header.frame_id == "chaser"
    np.testing.assert_allclose(told.momenta, seconds**3 * np.array([1.0, -2.0]), rtol=1e-9)
    np.testing.assert_allclose(told.torques, 3.0 * seconds**2 * np.array([1.0, -2.0]), rtol=1e-9)
    output.now_ns = START - 1
    output.output.stream(None)
    assert len(output.heard["predicted_wheel_momentum"]) == 1
