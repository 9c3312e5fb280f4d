"""Evaluation of all bags in a directory: a row per answer, success rate, percentiles."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ff_planner_ros.bag.plans import RecordedPlan, recorded_requests
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.publications import publications
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.shown import printable
from ff_planner_ros.errors import BagError, FfPlannerError, Status
from ff_planner_ros.report.statistics import Group, Rate, Row, grouped

T = TypeVar("T")

# Endings of files that make their directory a bag, even if it is damaged.
_OF_BAGS = (".mcap", ".db3", ".zstd", ".bag")
_METADATA = "metadata.yaml"
_ALL = 10**9  # plans of a bag
# So many bags or more are read by one process a core: to start one takes as long as to read a few.
_FOR_PROCESSES = 24
# Columns beside those of the table of answers: the largest difference between measured and planned
# while the plan ran; none where nothing was measured.
MEASURED = ("measured_joint_off_rad", "measured_chaser_off_m", "measured_ee_off_m")
# Quantities whose percentiles are shown: label, column, factor to the label's unit.
FIGURES = (
    ("solve time [s]", "solve_time_s", 1.0),
    ("clearance [mm]", "min_clearance_m", 1e3),
    ("clearance of bodies [mm]", "min_self_clearance_m", 1e3),
    ("joints off the plan [rad]", MEASURED[0], 1.0),
    ("chaser off the plan [mm]", MEASURED[1], 1e3),
    ("end effector off the plan [mm]", MEASURED[2], 1e3),
)
PERCENTILES = (0, 5, 50, 95, 100)


@dataclass(frozen=True)
class Fleet:
    """The answers in all bags of a directory."""

    directory: Path
    read: Mapping[str, Path]  # bags by name: their paths below the directory, as far as printable
    rows: tuple[Row, ...]  # one for each answer, or request without one
    skipped: tuple[tuple[str, str], ...]  # bags that cannot be read, and why
    copies: tuple[tuple[str, str], ...]  # bags that are copies, and of which bag
    notes: tuple[str, ...]  # problems of the bags that were read
    publications: tuple[Row, ...]  # one for each call of `~/publish_plan`

    @property
    def answers(self) -> Group:
        """All rows as one group."""
        return Group("all", self.rows)

    @property
    def solved(self) -> Rate | None:
        """Rate of requests with a plan; None: there is no request."""
        return self.answers.solved if self.rows else None

    @property
    def causes(self) -> Counter[str]:
        """Number of refusals by status."""
        return self.answers.causes

    def percentiles(self, column: str) -> list[float] | None:
        """Return `PERCENTILES` of a column over plans (solve times: all answers), if known."""
        values = self.answers.values(column, solved_only=column != "solve_time_s")
        values = values[np.isfinite(values)]
        return np.percentile(values, PERCENTILES).tolist() if len(values) else None

    @cached_property
    def runs(self) -> list[Group]:
        """The answers by bag, the worst first.

        Order: lowest rate of solved requests, then largest measured deviation of the end effector,
        then smallest clearance.
        """
        return sorted(grouped(self.rows, "bag"), key=_badness)


def _badness(run: Group) -> tuple[float, float, float]:
    off, clearance = run.values(MEASURED[2]), run.values("min_clearance_m")
    return run.solved.share, -max(off, default=0.0), min(clearance, default=np.inf)


def bags_below(directory: Path) -> list[Path]:
    """Return the bags in a directory and in those below it; none where it is a bag itself."""
    if not directory.is_dir() or _is_bag(directory):
        return []
    found: list[Path] = []
    with suppress(OSError):
        for one in sorted(directory.iterdir()):
            if one.is_dir() and not one.is_symlink():
                found += [one] if _is_bag(one) else bags_below(one)
    return found


def _is_bag(directory: Path) -> bool:
    try:
        names = [file.name for file in directory.iterdir()]
    except OSError:
        return False
    return _METADATA in names or any(name.endswith(_OF_BAGS) for name in names)


def read_fleet(directory: Path) -> Fleet:
    """Read every bag in a directory and below it; bags that cannot be read are skipped.

    Copies of one recording, whose answers are equal to the last bit, count once.

    Raises:
        BagError: None of the bags can be read.
    """
    paths = bags_below(directory) or [directory]
    rows, skipped, notes = list[Row](), list[tuple[str, str]](), list[str]()
    named, read = _named(directory, paths), dict[str, Path]()
    published, copies, seen = list[Row](), list[tuple[str, str]](), dict[str, str]()
    with progress_bar("reading bags", len(paths), unit="bags", per_unit=1) as advance:
        for name, of_bag in _each(named):
            if isinstance(of_bag, str):
                skipped.append((name, of_bag))
            elif of_bag.rows and (first := seen.setdefault(of_bag.told, name)) != name:
                copies.append((name, first))
            else:
                rows += of_bag.rows
                published += of_bag.publications
                notes += [note for note in of_bag.notes if note not in notes]
                read[name] = named[name]
            advance(1)
    if not read:
        why = f"; the first: {skipped[0][1]}" if skipped else ""
        raise BagError(f"of the {len(paths)} bags in {directory} none can be read{why}")
    return Fleet(
        directory,
        read=read,
        rows=tuple(rows),
        skipped=tuple(skipped),
        copies=tuple(copies),
        notes=tuple(notes),
        publications=tuple(published),
    )


@dataclass(frozen=True)
class _Bag:
    """What one bag holds."""

    rows: list[Row]
    publications: list[Row]
    notes: list[str]
    told: str  # all rows without the bag's name: equal for copies


def _named(directory: Path, paths: Sequence[Path]) -> dict[str, Path]:
    """Return the bags by name; two names that look the same when printed get numbers."""
    named = dict[str, Path]()
    for path in paths:
        inside = path.relative_to(directory) if path != directory else path.resolve().name
        name = printable(str(inside))
        others = (f"{name} ({number})" for number in itertools.count(2))
        named[next(one for one in itertools.chain([name], others) if one not in named)] = path
    return named


def _each(named: Mapping[str, Path]) -> Iterator[tuple[str, _Bag | str]]:
    """Yield the name of each bag with what it holds or why it is skipped, in their order."""
    pays = len(named) >= _FOR_PROCESSES
    yield from zip(named, on_all_cores(_bag, pays, named.values(), named), strict=True)


def on_all_cores(work: Callable[..., T], pays: bool, *of_each: Iterable[Any]) -> Iterator[T]:
    """Yield the results of `map(work, *of_each)`; if it `pays`, by one process a core."""
    cores = len(os.sched_getaffinity(0))
    if not pays or cores == 1:
        yield from map(work, *of_each)
        return
    # Not forked: Matplotlib's and ROS's threads may be there.
    context = multiprocessing.get_context("spawn")
    ignore = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for this process
    with ProcessPoolExecutor(cores, context, signal.signal, ignore) as pool:
        yield from pool.map(work, *of_each)


def _bag(path: Path, name: str) -> _Bag | str:
    notes = list[str]()
    try:
        with open_bag(path) as bag:
            asked, published = recorded_requests(bag), publications(bag)
            notes += [f"{name}: {note}" for note in bag.notes]
        rows = list(_rows(path, name, asked, notes))
        told = repr([{**row, "bag": ""} for row in rows])
        return _Bag(rows, [{"bag": name, **one.row()} for one in published], notes, told)
    except FfPlannerError as error:
        return str(error)


def _rows(path: Path, name: str, asked: Sequence[RecordedPlan], notes: list[str]) -> Iterator[Row]:
    solved = any(one.status == Status.SOLVED.name for one in asked)
    measured = _measured(path, name, notes) if solved else {}
    for one in asked:
        off = measured.get(one.plan_id, (None, None, None))
        told = {"bag": name, "solved": one.status == Status.SOLVED.name, **one.row()}
        yield told | dict(zip(MEASURED, off, strict=True))


def _measured(path: Path, name: str, notes: list[str]) -> dict[str, tuple[float, ...]]:
    """Return the values of `MEASURED` by plan id."""
    from ff_planner_ros.report.from_bag import WITHOUT_ROS, report_of_bag

    try:
        report = report_of_bag(path, _ALL)
    except FfPlannerError as error:
        notes.append(f"{name}: nothing measured is compared: {error}")
        return {}
    notes += [note for note in report.notes if note == WITHOUT_ROS]
    found = {}
    for request in report.requests:
        phases = () if request.plan is None else (request.plan, *request.then)
        off = [one.deviations for one in phases if one.deviations is not None]
        if off:
            of_each = ("joint_position", "chaser_position", "ee_position")
            found[request.plan_id] = tuple(
                max(float(getattr(one, name).max()) for one in off) for name in of_each
            )
    return found


def fleet_document(fleet: Fleet) -> dict[str, Any]:
    """Return the evaluation of the bags for JSON."""
    solved = fleet.solved
    return {
        "directory": str(fleet.directory),
        "bags": [*fleet.read],
        "request_count": len(fleet.rows),
        "solved_count": solved.count if solved else 0,
        "success_interval": list(solved.interval) if solved else None,
        "requests_by_status": dict(Counter(row["status"] for row in fleet.rows).most_common()),
        "publications_by_status": dict(publication_counts(fleet)),
        "percentiles": {
            column: dict(zip(map(str, PERCENTILES), found, strict=True))
            for _, column, _ in FIGURES
            if (found := fleet.percentiles(column)) is not None
        },
        "worst_first": [run.name for run in fleet.runs],
        "skipped": dict(fleet.skipped),
        "copies": dict(fleet.copies),
        "notes": list(fleet.notes),
    }


def fleet_lines(fleet: Fleet) -> Iterator[str]:
    """Yield the evaluation of the bags line by line, problems of single bags last."""
    total = len(fleet.read) + len(fleet.skipped) + len(fleet.copies)
    words = f"{len(fleet.skipped)} skipped, {len(fleet.copies)} copies"
    yield f"bags      {total} in {printable(str(fleet.directory))}, {words}"
    yield f"requests  {len(fleet.rows)}{success_words(fleet)}"
    for status, count in fleet.causes.most_common():
        yield f"  {count:9}  {status}"
    if counts := publication_counts(fleet):
        listed = ", ".join(f"{count} {status}" for status, count in counts)
        yield f"publish_plan  {len(fleet.publications)}: {listed}"
    names = ("least", *(f"{share} %" for share in PERCENTILES[1:-1]), "most")
    yield f"{'of plans':32}" + "".join(f"{name:>11}" for name in names)
    for words, column, factor in FIGURES:
        if (found := fleet.percentiles(column)) is not None:
            yield f"  {words:30}" + "".join(f"{factor * value:11.4g}" for value in found)
    yield "worst runs"
    for run in fleet.runs[:10]:
        yield f"  {run.solved.count} of {run.solved.total} solved  {run.name}"
    for name, why in fleet.skipped:
        yield f"skipped: {name}: {printable(why)}"
    for name, first in fleet.copies:
        yield f"copy: {name} is a copy of {first}, and counts once"
    for note in fleet.notes:
        yield f"note: {printable(note)}"


def publication_counts(fleet: Fleet) -> list[tuple[str, int]]:
    """Return status and number of the calls of `~/publish_plan`, the most frequent first."""
    return Counter(str(row["status"]) for row in fleet.publications).most_common()


def success_words(fleet: Fleet) -> str:
    """Return the number and rate of solved requests as text; empty without requests."""
    if fleet.solved is None:
        return ""
    low, high = fleet.solved.interval
    share = f"{percent(fleet.solved.share)}, 95 % interval {percent(low)} to {percent(high)}"
    return f": {fleet.solved.count} solved ({share})"
