"""Places in the scene that caused a refusal."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.analysis.scene_distances import gaps_at_start
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.stages import Stage, stages_of
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.task.task import PlanningTask

_OF_JOINTS = {Status.LIMIT_VIOLATED, Status.TORQUE_TOO_HIGH}


@dataclass(frozen=True, eq=False)
class Place:
    """A place in the scene at a time of the motion."""

    time: float  # from the first point on [s]
    points: Array  # one, or the two ends of a line; shape (1 or 2, 3) [m]
    words: str


def attempt_in(error: FfPlannerError) -> Plan | None:
    """Return the motion in a refusal: plans of earlier phases, and the best attempt; None: none."""
    if not isinstance(error, NoPlanFound):
        return None
    found = error.found if isinstance(error.found, Plan) else None
    attempt = error.attempt if isinstance(error.attempt, Plan) else None
    if found is None or attempt is None:
        return found or attempt
    return replace(found, then=(*found.then, attempt))


def place_of_fault(task: PlanningTask, error: FfPlannerError) -> Place | None:
    """Return the place that caused a refusal; None: it has none, as an invalid number."""
    problem = task.problem
    if error.status is Status.START_IN_COLLISION and (gaps := gaps_at_start(problem)):
        near = gaps[0]
        return Place(0.0, near.ends, f"{near.body}/{near.other}, {near.distance * 1e3:.1f} mm")
    attempt = error.attempt if isinstance(error, NoPlanFound) else None
    if not isinstance(error, NoPlanFound) or not isinstance(attempt, Plan):
        if error.status is Status.GOAL_OUT_OF_REACH and problem.posture is None:
            return Place(problem.duration, problem.target.position[None], "goal out of reach")
        return None
    stage = stages_of(task, attempt_in(error))[-1]
    if error.status in _OF_JOINTS:
        return _of_joint(stage, error.failures[0].finding if error.failures else "")
    if error.status is Status.COLLISION:
        return _nearest(stage, attempt)
    if error.status is Status.GOAL_OUT_OF_REACH and stage.problem.posture is None:
        ends = np.stack([stage.tip[-1], stage.problem.target.position])
        apart = float(np.linalg.norm(ends[1] - ends[0]))
        return Place(stage.end, ends, f"{apart * 1e3:.1f} mm from the goal")
    return None


def _nearest(stage: Stage, attempt: Plan) -> Place | None:
    metrics = attempt.metrics
    own = metrics.min_self_clearance < metrics.min_clearance
    name = "min_self_clearance" if own else "min_clearance"
    time, least = (getattr(metrics, f"{name}{of}") for of in ("_time", ""))
    if not np.isfinite(time):
        return None
    point = int(np.abs(stage.times - time).argmin())
    found = stage.nearest(point)
    ends = stage.tip[point][None] if found is None else found.ends
    words = f"{getattr(metrics, f'{name}_pair')}, {least * 1e3:.1f} mm"
    return Place(stage.begin + float(stage.times[point]), ends, words)


def _of_joint(stage: Stage, finding: str) -> Place | None:
    """Return the joint that a finding names, at the time that it names; None: it names none."""
    robot = stage.problem.robot
    name, at = re.search(r"joint (\S+) ", finding), re.search(r"at t = ([\d.]+) s", finding)
    if name is None or at is None or name[1] not in robot.joint_names:
        return None
    point = int(np.abs(stage.times - float(at[1])).argmin())
    joint = robot.joint_names.index(name[1])
    where = arm_points(robot, stage.q[point][None])[0, joint]
    return Place(stage.begin + float(stage.times[point]), where[None], name[1])
