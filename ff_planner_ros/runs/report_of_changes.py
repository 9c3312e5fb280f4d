"""The report of a what if: the plans of changed requests laid over the recorded ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.analysis.methods import CHANGED, RECORDED
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_messages import plan_from_answer
from ff_planner_ros.runs.recorded_run import RecordedRequest
from ff_planner_ros.runs.report import Report, ReportedPlan, reported_plan, robot_facts
from ff_planner_ros.runs.report_of_bag import reported_request

# A page of more plans is slow to open.
_MOST_PLANS = 20


@dataclass(frozen=True, eq=False)
class Answered:
    """A request that was planned with something changed."""

    recorded: RecordedRequest
    changed: RecordedRequest
    answer: PlanAnswer  # to the changed one


def report_of_changes(
    bag: Path, robot: Robot, changes: str, answered: Sequence[Answered], notes: Sequence[str]
) -> Report:
    """Return the report, the last plans drawn.

    Args:
        changes: In words.
        notes: What a reader must know of the bag.
    """
    requests, said = [], list(notes)
    for number, one in enumerate(answered):
        name, door = one.recorded.name, one.recorded.door
        before = reported_request(door, one.recorded.request, one.recorded.response)
        now = reported_request(door, one.changed.request, one.answer)
        before = replace(before, plan_id=f"{name}, recorded")
        now = replace(now, plan_id=f"{name}, changed", before=before)
        if number >= len(answered) - _MOST_PLANS:
            try:
                now = replace(now, plan=_plan(robot, one))
            except (FfPlannerError, LookupError, ValueError) as error:
                said.append(f"{name} is not drawn: {error}")
        requests.append(now)
    if len(answered) > _MOST_PLANS:
        said.append(f"of {len(answered)} requests the plans of the last {_MOST_PLANS} are drawn")
    facts = (("bag", str(bag)), ("changed", changes), *robot_facts(robot))
    return Report(f"{bag.name}, changed", facts, tuple(said), tuple(requests))


def _plan(robot: Robot, one: Answered) -> ReportedPlan | None:
    """Return what is drawn of a request, as recorded, as changed or both; None: no plan is."""
    answers = {RECORDED: one.recorded.response, CHANGED: one.answer}
    motions = {
        method: _motion(robot, answer)
        for method, answer in answers.items()
        if answer is not None and answer.status.code == Status.SOLVED
    }
    if not motions:
        return None
    problem = next(_problems(one))
    return reported_plan(robot, motions, problem.obstacles, scene_of(problem))


def _motion(robot: Robot, answer: PlanAnswer) -> Trajectory:
    motion = plan_from_answer(answer).trajectory
    require_sound_samples(robot, motion)
    return motion


def _problems(one: Answered) -> Iterator[PlanningProblem]:
    """Yield what was planned, of the requests that can be read; both have one goal and scene."""
    refused: FfPlannerError | None = None
    for request, answer in ((one.changed, one.answer), (one.recorded, one.recorded.response)):
        try:
            problem = request.read_request().task.problem
            yield lasting(problem, value_at(answer, "plans[0].duration", 0.0) or None)
        except FfPlannerError as error:
            refused = error
    if refused is not None:
        raise refused
