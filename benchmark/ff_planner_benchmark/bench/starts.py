"""Starts in motion: in the middle of a running plan, and with null-space motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_benchmark.bench.measurement import (
    OBJECTIVES,
    Attempt,
    Measurement,
    misses,
    timed_plan,
)
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import generalised_jacobian

# Null-space rates of the fastest joint [rad/s]; these arms' joints may turn at 0.5.
NULL_SPACE_RATES = (0.1, 0.3)
# Arms with a null space.
_REDUNDANT = ("lemur", "arm7")
_HEADER = ("start", "tried", "solved", "largest jump [rad/s]", "[rad/s2]")


@dataclass(frozen=True)
class StartAttempt(Attempt):
    """The planner's result from one start in motion."""

    kind: str  # kind of start, in words
    robot: str
    number: int  # of the ordinary scenario
    # Largest jump of a joint's motion from the start to the plan's first point; None for a miss
    rate_jump: float | None = None  # [rad/s]
    acceleration_jump: float | None = None  # [rad/s2]; None, too, if the start's is not known


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan from `count` starts of each kind, and tabulate the results."""
    tried = [*joins(count, settings), *null_space_starts(count, settings)]
    rows = []
    for kind in dict.fromkeys(each.kind for each in tried):
        group = [each for each in tried if each.kind == kind]
        jumps = _largest(e.rate_jump for e in group), _largest(e.acceleration_jump for e in group)
        rows.append((kind, f"{len(group)}", f"{sum(each.solved for each in group)}", *jumps))
    table = Table("Starts in motion, ordinary scenarios", _HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind}, {0.robot} {0.number}"))


def _largest(jumps: Iterable[float | None]) -> str:
    known = [jump for jump in jumps if jump is not None]
    return f"{max(known):.0e}" if known else "-"


def joins(count: int, settings: PlannerSettings) -> Iterator[StartAttempt]:
    """Replan to the same goal from a random time of a running plan, of `count` scenarios."""
    for index in range(count):
        number, arm = divmod(index, len(ROBOTS))
        robot = ROBOTS[arm]
        problem = scenario("ordinary", robot, number, turned=False).problem
        task = PlanningTask(problem, settings)
        made, _ = timed_plan(task)
        if made is None:
            continue  # a miss of the scenarios' table
        ahead = np.random.default_rng(index).uniform(0.0, problem.duration)
        task = replace(task, ahead=ahead, running=joint_motion(made.trajectory))
        for name in ("min(L)", "min(Theta)"):
            asked = replace(task, problem=replace(problem, objective=OBJECTIVES[name]))
            yield _attempt(f"in the middle of a plan, {name}", robot, number, asked)


def null_space_starts(count: int, settings: PlannerSettings) -> Iterator[StartAttempt]:
    """Plan `count` scenarios without obstacles from starts with null-space motion, at each rate."""
    for largest in NULL_SPACE_RATES:
        for index in range(count):
            number, arm = divmod(index, len(_REDUNDANT))
            robot = _REDUNDANT[arm]
            problem = scenario("ordinary", robot, number, turned=False).problem
            start = problem.start
            q, _ = configuration(problem.robot, start)
            jacobian = generalised_jacobian(problem.robot, problem.robot.model.createData(), q)
            _, _, rows = np.linalg.svd(jacobian)
            added = np.random.default_rng(index).normal(size=len(rows) - 6) @ rows[6:]
            added *= largest / np.abs(added).max()
            moving = replace(start, joint_velocities=start.joint_velocities + added)
            problem = replace(problem, start=moving, obstacles=())
            kind = f"null-space motion of {largest:g} rad/s"
            yield _attempt(kind, robot, number, PlanningTask(problem, settings))


def _attempt(kind: str, robot: str, number: int, task: PlanningTask) -> StartAttempt:
    made, outcome = timed_plan(task)
    jumps = _jumps(task, made) if made else (None, None)
    return StartAttempt(kind, robot, number, *jumps, **outcome)


def _jumps(task: PlanningTask, plan: Plan) -> tuple[float, float | None]:
    """Return the jumps of joint rates [rad/s] and accelerations [rad/s2] at the start."""
    motion = plan.trajectory
    if not isinstance(task.running, JointMotion):
        rates = task.problem.start.joint_velocities
        return float(np.abs(motion.joint_velocities[0] - rates).max()), None
    _, rates, accelerations = task.running.at(np.array([task.ahead]))
    return (
        float(np.abs(motion.joint_velocities[0] - rates).max()),
        float(np.abs(motion.joint_accelerations[0] - accelerations).max()),
    )
