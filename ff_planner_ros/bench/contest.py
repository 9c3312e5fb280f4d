"""Methods on the data set: each in its own process, judged by the scorer, in one table.

A method is a name of `ENTRANTS`, a Python file with a function `answer(scenario, seconds)` that
returns an answer as a dictionary, or a command line that reads {scenario} and writes {answer}.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import multiprocessing
import resource
import shlex
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.bench.dataset import names
from ff_planner_ros.bench.scorer.score import Score, score
from ff_planner_ros.errors import InvalidInput, Status

ENTRANTS = ("ours", "direct", "fixed_base", "zero_momentum", "rrt_connect")
# A process is ended by the system after so many times its processor time. The clock ends only what
# waits: the machine may have other work, and starting takes time [s].
_TOO_LONG, _PATIENCE, _TO_START = 2.0, 20.0, 120.0
# Scenarios that one process of a method plans in turn.
_IN_TURN = 10

Answers: TypeAlias = Callable[[Path, float], Any]


@dataclass(frozen=True)
class Result:
    """What became of one scenario."""

    method: str
    kind: str
    index: int
    seconds: float  # processor time
    score: Score


def results(
    methods: Sequence[str], directory: Path, each: int, seconds: float, workers: int
) -> Iterator[Result]:
    """Let methods plan the first scenarios of each class, and judge them.

    Args:
        each: Scenarios of each class.
        seconds: Processor time that a method has for each.

    Raises:
        InvalidInput: A method is not known.
    """
    for method in methods:
        _require_known(method)
    which = list(names(each))
    rounds = [which[i : i + _IN_TURN] for i in range(0, len(which), _IN_TURN)]
    tasks = [(method, one) for one in rounds for method in methods]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for done in pool.map(partial(_in_turn, directory, seconds), tasks):
            yield from done


def _require_known(method: str) -> None:
    if method == "rrt_connect" and importlib.util.find_spec("ompl") is None:
        allowed = "it needs OMPL: pip install 'ff_planner_ros[benchmark]'"
        raise InvalidInput(Status.UNSUPPORTED, "--method", method, allowed)
    if method in ENTRANTS or (method.endswith(".py") and Path(method).is_file()):
        return
    if "{scenario}" in method and "{answer}" in method:
        return
    allowed = (
        f"it must be {', '.join(ENTRANTS)}, a Python file that is there, or a command line with "
        "{scenario} and {answer}"
    )
    raise InvalidInput(Status.UNSUPPORTED, "--method", method, allowed)


def _in_turn(
    directory: Path, seconds: float, task: tuple[str, list[tuple[str, int]]]
) -> list[Result]:
    """Let a method plan some scenarios; after a death or too long a time it is started anew."""
    method, which = task
    done = list[Result]()
    process: Any = None
    for kind, index in which:
        scenario = directory / "scenarios" / kind / f"{index:04d}.yaml"
        if process is None:
            process, pipe = _started(method, seconds)
        taken, given = _asked(pipe, scenario, seconds)
        if given is None:
            process.kill()
            process.join()
            process = None
            judged = Score(False, ("no answer in time, or the process ended",))
        elif isinstance(given, str):
            judged = Score(False, (given,))
        elif taken > seconds and method != "ours":
            judged = Score(False, (f"it took {taken:.1f} s",))
        else:
            judged = score(scenario, given)
        done.append(Result(method, kind, index, taken, judged))
    if process is not None:
        process.kill()
        process.join()
    return done


def _started(method: str, seconds: float) -> tuple[Any, Connection]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(method, seconds, there))
    process.start()
    there.close()
    return process, here


def _asked(pipe: Connection, scenario: Path, seconds: float) -> tuple[float, Any]:
    """Return processor time and answer; the answer is None if there is none, text if it failed."""
    try:
        pipe.send(scenario)
        if pipe.poll(_PATIENCE * seconds + _TO_START):
            taken, given = pipe.recv()
            return taken, given
    except (EOFError, OSError):
        pass
    return _TOO_LONG * seconds, None


def _serve(method: str, seconds: float, pipe: Connection) -> None:
    """Answer scenarios until the pipe closes."""
    answer: Answers | None = None
    while True:
        try:
            scenario = pipe.recv()
        except EOFError:
            return
        given: Any
        begun = _processor_time()
        try:
            if answer is None:
                answer = _answers_of(method)
                begun = _processor_time()  # loading a library is nobody's planning
            if method != "ours":
                _limit_processor_time(_TOO_LONG * seconds)
            given = json.loads(json.dumps(answer(scenario, seconds)))
        except Exception as error:  # whatever a foreign method raises
            given = f"{type(error).__name__}: {error}"
        pipe.send((_processor_time() - begun, given))


def _limit_processor_time(seconds: float) -> None:
    """Let the system end this process, or one that it starts, after so much more."""
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), most))


def _processor_time() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _answers_of(method: str) -> Answers:
    """Return a method as a function."""
    if method in ENTRANTS:
        known: Answers = importlib.import_module(f"ff_planner_ros.bench.entrants.{method}").answer
        return known
    if "{scenario}" in method:
        return partial(_by_command, method)
    found = importlib.util.spec_from_file_location("foreign_method", method)
    if found is None or found.loader is None:
        raise InvalidInput(Status.UNSUPPORTED, "--method", method, "it must be a Python file")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    given: Answers = module.answer
    return given


def _by_command(method: str, scenario: Path, seconds: float) -> Any:
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "answer.json"
        told = {"{scenario}": str(scenario), "{answer}": str(file), "{seconds}": f"{seconds:g}"}
        words = [told.get(word, word) for word in shlex.split(method)]
        quiet = subprocess.DEVNULL
        subprocess.run(words, stdin=quiet, stdout=quiet, stderr=quiet, timeout=_PATIENCE * seconds)
        return json.loads(file.read_text()) if file.exists() else {"status": "no answer"}


HEADER = (
    *("method", "class", "scenarios", "solved", "processor time, median [s]", "95 % [s]"),
    *("least clearance [mm]", "miss, median [mm]", "worst [mm]"),
    *("joint path / first", "attitude / first"),
)


def rows(done: Sequence[Result]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each method and class; the last two columns compare with the first method.

    Those are medians over what both solve. Clearance is the least of what is solved, the miss that
    of every motion, solved or not.
    """
    first = {(r.kind, r.index): r.score for r in done if r.method == done[0].method}
    for method in dict.fromkeys(r.method for r in done):
        for kind in (*dict.fromkeys(r.kind for r in done), "all"):
            group = [r for r in done if r.method == method and kind in (r.kind, "all")]
            solved = [r for r in group if r.score.solved]
            times = [r.seconds for r in group if np.isfinite(r.seconds)]
            clear = [r.score.clearance for r in solved if r.score.clearance is not None]
            misses = [1e3 * r.score.miss for r in group if r.score.miss is not None]
            both = [(r.score, first[r.kind, r.index]) for r in solved]
            both = [(mine, other) for mine, other in both if other.solved]
            yield (
                *(method, kind, f"{len(group)}", f"{len(solved) / len(group):.1%}"),
                f"{np.median(times):.2f}" if times else "-",
                f"{np.quantile(times, 0.95):.2f}" if times else "-",
                f"{1e3 * min(clear):.2f}" if clear else "-",
                *((f"{np.median(misses):.3f}", f"{max(misses):.3f}") if misses else "--"),
                *(_ratio(both, name) for name in ("joint_path", "attitude")),
            )


def _ratio(both: list[tuple[Score, Score]], name: str) -> str:
    pairs = [(getattr(mine, name), getattr(other, name)) for mine, other in both]
    return f"{np.median([mine / other for mine, other in pairs if other]):.2f}" if pairs else "-"
