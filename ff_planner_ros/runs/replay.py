"""Replay of a bag: plans every recorded task again, and compares the answers."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from ff_planner_ros.bag.exchanges import WITHOUT_EXCHANGES, Exchange, exchange_count, exchanges
from ff_planner_ros.bag.plans import status_name
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.provenance import PROVENANCE, versions
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.shown import printable
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import BagError, FfPlannerError, InvalidInput, Status
from ff_planner_ros.messages.exchange_words import REFUSED_EARLY
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.runs.differences import Difference, differences, is_cut

ALL_SAME, DIFFERS = 0, 3

# Answers that depend on more than the task, which need not get them again.
_NO_FUNCTIONS_OF_THE_TASK = {
    Status.BUSY: "another request was being planned",
    Status.CANCELLED: "its client cancelled it",
    Status.PREEMPTED: "a newer request took its place",
    Status.NOT_ACTIVE: "the node was not active",
    Status.SHUT_DOWN: "the node was shut down",
    Status.SOLVER_DIED: "the solver process died",
    Status.CLOCK_JUMPED: "the node's clock jumped back",
}
_WIDTH = 80  # of words in a table


class Verdict(StrEnum):
    """Result of a request's replay."""

    IDENTICAL = "identical"
    WITHIN_TOLERANCE = "within tolerance"
    DIFFERENT = "DIFFERENT"
    WITHOUT_CLOCK = "without a clock"  # the recorded refusal depended on time
    NOT_PLANNED = "not planned"  # it was refused before there was a task, or for another's sake
    NOT_READ = "NOT READ"  # the bag lacks a part of the task or of the answer


@dataclass(frozen=True, eq=False)
class Replayed:
    """A request whose task was planned again."""

    exchange: Exchange
    verdict: Verdict
    again: Plan | FfPlannerError | None  # the new answer; None: it was not planned
    words: str  # reason for the verdict; may be empty
    differences: tuple[Difference, ...]  # from the recorded answer
    planning_time: float  # wall-clock time of planning alone [s]


def print_replay(bag: Path) -> int:
    """Replay a bag, print the verdicts, and return the exit code: ALL_SAME or DIFFERS.

    Raises:
        BagError: The bag cannot be read, or holds nothing to replay.
    """
    begun = time.perf_counter()
    with open_bag(bag) as opened:
        replayed = [replay(one) for one in replayable(opened)]
        notes = opened.notes
    planning = sum(one.planning_time for one in replayed)
    total = time.perf_counter() - begun
    print_table(
        f"Replay of {bag}",
        ("request", "interface", "recorded", "replayed", "verdict"),
        map(_row, replayed),
    )
    for line in [*_details(replayed), *_version_lines(replayed), *(f"note: {n}" for n in notes)]:
        print(line)
    counts = ", ".join(
        f"{number} {verdict}"
        for verdict in Verdict
        if (number := sum(one.verdict is verdict for one in replayed))
    )
    print(f"\n{counts}; planning took {planning:.2f} s of {total:.2f} s")
    fatal = (Verdict.DIFFERENT, Verdict.NOT_READ)
    return DIFFERS if any(one.verdict in fatal for one in replayed) else ALL_SAME


def replayable(bag: Bag) -> Iterator[Exchange]:
    """Yield the requests of a bag to plan, with a progress bar.

    Raises:
        BagError: The bag has none, or a baseline planned them.
    """
    method = bag.metadata.get(PROVENANCE, {}).get("method", OPTIMAL)
    if method != OPTIMAL:
        words = f"its requests were planned by a baseline, --method {method}"
        raise BagError(f"bag {bag.path} cannot be planned again: {words}")
    if not (count := exchange_count(bag)):
        raise BagError(f"bag {bag.path} cannot be planned again: {WITHOUT_EXCHANGES}")
    with progress_bar("planning", count, "exchanges", per_unit=1) as progress:
        for one in exchanges(bag):
            yield one
            progress(1 + bool(one.asked_ns and one.answered_ns))


