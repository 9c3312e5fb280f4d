"""The commands that read bags: replay, report, export, info, recover."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from ff_planner_ros.arrays import finite_number
from ff_planner_ros.commands.planning import SOLVED, print_notes
from ff_planner_ros.errors import InvalidInput, Status


def replay_bag(options: argparse.Namespace) -> int:
    """Plan the requests of a bag again, or with changes, or play the bag into ROS."""
    only_published = {"--rate": options.rate, "--topics": options.topics, "--clock": options.clock}
    if options.publish:
        if options.report is not None:
            allowed = "it goes with --with, and not with --publish"
            raise InvalidInput(Status.OUT_OF_RANGE, "--report", options.report, allowed)
        if options.changes:
            allowed = "a bag is published as it is: leave out --with or --publish"
            raise InvalidInput(Status.OUT_OF_RANGE, "--with", options.changes[0], allowed)
        from ff_planner_ros.runs.publish import publish_bag

        rate = 1.0 if options.rate is None else finite_number("--rate", options.rate, above=0.0)
        return publish_bag(options.bag, rate, options.topics or (), options.clock)
    for name, value in only_published.items():
        if value:
            raise InvalidInput(Status.OUT_OF_RANGE, name, value, "it goes with --publish")
    if options.changes:
        from ff_planner_ros.runs.what_if import print_what_if

        return print_what_if(options.bag, options.changes, options.report)
    if options.report is not None:
        allowed = "it goes with --with: `ff-planner report` shows a bag as it is"
        raise InvalidInput(Status.OUT_OF_RANGE, "--report", options.report, allowed)
    from ff_planner_ros.runs.replay import print_replay

    return print_replay(options.bag)


def report_run(options: argparse.Namespace) -> int:
    """Write one HTML file on a run or a plan."""
    from ff_planner_ros.runs.report import report_of_answer
    from ff_planner_ros.runs.report_page import save_page

    if options.plans < 0:
        allowed = "it must not be negative; 0 draws none"
        raise InvalidInput(Status.OUT_OF_RANGE, "--plans", options.plans, allowed)
    source: Path = options.source
    if source.suffix == ".json":
        report = report_of_answer(source)
    else:
        from ff_planner_ros.runs.report_of_bag import report_of_bag

        report = report_of_bag(source, options.plans)
    output = options.output or Path(f"{source.resolve().stem}_report.html")
    save_page(report, output)
    print_notes(report.notes)
    print(f"{output}  {report.counts}, {output.stat().st_size / 1e6:.1f} MB")
    return SOLVED


def export_plans(options: argparse.Namespace) -> int:
    """Write the plans of a bag, or its requests as scenario files."""
    notes: Sequence[str]
    if options.scenarios is not None:
        from ff_planner_ros.runs.export_scenarios import export_scenarios

        notes = export_scenarios(options.bag, options.scenarios)
    else:
        from ff_planner_ros.bag.export import export_csv, export_npz

        if options.csv is not None:
            notes = export_csv(options.bag, options.csv)
        else:
            notes = export_npz(options.bag, options.npz)
    print_notes(notes)
    return SOLVED


def show_bag(options: argparse.Namespace) -> int:
    """Show what is in a bag, to people or to programs."""
    from ff_planner_ros.bag.info import bag_document, info

    if options.json:
        print(json.dumps(bag_document(options.bag), indent=2))
    else:
        for line in info(options.bag):
            print(line)
    return SOLVED


def recover_bag(options: argparse.Namespace) -> int:
    """Save what a damaged bag still holds."""
    from ff_planner_ros.bag.recover import print_recovery

    return print_recovery(options.bag, options.output)
