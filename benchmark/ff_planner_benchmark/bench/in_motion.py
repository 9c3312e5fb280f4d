"""Starts in motion: in the middle of a running plan, with null-space motion, and taking over."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import (
    OBJECTIVES,
    SOLVED,
    Experiment,
    Row,
    attempt,
    is_solved,
    missed,
    timed_plan,
)
from ff_planner_benchmark.problems.classes import SCENARIOS
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import (
    Parametrisation,
    PlanningProblem,
    carried,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import generalised_jacobian

# Null-space rates of the fastest joint [rad/s]; these arms' joints may turn at 0.5.
_NULL_SPACE_RATES = (0.1, 0.3)
# Arms with a null space.
_REDUNDANT = ("lemur", "arm7")
# From a measurement to the handover, and the moments of a plan at which it is taken over, as
# parts of its duration.
_AHEAD = 0.2  # [s]
_MOMENTS = (0.1, 0.3, 0.5, 0.7, 0.9)
# Error of the chaser's angular velocity against the running plan, about each axis [rad/s].
_TURN_ERROR = np.deg2rad(0.01)
# Runs of which the fastest counts, as other processes disturb the others.
_REPEATED = 3

_ORDINARY, *_ = SCENARIOS


def _starts(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Replan from a random time of a running plan, then plan from starts with null-space motion."""
    for index in range(count):
        problem = _ORDINARY.draw(index).problem
        task = PlanningTask(problem, settings)
        made, _ = timed_plan(task)
        if made is None:
            continue  # a miss of the scenarios' table
        ahead = np.random.default_rng(index).uniform(0.0, problem.duration)
        task = replace(task, ahead=ahead, running=joint_motion(made.trajectory))
        robot, of_robot = _ORDINARY.robot(index), index // len(_ORDINARY.robots)
        for name in ("min(L)", "min(Theta)"):
            asked = replace(task, problem=replace(problem, objective=OBJECTIVES[name]))
            yield _start(f"in the middle of a plan, {name}", robot, of_robot, asked)
    for largest in _NULL_SPACE_RATES:
        for index in range(count):
            of_robot, arm = divmod(index, len(_REDUNDANT))
            robot = _REDUNDANT[arm]
            problem = scenario("ordinary", robot, of_robot, turned=False).problem
            start = problem.start
            q, _ = configuration(problem.robot, start)
            jacobian = generalised_jacobian(problem.robot, problem.robot.model.createData(), q)
            _, _, rows = np.linalg.svd(jacobian)
            added = np.random.default_rng(index).normal(size=len(rows) - 6) @ rows[6:]
            added *= largest / np.abs(added).max()
            moving = replace(start, joint_velocities=start.joint_velocities + added)
            problem = replace(problem, start=moving, obstacles=())
            kind = f"null-space motion of {largest:g} rad/s"
            yield _start(kind, robot, of_robot, PlanningTask(problem, settings))


def _start(kind: str, robot: str, of_robot: int, task: PlanningTask) -> Row:
    labels = {"kind": kind, "robot": robot, "number": of_robot}
    return attempt(task, partial(_jumps, task), **labels)


def _jumps(task: PlanningTask, made: Plan | None) -> Row:
    """Return the largest jumps of joint rates [rad/s] and accelerations [rad/s2] at the start.

    None for a miss; that of accelerations, too, where the start's are not known.
    """
    row: Row = {"rate_jump": None, "acceleration_jump": None}
    if made is None:
        return row
    motion, rates = made.trajectory, task.problem.start.joint_velocities
    if isinstance(task.running, JointMotion):
        _, rates, accelerations = task.running.at(np.array([task.ahead]))
        jump = np.abs(motion.joint_accelerations[0] - accelerations).max()
        row["acceleration_jump"] = float(jump)
    return row | {"rate_jump": float(np.abs(motion.joint_velocities[0] - rates).max())}


STARTS = Experiment(
    "starts",
    "Starts in motion, ordinary scenarios",
    _starts,
    {"start": "kind"},
    {
        "tried": columns.count,
        "solved": columns.number_of(is_solved),
        "largest jump [rad/s]": columns.value("rate_jump", max, ".0e"),
        "[rad/s2]": columns.value("acceleration_jump", max, ".0e"),
    },
    most=20,
    remark=missed("{kind}, {robot} {number}"),
)


