"""The commands that plan thousands of cases and report on them: campaign, map."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import NO_PLAN, SOLVED
from ff_planner_ros.commands.options import (
    Add,
    add_output,
    refuse_given,
    require_directory,
    require_file,
)
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status

if TYPE_CHECKING:
    from ff_planner_ros.campaign.study import Study

REPORT = "report"
_PLANS_OF_A_REPORT, _PLANS_OF_A_MAP = 24, 100
_PLANS = "plans"  # the directory of a campaign's table
MOST_WORKERS = 10_000  # more than a scheduler of Dask's has been seen to bear


def add_campaign(add: Add) -> None:
    """Add `campaign`."""
    campaign = add(
        "campaign",
        run_campaign,
        "plan the thousands of cases of a study, on one machine or a Dask cluster",
        usage="%(prog)s [-h] STUDY.yaml --out DIR [--scheduler ADDRESS] [--workers N]\n"
        "       %(prog)s [-h] report DIR [--output FILE.html] [--plans N | --case ID]",
        description="Plan every case of a study that the directory has no row of yet, into tables "
        "in Parquet; or tell of them on one page.",
        epilog="Exit code: 0 every case has its row, solved or refused; 2 bad input; 3 stopped, or "
        "some cases have none.",
    )
    campaign.add_argument(
        "study", type=Path, metavar="STUDY.yaml|report", help="docs/how_to/campaigns.md"
    )
    campaign.add_argument("directory", type=Path, nargs="?", metavar="DIR", help="of a campaign")
    add_output(campaign, "--out", "DIR", "new, or one to go on with", require_directory)
    _add_cluster(campaign)
    library_help = "make a library of the plans: first guesses for `plan --library DIR`"
    add_output(campaign, "--library", "DIR", library_help, require_directory)
    page_help = "of the report (default: DIR/report.html)"
    add_output(campaign, "--output", "FILE.html", page_help, require_file)
    _add_plans(campaign)
    case_help = "write the page of this case alone"
    campaign.add_argument("--case", metavar="ID", help=case_help)


def add_map(add: Add) -> None:
    """Add `map`."""
    command = add(
        "map",
        run_map,
        "plan a scenario over a grid of two or three quantities, and draw where it has plans",
        description="Plan a scenario at every point of a grid, as a campaign does, and write a "
        "report: where there are plans, what they cost, and what refuses the others. The same "
        "command goes on where it was stopped.",
        epilog="Exit code: 0 every point has its row, solved or refused; 2 bad input; 3 stopped, "
        "or some points have none.",
    )
    command.add_argument("scenario", type=Path, metavar="SCENARIO")
    over_help = (
        "two or three of grasp_time, approach, and KEY=LOW:HIGH:COUNT with any key of a study; "
        "grasp_time is the duration, by itself from half to twice the scenario's; approach turns "
        "the tool about its y axis at the grasp, by itself from -60 to 60 deg; both take a range, "
        "too"
    )
    command.add_argument("--over", required=True, metavar="QUANTITY,QUANTITY", help=over_help)
    add_output(command, "--out", "DIR", "default: NAME_map, here", require_directory)
    _add_cluster(command)
    _add_plans(command, default=_PLANS_OF_A_MAP)


def _add_cluster(command: ArgumentParser) -> None:
    """Add the options of the Dask cluster."""
    scheduler_help = "of a Dask cluster, tcp://HOST:8786 (default: a cluster of this machine)"
    command.add_argument("--scheduler", metavar="ADDRESS", help=scheduler_help)
    workers_help = "processes (default: one a core); with --scheduler: begin when so many are there"
    command.add_argument("--workers", type=int, metavar="N", help=workers_help)
    dashboard_help = "offer Dask's, at port 8787 of this machine (needs bokeh)"
    command.add_argument("--dashboard", action="store_true", help=dashboard_help)


def _add_plans(command: ArgumentParser, default: int = _PLANS_OF_A_REPORT) -> None:
    plans_help = (
        f"plan up to N cases again and draw each on a page of its own (default: {default}): all, "
        "if they are no more, or else the worst"
    )
    command.add_argument("--plans", type=int, default=default, metavar="N", help=plans_help)


def run_campaign(options: Namespace) -> int:
    """Plan the cases of a study, or write the report of a campaign."""
    _require_cluster(options)
    if options.study == Path(REPORT) and options.directory is not None:
        unused = dict.fromkeys(("out", "library", "scheduler", "workers")) | {"dashboard": False}
        refuse_given(options, unused, "it counts where a study is planned, and nothing is here")
        if options.case is not None:
            unused = {"output": None, "plans": _PLANS_OF_A_REPORT}
            refuse_given(options, unused, "not beside --case, which writes one page in DIR/cases")
        with _nothing_lost("the report", options.directory):
            return _report(options)
    if options.directory is not None:
        allowed = f"`ff-planner campaign {REPORT} DIR` or `ff-planner campaign STUDY.yaml`"
        raise InvalidInput(Status.UNSUPPORTED, "argument", options.directory, allowed)
    unused = {"output": None, "plans": _PLANS_OF_A_REPORT, "case": None}
    refuse_given(options, unused, f"it counts for `ff-planner campaign {REPORT} DIR`")
    if options.out is None:
        options.out = options.library
    if options.out is None:
        allowed = "a campaign needs a directory for its tables"
        raise InvalidInput(Status.OUT_OF_RANGE, "--out", "missing", allowed)
    with _nothing_lost("a file of the campaign", options.out):
        return _run(options)


def run_map(options: Namespace) -> int:
    """Plan a scenario over a grid, and write the report."""
    _require_cluster(options)
    require_packages("a map")
    from ff_planner_ros.campaign.study import study_of
    from ff_planner_ros.campaign.variations import grid_over
    from ff_planner_ros.common.yaml_file import read_yaml

    scenario: Path = options.scenario
    grid = grid_over(options.over, read_yaml(scenario))
    study = study_of({"scenarios": [scenario.name], "variations": {"grid": grid}}, scenario.parent)
    options.directory = options.out or Path(f"{options.scenario.stem}_map")
    with _nothing_lost("a file of the map", options.directory):
        code = _planned(study, options.directory, options)
        options.output, options.case = None, None
        return _report(options) or code


def _require_cluster(options: Namespace) -> None:
    """Refuse a number of workers out of range, and a dashboard without bokeh."""
    if options.workers is not None and not 1 <= options.workers <= MOST_WORKERS:
        allowed = f"it must be from 1 to {MOST_WORKERS}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--workers", options.workers, allowed)
    if options.dashboard and options.scheduler is not None:
        allowed = "it is of a cluster on this machine: a scheduler has its own"
        raise InvalidInput(Status.UNSUPPORTED, "--dashboard", "asked for", allowed)
    if options.dashboard and find_spec("bokeh") is None:
        allowed = "it needs bokeh: pip install bokeh"
        raise InvalidInput(Status.UNSUPPORTED, "--dashboard", "asked for", allowed)


@contextmanager
def _nothing_lost(what: str, directory: Path) -> Iterator[None]:
    """Add what could not be written to an error that names no file, as on a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or not error.strerror:
            raise
        words = f"{error.strerror}: {what} could not be written; the plans in {directory} are kept"
        raise OSError(error.errno, words) from None


