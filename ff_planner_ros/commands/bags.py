"""The commands that read bags: replay, report, export, info, recover."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.commands import SOLVED
from ff_planner_ros.commands.campaigns import require_packages
from ff_planner_ros.commands.options import (
    Add,
    add_output,
    refuse_given,
    require_file,
    require_new_directory,
    require_new_file,
)
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import InvalidInput, Status


def add_replay(add: Add) -> None:
    """Add `replay`."""
    replay = add(
        "replay",
        replay_bag,
        "plan the requests of a bag again and compare",
        parents=[_bag()],
        description="Plan every recorded task of a bag again, by the same code and without ROS, "
        "and compare the answers. Or ask what if.",
        epilog="Exit code: 0 every answer recurred, to the last bit or within tolerance, or does "
        "not depend on a task (BUSY, CANCELLED, ...); 3 one did not, or its task is not whole in "
        "the bag; 2 bad bag.",
    )
    replay.add_argument(
        "--set",
        action="append",
        dest="changes",
        metavar="KEY=VALUE",
        help="what if: plan with this changed and print both answers; may be given several times "
        "(objective.chaser_attitude=1, planner.starts=5, limits.velocity=none, ...), by the key "
        "of a scenario",
    )


def replay_bag(options: Namespace) -> int:
    """Plan the requests of a bag again and compare, or plan them with changes."""
    if options.changes:
        from ff_planner_ros.runs.what_if import print_what_if

        print_what_if(options.bag, options.changes)
        return SOLVED
    from ff_planner_ros.runs.replay import print_replay

    return print_replay(options.bag)


_PLANS = 20  # that a report draws


def add_report(add: Add) -> None:
    """Add `report`."""
    report = add(
        "report",
        report_run,
        "tell of a run in one HTML file",
        description="One HTML file that needs nothing else: every request with its answer, and of "
        "the plans figures over time, a 3-D view that plays, and what was measured against what "
        "was planned.",
    )
    source_help = "a bag (a directory or .mcap file) or an answer of `plan --json`"
    report.add_argument("source", type=Path, metavar="BAG|JSON", help=source_help)
    report.add_argument(
        "--output",
        type=Path,
        metavar="FILE.html|DIR",
        help="the page, or a directory for it (default: NAME_report.html, here)",
    )
    plans_help = (
        "draw the last N plans of a bag, up to 1 MB each (default: %(default)s); the tables tell "
        "of all"
    )
    report.add_argument("--plans", type=int, default=_PLANS, metavar="N", help=plans_help)


def report_run(options: Namespace) -> int:
    """Write one HTML file on a run or a plan."""
    from ff_planner_ros.report.fleet import bags_below
    from ff_planner_ros.report.run_page import save_page
    from ff_planner_ros.report.run_report import report_of_answer

    if options.plans < 0:
        allowed = "it must not be negative; 0 draws none"
        raise InvalidInput(Status.OUT_OF_RANGE, "--plans", options.plans, allowed)
    source: Path = options.source
    if bags_below(source):
        return _report_fleet(source, options)
    output = _page(options.output, source)
    if source.suffix == ".json":
        refuse_given(options, {"plans": _PLANS}, "it counts for bags: an answer is drawn whole")
        report = report_of_answer(source)
    else:
        from ff_planner_ros.report.from_bag import report_of_bag

        report = report_of_bag(source, options.plans)
    save_page(report, output)
    print_notes(report.notes)
    print(f"{output}  {report.counts}, {output.stat().st_size / 1e6:.1f} MB")
    return SOLVED


def _page(output: Path | None, source: Path) -> Path:
    """Return the file of a report, which can be written; `output` names it or its directory."""
    if output is None or output.is_dir():
        source = source.resolve()
        # A directory's name has no ending: run.1 and run.2 are two.
        name = source.name if source.is_dir() else source.stem
        output = (output or Path()) / f"{name}_report.html"
    require_file("--output", output)
    return output


def _report_fleet(directory: Path, options: Namespace) -> int:
    from ff_planner_ros.report.fleet import read_fleet, success_words
    from ff_planner_ros.report.fleet_page import save_fleet_page

    output = _page(options.output, directory)
    fleet = read_fleet(directory)
    notes = save_fleet_page(fleet, output, options.plans)
    print_notes([*notes, *(f"skipped: {name}: {why}" for name, why in fleet.skipped)])
    print(f"{output}  {len(fleet.read)} bags, {len(fleet.rows)} requests{success_words(fleet)}")
    return SOLVED


_LABELS: dict[str, str | None] = dict.fromkeys(("plan", "epoch", "object_name"))
_LABELS |= {"object_id": "UNKNOWN", "center_name": "EARTH", "ref_frame": "EME2000"}


def add_export(add: Add) -> None:
    """Add `export`."""
    export = add(
        "export",
        export_plans,
        "write plans or requests for other tools",
        description="Write the plans or the requests of a bag, or the predicted motion of the "
        "chaser in one plan as CCSDS messages.",
    )
    source_help = "a bag (a directory or .mcap file); for --oem and --aem also an answer of `plan`"
    export.add_argument("source", type=Path, metavar="BAG|JSON", help=source_help)
    form = export.add_mutually_exclusive_group()
    directory, file = ("DIR", require_new_directory), ("FILE", require_new_file)
    parquet_help = "new file, a row per answer of a bag, or of all bags in a directory"
    for option, (metavar, require), words in (
        ("--csv", directory, "new directory, a table per plan"),
        ("--npz", file, "new file of numpy"),
        ("--parquet", file, parquet_help),
        ("--scenarios", directory, "new directory, a scenario file per request"),
    ):
        add_output(form, option, metavar, words, require)
    oem_help = "new file, positions as Orbit Ephemeris Message (CCSDS 502.0-B, KVN)"
    add_output(export, "--oem", "FILE", oem_help, require_new_file)
    aem_help = "new file, attitudes as Attitude Ephemeris Message (CCSDS 504.0-B, KVN)"
    add_output(export, "--aem", "FILE", aem_help, require_new_file)
    for option, metavar, words in (
        ("--plan", "ID", "which plan of a bag with several"),
        ("--epoch", "UTC", "of the plan's first point (default: its stamp in a bag)"),
        ("--object-name", "NAME", "(default: the robot's)"),
        ("--object-id", "ID", "such as 1998-067A (default: %(default)s)"),
        ("--center-name", "NAME", "what is at the plan's origin (default: %(default)s)"),
        ("--ref-frame", "FRAME", "axes of the plan (default: %(default)s)"),
    ):
        export.add_argument(option, metavar=metavar, help=words)
    export.set_defaults(**_LABELS)


def export_plans(options: Namespace) -> int:
    """Write the plans of a bag, its requests as scenario files, or a plan as CCSDS messages."""
    notes: Sequence[str]
    if options.oem is not None or options.aem is not None:
        others = dict.fromkeys(("csv", "npz", "parquet", "scenarios"))
        refuse_given(options, others, "not beside --oem and --aem")
        return _export_ccsds(options)
    refuse_given(options, _LABELS, "it counts beside --oem and --aem alone")
    if options.parquet is not None:
        return _export_parquet(options)
    if options.scenarios is not None:
        from ff_planner_ros.runs.export_scenarios import export_scenarios

        notes = export_scenarios(options.source, options.scenarios)
    else:
        from ff_planner_ros.bag.export import export_csv, export_npz

        if options.csv is not None:
            notes = export_csv(options.source, options.csv)
        elif options.npz is not None:
            notes = export_npz(options.source, options.npz)
        else:
            allowed = "one of --csv, --npz, --parquet, --scenarios, --oem and --aem says it"
            raise InvalidInput(Status.UNSUPPORTED, "what to write", "missing", allowed)
    print_notes(notes)
    return SOLVED


def _export_ccsds(options: Namespace) -> int:
    """Write the chaser's motion in one plan as Orbit and Attitude Ephemeris Message."""
    from ff_planner_ros.runs import ccsds
    from ff_planner_ros.runs.planned_motions import PlannedMotion, recorded_motions

    epoch = None if options.epoch is None else ccsds.epoch_ns(options.epoch)
    plans = defaultdict[str, list[PlannedMotion]](list)
    for one in recorded_motions(options.source, print_notes):
        plans[one.plan].append(one)
    name = options.plan or (next(iter(plans)) if len(plans) == 1 else "")
    if name not in plans:
        allowed = f"it must be one of {', '.join(plans)}"
        raise InvalidInput(Status.UNSUPPORTED, "--plan", name or "missing", allowed)
    first, motions = plans[name][0], [(one.robot, one.trajectory) for one in plans[name]]
    called = options.object_name or first.robot.model.name
    labels = ccsds.Labels(called, options.object_id, options.center_name, options.ref_frame)
    segments = ccsds.segments_of(motions, first.start_ns if epoch is None else epoch)
    for file, message in ((options.oem, ccsds.oem), (options.aem, ccsds.aem)):
        if file is not None:
            file.write_text(message(segments, labels), encoding="ascii")
            print(f"{file}  {name}, points: {', '.join(str(len(one.epochs)) for one in segments)}")
    return SOLVED


