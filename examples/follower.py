"""Replanning in motion: flies a capture, and plans the rest of it again several times a second.

    .venv/bin/python examples/simulated_testbed.py config/scenarios/lemur_capture.yaml \
        --arm-heavier 0.05 --rate-bias 0.000175
    .venv/bin/python examples/follower.py config/scenarios/lemur_capture.yaml

needs the planner node, too. Each new plan takes over from the running plan at a point on it, and
goes to the same goal from the chaser's state at that time. With `--rate 0` the first plan is flown
alone.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from rclpy.utilities import remove_ros_args

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.executive import MissionExecutive
from ff_planner_ros.demo.mission import mission_report, run_mission
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME, load_scenario
from ff_planner_ros.ros.messages.to_messages import request_message

NAME = "follower"  # requester
PATIENCE = 60.0  # [s] for the planner, the testbed and the answer
# No new plan in time: the arm continues with the running one, and the next plan is requested.
_GOES_ON = (Status.TOO_LATE, Status.TIMED_OUT)
_LOOK_INTERVAL = 0.005  # [s] between looks at the clock


def main() -> int:
    """Fly one capture; exit code: 0 done, 2 something could not run, 3 no plan, 130 interrupted."""
    options = _options()
    return run_mission("follower", partial(_fly, options), options.json)


def _fly(options: argparse.Namespace, check: Callable[[], None]) -> dict[str, Any]:
    scenario = load_scenario(options.scenario)
    with closing(MissionExecutive(check, PATIENCE, sys.argv)) as executive:
        request = request_message(scenario, SCENARIO_FRAME)
        request.requester, request.plan_only = NAME, True
        request.start_time = Time(sec=options.start)
        first = executive.plan(request, lambda _: None)
        executive.commit(first)
        print(f"flying     {first.plan_id}", flush=True)
        begin = nanoseconds(first.plans[0].joint_trajectory.header.stamp) / NANOSECONDS
        again = request_message(scenario, SCENARIO_FRAME)
        again.requester, again.replan_active, again.duration = NAME, True, 0.0
        again.duration_max = 0.0
        replans = list(_replans(executive, again, begin, options.rate, check))
        flown = executive.watch(first, first.plans[0].duration, scenario.robot)
    figures = _figures(replans) | {
        "end_error": flown.error.position,
        "end_angle": flown.error.angle,
    }
    for name, value in figures.items():
        print(f"{name:20} {value:.5g}")
    way = np.array([flown.time, flown.from_end]).T.tolist()
    return mission_report(first, [flown]) | figures | {"way": way}


def _replans(
    executive: MissionExecutive,
    request: PlanRequest,
    begin: float,
    rate: float,
    check: Callable[[], None],
) -> Iterator[tuple[PlanAnswer, float]]:
    """Request plans until the goal is near; yield each answer and its round-trip time [s]."""
    due = begin + (1.0 / rate if rate else np.inf)
    while rate:
        while time.time() < due:
            check()
            time.sleep(min(_LOOK_INTERVAL, max(due - time.time(), 0.0)))
        asked = time.perf_counter()
        answer = executive.replan(request)
        took = time.perf_counter() - asked
        status = Status(answer.status.code)
        if status is Status.PLAN_ENDING:
            return
        if status is not Status.SOLVED and status not in _GOES_ON:
            raise FfPlannerError(status, answer.status.message)
        yield answer, took
        # Not before the plan that was just made has begun.
        due = max(due + 1.0 / rate, time.time())
        if answer.plans:
            begun = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
            due = max(due, begun / NANOSECONDS)


def _figures(replans: list[tuple[PlanAnswer, float]]) -> dict[str, float]:
    """Return statistics of the replans: counts, delays and times [s], iterations."""
    made = [(one, took) for one, took in replans if one.status.code == Status.SOLVED]
    report: dict[str, float] = {"asked": len(replans), "plans": len(made)}
    if made:
        solve = [answer.solver.solve_time for answer, _ in made]
        report |= {
            "delay": float(np.median([answer.inputs.handover_delay for answer, _ in made])),
            "solve_time_p50": float(np.median(solve)),
            "solve_time_p99": float(np.quantile(solve, 0.99)),
            "round_trip_p50": float(np.median([took for _, took in made])),
            "iterations_p50": float(np.median([answer.solver.iterations for answer, _ in made])),
        }
    return report


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", type=Path, metavar="SCENARIO")
    parser.add_argument("--rate", type=float, default=5.0, help="of new plans [Hz]; 0: none")
    parser.add_argument(
        "--start",
        type=int,
        default=0,
        metavar="SECONDS",
        help="ROS time at which the first plan starts (default: as soon as the planner can)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures")
    return parser.parse_args(remove_ros_args(sys.argv)[1:])


if __name__ == "__main__":
    sys.exit(main())
