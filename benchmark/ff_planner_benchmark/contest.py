"""Methods on the data set: each in its own process, judged by the scorer."""

from __future__ import annotations

import multiprocessing
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import resource_tracker
from operator import itemgetter
from pathlib import Path

from ff_planner_benchmark.contest_results import Result
from ff_planner_benchmark.dataset import end_with_parent, names
from ff_planner_benchmark.method_process import require_known
from ff_planner_benchmark.own_copy import OwnCopy, own_copy
from ff_planner_benchmark.processes import Family
from ff_planner_benchmark.scorer.score import Score, judged
from ff_planner_benchmark.watched import TOO_LONG, Asked, Method
from ff_planner_ros.errors import InvalidInput, Status

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
    """Yield the judged answers of methods to the first scenarios of each class.

    Args:
        directory: Directory of the data set.
        each: Number of scenarios of each class.
        seconds: Processor time that a method has for a scenario [s].
        workers: Number of processes that judge.
        there: Results of an earlier run, which are not made again.

    Raises:
        InvalidInput: A method is not known or cannot be loaded, or a judge was ended from outside.
    """
    for method in methods:
        require_known(method)
    known = {(one.method, one.kind, one.index) for one in there}
    which = list(names(each))
    # Before any method runs, as a method may change the files.
    copies = {
        one: own_copy(directory, *one)
        for one in which
        if any((method, *one) not in known for method in methods)
    }
    rounds = [which[i : i + _IN_TURN] for i in range(0, len(which), _IN_TURN)]
    tasks = [
        (method, [copies[one] for one in some if (method, *one) not in known])
        for some in rounds
        for method in methods
    ]
    context = multiprocessing.get_context("spawn")
    resource_tracker.ensure_running()  # of multiprocessing, which needs it to the end
    judges = Family()
    with ProcessPoolExecutor(workers, context, _end_with_contest) as pool:
        try:
            for _ in pool.map(partial(_require_loads, seconds), methods):
                pass
            for done in pool.map(partial(_judged_in_turn, seconds), filter(itemgetter(1), tasks)):
                yield from done
        except BrokenProcessPool:
            allowed = (
                "a judge was ended from outside, by one of them or for want of memory; let methods "
                "that you do not trust run in a container or as another user"
            )
            judges.end()
            told = ", ".join(methods)
            raise InvalidInput(Status.UNSUPPORTED, "--method", told, allowed) from None
        except BaseException:  # nobody waits for what methods do, and nothing of them stays
            judges.end()
            raise


def _end_with_contest() -> None:
    """Let a judge, and the method that it watches, end with the contest, however that ends."""
    end_with_parent(lambda: Family(of_all=True).end())


def _require_loads(seconds: float, method: str) -> None:
    Method(method, seconds).end("that was all")


def _judged_in_turn(seconds: float, task: tuple[str, list[OwnCopy]]) -> list[Result]:
    """Return a method's judged answers; after its death or a time-out it is started again."""
    method, copies = task
    done = list[Result]()
    running: Method | None = None
    try:
        for copy in copies:
            try:
                loaded = copy.loaded()  # the method has not seen this one yet
                running = running or Method(method, seconds)
            except InvalidInput:
                asked = Asked(TOO_LONG * seconds, None, "it cannot be loaded again")
            except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
                asked = Asked(0.0, None, f"the scenario cannot be read: {type(error).__name__}")
            else:
                with copy.written() as scenario:
                    asked = running.ask(scenario)
            if running is not None and running.has_ended:
                running.end()
                running = None
            if asked.failed is not None:
                score = Score(False, (asked.failed,))
            elif asked.seconds > seconds:
                score = Score(False, (f"it took {asked.seconds:.1f} s",))
            else:
                score = judged(*loaded, asked.answer)
            done.append(Result(method, copy.kind, copy.index, asked.seconds, score))
    finally:
        if running is not None:
            running.end("that was all")
    return done