def _replanned(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Replan while a plan runs, at several moments of each plan of the paper's capture and more."""
    problem = load_scenario(share_directory() / "config" / "scenarios" / "lemur_capture.yaml")
    shortest = replace(problem, objective=OBJECTIVES["min(L)"])
    cases = {
        "min(L)": shortest,
        "min(L), joint splines": replace(shortest, parametrisation=Parametrisation.JOINT_SPLINE),
        "min(Theta)": replace(problem, objective=OBJECTIVES["min(Theta)"]),
    }
    for name, asked in cases.items():
        yield from _of_plan(f"lemur_capture, {name}", "lemur", 0, PlanningTask(asked, settings))
    for index in range(count):
        robot, of_robot = _ORDINARY.robot(index), index // len(_ORDINARY.robots)
        yield from _of_plan("ordinary, min(L)", robot, of_robot, _ORDINARY.task(index, settings))


def _of_plan(kind: str, robot: str, of_robot: int, task: PlanningTask) -> Iterator[Row]:
    try:
        motion = joint_motion(perform(task).trajectory)
    except FfPlannerError:
        return  # it is counted where the scenarios are
    for part in _MOMENTS:
        since = part * task.problem.duration
        asked = _continuing(task, motion, since)
        labels = {"kind": kind, "robot": robot, "number": of_robot, "since": since}
        row = labels | _timed(asked, _REPEATED)
        before = _timed(replace(asked, running_goal=None), 1)["seconds"]
        yield row | {"seconds_from_nothing": before, "faster": before / row["seconds"]}


def _continuing(task: PlanningTask, motion: JointMotion, since: float) -> PlanningTask:
    """Return the task of taking over from a plan, with a small error of the chaser's motion."""
    problem = task.problem
    state = carried_forward(problem.robot, problem.start, since, motion)
    wrong = state.angular_velocity_chaser_in_inertial + _TURN_ERROR
    goal = problem.duration - since
    later: PlanningProblem = replace(
        problem,
        start=replace(state, angular_velocity_chaser_in_inertial=wrong),
        duration=goal - _AHEAD,
        obstacles=carried(problem.obstacles, since + _AHEAD),
    )
    if problem.target_body is not None:
        later = with_capture_target(problem.target_body.after(since + _AHEAD), later)
    running = replace(motion, time=motion.time - since)
    return replace(task, problem=later, ahead=_AHEAD, running=running, running_goal=goal)


def _timed(task: PlanningTask, times: int) -> Row:
    """Return status, effort and the least processor time of so many runs [s]."""
    row: Row = {"status": SOLVED, "starts": 0, "iterations": 0, "seconds": np.inf}
    for _ in range(times):
        begun = time.process_time()
        try:
            report = perform(task).solver
            row |= {"starts": report.starts, "iterations": report.iterations}
        except FfPlannerError as error:
            row["status"] = error.status.name
        row["seconds"] = min(row["seconds"], time.process_time() - begun)
    return row


REPLANNING = Experiment(
    "replanning",
    "Replanning in motion",
    _replanned,
    {"what is planned again": "kind"},
    {
        "asked": columns.count,
        "solved": columns.number_of(is_solved),
        # One start: the running plan's remainder sufficed
        "near the rest": columns.number_of(lambda row: is_solved(row) and row["starts"] == 1),
        "iterations": columns.among(columns.value("iterations", form=".0f"), is_solved),
        "p50 [ms]": columns.among(columns.value("seconds", form=".1f", unit=1e3), is_solved),
        "p99 [ms]": columns.among(
            columns.value("seconds", columns.quantile_99, ".1f", 1e3), is_solved
        ),
        "from nothing p50 [ms]": columns.among(
            columns.value("seconds_from_nothing", np.nanmedian, ".1f", 1e3), is_solved
        ),
        "times faster": columns.among(columns.value("faster", np.nanmedian, ".1f"), is_solved),
    },
    most=20,
)
