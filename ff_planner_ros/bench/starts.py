"""Starts in motion: in the middle of a running plan, and with null-space motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import generalised_jacobian

OBJECTIVES = {"min(L)": Objective(1.0, 0.0), "min(Theta)": Objective(0.0, 1.0)}
# Null-space rates of the fastest joint [rad/s]; these arms' joints may turn at 0.5.
NULL_SPACE_RATES = (0.1, 0.3)
# Arms with a null space.
_REDUNDANT = ("lemur", "arm7")


@dataclass(frozen=True)
class StartAttempt:
    """What became of one start."""

    kind: str  # what the start is
    robot: str
    number: int  # of the ordinary scenario
    status: Status
    message: str  # cause of a miss; empty if solved
    # Largest difference between the plan's first joint motion and the start's; NaN for a miss.
    rate_jump: float  # [rad/s]
    acceleration_jump: float  # [rad/s2]; NaN, too, where the start's accelerations are not known


def joins(count: int, settings: PlannerSettings) -> Iterator[StartAttempt]:
    """Plan to the same goal again while a plan runs, from a random time of it on."""
    for index in range(count):
        number, arm = divmod(index, len(ROBOTS))
        robot = ROBOTS[arm]
        problem = scenario("ordinary", robot, number, turned=False).problem
        task = PlanningTask(problem, settings)
        try:
            running = joint_motion(perform(task).trajectory)
        except FfPlannerError:
            continue  # it is counted where the scenarios are
        rng = np.random.default_rng(index)
        task = replace(task, ahead=rng.uniform(0.0, problem.duration), running=running)
        for name, objective in OBJECTIVES.items():
            asked = replace(task, problem=replace(problem, objective=objective))
            yield _attempt(f"in the middle of a plan, {name}", robot, number, asked)


def null_space_starts(count: int, settings: PlannerSettings) -> Iterator[StartAttempt]:
    """Plan the same scenarios without obstacles from starts with null-space motion."""
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
    try:
        plan = perform(task)
    except FfPlannerError as error:
        return StartAttempt(kind, robot, number, error.status, str(error), np.nan, np.nan)
    return StartAttempt(kind, robot, number, Status.SOLVED, "", *_jumps(task, plan))


def _jumps(task: PlanningTask, plan: Plan) -> tuple[float, float]:
    """Return the jumps of joint rates [rad/s] and accelerations [rad/s2] at the start."""
    motion, rates = plan.trajectory, task.problem.start.joint_velocities
    accelerations = np.full_like(rates, np.nan)
    if isinstance(task.running, JointMotion):
        _, (rates,), (accelerations,) = task.running.at(np.array([task.ahead]))
    return (
        float(np.abs(motion.joint_velocities[0] - rates).max()),
        float(np.abs(motion.joint_accelerations[0] - accelerations).max()),
    )
