"""Replanning in motion: plans that take over from a running one, beside plans from scratch."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_benchmark.bench.measurement import OBJECTIVES, Measurement
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.problem.problem import (
    Parametrisation,
    PlanningProblem,
    carried,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario

_HEADER = (
    *("what is planned again", "asked", "solved", "near the rest", "iterations"),
    *("p50 [ms]", "p99 [ms]", "from nothing p50 [ms]", "times faster"),
)

# From a measurement to the handover, and the moments of a plan at which it is taken over, as
# parts of its duration.
_AHEAD = 0.2  # [s]
_MOMENTS = (0.1, 0.3, 0.5, 0.7, 0.9)
# Error of the chaser's angular velocity against the running plan, about each axis [rad/s].
_TURN_ERROR = np.deg2rad(0.01)
# Runs of which the fastest counts, as other processes disturb the others.
_REPEATED = 3


@dataclass(frozen=True)
class Replanned:
    """The result of replanning once while a plan runs."""

    kind: str
    robot: str
    number: int  # of the scenario
    since: float  # from the running plan's first point to the measurement [s]
    status: Status
    starts: int  # initial guesses; 1: the running plan's remainder sufficed
    iterations: int
    seconds: float  # processor time of the whole task
    seconds_from_nothing: float  # of the same task, planned from scratch


def measurement(problem: PlanningProblem, count: int, settings: PlannerSettings) -> Measurement:
    """Compare replanning times with those of the same tasks planned from scratch."""
    results = list(replanned(problem, count, settings))
    return Measurement(results, [Table("Replanning in motion", _HEADER, [*_rows(results)])])


def replanned(
    problem: PlanningProblem, count: int, settings: PlannerSettings
) -> Iterator[Replanned]:
    """Replan while a plan runs, at several moments of each plan.

    Args:
        problem: Replanned for three objectives and parameterisations.
        count: Number of ordinary scenarios that are replanned, too, the robots in turn.
    """
    shortest = replace(problem, objective=OBJECTIVES["min(L)"])
    cases = {
        "min(L)": shortest,
        "min(L), joint splines": replace(shortest, parametrisation=Parametrisation.JOINT_SPLINE),
        "min(Theta)": replace(problem, objective=OBJECTIVES["min(Theta)"]),
    }
    for name, asked in cases.items():
        yield from _of_plan(f"lemur_capture, {name}", "lemur", 0, asked, settings)
    for index in range(count):
        number, arm = divmod(index, len(ROBOTS))
        found = scenario("ordinary", ROBOTS[arm], number, turned=False)
        yield from _of_plan("ordinary, min(L)", ROBOTS[arm], number, found.problem, settings)


def _rows(results: Sequence[Replanned]) -> Iterator[tuple[str, ...]]:
    """Yield a row of the table for each kind."""
    for kind in dict.fromkeys(one.kind for one in results):
        mine = [one for one in results if one.kind == kind]
        solved = [one for one in mine if one.status is Status.SOLVED]
        if not solved:
            yield (kind, str(len(mine)), "0", *["-"] * (len(_HEADER) - 3))
            continue
        seconds = np.array([one.seconds for one in solved])
        before = np.array([one.seconds_from_nothing for one in solved])
        yield (
            kind,
            str(len(mine)),
            str(len(solved)),
            str(sum(one.starts == 1 for one in solved)),
            f"{np.median([one.iterations for one in solved]):.0f}",
            f"{1e3 * np.median(seconds):.1f}",
            f"{1e3 * np.quantile(seconds, 0.99):.1f}",
            f"{1e3 * np.nanmedian(before):.1f}",
            f"{np.nanmedian(before / seconds):.1f}",
        )


def _of_plan(
    kind: str, robot: str, number: int, problem: PlanningProblem, settings: PlannerSettings
) -> Iterator[Replanned]:
    task = PlanningTask(problem, settings)
    try:
        motion = joint_motion(perform(task).trajectory)
    except FfPlannerError:
        return  # it is counted where the scenarios are
    for part in _MOMENTS:
        since = part * problem.duration
        asked = _continuing(task, motion, since)
        status, (starts, iterations), seconds = _timed(asked, _REPEATED)
        _, _, from_nothing = _timed(replace(asked, running_goal=None), 1)
        yield Replanned(
            kind, robot, number, since, status, starts, iterations, seconds, from_nothing
        )


def _continuing(task: PlanningTask, motion: JointMotion, since: float) -> PlanningTask:
    """Return the task of taking over from a plan, with a small error of the chaser's motion."""
    problem = task.problem
    state = carried_forward(problem.robot, problem.start, since, motion)
    wrong = state.angular_velocity_chaser_in_inertial + _TURN_ERROR
    state = replace(state, angular_velocity_chaser_in_inertial=wrong)
    goal = problem.duration - since
    later = replace(
        problem,
        start=state,
        duration=goal - _AHEAD,
        obstacles=carried(problem.obstacles, since + _AHEAD),
    )
    if problem.target_body is not None:
        later = with_capture_target(problem.target_body.after(since + _AHEAD), later)
    running = replace(motion, time=motion.time - since)
    return replace(task, problem=later, ahead=_AHEAD, running=running, running_goal=goal)


def _timed(task: PlanningTask, times: int) -> tuple[Status, tuple[int, int], float]:
    """Return status, (initial guesses, iterations), and the least processor time of runs [s]."""
    status, effort, seconds = Status.SOLVED, (0, 0), np.inf
    for _ in range(times):
        begun = time.process_time()
        try:
            report = perform(task).solver
            effort = report.starts, report.iterations
        except FfPlannerError as error:
            status = error.status
        seconds = min(seconds, time.process_time() - begun)
    return status, effort, seconds
