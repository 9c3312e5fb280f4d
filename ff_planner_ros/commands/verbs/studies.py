"""The verbs that tell what to expect: bench, campaign, doctor."""

from __future__ import annotations

from pathlib import Path

from ff_planner_ros.commands.verbs import Add, add_renamed


def add_bench(add: Add) -> None:
    """Add `bench`."""
    bench = add(
        "bench",
        "ff_planner_ros.commands.benchmark:run_benchmark",
        "measure speed and success rate; write the benchmark's data set, or let methods plan it",
    )
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench.add_argument(
        "--scenarios", type=int, metavar="N", help="of each class (default: 200; quick: 4)"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    bench.add_argument("--dataset", type=Path, metavar="DIR", help="written unless it is there")
    bench.add_argument("--seeds", metavar="WHICH", help="public (default), hidden, or a number")
    method_help = "on the data set: all, or ours, rrt_connect, FILE.py, a command (docs/dataset.md)"
    bench.add_argument("--method", action="append", metavar="METHOD", help=method_help)
    seconds_help = "processor time for each answer (default: %(default)g)"
    bench.add_argument("--seconds", type=float, default=10.0, metavar="S", help=seconds_help)
    workers_help = "processes at a time for the data set (default: %(default)s)"
    bench.add_argument("--workers", type=int, default=2, metavar="N", help=workers_help)
    simulate_help = "execute our plans of N scenarios of each class in MuJoCo and in Drake"
    simulate = bench.add_argument("--simulate", type=int, metavar="N", help=simulate_help)
    add_renamed(bench, "--fly", simulate)
    score_help = "judge one answer to a scenario of the data set"
    bench.add_argument(
        "--score", type=Path, nargs=2, metavar=("SCENARIO", "ANSWER"), help=score_help
    )


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
