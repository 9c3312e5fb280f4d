"""A mission as a process: its signals, exit code and report."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.demo.executive import FlownPlan
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.trajectories import begin_of, trajectory_in
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.ros.outputs.prediction import FramePose
from ff_planner_ros.ros.process import StopRequest


def run_mission(
    name: str, fly: Callable[[Callable[[], None]], Mapping[str, Any]], file: Path | None
) -> int:
    """Run a mission to its end, and write its report or the error.

    Args:
        name: Name of the program in messages.
        fly: Flies the mission with the `check` of `MissionExecutive`; returns the report.
        file: JSON file for the report; None: it is not written.

    Returns:
        Exit code: 0 done, 2 something could not run, 3 no plan, 130 interrupted.
    """
    stop = StopRequest()
    try:
        code, report = 0, fly(stop.check)
    except KeyboardInterrupt:
        return 130
    except FfPlannerError as error:
        print(f"{name}: {_said(error)}", file=sys.stderr)
        report = {"status": int(error.status), "message": str(error)}
        code = exit_code(error)
    if file is not None:
        file.write_text(json_text(report) + "\n", encoding="utf-8")
    return code


def exit_code(error: FfPlannerError) -> int:
    """Return the exit code for an error: 3 no plan was found, 2 any other error."""
    return 3 if error.status.is_no_plan else 2


def _said(error: FfPlannerError) -> str:
    """Return an error in words; an internal error is no refusal."""
    if error.status is Status.INTERNAL_ERROR:
        return str(error)
    return f"refused {int(error.status)} {error.status.name}: {error}"


def ends_of_phases(answer: PlanAnswer) -> list[float]:
    """Return the time at which each phase reaches its goal, from the first phase's start [s]."""
    return [begin_of(answer.plans, phase) + one.duration for phase, one in enumerate(answer.plans)]


def phases_said(request: PlanRequest, answer: PlanAnswer) -> list[str]:
    """Return a line on the plan of each phase; empty for a single phase."""
    said = list[str]()
    goals = [request.goal, *(one.goal for one in request.then)]
    for goal, one in zip(goals, answer.plans, strict=True):
        motion, kind = trajectory_in(one), GoalKind(goal.kind).name.lower()
        path = np.linalg.norm(motion.joint_velocities[:-1], axis=1) @ np.diff(motion.time)
        turns = Rotation.from_quat(motion.chaser_quaternions_xyzw)
        turned = math.degrees((turns[0].inv() * turns).magnitude().max())
        said.append(
            f"{kind.replace('_', ' ')}, {one.duration:.3f} s long, joint path {path:.4f} rad, "
            f"rotation of the chaser {turned:.3f} deg"
        )
    return said if len(said) > 1 else []


def mission_report(answer: PlanAnswer, flown: Sequence[FlownPlan]) -> dict[str, Any]:
    """Return the report of a committed plan, for JSON; its duration is that of all phases.

    Args:
        flown: Comparison at the end of each phase, or at the end alone.
    """
    return {
        "status": int(answer.status.code),
        "plan_id": answer.plan_id,
        "solve_time": answer.solver.solve_time,
        "duration": ends_of_phases(answer)[-1],
        **_reached(flown[-1]),
        "phases": [_reached(one) for one in flown],
    }


def _reached(flown: FlownPlan) -> dict[str, Any]:
    return {
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
