"""The command `ff-planner`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ff_planner_ros.analysis.plan_json import plan_dictionary, planned_motion, refusal_dictionary
from ff_planner_ros.analysis.summary import plan_rows, robot_rows
from ff_planner_ros.arrays import finite_number
from ff_planner_ros.baselines.artificial_potential_field import artificial_potential_field
from ff_planner_ros.baselines.potential_field import load_parameters
from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.failures import Failure, failures, refusal
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import Objective, PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.settings import PlannerSettings, load_settings
from ff_planner_ros.planning.task import Calls
from ff_planner_ros.robot.model import Robot, read_urdf, robot_from_urdf_text
from ff_planner_ros.robot.urdf import only_leaf_link, root_link
from ff_planner_ros.share import share_directory
from ff_planner_ros.time_budget import time_budget

SOLVED, BAD_INPUT, NO_PLAN = 0, 2, 3

_METHODS = ("optimal", "straight", "apf")
_OBJECTIVES = {"length": Objective(1.0, 0.0), "attitude": Objective(0.0, 1.0)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        Exit code: 0 done, 2 bad input, 3 no plan found, or one that does not come true.
    """
    parser = _parser()
    options, rest = parser.parse_known_args(arguments)
    if rest and options.command is not _node:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    options.rest = rest
    try:
        return int(options.command(options))
    except NoPlanFound as error:
        return _fail(error, NO_PLAN)
    except FfPlannerError as error:
        return _fail(error, BAD_INPUT)
    except OSError as error:
        return _fail(error, BAD_INPUT)


