"""The report of a what-if: the plans of changed requests laid over the recorded ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.analysis.methods import CHANGED, RECORDED
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.report.from_bag import reported_request
from ff_planner_ros.report.run_report import Report, ReportedPlan, reported_plan, robot_facts
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.runs.what_if import ChangedAnswer, WhatIf

# A page of more plans is slow to open.
_MOST_PLANS = 20


def report_of_changes(found: WhatIf) -> Report:
    """Return the report of a what-if, with the plans of its last requests drawn."""
    requests, notes, robot = [], list(found.notes), found.robot
    for number, one in enumerate(found.answers):
        name, door = one.recorded.name, one.recorded.door
        before = reported_request(door, one.recorded.request, one.recorded.response)
        now = reported_request(door, one.changed.request, one.answer)
        before = replace(before, plan_id=f"{name}, recorded")
        now = replace(now, plan_id=f"{name}, changed", before=before)
        if number >= len(found.answers) - _MOST_PLANS:
            try:
                now = replace(now, plan=_plan(robot, one))
            except (FfPlannerError, LookupError, ValueError) as error:
                notes.append(f"{name} is not drawn: {error}")
        requests.append(now)
    if (count := len(found.answers)) > _MOST_PLANS:
        notes.append(f"of {count} requests the plans of the last {_MOST_PLANS} are drawn")
    facts = (("bag", str(found.bag)), ("changed", found.changes), *robot_facts(robot))
    return Report(f"{found.bag.name}, changed", facts, tuple(notes), tuple(requests))


def _plan(robot: Robot, one: ChangedAnswer) -> ReportedPlan | None:
    """Return the plan to draw, as recorded, as changed or both; None: both were refused."""
    answers = {RECORDED: one.recorded.response, CHANGED: one.answer}
    solved = {
        method: answer
        for method, answer in answers.items()
        if answer is not None and answer.status.code == Status.SOLVED
    }
    if not solved:
        return None
    motions = {method: _motion(robot, answer) for method, answer in solved.items()}
    problem, wheels = next(_problems(one)), plan_from_answer(next(iter(solved.values()))).wheels
    return reported_plan(robot, motions, problem.obstacles, scene_of(problem), wheels)


def _motion(robot: Robot, answer: PlanAnswer) -> Trajectory:
    motion = plan_from_answer(answer).trajectory
    require_sound_samples(robot, motion)
    return motion


def _problems(one: ChangedAnswer) -> Iterator[PlanningProblem]:
    """Yield the problems of the requests that can be read; both have one goal and scene."""
    refused: FfPlannerError | None = None
    for request, answer in ((one.changed, one.answer), (one.recorded, one.recorded.response)):
        try:
            problem = request.read_request().task.problem
            yield lasting(problem, value_at(answer, "plans[0].duration", 0.0) or None)
        except FfPlannerError as error:
            refused = error
    if refused is not None:
        raise refused
