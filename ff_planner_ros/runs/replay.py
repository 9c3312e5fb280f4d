"""Replay of a bag: plans every request again, and compares the answers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.provenance import provenance
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.shown import printable
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import BagError, FfPlannerError, Status
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.ros.inputs.input_topics import OBSTACLES
from ff_planner_ros.ros.messages.phases import (
    bodies_of,
    efforts_of,
    plan_messages,
    tell_found,
)
from ff_planner_ros.ros.messages.to_messages import answer_of_error, answer_with_plan
from ff_planner_ros.ros.requests.reading import Provenance
from ff_planner_ros.runs.differences import Difference, differences
from ff_planner_ros.runs.recorded_run import RecordedRequest, RecordedRun, recorded_run

ALL_SAME, DIFFERS = 0, 3

# Answers that depend on more than the problem, which need not get them again.
_NO_FUNCTIONS_OF_THE_PROBLEM = {
    Status.BUSY: "another request was being planned",
    Status.CANCELLED: "its client cancelled it",
    Status.PREEMPTED: "a newer request took its place",
    Status.NOT_ACTIVE: "the node was not active",
    Status.SHUT_DOWN: "the node was shut down",
    Status.SOLVER_DIED: "the solver process died",
    Status.CLOCK_JUMPED: "the node's clock jumped back",
    Status.CONTRADICTING_PUBLISHERS: "publishers contradicted each other",
}
_FOR_LACK_OF_TIME = (Status.TOO_LATE, Status.TIMED_OUT)
# A bag does not say when messages stamped ahead of their arrival arrived at the node.
_OF_ARRIVALS = (Status.STATE_IN_FUTURE, Status.TARGET_IN_FUTURE)
# Entries of the provenance that cannot change a plan.
_IRRELEVANT = ("host", "started")
_WIDTH = 80  # of words in a table


class Verdict(StrEnum):
    """Result of a request's replay."""

    IDENTICAL = "identical"
    WITHIN_TOLERANCE = "within tolerance"
    DIFFERENT = "DIFFERENT"
    WITHOUT_CLOCK = "without a clock"  # the recorded refusal depended on time
    NOT_REPLAYABLE = "not replayable"
    NOT_REBUILT = "NOT REBUILT"  # the bag lacks a part of the inputs


@dataclass(frozen=True, eq=False)
class Replayed:
    """A request that was planned again."""

    recorded: RecordedRequest
    verdict: Verdict
    answer: PlanAnswer | None  # the new answer; None: not replayable, or not rebuilt
    words: str  # reason for the verdict; may be empty
    differences: tuple[Difference, ...]  # from the recorded answer
    planning_time: float  # wall-clock time of planning alone [s]


def print_replay(bag: Path) -> int:
    """Replay a bag, print the verdicts, and return the exit code: ALL_SAME or DIFFERS.

    Raises:
        BagError: The bag cannot be read, or holds nothing to replay.
        InvalidInput: The URDF in the bag is invalid.
    """
    begun = time.perf_counter()
    with open_bag(bag) as opened:
        run = recorded_run(opened)
    replayed = [replay(recorded) for recorded in one_by_one(run.requests)]
    planning = sum(one.planning_time for one in replayed)
    total = time.perf_counter() - begun
    print_table(
        f"Replay of {bag}",
        ("request", "interface", "recorded", "replayed", "verdict"),
        map(_row, replayed),
    )
    for line in [
        *_details(replayed),
        *version_lines(run),
        *(f"note: {note}" for note in run.notes),
    ]:
        print(line)
    counts = ", ".join(
        f"{number} {verdict}"
        for verdict in Verdict
        if (number := sum(one.verdict is verdict for one in replayed))
    )
    print(f"\n{counts}; planning took {planning:.2f} s of {total:.2f} s")
    fatal = (Verdict.DIFFERENT, Verdict.NOT_REBUILT)
    return DIFFERS if any(one.verdict in fatal for one in replayed) else ALL_SAME


def replay(recorded: RecordedRequest) -> Replayed:
    """Plan a request again, without time limits, and compare the answers."""
    then = recorded.status
    if then in _NO_FUNCTIONS_OF_THE_PROBLEM and recorded.response is not None:
        why = _NO_FUNCTIONS_OF_THE_PROBLEM[then]
        return Replayed(recorded, Verdict.NOT_REPLAYABLE, None, why, (), 0.0)
    try:
        efforts = [] if recorded.response is None else efforts_of(recorded.response)
        answer, planning_time = answer_again(recorded, efforts)
    except BagError as error:
        return Replayed(recorded, Verdict.NOT_REBUILT, None, str(error), (), 0.0)
    before, found = recorded.response, list[Difference]()
    lacked_time = then in _FOR_LACK_OF_TIME and not (before and before.effort)
    if lacked_time or (_is_of_arrivals(recorded) and answer.status.code != then):
        verdict, words = Verdict.WITHOUT_CLOCK, _result(answer)
    elif before is None or answer.status.code != before.status.code:
        verdict, words = Verdict.DIFFERENT, f"{answer.status.message}{_doubt(recorded)}"
    else:
        words = ""
        try:
            robot = None if recorded.inputs is None else recorded.inputs.robot
            found = differences(before, answer, robot)
            verdict = Verdict.WITHIN_TOLERANCE if found else Verdict.IDENTICAL
            if not all(one.is_tolerable for one in found):
                verdict = Verdict.DIFFERENT
        except (ValueError, IndexError) as error:  # a damaged answer, whose arrays do not fit
            verdict, words = Verdict.DIFFERENT, f"the recorded answer is damaged: {error}"
    return Replayed(recorded, verdict, answer, words, tuple(found), planning_time)