def _fail(error: Exception, code: int) -> int:
    print(f"ff-planner: {error}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ff-planner",
        description="Trajectory planning for free-floating space manipulators.",
        epilog="Exit code: 0 done, 2 bad input, 3 no plan found, or one that does not come true.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    bench = commands.add_parser("bench", help="measure speed and success rate")
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench.add_argument(
        "--scenarios", type=int, metavar="N", help="of each class (default: 200; quick: 4)"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    bench.set_defaults(command=_bench)

    compare = commands.add_parser(
        "compare", help="let every method answer a scenario: tables, figures, 3-D view"
    )
    compare.add_argument("scenario", type=Path, metavar="SCENARIO")
    compare.add_argument(
        "--output", type=Path, default=Path("comparison"), metavar="DIR", help="of the pictures"
    )
    compare.set_defaults(command=_compare)

    demo = commands.add_parser("demo", help="plan the paper's capture over ROS, show the result")
    demo.add_argument("--output", type=Path, default=Path("demo_output"), metavar="DIR")
    demo.set_defaults(command=_demo)

    _add_bag_commands(commands)

    node = commands.add_parser(
        "node", help="run the planner node", epilog="Everything else goes to ROS (--ros-args ...)."
    )
    node.set_defaults(command=_node)

    how_to_plan = _how_to_plan()
    plan_command = commands.add_parser(
        "plan", parents=[how_to_plan], help="plan a scenario file, without ROS"
    )
    plan_command.add_argument("scenario", type=Path, metavar="SCENARIO")
    plan_command.add_argument("--json", type=Path, metavar="FILE", help="write the answer")
    plan_command.add_argument(
        "--bag", type=Path, metavar="DIR", help="write question and answer as a new bag"
    )
    plan_command.set_defaults(command=_plan)

    replay = commands.add_parser(
        "replay",
        help="plan the requests of a bag again and compare",
        description="Plan every request of a bag again: the recorded state, obstacles, parameters "
        "and robot, the same code, no ROS graph. Or ask what if, or play the bag into ROS.",
        epilog="Exit code: 0 every answer came again, to the last bit or within tolerance, or is "
        "no function of its problem (BUSY, CANCELLED, ...); 3 one did not, or its problem is not "
        "all in the bag; 2 bad bag.",
    )
    replay.add_argument("bag", type=Path, metavar="BAG", help="a directory or .mcap file")
    replay.add_argument(
        "--with",
        action="append",
        dest="changes",
        metavar="KEY=VALUE",
        help="what if: plan with this changed and print both answers; may be given several times "
        "(objective.chaser_attitude=1, planner.starts=5, limits.velocity=none, ...; an unknown "
        "key gets the list)",
    )
    replay.add_argument(
        "--publish", action="store_true", help="play the recorded messages into ROS instead"
    )
    replay.add_argument(
        "--rate", type=float, metavar="R", help="with --publish: so many times as fast (default: 1)"
    )
    replay.add_argument(
        "--topics",
        nargs="+",
        metavar="TOPIC",
        help="with --publish: these, or `all` (default: the planner's inputs)",
    )
    replay.add_argument(
        "--clock",
        action="store_true",
        help="with --publish: also /clock, the time of recording, for nodes with use_sim_time",
    )
    replay.set_defaults(command=_replay)

    report = commands.add_parser(
        "report",
        help="tell of a run in one HTML file",
        description="One HTML file that needs nothing else: every request with its answer, and of "
        "the plans figures over time, a 3-D view that plays, and what was measured against what "
        "was planned.",
    )
    report.add_argument(
        "source",
        type=Path,
        metavar="BAG|JSON",
        help="a bag (a directory or .mcap file) or an answer of `plan --json`",
    )
    report.add_argument(
        "--output", type=Path, metavar="FILE.html", help="default: NAME_report.html, here"
    )
    report.add_argument(
        "--plans",
        type=int,
        default=20,
        metavar="N",
        help="draw the last N plans, up to 1 MB each (default: 20); the tables tell of all",
    )
    report.set_defaults(command=_report)

    robot = commands.add_parser("robot", help="show what the planner makes of a URDF")
    robot.add_argument("urdf", type=Path, metavar="URDF")
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    robot.add_argument("--tip-link", metavar="LINK", help="default: the only link without children")
    robot.set_defaults(command=_robot)

    verify = commands.add_parser(
        "verify",
        parents=[how_to_plan],
        help="execute plans open loop in an independent physics engine",
        description="Execute plans open loop in MuJoCo: joint torques only, nothing fed back. "
        "Options of planning count for a scenario only.",
        epilog="Exit code: 0 every plan came true, 2 bad input, 3 one did not, or none was found.",
    )
    verify.add_argument(
        "source",
        type=Path,
        metavar="SCENARIO|JSON|BAG",
        help="a scenario (.yaml) to plan first, an answer of `plan --json` (.json), or a bag with "
        "plans (a directory or .mcap)",
    )
    verify.add_argument(
        "--sensitivity",
        action="store_true",
        help="execute them with wrong masses, start velocities and friction, too",
    )
    verify.set_defaults(command=_verify)
    return parser


def _add_bag_commands(commands: Any) -> None:
    bag_help = "a directory or .mcap file"
    export = commands.add_parser("export", help="write the plans of a bag for other tools")
    export.add_argument("bag", type=Path, metavar="BAG", help=bag_help)
    form = export.add_mutually_exclusive_group(required=True)
    form.add_argument("--csv", type=Path, metavar="DIR", help="new directory, a table per plan")
    form.add_argument("--npz", type=Path, metavar="FILE", help="new file of numpy")
    export.set_defaults(command=_export)

    info = commands.add_parser("info", help="show what is in a bag")
    info.add_argument("bag", type=Path, metavar="BAG", help=bag_help)
    info.set_defaults(command=_info)

    recover = commands.add_parser(
        "recover",
        help="save what a damaged bag still holds",
        description="Write everything that can be read of a truncated, killed or damaged bag into "
        "a new one; the old one stays as it is.",
        epilog="Exit code: 0 everything in it was saved, 3 a part of it, 1 nothing, 2 bad input.",
    )
    recover.add_argument("bag", type=Path, metavar="BAG", help=bag_help)
    recover.add_argument(
        "--output", type=Path, metavar="DIR", help="the new bag (default: BAG_recovered beside it)"
    )
    recover.set_defaults(command=_recover)


def _how_to_plan() -> argparse.ArgumentParser:
    options = argparse.ArgumentParser(add_help=False)
    options.add_argument(
        "--objective", choices=_OBJECTIVES, help="instead of the scenario's weights"
    )
    options.add_argument(
        "--method",
        choices=_METHODS,
        default="optimal",
        help="optimal, or a baseline to compare with: the straight path or an artificial potential "
        "field (config/baselines.yaml)",
    )
    options.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="planner settings, as the node reads them (default: config/planner.yaml)",
    )
    options.add_argument(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="give up after this time (default: take what it takes)",
    )
    return options


def _bench(options: argparse.Namespace) -> int:
    from ff_planner_ros.bench.report import run_on_one_core

    return run_on_one_core(options.quick, options.scenarios, options.json)


def _compare(options: argparse.Namespace) -> int:
    from ff_planner_ros.compare import compare

    config = share_directory() / "config"
    papers_scenario = config / "scenarios" / "lemur_capture.yaml"
    any_motion = compare(
        load_scenario(options.scenario),
        load_settings(config / "planner.yaml"),
        load_parameters(config / "baselines.yaml"),
        options.output,
        of_the_paper=options.scenario.samefile(papers_scenario),
    )
    return SOLVED if any_motion else NO_PLAN


def _export(options: argparse.Namespace) -> int:
    from ff_planner_ros.bag.export import export_csv, export_npz

    if options.csv is not None:
        notes = export_csv(options.bag, options.csv)
    else:
        notes = export_npz(options.bag, options.npz)
    _print_notes(notes)
    return SOLVED


def _info(options: argparse.Namespace) -> int:
    from ff_planner_ros.bag.info import info

    for line in info(options.bag):
        print(line)
    return SOLVED


def _recover(options: argparse.Namespace) -> int:
    from ff_planner_ros.bag.recover import print_recovery

    return print_recovery(options.bag, options.output)


def _print_notes(notes: Sequence[str]) -> None:
    for note in notes:
        print(f"ff-planner: note: {note}", file=sys.stderr)


# The commands that talk to ROS import it themselves: the others run where it is not installed.


def _demo(options: argparse.Namespace) -> int:
    from ff_planner_ros.demo.run import run_demo

    return run_demo(options.output)


def _node(options: argparse.Namespace) -> int:
    from ff_planner_ros.ros.node import main as node_main

    return node_main([sys.argv[0], *options.rest])


def _plan(options: argparse.Namespace) -> int:
    try:
        settings = _settings(options)
        problem = _problem(options.scenario, options)
    except FfPlannerError as error:
        _write_json(options.json, refusal_dictionary(error, solve_time=0.0))
        raise
    answer: Plan | FfPlannerError
    begun = time.perf_counter()
    try:
        answer = _solved(problem, settings, options)
    except FfPlannerError as error:
        answer = error
    solve_time = time.perf_counter() - begun

    if isinstance(answer, Plan):
        _write_json(options.json, plan_dictionary(answer, problem, solve_time))
    else:
        _write_json(options.json, refusal_dictionary(answer, solve_time))
    if options.bag is not None:
        from ff_planner_ros.runs.offline_bag import record_answer

        record_answer(
            options.bag, problem, settings, answer, solve_time, options.scenario, options.method
        )
    if isinstance(answer, FfPlannerError):
        raise answer
    _print_table(plan_rows(answer, solve_time))
    return SOLVED


def _write_json(file: Path | None, answer: dict[str, Any]) -> None:
    if file is not None:
        file.write_text(json.dumps(answer) + "\n")


def _settings(options: argparse.Namespace) -> PlannerSettings:
    return load_settings(options.parameters or share_directory() / "config" / "planner.yaml")


def _problem(scenario: Path, options: argparse.Namespace) -> PlanningProblem:
    problem = load_scenario(scenario)
    if options.objective is None:
        return problem
    return replace(problem, objective=_OBJECTIVES[options.objective])


def _solved(
    problem: PlanningProblem, settings: PlannerSettings, options: argparse.Namespace
) -> Plan:
    if options.method == "optimal":
        return plan(problem, settings, Calls(_keep_going(options.time_budget), lambda _: None))
    return _sound_baseline(options.method, problem, settings)


def _sound_baseline(method: str, problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Return a baseline's plan if it passes the check that every plan must pass.

    Raises:
        InvalidInput: The start violates what a plan must keep.
        NoPlanFound: It does not pass; carries the plan.
    """
    if method == "straight":
        answer = straight_line(problem, settings)
    else:
        parameters = load_parameters(share_directory() / "config" / "baselines.yaml")
        answer = artificial_potential_field(problem, settings, parameters)
    found = list(failures(problem, answer, settings))
    if found:
        ending = Failure(found[0].status, answer.solver.stop_reason, ())
        raise refusal(answer, [ending, *found], advice=["--method optimal"])
    return answer


def _keep_going(budget: float | None) -> Callable[[], None]:
    if budget is None:
        return lambda: None
    return time_budget(finite_number("--time-budget", budget, above=0.0))


def _replay(options: argparse.Namespace) -> int:
    only_published = {"--rate": options.rate, "--topics": options.topics, "--clock": options.clock}
    if options.publish:
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

        return print_what_if(options.bag, options.changes)
    from ff_planner_ros.runs.replay import print_replay

    return print_replay(options.bag)


def _report(options: argparse.Namespace) -> int:
    from ff_planner_ros.runs.report import report_of_answer
    from ff_planner_ros.runs.report_of_bag import report_of_bag
    from ff_planner_ros.runs.report_page import save_page

    if options.plans < 0:
        allowed = "it must not be negative; 0 draws none"
        raise InvalidInput(Status.OUT_OF_RANGE, "--plans", options.plans, allowed)
    source: Path = options.source
    if source.suffix == ".json":
        report = report_of_answer(source)
    else:
        report = report_of_bag(source, options.plans)
    output = options.output or Path(f"{source.resolve().stem}_report.html")
    save_page(report, output)
    for note in report.notes:
        print(f"ff-planner: note: {note}", file=sys.stderr)
    print(f"{output}  {report.counts}, {output.stat().st_size / 1e6:.1f} MB")
    return SOLVED


def _robot(options: argparse.Namespace) -> int:
    text = read_urdf(options.urdf)
    base_link = options.base_link or root_link(text)
    tip_link = options.tip_link or only_leaf_link(text)
    _print_table(robot_rows(robot_from_urdf_text(text, base_link, tip_link)))
    return SOLVED


def _verify(options: argparse.Namespace) -> int:
    from ff_planner_ros.verify import print_verdict

    verdicts = [
        print_verdict(name, robot, motion, options.sensitivity)
        for name, robot, motion in _motions(options.source, options)
    ]
    return SOLVED if all(verdicts) else NO_PLAN


def _motions(source: Path, options: argparse.Namespace) -> Iterator[tuple[str, Robot, Trajectory]]:
    """Yield name, robot and motion of each plan that a file or bag holds or asks for."""
    if source.suffix in (".yaml", ".yml"):
        problem = _problem(source, options)
        yield source.name, problem.robot, _solved(problem, _settings(options), options).trajectory
    elif source.suffix == ".json":
        yield source.name, *_motion_in_json(source)
    elif source.is_dir() or source.suffix == ".mcap":
        from ff_planner_ros.runs.recorded_plans import recorded_plans

        recorded = recorded_plans(source)
        _print_notes(recorded.notes)
        for plan_id, recorded_plan in recorded.plans.items():
            yield plan_id, recorded.robot, recorded_plan.trajectory
    else:
        allowed = "it must be a scenario (.yaml), an answer (.json) or a bag (directory or .mcap)"
        raise InvalidInput(Status.UNSUPPORTED, "what to verify", source, allowed)


def _motion_in_json(source: Path) -> tuple[Robot, Trajectory]:
    try:
        answer = json.loads(source.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InvalidInput(Status.UNSUPPORTED, str(source), "no JSON", str(error)) from None
    try:
        return planned_motion(answer)
    except InvalidInput as error:
        field = f"{source}: {error.field}"
        raise InvalidInput(error.status, field, error.value, error.allowed) from None


def _print_table(rows: Sequence[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")


if __name__ == "__main__":
    sys.exit(main())
