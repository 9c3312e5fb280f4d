"""The command `ask`: one request to a running node, and its answer."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from ff_planner_ros.analysis.plan_json import received_dictionary, refusal_dictionary
from ff_planner_ros.analysis.summary import plan_rows
from ff_planner_ros.commands import SOLVED
from ff_planner_ros.commands.printed import print_table
from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status

if TYPE_CHECKING:
    from ff_planner_msgs.msg import PlanRequest

_REQUESTER = "ff-planner ask"
_INTERRUPTED = 130  # exit code


def ask_node(options: argparse.Namespace) -> int:
    """Ask a running node for a plan, and print its answer as `plan` does."""
    from ff_planner_ros.ros.client import answer_of_node
    from ff_planner_ros.ros.messages.from_messages import plan_from_answer

    request = _request(options)
    patience = finite_number("--timeout", options.timeout, above=0.0)
    try:
        answer = answer_of_node(request, patience, options.rest)
    except KeyboardInterrupt:
        return _INTERRUPTED
    status, solve_time = Status(answer.status.code), answer.solver.solve_time
    if status is not Status.SOLVED:
        none_found = Status.GOAL_OUT_OF_REACH <= status < Status.INTERNAL_ERROR
        error = (NoPlanFound if none_found else FfPlannerError)(status, answer.status.message)
        _write(options, refusal_dictionary(error, solve_time, answer.task_digest or None))
        raise error
    plan, digest = plan_from_answer(answer), answer.task_digest
    start = nanoseconds(answer.plans[0].joint_trajectory.header.stamp) / NANOSECONDS
    token = answer.publish_token
    _write(options, received_dictionary(plan, answer.plan_id, token, digest, start, solve_time))
    chosen = request.duration_max > 0.0
    print_table(
        [
            ("plan", f"{answer.plan_id}, {'not published' if request.plan_only else 'published'}"),
            *((("publish token", token),) if token else ()),
            ("starts at", f"{start:.3f} s"),
            *plan_rows(plan, solve_time, digest, chosen, limits=None),
        ]
    )
    return SOLVED


def _request(options: argparse.Namespace) -> PlanRequest:
    """Return what is asked for: the scenario's goal, or nothing yet, with what was set."""
    from ff_planner_ros.ros.client import change_request, request_of_nothing, request_of_scenario

    if options.scenario is not None:
        request = request_of_scenario(options.scenario, options.frame, options.bring)
    elif options.bring:
        allowed = "it goes with a scenario"
        raise InvalidInput(Status.UNSUPPORTED, "--bring", options.bring[0], allowed)
    else:
        request = request_of_nothing(options.frame)
    change_request(request, options.changes)
    request.plan_only, request.requester = options.plan_only, _REQUESTER
    if options.time_budget is not None:
        request.search.time_budget = finite_number("--time-budget", options.time_budget, above=0.0)
    return request


def _write(options: argparse.Namespace, answer: dict[str, Any]) -> None:
    if options.json is not None:
        options.json.write_text(json.dumps(answer) + "\n", encoding="utf-8")
