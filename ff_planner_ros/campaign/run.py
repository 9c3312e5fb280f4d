"""Running a campaign, from its study to its tables: rows are kept, missing cases are planned."""

from __future__ import annotations

import shutil
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.campaign.cases import (
    Case,
    cases,
    kinds_of_values,
    require_sound,
)
from ff_planner_ros.campaign.cluster import local_cluster, outcomes
from ff_planner_ros.campaign.environment import environment
from ff_planner_ros.campaign.sources import SCENARIO, URDF, Written, require_unique, write
from ff_planner_ros.campaign.study import Study
from ff_planner_ros.campaign.table import (
    Writer,
    below,
    locked,
    plan_schema,
    require_campaign,
)
from ff_planner_ros.campaign.work import Outcome

VERSIONS, PARAMETERS = "versions.json", "parameters.yaml"
CASES = "cases"  # the directory of what a report writes of single cases
# Rows are written when there are so many, or after so long [s]: what a crash can cost.
_MOST_ROWS, _LONGEST = 1000, 20.0


@dataclass(frozen=True)
class Done:
    """The result of running a campaign."""

    cases: int  # number in the study
    rows: int  # of these cases in the table
    other_rows: int  # in the table that are none of the study's cases
    given_up: tuple[str, ...]  # ids of cases on which several workers died


def run_campaign(
    study: Study,
    directory: Path,
    scheduler: str | None = None,
    workers: int | None = None,
    dashboard: bool = False,
) -> Done:
    """Plan every case that has no row in the directory yet.

    Args:
        study: See `load_study`.
        directory: New, empty, or of a campaign of the same software versions, which is continued.
        scheduler: Address of a running scheduler; None: a cluster on this machine.
        workers: Number of this cluster's workers; with a scheduler, number to wait for.
        dashboard: Whether the cluster on this machine offers Dask's dashboard.

    Raises:
        InvalidInput: The study's first cases cannot be read; the directory is of something else;
            no scheduler answers; a worker has other software.
        FfPlannerError: The cluster does not start, or a worker fails.
        OSError: A table cannot be written; what was written before is kept.
    """
    require_unique(source.name for source in study.sources)
    require_sound(study)
    require_campaign(directory, environment(), VERSIONS)
    with locked(directory):
        _keep_sources(study, directory)
        writer = Writer(directory, plan_schema(kinds_of_values(study)))
        wanted = [case.id for case in cases(study)]
        missing = len(set(wanted) - writer.done)
        given_up: list[str] = []
        if missing:
            jobs = (case for case in cases(study) if case.id not in writer.done)
            local = local_cluster(workers, dashboard) if scheduler is None else None
            cluster = local or nullcontext(scheduler)
            with _stop_as_asked(), cluster as address, suppress(KeyboardInterrupt):
                results = outcomes(str(address), jobs, missing, workers or 1)
                given_up = _write_down(results, writer, missing)
        rows = len(set(wanted) & writer.done)
    return Done(len(wanted), rows, len(writer.done) - rows, tuple(given_up))


def _keep_sources(study: Study, directory: Path) -> None:
    """Write all that is needed to plan a case again; generated problems need nothing."""
    for source in study.sources:
        if isinstance(source, Written):
            place = scenario_directory(directory, source.name)
            place.mkdir(parents=True, exist_ok=True)
            for name in (SCENARIO, URDF):
                below(place, name)
            write(source.document, source.urdf, place)
    if study.parameters is not None:
        shutil.copyfile(study.parameters, below(directory, PARAMETERS))


def scenario_directory(directory: Path, source: str) -> Path:
    """Return the directory of a scenario in a campaign, by the name of its source.

    Raises:
        InvalidInput: It would not be below the campaign's directory.
    """
    return below(directory, "scenarios", source)


def _write_down(results: Iterator[list[Outcome] | Case], writer: Writer, missing: int) -> list[str]:
    """Write rows as they come, and return the ids of cases that were given up."""
    given_up = []
    written = time.monotonic()
    try:
        with progress_bar("planning", missing, "plans", per_unit=1) as advance:
            for result in results:
                if isinstance(result, Case):
                    given_up.append(result.id)
                    continue
                advance(writer.add(result))
                if writer.waiting >= _MOST_ROWS or time.monotonic() >= written + _LONGEST:
                    writer.flush()
                    written = time.monotonic()
    finally:
        writer.flush()
    return given_up


@contextmanager
def _stop_as_asked() -> Iterator[None]:
    """Let SIGTERM do what Ctrl-C does: stop, and keep the rows that are there."""

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not in the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
