"""The command `ask`: one request to a running node, and its answer."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import rclpy
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.srv import PlanTrajectory as PlanTrajectoryService
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.analysis.plan_json import received_dictionary, refusal_dictionary
from ff_planner_ros.analysis.summary import plan_rows
from ff_planner_ros.arrays import finite_number
from ff_planner_ros.bag.decoding import NANOSECONDS, nanoseconds
from ff_planner_ros.commands import SOLVED
from ff_planner_ros.commands.printed import print_table
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.ros.background import ask, spin_in_background
from ff_planner_ros.ros.joining import joining_ros
from ff_planner_ros.ros.messages.from_messages import plan_from_response
from ff_planner_ros.ros.messages.request_values import (
    REQUEST_KEYS,
    request_value,
    set_in_request,
    split_setting,
    yaml_or_text,
)
from ff_planner_ros.ros.messages.to_messages import (
    obstacles_message,
    request_message,
    same_fields,
    state_message,
    target_body_message,
)

_ACTION = "plan_trajectory_action"
_REQUESTER = "ff-planner ask"
_INTERVAL = 0.2  # [s] between looks at the clock while waiting
_INTERRUPTED = 130  # exit code


def ask_node(options: argparse.Namespace) -> int:
    """Ask a running node for a plan, and print its answer as `plan` does."""
    request = _request(options)
    patience = finite_number("--timeout", options.timeout, above=0.0)
    try:
        answer = _answer(request, patience, options.rest)
    except KeyboardInterrupt:  # the node has been told that the plan is not needed any more
        return _INTERRUPTED
    status, solve_time = Status(answer.status.code), answer.solver.solve_time
    if status is not Status.SOLVED:
        kind = (
            NoPlanFound
            if Status.GOAL_OUT_OF_REACH <= status < Status.INTERNAL_ERROR
            else FfPlannerError
        )
        error = kind(status, answer.status.message)
        _write(options, refusal_dictionary(error, solve_time, answer.task_digest or None))
        raise error
    plan = plan_from_response(answer)
    start = nanoseconds(answer.joint_trajectory.header.stamp) / NANOSECONDS
    digest = answer.task_digest
    _write(options, received_dictionary(plan, answer.plan_id, digest, start, solve_time))
    chosen = request.duration_max > 0.0
    print_table(
        [
            ("plan", f"{answer.plan_id}, {'not published' if request.plan_only else 'published'}"),
            ("starts at", f"{start:.3f} s"),
            *plan_rows(plan, solve_time, digest, chosen, limits=None),
        ]
    )
    return SOLVED


def _request(options: argparse.Namespace) -> PlanTrajectoryService.Request:
    """Return what is asked for: the scenario's problem, or nothing yet, with what was set."""
    request, frame = PlanTrajectoryService.Request(), options.frame
    request.target_pose.header.frame_id = frame
    if options.scenario is not None:
        problem = load_scenario(options.scenario)
        request = request_message(problem, frame)
        names = problem.robot.joint_names
        # Stamps of zero: as if measured when the node reads it.
        if "state" in options.bring:
            request.start_state = state_message(problem.start, names, 0, frame)
        if "obstacles" in options.bring:
            request.obstacles = obstacles_message(problem.obstacles, 0, frame)
        if "target_body" in options.bring and problem.target_body is not None:
            request.use_target_body = True
            request.target_body = target_body_message(problem.target_body, 0, frame)
        request.use_start_state = "state" in options.bring
        request.use_obstacles = "obstacles" in options.bring
    elif options.bring:
        raise InvalidInput(
            Status.UNSUPPORTED, "--bring", options.bring[0], "it goes with a scenario"
        )
    for setting in options.changes or ():
        key, value = split_setting(setting)
        if key not in REQUEST_KEYS:
            allowed = f"allowed are {', '.join(REQUEST_KEYS)}"
            raise InvalidInput(Status.OUT_OF_RANGE, f"--set {key}", "an unknown key", allowed)
        given = request_value(key, yaml_or_text(key, value), in_range=True)
        set_in_request(request, key, given)
    request.plan_only, request.asked_by = options.plan_only, _REQUESTER
    if options.time_budget is not None:
        request.time_budget = finite_number("--time-budget", options.time_budget, above=0.0)
    return request


def _answer(
    request: PlanTrajectoryService.Request, patience: float, ros_arguments: list[str]
) -> PlanTrajectory.Result:
    """Send a request and wait for its answer; whoever stops waiting cancels it.

    Args:
        patience: How long the action may take to appear [s].

    Raises:
        FfPlannerError: The node does not take the request up, or ends.
        InvalidInput: No node offers the action.
        KeyboardInterrupt: The user does not want the plan any more.
    """
    goal = same_fields(request, PlanTrajectory.Goal)
    with _client(ros_arguments) as (client, executor):
        deadline = time.monotonic() + patience
        while not client.wait_for_server(timeout_sec=_INTERVAL):
            if time.monotonic() > deadline:
                domain = os.environ.get("ROS_DOMAIN_ID", "0")
                allowed = (
                    f"no node offers it within {patience:g} s: does one run, active, in ROS domain "
                    f"{domain} and this namespace?"
                )
                raise InvalidInput(Status.NOT_ACTIVE, "action", _ACTION, allowed)

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
            if not handle.accepted:
                raise FfPlannerError(Status.BUSY, "the node did not take the request up")
            result: PlanTrajectory.Result = waited(ask(executor, handle.get_result_async)).result
        except KeyboardInterrupt:
            handle = waited(sent)
            if handle.accepted:
                waited(ask(executor, handle.cancel_goal_async))
            raise
    return result


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
    client = ActionClient(node, PlanTrajectory, _ACTION)
    try:
        yield client, executor
    finally:
        stop()
        client.destroy()
        rclpy.shutdown()


def _write(options: argparse.Namespace, answer: dict[str, Any]) -> None:
    if options.json is not None:
        options.json.write_text(json.dumps(answer) + "\n", encoding="utf-8")
