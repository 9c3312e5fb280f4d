"""The page of one case of a campaign: planned again, and drawn."""

from __future__ import annotations

import time
from dataclasses import astuple, replace
from pathlib import Path

from ff_planner_ros.analysis.drawing.before_plan import figure_before_plan
from ff_planner_ros.analysis.scene_distances import gaps_at_goal, gaps_at_start
from ff_planner_ros.campaign.again import (
    case_directory,
    changes_of,
    command_again,
    defaults_of,
    scenario_again,
)
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.campaign.table import below
from ff_planner_ros.campaign.work import motion_digest
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, OutOfTime
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import load_task
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.report.html import LIBRARY
from ff_planner_ros.report.run_page import save_page
from ff_planner_ros.report.run_report import (
    Report,
    ReportedPlan,
    ReportedRequest,
    reported_plan,
    robot_facts,
    solved,
)
from ff_planner_ros.report.statistics import Row

PAGE = "plan.html"
# A damaged table may ask for an endless search [s].
_LONGEST = 120.0


def save_case(row: Row, directory: Path) -> str:
    """Plan a case again and write its page below the campaign's directory.

    The page loads plotly.js from the file `LIBRARY` of the campaign.

    Returns:
        Why there is no page; empty: it was written.
    """
    try:
        scenario = scenario_again(row, directory)
        page = below(directory, *case_directory(row, directory).relative_to(directory).parts, PAGE)
        save_page(_report(row, directory, scenario), page, library=f"../../{LIBRARY}")
    except (FfPlannerError, OSError) as error:
        return str(error)
    return ""


class _Deadline(Watch):
    """Ends a search after `_LONGEST` seconds."""

    def __init__(self) -> None:
        """Begin now."""
        self._end = time.monotonic() + _LONGEST

    def require_time(self, phase: str = "", /) -> None:  # noqa: ARG002 (any phase)
        """Raise OutOfTime once it is over."""
        if self.time_left() < 0.0:
            raise self.cut_short()

    def time_left(self) -> float:
        """Return what is left [s]."""
        return self._end - time.monotonic()

    def cut_short(self) -> OutOfTime:
        """Return what ends the search."""
        return OutOfTime(f"a report plans a case for {_LONGEST:g} s at most")


def _report(row: Row, directory: Path, scenario: Path) -> Report:
    """Return the report of a case.

    Raises:
        InvalidInput: The row's changes are malformed, or the path of the parameters is a link.
    """
    facts = [
        ("campaign", str(directory)),
        ("case", row["id"]),
        ("scenario", row["source"]),
        ("method", row["method"]),
        *((key, str(value)) for key, value in changes_of(row, "changes").items()),
        ("planned again by", command_again(row, directory, scenario)),
    ]
    title = f"case {row['id']} of {directory.resolve().name}"
    begun = time.perf_counter()
    try:
        task = load_task(scenario, defaults_of(directory))
        facts += robot_facts(task.problem.robot)
        answer: Plan | NoPlanFound = perform(task, _Deadline(), method_of(row["planned_by"], task))
    except NoPlanFound as error:
        answer = error
    except FfPlannerError as error:  # it cannot even be read
        refused = ReportedRequest("", "campaign", code=error.status, message=str(error))
        return Report(title, tuple(facts), differences(row, error), (refused,))
    took = time.perf_counter() - begun
    asked = ReportedRequest(
        row["id"], "campaign", weights=astuple(task.problem.objective), solve_time=took
    )
    told = _answered(asked, task, answer)
    return Report(title, tuple(facts), differences(row, answer), (told,))


def differences(row: Row, answer: Plan | FfPlannerError) -> tuple[str, ...]:
    """Return a note if the answer of a case planned again differs from its row in the table."""
    if isinstance(answer, Plan):
        same = row["solved"] and motion_digest(whole(answer)) == row["motion_digest"]
    else:
        same = answer.status.name.lower() == row["status"]
    told = "Planned again for this page it came out otherwise than in the table, which says "
    return () if same else (f"{told}{row['status']}: another version or another processor.",)


def _answered(
    asked: ReportedRequest, task: PlanningTask, answer: Plan | NoPlanFound
) -> ReportedRequest:
    """Return a request with its plan, or with the best attempt and the refusal."""
    if isinstance(answer, Plan):
        drawn = [_drawn(one, found) for one, found in phase_tasks(task, answer)]
        return solved(asked, answer, drawn, answer.message)
    if isinstance(answer.attempt, Plan):
        remarks = ("It is the best attempt, and no plan: nobody must execute it.",)
        drawn = [replace(_drawn(task, answer.attempt), remarks=remarks)]
        asked = solved(asked, answer.attempt, drawn, str(answer))
    else:
        problem = task.problem
        gaps = gaps_at_start(problem), gaps_at_goal(problem) or ()
        asked = replace(asked, weights=None, asked=figure_before_plan(problem, *gaps))
    return replace(asked, code=answer.status, message=str(answer))


def _drawn(task: PlanningTask, found: Plan) -> ReportedPlan:
    problem = lasting(task.problem, found.duration)
    scene = scene_of(problem)
    return reported_plan(problem.robot, found.trajectory, problem.obstacles, scene, found.wheels)
