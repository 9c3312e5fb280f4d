"""The commands of `ff-planner-benchmark`."""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Iterable
from dataclasses import asdict
from importlib import import_module
from itertools import chain
from pathlib import Path

from ff_planner_benchmark import contest_results
from ff_planner_benchmark import dataset as data_set
from ff_planner_benchmark.bench.executed import ENGINES
from ff_planner_benchmark.bench.report import BENCH, run_on_one_core
from ff_planner_benchmark.contest import results
from ff_planner_benchmark.gallery import reach as reaches
from ff_planner_benchmark.gallery import run as gallery
from ff_planner_benchmark.gallery.problems import PROBLEMS
from ff_planner_benchmark.method_process import ENTRANTS
from ff_planner_benchmark.scorer import score as scorer
from ff_planner_ros.analysis.json_file import json_text, read_json
from ff_planner_ros.bag.provenance import provenance
from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import InvalidInput, Status

# Scenarios of a class and processes at a time.
_MOST = 10_000
# Rows of a method in the table of reasons.
_REASONS = 8


def bench(options: argparse.Namespace) -> int:
    """Measure speed and success rate of the planner.

    Raises:
        InvalidInput: There is no experiment of a name.
    """
    names = _only(options, dict.fromkeys(one.name for one in BENCH))
    scenarios = (4 if options.quick else 200) if options.scenarios is None else options.scenarios
    _require_in_range("scenarios", scenarios)
    return _run(names, scenarios, options)


def _only(options: argparse.Namespace, known: Iterable[str]) -> list[str]:
    """Return the names that are asked for, or all."""
    every = list(known)
    if unknown := set(options.only or ()).difference(every):
        allowed = f"it must be one of {', '.join(every)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--only", ", ".join(sorted(unknown)), allowed)
    return options.only or every


def published(options: argparse.Namespace) -> int:
    """Plan the problems of the gallery, and write their page.

    Raises:
        InvalidInput: There is no problem of a name.
    """
    names = _only(options, PROBLEMS)
    _require_in_range("goals", options.goals)
    return gallery.run_on_one_core(names, options.goals, options.json, options.page)


def engines(options: argparse.Namespace) -> int:
    """Execute plans of every class in two physics engines, and print the largest deviations."""
    _require_in_range("scenarios", options.scenarios)
    import_module("ff_planner_benchmark.second_engine")  # which says what is missing
    import_module("ff_planner_ros.simulation.verification")
    return _run([ENGINES.name], options.scenarios, options)


def _run(names: Iterable[str], scenarios: int, options: argparse.Namespace) -> int:
    commit = provenance().get("git", "")
    return run_on_one_core(names, options.quick, scenarios, options.json, commit)


def dataset(options: argparse.Namespace) -> int:
    """Write the data set if it is not there, and print whether it is a published one.

    Raises:
        InvalidInput: A file differs from what was written, the set is of other seeds than asked
            for, or the whole set is not the published one.
    """
    _require_in_range("scenarios", options.scenarios)
    _require_in_range("workers", options.workers)
    _limit_threads()
    directory, named = options.directory, options.seeds or "public"
    seed = data_set.seed_of(named)
    if named == data_set.HIDDEN:
        print(f"seed {seed}, drawn now: `--seeds {seed}` writes the same set again")
    is_new = not (directory / data_set.SUMS).exists()
    if is_new:
        begun = time.monotonic()
        found = data_set.write_dataset(directory, seed, options.scenarios, options.workers)
        print(f"{directory}: written in {time.monotonic() - begun:.0f} s")
    else:
        found = data_set.checked(directory)
        _require_there(directory, options.scenarios)
        if options.seeds and not data_set.is_of(directory, seed):
            allowed = f"{directory} was written with other seeds; give another directory"
            raise InvalidInput(Status.UNSUPPORTED, "--seeds", named, allowed)
    wanted = data_set.PUBLISHED.get(named, found)
    if (is_new or options.seeds) and found != wanted and data_set.is_whole(directory):
        allowed = f"that of the {named} seeds is {wanted}, of version {data_set.VERSION}"
        raise InvalidInput(Status.UNSUPPORTED, "hash of the data set", found, allowed)
    _print_hash(found)
    return 0


