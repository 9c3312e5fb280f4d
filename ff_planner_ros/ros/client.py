"""A client of a running node: one request, and its answer."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import captured_bodies
from ff_planner_ros.ros.background import ask, spin_in_background
from ff_planner_ros.ros.joining import joining_ros
from ff_planner_ros.ros.messages.interfaces import ACTION
from ff_planner_ros.ros.messages.phases import not_in_requests, phase_message
from ff_planner_ros.ros.messages.request_values import (
    REQUEST_KEYS,
    request_value,
    set_in_request,
    split_setting,
    yaml_or_text,
)
from ff_planner_ros.ros.messages.to_messages import (
    payload_message,
    request_message,
    scene_message,
    state_message,
    target_body_message,
)

_INTERVAL = 0.2  # [s] between looks at the clock while waiting


def request_of_scenario(scenario: Path, frame: str, bring: Collection[str]) -> PlanRequest:
    """Return the request for a scenario's goal and phases.

    Args:
        frame: Name of the node's inertial frame.
        bring: Inputs that the request carries from the scenario, instead of those that the node
            has received: any of `state`, `obstacles`, `target_body`.

    Raises:
        InvalidInput: The scenario is invalid, or a goal in it has what no request holds.
    """
    task = load_task(scenario, Defaults(load_parameters().planner))
    problem, names = task.problem, task.problem.robot.joint_names
    request = request_of_task(task, frame)
    # Stamps of zero: as if measured when the node reads it.
    if "state" in bring:
        request.start_state = [state_message(problem.start, names, 0, frame)]
    if "obstacles" in bring:
        request.scene = [scene_message(problem.obstacles, 0, frame)]
    body = next((one for one in captured_bodies(task) if one is not None), None)
    if "target_body" in bring and body is not None:
        request.target_body = [target_body_message(body, 0, frame)]
    return request


def request_of_task(task: PlanningTask, frame: str) -> PlanRequest:
    """Return the request for a task's goal and phases; state and scene are left to the node.

    Raises:
        InvalidInput: A goal has what no request holds.
    """
    for field in not_in_requests(task):
        allowed = "a request to a node cannot ask for it: leave it out"
        raise InvalidInput(Status.UNSUPPORTED, field, "given", allowed)
    robot = task.problem.robot
    request = request_message(task.problem, frame)
    request.then = [phase_message(one, robot.joint_names, frame) for one in task.then]
    if robot.payload is not None:
        request.payload = [payload_message(robot.payload)]
    return request


def request_of_nothing(frame: str) -> PlanRequest:
    """Return a request in which only the frame of the goal is set."""
    request = PlanRequest()
    request.goal.pose.header.frame_id = frame
    return request


def change_request(request: PlanRequest, settings: Sequence[str]) -> None:
    """Set fields of a request by `key=value`, with the keys of a scenario.

    Raises:
        InvalidInput: A key is unknown, or a value is not allowed.
    """
    for setting in settings:
        key, value = split_setting(setting, REQUEST_KEYS)
        given = request_value(key, yaml_or_text(key, value))
        set_in_request(request, key, given)


def answer_of_node(request: PlanRequest, patience: float, ros_arguments: list[str]) -> PlanAnswer:
    """Send a request to a running node and wait for its answer; Ctrl-C cancels it.

    Args:
        patience: How long the action may take to appear [s].

    Raises:
        FfPlannerError: The node ends before it answers.
        InvalidInput: No node offers the action.
    """
    goal = PlanTrajectory.Goal(request=request)
    with _client(ros_arguments) as (client, executor):
        deadline = time.monotonic() + patience
        while not client.wait_for_server(timeout_sec=_INTERVAL):
            if time.monotonic() > deadline:
                domain = os.environ.get("ROS_DOMAIN_ID", "0")
                allowed = (
                    f"no node offers it within {patience:g} s: does one run, active, in ROS domain "
                    f"{domain} and this namespace?"
                )
                raise InvalidInput(Status.NOT_ACTIVE, "action", ACTION, allowed)

        def waited(answer: Future[Any]) -> Any:
            while True:
                try:
                    return answer.result(_INTERVAL)  # so that a signal is handled meanwhile
                except TimeoutError:
                    if not client.server_is_ready():
                        words = "the node ended before it answered"
                        raise FfPlannerError(Status.SHUT_DOWN, words) from None

        sent = ask(executor, lambda: client.send_goal_async(goal))
        try:
            handle = waited(sent)
            result: PlanTrajectory.Result = waited(ask(executor, handle.get_result_async)).result
        except KeyboardInterrupt:
            waited(ask(executor, waited(sent).cancel_goal_async))
            raise
    answer: PlanAnswer = result.answer
    return answer


@contextmanager
def _client(ros_arguments: list[str]) -> Iterator[tuple[ActionClient, SingleThreadedExecutor]]:
    """Yield a client of the action, and what receives its answers."""
    with joining_ros():
        rclpy.init(
            args=[sys.argv[0], *ros_arguments], signal_handler_options=SignalHandlerOptions.NO
        )
        node = rclpy.create_node(f"ff_planner_ask_{os.getpid()}")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stop = spin_in_background(executor, node.get_logger())
    client = ActionClient(node, PlanTrajectory, ACTION)
    try:
        yield client, executor
    finally:
        stop()
        client.destroy()
        rclpy.shutdown()