def _export_parquet(options: Namespace) -> int:
    """Write the answers in one bag or in many as one table."""
    require_packages("a table in Parquet")
    from ff_planner_ros.report.fleet import read_fleet
    from ff_planner_ros.report.fleet_table import publications_beside, save_fleet_table

    fleet = read_fleet(options.source)
    save_fleet_table(fleet, options.parquet)
    print_notes([*fleet.notes, *(f"skipped: {name}: {why}" for name, why in fleet.skipped)])
    print(f"{options.parquet}  {len(fleet.read)} bags, {len(fleet.rows)} requests")
    if fleet.publications:
        print(f"{publications_beside(options.parquet)}  {len(fleet.publications)} of publish_plan")
    return SOLVED


def add_info(add: Add) -> None:
    """Add `info`."""
    info = add("info", show_bag, "show what is in a bag", parents=[_bag()])
    info.add_argument("--json", action="store_true", help="as JSON, with every answer")


def show_bag(options: Namespace) -> int:
    """Print the content of a bag, or the evaluation of a directory of bags, as text or JSON."""
    from ff_planner_ros.report.fleet import bags_below, fleet_document, fleet_lines, read_fleet

    if bags_below(options.bag):
        fleet = read_fleet(options.bag)
        if options.json:
            print(json_text(fleet_document(fleet), indent=2))
        else:
            print(*fleet_lines(fleet), sep="\n")
        return SOLVED
    from ff_planner_ros.bag.info import bag_document, info

    if options.json:
        print(json_text(bag_document(options.bag), indent=2))
    else:
        for line in info(options.bag):
            print(line)
    return SOLVED


def add_recover(add: Add) -> None:
    """Add `recover`."""
    recover = add(
        "recover",
        recover_bag,
        "save what a damaged bag still holds",
        parents=[_bag()],
        description="Write everything that can be read of a truncated, killed or damaged bag into "
        "a new one; the original stays as it is.",
        epilog="Exit code: 0 everything in it was saved, 3 a part of it, 1 nothing, 2 bad input.",
    )
    output_help = "the new bag (default: BAG_recovered beside it)"
    add_output(recover, "--output", "DIR", output_help, require_new_directory)


def recover_bag(options: Namespace) -> int:
    """Save what a damaged bag still holds."""
    from ff_planner_ros.bag.recover import print_recovery

    return print_recovery(options.bag, options.output)


def _bag() -> ArgumentParser:
    bag = ArgumentParser(add_help=False)
    bag.add_argument("bag", type=Path, metavar="BAG", help="a directory or .mcap file")
    return bag
