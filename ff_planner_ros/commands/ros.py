"""The commands that talk to ROS: ask, demo, node."""

from __future__ import annotations

import os
from argparse import Namespace
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import INTERRUPTED, SOLVED
from ff_planner_ros.commands.options import (
    Add,
    add_output,
    refuse_given,
    require_directory,
    require_file,
)
from ff_planner_ros.commands.printed import print_table, write_json
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status

if TYPE_CHECKING:
    from ff_planner_msgs.msg import PlanRequest

_REQUESTER = "ff-planner ask"


def add_ask(add: Add) -> None:
    """Add `ask`."""
    ask = add(
        "ask",
        ask_node,
        "ask a running node for a plan",
        description="Send one request to a running node and print its answer. The node plans from "
        "the state, obstacles and target body that it has received last.",
        epilog="What follows --ros-args goes to ROS. Exit code: 0 solved, 2 refused, 3 no plan "
        "found, 130 interrupted: the request is cancelled.",
    )
    scenario_help = "the request; without one, --set says all of it"
    ask.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO", help=scenario_help)
    ask.add_argument(
        "--bring",
        action="append",
        choices=("state", "obstacles", "target_body"),
        default=[],
        help="plan from this of the scenario, not from what the node has received; may be given "
        "several times",
    )
    ask.add_argument(
        "--set",
        action="append",
        dest="changes",
        default=[],
        metavar="KEY=VALUE",
        help="ask for this instead, by the key of a scenario; may be given several times "
        "(target.position=[4, 0, 1], duration=20, ...; an unknown key gets the list)",
    )
    plan_only_help = "the plan is not published; the service ~/publish_plan does that, by its id"
    ask.add_argument("--plan-only", action="store_true", help=plan_only_help)
    frame_help = "the node's inertial frame (default: %(default)s)"
    ask.add_argument("--frame", default="inertial", metavar="FRAME", help=frame_help)
    budget_help = "for planning (default: the node's parameter)"
    ask.add_argument("--time-budget", type=float, metavar="SECONDS", help=budget_help)
    timeout_help = "how long to look for the node (default: %(default)g)"
    ask.add_argument("--timeout", type=float, default=10.0, metavar="SECONDS", help=timeout_help)
    add_output(ask, "--json", "FILE", "write the answer", require_file)


# The demonstration that continues after the grasp.
_WHOLE = "whole_capture"
_TESTBED = "lemur"


def ask_node(options: Namespace) -> int:
    """Ask a running node for a plan, and print its answer as `plan` does."""
    from ff_planner_ros.analysis.plan_json import received_dictionary, refusal_dictionary
    from ff_planner_ros.analysis.summary import plan_rows
    from ff_planner_ros.common.arrays import finite_number
    from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
    from ff_planner_ros.messages.plans import plan_from_answer
    from ff_planner_ros.ros.client import PlannerClient
    from ff_planner_ros.ros.process import StopRequest

    request = _request(options)
    patience = finite_number("--timeout", options.timeout, above=0.0)
    # As the node's: also where the signal is SIGTERM, and where a shell that starts `ask` in the
    # background has it ignore SIGINT.
    check = StopRequest().check
    try:
        with closing(PlannerClient(f"ff_planner_ask_{os.getpid()}", options.rest)) as client:
            client.wait_for_planner(patience, check)
            answer = client.plan(request, check=check)
    except KeyboardInterrupt:
        return INTERRUPTED
    status, solve_time = Status(answer.status.code), answer.solver.solve_time
    if status is not Status.SOLVED:
        error = (NoPlanFound if status.is_no_plan else FfPlannerError)(
            status, answer.status.message
        )
        write_json(options.json, refusal_dictionary(error, solve_time, answer.task_digest or None))
        raise error
    plan, digest = plan_from_answer(answer), answer.task_digest
    start = nanoseconds(answer.plans[0].joint_trajectory.header.stamp) / NANOSECONDS
    write_json(options.json, received_dictionary(plan, answer.plan_id, digest, start, solve_time))
    chosen, goal = request.duration_max > 0.0, request.goal
    attains = not plan.then and bool(goal.chaser_rotation or goal.chaser_attitude)
    print_table(
        [
            ("plan", f"{answer.plan_id}, {'not published' if request.plan_only else 'published'}"),
            ("starts at", f"{start:.3f} s"),
            *plan_rows(None, plan, solve_time, digest, chosen, limits=None, attains=attains),
        ]
    )
    return SOLVED


def _request(options: Namespace) -> PlanRequest:
    """Return the request: of the scenario, or empty, with the changes of `--set`."""
    from ff_planner_ros.common.arrays import finite_number
    from ff_planner_ros.ros.messages.requests import (
        change_request,
        request_of_nothing,
        request_of_scenario,
    )

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


def add_demo(add: Add) -> None:
    """Add `demo`."""
    demo = add(
        "demo",
        show_demo,
        "plan the paper's capture over ROS, show the result",
    )
    demo.add_argument(
        "what",
        nargs="?",
        choices=("capture", _WHOLE),
        default="capture",
        help="capture: one of the testbeds below, executed in real time (default); whole_capture: "
        "approach, grasp, stop and stow in one request, executed in real time, then in MuJoCo",
    )
    demo.add_argument(
        "--testbed",
        choices=("lemur", "lines", "planar", "tumbling", "following"),
        default=_TESTBED,
        help="lemur: the paper's capture, the whole robot collision-checked (default); lines: the "
        "same with the link centre lines, as in the paper; planar: one on an air-bearing table; "
        "tumbling: of a body that tumbles; following: by an arm that is heavier than its model, "
        "replanned five times a second",
    )
    output_help = "of the results (default: %(default)s)"
    add_output(demo, "--output", "DIR", output_help, require_directory)
    demo.set_defaults(output=Path("demo_output"))


def show_demo(options: Namespace) -> int:
    """Run a demonstration over ROS."""
    import rclpy  # noqa: F401 (the processes of the demo need it: said before they start)

    if options.what == _WHOLE:
        refuse_given(options, {"testbed": _TESTBED}, f"{_WHOLE} has a testbed of its own")
        from ff_planner_ros.demo.whole_capture import run_whole_capture

        return run_whole_capture(options.output)
    from ff_planner_ros.demo.run import run_demo

    return run_demo(options.output, testbed=options.testbed)
