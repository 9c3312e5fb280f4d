"""A mission as a process: its signals, its exit code and what it writes."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.demo.executive import FlownPlan
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.background import StopRequest
from ff_planner_ros.ros.outputs.prediction import FramePose


def run_mission(
    name: str, fly: Callable[[Callable[[], None]], Mapping[str, Any]], file: Path | None
) -> int:
    """Run a mission until it is done, and write its report or why there is none.

    Args:
        name: Of the program, before what it says to stderr.
        fly: Is given the check for `MissionExecutive`; returns the report.
        file: For the report, JSON; None: it is not written.

    Returns:
        Exit code: 0 done, 2 something could not run, 3 no plan, 130 interrupted.
    """
    stop = StopRequest()

    def check() -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    try:
        code, report = 0, fly(check)
    except KeyboardInterrupt:
        return 130
    except FfPlannerError as error:
        print(f"{name}: {_said(error)}", file=sys.stderr)
        report = {"status": int(error.status), "message": str(error)}
        code = 3 if Status.GOAL_OUT_OF_REACH <= error.status < Status.INTERNAL_ERROR else 2
    if file is not None:
        file.write_text(json.dumps(report) + "\n", encoding="utf-8")
    return code


def _said(error: FfPlannerError) -> str:
    """Return an error for a reader; what failed by itself was refused by nobody."""
    if error.status is Status.INTERNAL_ERROR:
        return str(error)
    return f"refused {int(error.status)} {error.status.name}: {error}"


def mission_report(answer: PlanAnswer, flown: FlownPlan) -> dict[str, Any]:
    """Return what became of a plan that was committed, for JSON."""
    return {
        "status": int(answer.status.code),
        "plan_id": answer.plan_id,
        "solve_time": answer.solver.solve_time,
        "duration": answer.plans[0].duration,
        "predicted": _numbers(flown.predicted),
        "reached": _numbers(flown.reached),
        "error": flown.error._asdict(),
        "worst_chaser_error": flown.worst._asdict(),
        "capture": None if flown.capture is None else asdict(flown.capture),
    }


def _numbers(pose: FramePose) -> dict[str, list[float]]:
    return {
        "position": pose.position.tolist(),
        "quaternion_xyzw": pose.rotation.as_quat().tolist(),
    }
