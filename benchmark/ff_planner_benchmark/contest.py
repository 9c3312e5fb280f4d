"""Methods on the data set: each in its own process, judged by the scorer."""

from __future__ import annotations

import multiprocessing
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from operator import itemgetter
from pathlib import Path
from typing import Any

from ff_planner_benchmark.contest_results import Result
from ff_planner_benchmark.dataset import end_with_parent, names
from ff_planner_benchmark.method_process import TOO_LONG, asked, ended, require_known, started
from ff_planner_benchmark.scorer.score import Score, score
from ff_planner_ros.errors import InvalidInput

# Scenarios that one process of a method plans in turn.
_IN_TURN = 10


def results(
    methods: Sequence[str],
    directory: Path,
    each: int,
    seconds: float,
    workers: int,
    there: Collection[Result] = (),
) -> Iterator[Result]:
    """Let methods plan the first scenarios of each class, and judge them.

    Args:
        each: Scenarios of each class.
        seconds: Processor time that a method has for each.
        there: Results of an earlier run, which are not made again.

    Raises:
        InvalidInput: A method is not known, or cannot be loaded.
    """
    for method in methods:
        require_known(method)
    for method in methods:
        ended(*started(method, seconds))
    known = {(one.method, one.kind, one.index) for one in there}
    which = list(names(each))
    rounds = [which[i : i + _IN_TURN] for i in range(0, len(which), _IN_TURN)]
    tasks = [
        (method, [one for one in some if (method, *one) not in known])
        for some in rounds
        for method in methods
    ]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, end_with_parent) as pool:
        for done in pool.map(partial(_in_turn, directory, seconds), filter(itemgetter(1), tasks)):
            yield from done


def _in_turn(
    directory: Path, seconds: float, task: tuple[str, list[tuple[str, int]]]
) -> list[Result]:
    """Let a method plan some scenarios; after a death or too long a time it is started anew."""
    method, which = task
    done = list[Result]()
    running: tuple[Any, Connection] | None = None
    for kind, index in which:
        scenario = directory / "scenarios" / kind / f"{index:04d}.yaml"
        given: Any = "it cannot be loaded again"
        taken = TOO_LONG * seconds
        with suppress(InvalidInput):
            running = running or started(method, seconds)
            taken, given = asked(running[1], scenario, seconds)
        if given is None and running is not None:
            given, running = ended(*running), None
        if isinstance(given, str):
            judged = Score(False, (given,))
        elif taken > seconds and method != "ours":
            judged = Score(False, (f"it took {taken:.1f} s",))
        else:
            judged = score(scenario, given["answer"])
        done.append(Result(method, kind, index, taken, judged))
    if running is not None:
        ended(*running)
    return done
