"""Every command of `ff-planner`, and its options."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ff_planner_ros.commands import bags, benchmark, campaigns, planning
from ff_planner_ros.planning.problem import Parametrisation
from ff_planner_ros.robot.bodies import Geometry

_A_BAG = "a directory or .mcap file"


def command_parser() -> ArgumentParser:
    """Return the parser; what it reads holds the function of the command as `command`."""
    parser = ArgumentParser(
        prog="ff-planner",
        description="Trajectory planning for free-floating space manipulators.",
        epilog="Exit code: 0 done, 2 bad input, 3 no plan found, or one that does not come true.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def add(
        name: str, function: Callable[[Namespace], int], summary: str, **more: Any
    ) -> ArgumentParser:
        command = commands.add_parser(name, help=summary, **more)
        command.set_defaults(command=function)
        return command

    bag, scenario = ArgumentParser(add_help=False), ArgumentParser(add_help=False)
    bag.add_argument("bag", type=Path, metavar="BAG", help=_A_BAG)
    scenario.add_argument("scenario", type=Path, metavar="SCENARIO")
    how_to_plan = _how_to_plan()

    bench = add(
        "bench",
        benchmark.run_benchmark,
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
    fly_help = "execute our plans of N scenarios of each class in MuJoCo and in Drake"
    bench.add_argument("--fly", type=int, metavar="N", help=fly_help)
    score_help = "judge one answer to a scenario of the data set"
    bench.add_argument(
        "--score", type=Path, nargs=2, metavar=("SCENARIO", "ANSWER"), help=score_help
    )

    campaign = add(
        "campaign",
        campaigns.run_campaign,
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

    summary = "let every method plan a scenario: tables, figures, 3-D view"
    compare = add("compare", planning.compare_methods, summary, parents=[scenario])
    compare.add_argument(
        "--output", type=Path, default="comparison", metavar="DIR", help="of the pictures"
    )

    demo = add("demo", planning.show_demo, "plan the paper's capture over ROS, show the result")
    demo.add_argument(
        *("--testbed", "--scene"),
        choices=("lemur", "lines", "planar", "tumbling", "following"),
        default="lemur",
        help="lemur: the paper's capture in space, the whole robot kept clear (default); lines: "
        "the same with the arm's centre lines kept clear, as in the paper; planar: one on an "
        "air-bearing table; tumbling: of a body that tumbles; following: by an arm that is heavier "
        "than its model, and planned again five times a second",
    )
    demo.add_argument("--output", type=Path, default="demo_output", metavar="DIR")

    summary = "write the plans or the requests of a bag for other tools"
    export = add("export", bags.export_plans, summary, parents=[bag])
    form = export.add_mutually_exclusive_group(required=True)
    form.add_argument("--csv", type=Path, metavar="DIR", help="new directory, a table per plan")
    form.add_argument("--npz", type=Path, metavar="FILE", help="new file of numpy")
    parquet_help = "new file, a row per answer of a bag, or of all bags in a directory"
    form.add_argument("--parquet", type=Path, metavar="FILE", help=parquet_help)
    form.add_argument(
        "--scenarios", type=Path, metavar="DIR", help="new directory, a scenario file per request"
    )

    info = add("info", bags.show_bag, "show what is in a bag", parents=[bag])
    info.add_argument("--json", action="store_true", help="as JSON, with every answer")

    recover = add(
        "recover",
        bags.recover_bag,
        "save what a damaged bag still holds",
        parents=[bag],
        description="Write everything that can be read of a truncated, killed or damaged bag into "
        "a new one; the old one stays as it is.",
        epilog="Exit code: 0 everything in it was saved, 3 a part of it, 1 nothing, 2 bad input.",
    )
    recover.add_argument(
        "--output", type=Path, metavar="DIR", help="the new bag (default: BAG_recovered beside it)"
    )

    epilog = "Everything else goes to ROS (--ros-args ...)."
    add("node", planning.run_node, "run the planner node", epilog=epilog)

    summary = "plan a scenario file, without ROS"
    plan = add("plan", planning.plan_scenario, summary, parents=[how_to_plan, scenario])
    plan.add_argument("--json", type=Path, metavar="FILE", help="write the answer")
    plan.add_argument(
        "--bag", type=Path, metavar="DIR", help="write task and answer as a new bag (needs ROS)"
    )
    plan.add_argument(
        "--front",
        action="store_true",
        help="plan with several weights, from least joint path to least chaser attitude; print "
        "and draw what they trade",
    )
    plan.add_argument(
        "--output", type=Path, default="front", metavar="DIR", help="of the picture of --front"
    )

    replay = add(
        "replay",
        bags.replay_bag,
        "plan the requests of a bag again and compare",
        parents=[bag],
        description="Plan every request of a bag again: the recorded state, obstacles, parameters "
        "and robot, the same code, no ROS graph. Or ask what if, or play the bag into ROS.",
        epilog="Exit code: 0 every answer came again, to the last bit or within tolerance, or is "
        "no function of its problem (BUSY, CANCELLED, ...); 3 one did not, or its problem is not "
        "all in the bag; 2 bad bag.",
    )
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
        "--report",
        type=Path,
        metavar="FILE",
        help="with --with: write a page that lays the changed plans over the recorded ones",
    )
    replay.add_argument(
        "--publish", action="store_true", help="play the recorded messages into ROS instead"
    )
    replay.add_argument(
        "--rate", type=float, metavar="R", help="with --publish: so many times as fast (default: 1)"
    )
    topics_help = "with --publish: these, or `all` (default: the planner's inputs)"
    replay.add_argument("--topics", nargs="+", metavar="TOPIC", help=topics_help)
    clock_help = "with --publish: also /clock, the time of recording, for nodes with use_sim_time"
    replay.add_argument("--clock", action="store_true", help=clock_help)

    report = add(
        "report",
        bags.report_run,
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

    robot = add("robot", planning.show_robot, "show what the planner makes of a URDF")
    robot.add_argument("urdf", type=Path, metavar="URDF")
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    tip_help = "default: the only link that moves and carries no other"
    robot.add_argument("--tip-link", metavar="LINK", help=tip_help)
    robot.add_argument(
        "--geometry",
        choices=[one.value for one in Geometry],
        help="default: shapes where the arm has any <collision>",
    )
    draw_help = "draw it, bodies and lines, as a page for a browser"
    robot.add_argument("--draw", type=Path, metavar="FILE.html", help=draw_help)
    robot.add_argument(
        "--srdf",
        type=Path,
        metavar="FILE",
        help="write an SRDF of links that may touch: neighbours, and those that always or never "
        "touch in 10,000 random postures",
    )

    verify = add(
        "verify",
        planning.verify_plans,
        "execute plans open loop in an independent physics engine",
        parents=[how_to_plan],
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
    sensitivity_help = "execute them with wrong masses, start velocities and friction, too"
    verify.add_argument("--sensitivity", action="store_true", help=sensitivity_help)
    verify.add_argument(
        "--monte-carlo",
        type=int,
        metavar="N",
        help="execute them N times, too, by systems with other masses, inertias and start rates, "
        "beside a linear prediction",
    )
    verify.add_argument(
        "--uncertainty",
        metavar="NAME=VALUE,...",
        help="standard deviations of mass, inertia, friction [share], center_of_mass [m], "
        "linear_velocity [m/s], angular_velocity, joint_velocity [rad/s]; the others are 0; "
        "default: those of the scenario's planner.robust, else mass and inertia 0.01 and "
        "angular_velocity 0.01 deg/s",
    )
    verify.add_argument(
        "--execution",
        choices=("tracked", "torques"),
        default="tracked",
        help="of the N runs: a controller keeps the joints on the plan, or torques alone are given "
        "(by MuJoCo; for few runs)",
    )
    verify.add_argument("--seed", type=int, default=0, metavar="N", help="of the runs")
    verify.add_argument("--json", type=Path, metavar="FILE", help="write all numbers to a file")
    return parser


def _how_to_plan() -> ArgumentParser:
    options = ArgumentParser(add_help=False)
    options.add_argument(
        "--objective",
        metavar="{length,attitude,L,THETA}",
        help="instead of the scenario's weights: one of the two names, or a pair such as 1,10: "
        "weights of joint path length and chaser attitude, and of the duration if there is a third",
    )
    options.add_argument(
        "--method",
        choices=planning.METHODS,
        default=planning.OPTIMAL,
        help="optimal, or a baseline to compare with: the straight path or an artificial potential "
        "field (config/baselines.yaml)",
    )
    options.add_argument(
        "--parametrisation",
        choices=[one.value for one in Parametrisation],
        help="instead of the scenario's: the paths that the plan is looked for among; auto takes "
        "the paper's, and joint splines where these do not apply or hold no plan",
    )
    library_help = "of plans made before (`campaign --library`): the nearest is the first guess"
    options.add_argument("--library", type=Path, metavar="DIR", help=library_help)
    parameters_help = (
        "the node's parameters, all or some: they count where the scenario does not say"
    )
    options.add_argument("--parameters", type=Path, metavar="FILE", help=parameters_help)
    budget_help = "give up after this time (default: take what it takes)"
    options.add_argument("--time-budget", type=float, metavar="SECONDS", help=budget_help)
    return options