def contest(options: argparse.Namespace) -> int:
    """Let methods plan the data set; answers in the file of an earlier run are not made again."""
    each, seconds, workers = options.scenarios, options.seconds, options.workers
    _require_in_range("scenarios", each)
    _require_in_range("workers", workers)
    if not (seconds > 0.0 and math.isfinite(seconds)):
        allowed = "it must be positive and finite"
        raise InvalidInput(Status.OUT_OF_RANGE, "--seconds", seconds, allowed)
    _limit_threads()
    kept = contest_results.Kept(options.json, _opened(options.directory, each), seconds)
    asked_for = ((ENTRANTS if one == "all" else (one,)) for one in options.method)
    methods = list(dict.fromkeys(chain.from_iterable(asked_for)))
    there = kept.read()
    if there:
        print(f"{options.json}: {len(there)} answers are there, what is missing is added")
    kept.write(there)  # a file that cannot be written is told now, not after an hour
    done, begun = list(there), time.monotonic()
    for one in results(methods, options.directory, each, seconds, workers, there):
        done.append(one)
        kept.write(done)
    minutes, made = (time.monotonic() - begun) / 60, len(done) - len(there)
    asked = {(method, *one) for method in methods for one in data_set.names(each)}
    done = [one for one in done if (one.method, one.kind, one.index) in asked]
    kinds = list(data_set.CLASSES)
    done.sort(key=lambda one: (methods.index(one.method), kinds.index(one.kind), one.index))
    print_table("Methods on the data set", contest_results.HEADER, list(contest_results.rows(done)))
    why = list(contest_results.reasons(done, _REASONS))
    if why:
        print_table("Why answers do not count", contest_results.REASONS_HEADER, why)
    print(f"\n{made} answers in {minutes:.0f} minutes, {workers} at a time")
    return 0


def score(options: argparse.Namespace) -> int:
    """Judge one answer; exit code 3 if it does not solve the scenario."""
    answer = read_json(options.answer)
    try:
        loaded = scorer.load(options.scenario)
    except (OSError, LookupError, TypeError, ValueError, AttributeError) as error:
        allowed = f"it must be a scenario of the data set: {type(error).__name__}: {error}"
        raise InvalidInput(Status.UNSUPPORTED, "SCENARIO", options.scenario, allowed) from None
    judged = scorer.judged(*loaded, answer)
    print(json_text(asdict(judged), indent=1))
    return 0 if judged.solved else 3


def reach(options: argparse.Namespace) -> int:
    """Add how far the arm of P5 reaches to the gallery's figures, and print it.

    Raises:
        InvalidInput: There are not so many directions.
    """
    count = options.directions
    if not 1 <= count <= len(reaches.directions()):
        allowed = f"it must be from 1 to {len(reaches.directions())}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--directions", count, allowed)
    reaches.write_figures(options.json, count)
    print(*reaches.summary(read_json(options.json)["reach"]), sep="\n")
    return 0


def _require_in_range(name: str, value: int | None) -> None:
    if value is not None and not 1 <= value <= _MOST:
        allowed = f"it must be from 1 to {_MOST}"
        raise InvalidInput(Status.OUT_OF_RANGE, f"--{name}", value, allowed)


def _opened(directory: Path, each: int) -> str:
    """Return the hash of a data set; refuse one with fewer than `each` scenarios of a class."""
    found = data_set.checked(directory)
    _require_there(directory, each)
    _print_hash(found)
    return found


def _require_there(directory: Path, each: int | None) -> None:
    """Refuse a data set with fewer than `each` scenarios of a class (None: whatever it has)."""
    for kind, index in () if each is None else data_set.names(each):
        if not (directory / "scenarios" / kind / f"{index:04d}.yaml").exists():
            allowed = f"it has no {kind}/{index:04d}: it was written with fewer scenarios"
            raise InvalidInput(Status.UNSUPPORTED, "DIR", directory, allowed)


def _print_hash(found: str) -> None:
    names = [name for name, one in data_set.PUBLISHED.items() if one == found]
    words = f"as published: {names[0]}, version {data_set.VERSION}" if names else ""
    print(f"{found}  {words or 'not a published set'}")


def _limit_threads() -> None:
    """Let processes that are started have one thread, for one core, and keep their memory."""
    os.environ.update(PLANNING)
