"""The command that measures: our own benchmark, its data set, methods on it, one answer."""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.one_thread import ONE_THREAD
from ff_planner_ros.text_table import print_table

# Scenarios of each class in the table: within an hour on two cores, ten seconds an answer.
_EACH = 40
# Scenarios of a class and processes at a time.
_MOST = 10_000
# Rows of a method in the table of reasons.
_REASONS = 8


def run_benchmark(options: argparse.Namespace) -> int:
    """Measure speed and success rate, or write the data set, or let methods plan it."""
    _require_in_range(options)
    if options.score is not None:
        return _score(*options.score)
    if options.dataset is None:
        for name in ("method", "seeds", "simulate"):
            if getattr(options, name):
                raise InvalidInput(Status.UNSUPPORTED, f"--{name}", "given", "it needs --dataset")
        from ff_planner_ros.bench.report import run_on_one_core

        return run_on_one_core(options.quick, options.scenarios, options.json)
    _limit_threads()
    found = _require_dataset(options)
    if options.simulate:
        _fly(options)
    return _table(options, found) if options.method else 0


def _require_in_range(options: argparse.Namespace) -> None:
    for name in ("scenarios", "workers", "simulate"):
        value = getattr(options, name)
        if value is not None and not 1 <= value <= _MOST:
            allowed = f"it must be from 1 to {_MOST}"
            raise InvalidInput(Status.OUT_OF_RANGE, f"--{name}", value, allowed)
    if not (options.seconds > 0.0 and math.isfinite(options.seconds)):
        allowed = "it must be positive and finite"
        raise InvalidInput(Status.OUT_OF_RANGE, "--seconds", options.seconds, allowed)


def _score(scenario: Path, answer: Path) -> int:
    """Judge one answer; exit code 3 if it does not solve the scenario."""
    from ff_planner_ros.analysis.json_file import read_json
    from ff_planner_ros.bench.scorer.score import score

    try:
        judged = score(scenario, read_json(answer))
    except (OSError, LookupError, TypeError, ValueError) as error:
        allowed = f"it must be a scenario of the data set: {type(error).__name__}: {error}"
        raise InvalidInput(Status.UNSUPPORTED, "--score", scenario, allowed) from None
    print(json.dumps(asdict(judged), indent=1))
    return 0 if judged.solved else 3


def _require_dataset(options: argparse.Namespace) -> str:
    """Write the data set if it is not there, tell whether it is published, and return its hash.

    Raises:
        InvalidInput: A file is not what was written, the set is of other seeds than asked for, or
            the whole set is not the published one.
    """
    from ff_planner_ros.bench import dataset

    directory, named = options.dataset, options.seeds or "public"
    seed, cores = dataset.seed_of(named), options.workers
    is_new = not (directory / dataset.SUMS).exists()
    if is_new:
        begun = time.monotonic()
        found = dataset.write_dataset(directory, seed, options.scenarios, cores)
        print(f"{directory}: written in {time.monotonic() - begun:.0f} s")
    else:
        found = dataset.checked(directory)
        if options.seeds and not dataset.is_of(directory, seed):
            allowed = f"{directory} was written with other seeds; give another directory"
            raise InvalidInput(Status.UNSUPPORTED, "--seeds", named, allowed)
    wanted = dataset.PUBLISHED.get(named, found)
    if (is_new or options.seeds) and found != wanted and dataset.is_whole(directory):
        allowed = f"that of the {named} seeds is {wanted}"
        raise InvalidInput(Status.UNSUPPORTED, "hash of the data set", found, allowed)
    published = found in dataset.PUBLISHED.values()
    print(f"{found}  {'as published' if published else 'not a published set'}")
    return found


def _table(options: argparse.Namespace, dataset_hash: str) -> int:
    """Let methods plan the data set; answers in the file of an earlier run are taken from there."""
    from ff_planner_ros.bench import contest, contest_results
    from ff_planner_ros.bench.dataset import CLASSES, names
    from ff_planner_ros.bench.method_process import ENTRANTS

    asked_for = ((ENTRANTS if one == "all" else (one,)) for one in options.method)
    methods = list(dict.fromkeys(chain.from_iterable(asked_for)))
    each, seconds, workers = options.scenarios or _EACH, options.seconds, options.workers
    for kind, index in names(each):
        if not (options.dataset / "scenarios" / kind / f"{index:04d}.yaml").exists():
            allowed = f"it has no {kind}/{index:04d}: it was written with fewer scenarios"
            raise InvalidInput(Status.UNSUPPORTED, "--dataset", options.dataset, allowed)
    kept = contest_results.Kept(options.json, dataset_hash, seconds)
    there = kept.read()
    if there:
        print(f"{options.json}: {len(there)} answers are there, what is missing is added")
    kept.write(there)  # a file that cannot be written is told now, not after an hour
    done, begun = list(there), time.monotonic()
    for one in contest.results(methods, options.dataset, each, seconds, workers, there):
        done.append(one)
        kept.write(done)
    minutes, made = (time.monotonic() - begun) / 60, len(done) - len(there)
    asked = {(method, *one) for method in methods for one in names(each)}
    done = [one for one in done if (one.method, one.kind, one.index) in asked]
    kinds = list(CLASSES)
    done.sort(key=lambda one: (methods.index(one.method), kinds.index(one.kind), one.index))
    print_table("Methods on the data set", contest_results.HEADER, list(contest_results.rows(done)))
    why = list(contest_results.reasons(done, _REASONS))
    if why:
        print_table("Why answers do not count", contest_results.REASONS_HEADER, why)
    print(f"\n{made} answers in {minutes:.0f} minutes, {workers} at a time")
    return 0


def _fly(options: argparse.Namespace) -> None:
    from ff_planner_ros.bench.flown import HEADER, flown_rows

    print_table("Plans in two engines", HEADER, list(flown_rows(options.dataset, options.simulate)))


def _limit_threads() -> None:
    """Let every process that is started have one thread: a method has one core."""
    os.environ.update(ONE_THREAD)