def _run(options: Namespace) -> int:
    require_packages("a campaign")
    from ff_planner_ros.campaign.study import load_study

    return _planned(load_study(options.study), options.out, options, options.library)


def _planned(study: Study, out: Path, options: Namespace, library: Path | None = None) -> int:
    """Plan the cases without a row in a directory, print the result, and return the exit code."""
    from ff_planner_ros.campaign import table
    from ff_planner_ros.campaign.run import run_campaign as run

    print_notes(study.notes)
    done = run(study, out, options.scheduler, options.workers, options.dashboard)
    print(f"{out}: {done.rows} of {done.cases} plans are there")
    if done.other_rows:
        print(f"and {done.other_rows} of cases that the study no longer has")
    if library is not None and done.rows:
        from ff_planner_ros.campaign.to_library import write_library

        stored = write_library(out, library)
        print(f"{library}: a library of {stored} plans")
    if done.rows == done.cases:
        print(f"results {table.digest_of(table.read_plans(out))}")
        return SOLVED
    for case in done.given_up:
        print(f"ff-planner: case {case}: every worker that planned it died", file=sys.stderr)
    print("ff-planner: the same command plans what is missing", file=sys.stderr)
    return NO_PLAN


def _report(options: Namespace) -> int:
    require_packages("a campaign")
    from ff_planner_ros.report.study.page import save_campaign_page, save_case_page

    if options.plans < 0:
        allowed = "it must not be negative; 0 draws none"
        raise InvalidInput(Status.OUT_OF_RANGE, "--plans", options.plans, allowed)
    if options.case is not None:
        print(save_case_page(options.directory, options.case))
        return SOLVED
    page, notes = save_campaign_page(options.directory, options.output, options.plans)
    print_notes(notes)
    print(page)
    return SOLVED


def is_campaign(directory: Path) -> bool:
    """Tell whether a path is the directory of a campaign, or of a map."""
    return (directory / _PLANS).is_dir()


def require_packages(what: str) -> None:
    """Refuse if the packages of the extra `campaign` are not installed.

    Args:
        what: Name of what needs them, for the error.

    Raises:
        FfPlannerError: One is missing.
    """
    try:
        import cryptography  # noqa: F401
        import distributed  # noqa: F401
        import pyarrow  # noqa: F401
    except ModuleNotFoundError as error:
        raise FfPlannerError(
            Status.UNSUPPORTED,
            f"{what} needs {error.name}: pip install 'ff_planner_ros[campaign]', or where this "
            "package came without pip, pip install cryptography distributed pyarrow",
        ) from None
