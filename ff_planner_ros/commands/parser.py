"""Every command of `ff-planner`, and its options."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ff_planner_ros.commands.bags import (
    export_plans,
    recover_bag,
    replay_bag,
    report_run,
    show_bag,
)
from ff_planner_ros.commands.node import run_node, show_demo
from ff_planner_ros.commands.planning import (
    METHODS,
    OBJECTIVES,
    OPTIMAL,
    compare_methods,
    plan_scenario,
    run_benchmark,
    show_robot,
    verify_plans,
)


def command_parser() -> argparse.ArgumentParser:
    """Return the parser; what it reads holds the function of the command as `command`."""
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
    bench.set_defaults(command=run_benchmark)

    compare = commands.add_parser(
        "compare", help="let every method plan a scenario: tables, figures, 3-D view"
    )
    compare.add_argument("scenario", type=Path, metavar="SCENARIO")
    compare.add_argument(
        "--output", type=Path, default=Path("comparison"), metavar="DIR", help="of the pictures"
    )
    compare.set_defaults(command=compare_methods)

    demo = commands.add_parser("demo", help="plan the paper's capture over ROS, show the result")
    demo.add_argument("--output", type=Path, default=Path("demo_output"), metavar="DIR")
    demo.set_defaults(command=show_demo)

    _add_bag_commands(commands)

    node = commands.add_parser(
        "node", help="run the planner node", epilog="Everything else goes to ROS (--ros-args ...)."
    )
    node.set_defaults(command=run_node)

    how_to_plan = _how_to_plan()
    plan_command = commands.add_parser(
        "plan", parents=[how_to_plan], help="plan a scenario file, without ROS"
    )
    plan_command.add_argument("scenario", type=Path, metavar="SCENARIO")
    plan_command.add_argument("--json", type=Path, metavar="FILE", help="write the answer")
    plan_command.add_argument(
        "--bag", type=Path, metavar="DIR", help="write task and answer as a new bag (needs ROS)"
    )
    plan_command.set_defaults(command=plan_scenario)

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
    replay.set_defaults(command=replay_bag)

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
    report.set_defaults(command=report_run)

    robot = commands.add_parser("robot", help="show what the planner makes of a URDF")
    robot.add_argument("urdf", type=Path, metavar="URDF")
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    robot.add_argument("--tip-link", metavar="LINK", help="default: the only link without children")
    robot.set_defaults(command=show_robot)

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
    verify.set_defaults(command=verify_plans)
    return parser


def _add_bag_commands(commands: Any) -> None:
    bag_help = "a directory or .mcap file"
    export = commands.add_parser(
        "export", help="write the plans or the requests of a bag for other tools"
    )
    export.add_argument("bag", type=Path, metavar="BAG", help=bag_help)
    form = export.add_mutually_exclusive_group(required=True)
    form.add_argument("--csv", type=Path, metavar="DIR", help="new directory, a table per plan")
    form.add_argument("--npz", type=Path, metavar="FILE", help="new file of numpy")
    form.add_argument(
        "--scenarios", type=Path, metavar="DIR", help="new directory, a scenario file per request"
    )
    export.set_defaults(command=export_plans)

    info = commands.add_parser("info", help="show what is in a bag")
    info.add_argument("bag", type=Path, metavar="BAG", help=bag_help)
    info.set_defaults(command=show_bag)

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
    recover.set_defaults(command=recover_bag)


def _how_to_plan() -> argparse.ArgumentParser:
    options = argparse.ArgumentParser(add_help=False)
    options.add_argument(
        "--objective", choices=OBJECTIVES, help="instead of the scenario's weights"
    )
    options.add_argument(
        "--method",
        choices=METHODS,
        default=OPTIMAL,
        help="optimal, or a baseline to compare with: the straight path or an artificial potential "
        "field (config/baselines.yaml)",
    )
    options.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="the node's parameters, all or some: they count where the scenario does not say",
    )
    options.add_argument(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="give up after this time (default: take what it takes)",
    )
    return options