def replay(exchange: Exchange) -> Replayed:
    """Plan a recorded task again, without time limits, and compare the answers."""
    then = exchange.status
    if then in _NO_FUNCTIONS_OF_THE_TASK:
        return _not_planned(exchange, Verdict.NOT_PLANNED, _NO_FUNCTIONS_OF_THE_TASK[then])
    if exchange.answer is not None and not exchange.task:
        return _not_planned(exchange, Verdict.NOT_PLANNED, REFUSED_EARLY)
    try:
        task = exchange.planned_task()
    except InvalidInput as error:
        return _not_planned(exchange, Verdict.NOT_READ, str(error))
    begun = time.perf_counter()
    again = answer_to(task)
    took = time.perf_counter() - begun
    now = Status.SOLVED if isinstance(again, Plan) else again.status
    found = list[Difference]()
    if then is Status.TOO_LATE or (then is Status.TIMED_OUT and not is_cut(task)):
        verdict, words = Verdict.WITHOUT_CLOCK, status_name(now)
    elif now != then:
        verdict, words = Verdict.DIFFERENT, again.message if isinstance(again, Plan) else str(again)
    else:
        verdict, words = Verdict.IDENTICAL, _changed_digest(exchange, task)
        try:
            found = differences(exchange.answer, task, again)
        except (AttributeError, ValueError, LookupError, TypeError) as error:
            verdict, words = Verdict.DIFFERENT, f"the recorded answer is damaged: {error}"
        if found:
            is_tolerable = all(one.is_tolerable for one in found)
            verdict = Verdict.WITHIN_TOLERANCE if is_tolerable else Verdict.DIFFERENT
    return Replayed(exchange, verdict, again, words, tuple(found), took)


def _changed_digest(exchange: Exchange, task: PlanningTask) -> str:
    told = str(value_at(exchange.answer, "task_digest", ""))
    return "" if told in ("", task.digest) else f"digest of the task was {told}, is {task.digest}"


def _not_planned(exchange: Exchange, verdict: Verdict, words: str) -> Replayed:
    return Replayed(exchange, verdict, None, words, (), 0.0)


def answer_to(task: PlanningTask) -> Plan | FfPlannerError:
    """Return the plan of a task, or why there is none."""
    try:
        return perform(task)
    except FfPlannerError as error:
        return error
    except Exception as error:  # as the node answers what nobody foresaw
        return FfPlannerError(Status.INTERNAL_ERROR, f"{type(error).__name__}: {error}")


def _version_lines(replayed: Sequence[Replayed]) -> Iterator[str]:
    """Yield a line for each version that differs from a recorded one."""
    now = versions()
    for recorded in dict.fromkeys(one.exchange.versions for one in replayed):
        try:
            before: Any = json.loads(recorded)
            changed = {name: before.get(name, "unknown") for name in now}
        except (ValueError, AttributeError):
            yield "note: the bag does not say with which versions it was recorded"
            continue
        for name, then in changed.items():
            if then != now[name]:
                yield f"version: {name} was {then}, is {now[name]}"


def _row(one: Replayed) -> tuple[str, ...]:
    words = one.verdict.value
    if one.differences:
        worst = max(one.differences, key=lambda found: found.tolerances)
        words += f": {worst}"
    if one.words:
        words += f": {printable(one.words, _WIDTH)}"
    exchange = one.exchange
    now = Status.SOLVED if isinstance(one.again, Plan) else getattr(one.again, "status", None)
    return (
        printable(exchange.plan_id, _WIDTH),
        printable(exchange.interface, _WIDTH),
        "-" if exchange.answer is None else status_name(int(exchange.answer.status.code)),
        "-" if now is None else now.name,
        words,
    )


def _details(replayed: Sequence[Replayed]) -> Iterator[str]:
    """Yield the lines below the table, for what does not fit into it."""
    for one in replayed:
        is_different = one.verdict is Verdict.DIFFERENT
        if len(one.words) > _WIDTH or (is_different and len(one.differences) > 1):
            yield f"\n{one.exchange.plan_id}: {one.words or one.verdict.value}"
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
