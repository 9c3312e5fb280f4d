"""The verbs that read bags: replay, report, export, info, recover."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from ff_planner_ros.commands.verbs import Add, add_renamed


def add_replay(add: Add) -> None:
    """Add `replay`."""
    replay = add(
        "replay",
        "ff_planner_ros.commands.bags:replay_bag",
        "plan the requests of a bag again and compare",
        parents=[_bag()],
        description="Plan every request of a bag again: the recorded state, obstacles, parameters "
        "and robot, the same code, no ROS graph. Or ask what if.",
        epilog="Exit code: 0 every answer came again, to the last bit or within tolerance, or is "
        "no function of its problem (BUSY, CANCELLED, ...); 3 one did not, or its problem is not "
        "all in the bag; 2 bad bag.",
    )
    changes = replay.add_argument(
        "--set",
        action="append",
        dest="changes",
        metavar="KEY=VALUE",
        help="what if: plan with this changed and print both answers; may be given several times "
        "(objective.chaser_attitude=1, planner.starts=5, limits.velocity=none, ...; an unknown "
        "key gets the list)",
    )
    add_renamed(replay, "--with", changes)
    replay.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="with --set: write a page that lays the changed plans over the recorded ones",
    )


def add_report(add: Add) -> None:
    """Add `report`."""
    report = add(
        "report",
        "ff_planner_ros.commands.bags:report_run",
        "tell of a run in one HTML file",
        description="One HTML file that needs nothing else: every request with its answer, and of "
        "the plans figures over time, a 3-D view that plays, and what was measured against what "
        "was planned.",
    )
    source_help = "a bag (a directory or .mcap file) or an answer of `plan --json`"
    report.add_argument("source", type=Path, metavar="BAG|JSON", help=source_help)
    report.add_argument(
        "--output", type=Path, metavar="FILE.html", help="default: NAME_report.html, here"
    )
    plans_help = "draw the last N plans, up to 1 MB each (default: 20); the tables tell of all"
    report.add_argument("--plans", type=int, default=20, metavar="N", help=plans_help)


def add_export(add: Add) -> None:
    """Add `export`."""
    summary = "write the plans or the requests of a bag for other tools"
    export = add("export", "ff_planner_ros.commands.bags:export_plans", summary, parents=[_bag()])
    form = export.add_mutually_exclusive_group(required=True)
    form.add_argument("--csv", type=Path, metavar="DIR", help="new directory, a table per plan")
    form.add_argument("--npz", type=Path, metavar="FILE", help="new file of numpy")
    parquet_help = "new file, a row per answer of a bag, or of all bags in a directory"
    form.add_argument("--parquet", type=Path, metavar="FILE", help=parquet_help)
    form.add_argument(
        "--scenarios", type=Path, metavar="DIR", help="new directory, a scenario file per request"
    )


def add_info(add: Add) -> None:
    """Add `info`."""
    info = add(
        "info", "ff_planner_ros.commands.bags:show_bag", "show what is in a bag", parents=[_bag()]
    )
    info.add_argument("--json", action="store_true", help="as JSON, with every answer")


def add_recover(add: Add) -> None:
    """Add `recover`."""
    recover = add(
        "recover",
        "ff_planner_ros.commands.bags:recover_bag",
        "save what a damaged bag still holds",
        parents=[_bag()],
        description="Write everything that can be read of a truncated, killed or damaged bag into "
        "a new one; the old one stays as it is.",
        epilog="Exit code: 0 everything in it was saved, 3 a part of it, 1 nothing, 2 bad input.",
    )
    recover.add_argument(
        "--output", type=Path, metavar="DIR", help="the new bag (default: BAG_recovered beside it)"
    )


def _bag() -> ArgumentParser:
    bag = ArgumentParser(add_help=False)
    bag.add_argument("bag", type=Path, metavar="BAG", help="a directory or .mcap file")
    return bag
