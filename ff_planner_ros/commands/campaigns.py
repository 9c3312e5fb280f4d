"""The command that plans thousands of cases, and tells of them."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from ff_planner_ros.commands import NO_PLAN, SOLVED
from ff_planner_ros.commands.options import Add
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status

REPORT = "report"
MOST_WORKERS = 10_000  # more than a scheduler of Dask's has been seen to bear


def add_campaign(add: Add) -> None:
    """Add `campaign`."""
    campaign = add(
        "campaign",
        run_campaign,
        "plan the thousands of cases of a study, on one machine or a Dask cluster",
        usage="%(prog)s [-h] STUDY.yaml --out DIR [--scheduler ADDRESS] [--workers N]\n"
        "       %(prog)s [-h] report DIR [--output FILE.html]",
        description="Plan every case of a study that the directory has no row of yet, into tables "
        "in Parquet; or tell of them on one page.",
        epilog="Exit code: 0 every case has its row, solved or refused; 2 bad input; 3 stopped, or "
        "some cases have none.",
    )
    campaign.add_argument(
        "study", type=Path, metavar="STUDY.yaml|report", help="docs/how_to/campaigns.md"
    )
    campaign.add_argument("directory", type=Path, nargs="?", metavar="DIR", help="of a campaign")
    campaign.add_argument("--out", type=Path, metavar="DIR", help="new, or one to go on with")
    library_help = "make a library of the plans: first guesses for `plan --library DIR`"
    campaign.add_argument("--library", type=Path, metavar="DIR", help=library_help)
    scheduler_help = "of a Dask cluster, tcp://HOST:8786 (default: a cluster of this machine)"
    campaign.add_argument("--scheduler", metavar="ADDRESS", help=scheduler_help)
    workers_help = "processes (default: one a core); with --scheduler: begin when so many are there"
    campaign.add_argument("--workers", type=int, metavar="N", help=workers_help)
    dashboard_help = "offer Dask's, at port 8787 of this machine (needs bokeh)"
    campaign.add_argument("--dashboard", action="store_true", help=dashboard_help)
    page_help = "of the report (default: DIR/report.html)"
    campaign.add_argument("--output", type=Path, metavar="FILE.html", help=page_help)


def run_campaign(options: Namespace) -> int:
    """Plan the cases of a study, or tell of those that are planned."""
    if options.study == Path(REPORT) and options.directory is not None:
        with _nothing_lost("the report", options.directory):
            return _report(options)
    if options.directory is not None:
        allowed = f"`ff-planner campaign {REPORT} DIR` or `ff-planner campaign STUDY.yaml`"
        raise InvalidInput(Status.UNSUPPORTED, "argument", options.directory, allowed)
    if options.out is None:
        options.out = options.library
    if options.out is None:
        allowed = "a campaign needs a directory for its tables"
        raise InvalidInput(Status.OUT_OF_RANGE, "--out", "missing", allowed)
    if options.workers is not None and not 1 <= options.workers <= MOST_WORKERS:
        allowed = f"it must be from 1 to {MOST_WORKERS}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--workers", options.workers, allowed)
    with _nothing_lost("a file of the campaign", options.out):
        return _run(options)


@contextmanager
def _nothing_lost(what: str, directory: Path) -> Iterator[None]:
    """Say what could not be written where the system names no file, as on a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or not error.strerror:
            raise
        words = f"{error.strerror}: {what} could not be written; the plans in {directory} are kept"
        raise OSError(error.errno, words) from None


def _run(options: Namespace) -> int:
    require_packages("a campaign")
    if options.dashboard and find_spec("bokeh") is None:
        allowed = "it needs bokeh: pip install bokeh"
        raise InvalidInput(Status.UNSUPPORTED, "--dashboard", "asked for", allowed)
    from ff_planner_ros.campaign import table
    from ff_planner_ros.campaign.run import run_campaign as run
    from ff_planner_ros.campaign.study import load_study

    study = load_study(options.study)
    print_notes(study.notes)
    done = run(study, options.out, options.scheduler, options.workers, options.dashboard)
    print(f"{options.out}: {done.rows} of {done.cases} plans are there")
    if done.other_rows:
        print(f"and {done.other_rows} of cases that the study no longer has")
    if options.library is not None and done.rows:
        from ff_planner_ros.campaign.to_library import write_library

        stored = write_library(options.out, options.library)
        print(f"{options.library}: a library of {stored} plans")
    if done.rows == done.cases:
        print(f"results {table.digest_of(table.read_plans(options.out))}")
        return SOLVED
    for case in done.given_up:
        print(f"ff-planner: case {case}: every worker that planned it died", file=sys.stderr)
    print("ff-planner: the same command plans what is missing", file=sys.stderr)
    return NO_PLAN


def _report(options: Namespace) -> int:
    require_packages("a campaign")
    from ff_planner_ros.report.campaign_page import save_campaign_page

    print(save_campaign_page(options.directory, options.output))
    return SOLVED


def require_packages(what: str) -> None:
    """Refuse where the extra is not installed.

    Args:
        what: Needs it.

    Raises:
        FfPlannerError: It is not.
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