def _is_of_arrivals(recorded: RecordedRequest) -> bool:
    """Return whether a request was refused for the times or order of arriving messages."""
    if recorded.status is Status.STATE_TOO_OLD and recorded.response is not None:
        return str(recorded.response.status.field).startswith(OBSTACLES.name)
    return recorded.status in _OF_ARRIVALS


def answer_again(
    recorded: RecordedRequest, efforts: Sequence[int] = ()
) -> tuple[PlanAnswer, float]:
    """Return the answer to a request, as the node would give it, and the planning time alone [s].

    Args:
        efforts: Step at which the search of each phase is cut short, as the recorded one was by its
            time budget; zero: it is not.

    Raises:
        BagError: The request cannot be rebuilt.
    """
    if recorded.inputs is None:
        raise BagError(recorded.missing)
    frame, digest = recorded.inputs.parameters.inertial_frame, ""
    origin, asked = Provenance(), None
    begun, took = time.perf_counter(), 0.0
    try:
        asked = recorded.read_request()
        task, origin = asked.task.ended_at(*efforts), asked.provenance
        digest, begun = task.digest, time.perf_counter()
        try:
            plan = perform(task)
        finally:
            took = time.perf_counter() - begun
        written = plan_messages(plan, asked.start_ns, frame, bodies_of(task, plan))
        answer = answer_with_plan(whole(plan), written, recorded.name, took)
    except BagError:
        raise
    except FfPlannerError as error:
        answer = answer_of_error(error, recorded.name, took)
        if asked is not None:
            tell_found(answer, error, asked.task, asked.start_ns, frame)
    except Exception as error:  # as the node answers what nobody foresaw
        unforeseen = FfPlannerError(Status.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
        answer = answer_of_error(unforeseen, recorded.name, took)
    replace(origin, task_digest=digest).tell(answer)
    return answer, took


def one_by_one(requests: Sequence[RecordedRequest]) -> Iterator[RecordedRequest]:
    """Yield requests to plan, with a progress bar."""
    with progress_bar("planning", len(requests), "requests", per_unit=1) as progress:
        for recorded in requests:
            yield recorded
            progress(1)


def version_lines(run: RecordedRun) -> Iterator[str]:
    """Yield a line for each version or other provenance that differs from the recorded one."""
    if not run.provenance:
        yield "note: the bag does not say with which versions it was recorded"
        return
    for name, now in provenance().items():
        before = run.provenance.get(name, "unknown")
        if name not in _IRRELEVANT and before != now:
            yield f"version: {name} was {before}, is {now}"


def _doubt(recorded: RecordedRequest) -> str:
    """Return a remark on inputs that the answer does not name; empty if it names all."""
    names = " and ".join(recorded.by_time)
    words = f" (which {names} the node had heard is known from the times of recording only)"
    return words if names else ""


def _row(one: Replayed) -> tuple[str, ...]:
    recorded, response = one.recorded, one.recorded.response
    now = status_name(one.answer)
    words = one.verdict.value
    if one.differences:
        worst = max(one.differences, key=lambda found: found.tolerances)
        words += f": {worst}"
    elif one.words:
        words += f": {printable(one.words, _WIDTH)}"
    return recorded.name, recorded.door, status_name(response), now, words


def status_name(response: PlanAnswer | None) -> str:
    """Return the name or number of an answer's status; `-` if there is no answer."""
    if response is None:
        return "-"
    code = response.status.code
    return Status(code).name if code in iter(Status) else f"code {code}"


def _details(replayed: Sequence[Replayed]) -> Iterator[str]:
    """Yield the lines below the table, for what does not fit into it."""
    for one in replayed:
        yield from _changed_task(one)
        is_different = one.verdict is Verdict.DIFFERENT
        if len(one.words) > _WIDTH or (is_different and len(one.differences) > 1):
            yield f"\n{one.recorded.name}: {one.words or one.verdict.value}"
        if is_different and len(one.differences) > 1:
            for found in sorted(one.differences, key=lambda found: -found.tolerances):
                yield f"  {found}"
    tolerated: dict[str, Difference] = {}
    for one in replayed:
        for found in one.differences if one.verdict is Verdict.WITHIN_TOLERANCE else ():
            largest = tolerated.get(found.quantity, found)
            tolerated[found.quantity] = max(largest, found, key=lambda found: found.amount)
    if tolerated:
        yield "\nwithin tolerance, the largest of all requests:"
        yield from (f"  {found}" for found in tolerated.values())


def _changed_task(one: Replayed) -> Iterator[str]:
    """Yield a note if the task differs from the recorded one, and both are known."""
    if one.answer is None or one.recorded.response is None:
        return
    then, now = one.recorded.response.task_digest, one.answer.task_digest
    if then and now and then != now:
        yield (
            f"note: {one.recorded.name}: what was planned is not what was recorded: the task's "
            f"digest was {then}, is {now}"
        )


def _result(answer: PlanAnswer) -> str:
    if answer.status.code == Status.SOLVED:
        return f"a plan, in {answer.solver.solve_time:.2f} s on this machine"
    return f"no plan: {answer.status.message}"
