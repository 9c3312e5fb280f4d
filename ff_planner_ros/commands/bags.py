"""The commands that read bags: replay, report, export, info, recover."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from ff_planner_ros.commands import SOLVED
from ff_planner_ros.commands.campaigns import require_packages
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.report.fleet import (
    bags_below,
    fleet_document,
    fleet_lines,
    read_fleet,
    success_words,
)


def replay_bag(options: argparse.Namespace) -> int:
    """Plan the requests of a bag again, or with changes."""
    if options.changes:
        from ff_planner_ros.runs.what_if import print_what_if

        found = print_what_if(options.bag, options.changes)
        if options.report is not None:
            from ff_planner_ros.report.from_changes import report_of_changes
            from ff_planner_ros.report.run_page import save_page

            save_page(report_of_changes(found), options.report)
            print(f"{options.report}  {options.report.stat().st_size / 1e6:.1f} MB")
        return SOLVED
    if options.report is not None:
        allowed = "it goes with --set: `ff-planner report` shows a bag as it is"
        raise InvalidInput(Status.OUT_OF_RANGE, "--report", options.report, allowed)
    from ff_planner_ros.runs.replay import print_replay

    return print_replay(options.bag)


def report_run(options: argparse.Namespace) -> int:
    """Write one HTML file on a run or a plan."""
    from ff_planner_ros.report.run_page import save_page
    from ff_planner_ros.report.run_report import report_of_answer

    if options.plans < 0:
        allowed = "it must not be negative; 0 draws none"
        raise InvalidInput(Status.OUT_OF_RANGE, "--plans", options.plans, allowed)
    source: Path = options.source
    if bags_below(source):
        return _report_fleet(source, options)
    if source.suffix == ".json":
        report = report_of_answer(source)
    else:
        from ff_planner_ros.report.from_bag import report_of_bag

        report = report_of_bag(source, options.plans)
    output = options.output or Path(f"{source.resolve().stem}_report.html")
    save_page(report, output)
    print_notes(report.notes)
    print(f"{output}  {report.counts}, {output.stat().st_size / 1e6:.1f} MB")
    return SOLVED


def _report_fleet(directory: Path, options: argparse.Namespace) -> int:
    from ff_planner_ros.report.fleet_page import save_fleet_page

    output = options.output or Path(f"{directory.resolve().name}_report.html")
    fleet = read_fleet(directory)
    notes = save_fleet_page(fleet, output, options.plans)
    print_notes([*notes, *(f"skipped: {name}: {why}" for name, why in fleet.skipped)])
    print(f"{output}  {len(fleet.read)} bags, {len(fleet.rows)} requests{success_words(fleet)}")
    return SOLVED


def export_plans(options: argparse.Namespace) -> int:
    """Write the plans of a bag, or its requests as scenario files."""
    notes: Sequence[str]
    if options.parquet is not None:
        return _export_parquet(options)
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


def _export_parquet(options: argparse.Namespace) -> int:
    """Write the answers in one bag or in many as one table."""
    require_packages("a table in Parquet")
    from ff_planner_ros.report.fleet_table import save_fleet_table

    fleet = read_fleet(options.bag)
    save_fleet_table(fleet, options.parquet)
    print_notes([*fleet.notes, *(f"skipped: {name}: {why}" for name, why in fleet.skipped)])
    print(f"{options.parquet}  {len(fleet.read)} bags, {len(fleet.rows)} requests")
    return SOLVED


def show_bag(options: argparse.Namespace) -> int:
    """Show what is in a bag, or come to in a directory of bags, to people or to programs."""
    if bags_below(options.bag):
        fleet = read_fleet(options.bag)
        if options.json:
            print(json.dumps(fleet_document(fleet), indent=2))
        else:
            print(*fleet_lines(fleet), sep="\n")
        return SOLVED
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
