"""The command that plans thousands of cases and reports on them: campaign."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

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

REPORT = "report"
_DRAWN = 24  # plans of a report
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
    scheduler_help = "of a Dask cluster, tcp://HOST:8786 (default: a cluster of this machine)"
    campaign.add_argument("--scheduler", metavar="ADDRESS", help=scheduler_help)
    workers_help = "processes (default: one a core); with --scheduler: begin when so many are there"
    campaign.add_argument("--workers", type=int, metavar="N", help=workers_help)
    dashboard_help = "offer Dask's, at port 8787 of this machine (needs bokeh)"
    campaign.add_argument("--dashboard", action="store_true", help=dashboard_help)
    library_help = "make a library of the plans: first guesses for `plan --library DIR`"
    add_output(campaign, "--library", "DIR", library_help, require_directory)
    page_help = "of the report (default: DIR/report.html)"
    add_output(campaign, "--output", "FILE.html", page_help, require_file)
    plans_help = (
        "plan up to N cases again and draw each on a page of its own (default: %(default)s): all, "
        "if they are no more, or else the worst"
    )
    campaign.add_argument("--plans", type=int, default=_DRAWN, metavar="N", help=plans_help)
    case_help = "write the page of this case alone"
    campaign.add_argument("--case", metavar="ID", help=case_help)


def run_campaign(options: Namespace) -> int:
    """Plan the cases of a study, or write the report of a campaign."""
    _require_cluster(options)
    if options.study == Path(REPORT) and options.directory is not None:
        unused = dict.fromkeys(("out", "library", "scheduler", "workers")) | {"dashboard": False}
        refuse_given(options, unused, "it counts where a study is planned, and nothing is here")
        if options.case is not None:
            unused = {"output": None, "plans": _DRAWN}
            refuse_given(options, unused, "not beside --case, which writes one page in DIR/cases")
        with _nothing_lost("the report", options.directory):
            return _report(options)
    if options.directory is not None:
        allowed = f"`ff-planner campaign {REPORT} DIR` or `ff-planner campaign STUDY.yaml`"
        raise InvalidInput(Status.UNSUPPORTED, "argument", options.directory, allowed)
    unused = {"output": None, "plans": _DRAWN, "case": None}
    refuse_given(options, unused, f"it counts for `ff-planner campaign {REPORT} DIR`")
    if options.out is None:
        options.out = options.library
    if options.out is None:
        allowed = "a campaign needs a directory for its tables"
        raise InvalidInput(Status.OUT_OF_RANGE, "--out", "missing", allowed)
    with _nothing_lost("a file of the campaign", options.out):
        return _run(options)


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
    """Plan the cases without a row in a directory, print the result, and return the exit code."""
    require_packages("a campaign")
    from ff_planner_ros.campaign import table
    from ff_planner_ros.campaign.run import run_campaign as run
    from ff_planner_ros.campaign.study import load_study

    study, out = load_study(options.study), options.out
    print_notes(study.notes)
    done = run(study, out, options.scheduler, options.workers, options.dashboard)
    print(f"{out}: {done.rows} of {done.cases} plans are there")
    if done.other_rows:
        print(f"and {done.other_rows} of cases that the study no longer has")
    if options.library is not None and done.rows:
        from ff_planner_ros.campaign.to_library import write_library

        stored = write_library(out, options.library)
        print(f"{options.library}: a library of {stored} plans")
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
