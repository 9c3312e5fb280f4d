"""The verbs that tell what to expect: bench, campaign, doctor."""

from __future__ import annotations

from argparse import SUPPRESS, Action, ArgumentParser
from pathlib import Path
from typing import Any

from ff_planner_ros.commands import BAD_INPUT
from ff_planner_ros.commands.verbs import Add


def add_bench(add: Add) -> None:
    """Add `bench`."""
    bench = add(
        "bench",
        "ff_planner_ros.commands.bench:run_benchmark",
        "measure speed and success rate",
    )
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench.add_argument(
        "--scenarios", type=int, metavar="N", help="of each class (default: 200; quick: 4)"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    bench.add_argument("--dataset", "--score", action=_Moved, nargs="*", help=SUPPRESS)


class _Moved(Action):
    """An option that is a command of another program now, and says so for another version."""

    def __call__(self, parser: ArgumentParser, *given: Any) -> None:
        where = "ff-planner-benchmark: see docs/dataset.md"
        parser.exit(BAD_INPUT, f"ff-planner: {given[2]} is now a command of {where}\n")


def add_campaign(add: Add) -> None:
    """Add `campaign`."""
    campaign = add(
        "campaign",
        "ff_planner_ros.commands.campaigns:run_campaign",
        "plan the thousands of cases of a study, on one machine or a Dask cluster",
        usage="%(prog)s [-h] STUDY.yaml --out DIR [--scheduler ADDRESS] [--workers N]\n"
        "       %(prog)s [-h] report DIR [--output FILE.html]",
        description="Plan every case of a study that the directory has no row of yet, into tables "
        "in Parquet; or tell of them on one page.",
        epilog="Exit code: 0 every case has its row, solved or refused; 2 bad input; 3 stopped, or "
        "some cases have none.",
    )
    campaign.add_argument("study", type=Path, metavar="STUDY.yaml|report", help="docs/campaigns.md")
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


def add_doctor(add: Add) -> None:
    """Add `doctor`."""
    doctor = add(
        "doctor",
        "ff_planner_ros.commands.doctor:examine",
        "say what is installed, what is missing, and how fast it plans",
        description="One screen for a report of a defect: versions, extras and the commands that "
        "bring them, the core, ROS, and one timed plan.",
        epilog="Exit code: 0 a plan can be made, 2 none can.",
    )
    doctor.add_argument("--json", type=Path, metavar="FILE", help="write it all")
