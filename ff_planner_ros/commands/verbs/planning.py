"""The verbs that make or test plans: plan, ask, verify, compare, robot, demo, node."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from ff_planner_ros.commands import METHODS, OPTIMAL
from ff_planner_ros.commands.verbs import Add, add_renamed
from ff_planner_ros.planning.problem.parametrisation import Parametrisation
from ff_planner_ros.robot.collision.geometry import Geometry


def add_plan(add: Add) -> None:
    """Add `plan`."""
    summary = "plan a scenario file, without ROS"
    plan = add(
        "plan",
        "ff_planner_ros.commands.planning:plan_scenario",
        summary,
        parents=[_how_to_plan(), _scenario()],
    )
    plan.add_argument("--json", type=Path, metavar="FILE", help="write the answer")
    plan.add_argument(
        "--bag", type=Path, metavar="DIR", help="write task and answer as a new bag (needs ROS)"
    )
    pareto = plan.add_argument(
        "--pareto",
        action="store_true",
        help="plan with several weights, from least joint path to least chaser attitude; print "
        "and draw what they trade",
    )
    add_renamed(plan, "--front", pareto)
    plan.add_argument(
        "--output", type=Path, default="pareto", metavar="DIR", help="of the picture of --pareto"
    )


def add_ask(add: Add) -> None:
    """Add `ask`."""
    ask = add(
        "ask",
        "ff_planner_ros.commands.asking:ask_node",
        "ask a running node for a plan",
        description="Send one request to a running node and print its answer. The node plans from "
        "the state, obstacles and target body that it has received last.",
        epilog="What follows --ros-args goes to ROS. Exit code: 0 solved, 2 refused, 3 no plan "
        "found, 130 interrupted: the request is cancelled.",
    )
    scenario_help = "what to ask for; without one, --set says it all"
    ask.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO", help=scenario_help)
    ask.add_argument(
        "--bring",
        action="append",
        choices=("state", "obstacles", "target_body"),
        default=[],
        help="plan from this of the scenario, not from what the node has received; may be given "
        "several times",
    )
    ask.add_argument(
        "--set",
        action="append",
        dest="changes",
        default=[],
        metavar="KEY=VALUE",
        help="ask for this instead, by the key of a scenario; may be given several times "
        "(target.position=[4, 0, 1], duration=20, ...; an unknown key gets the list)",
    )
    plan_only_help = "the plan is not published; the service ~/publish_plan does that, by its id"
    ask.add_argument("--plan-only", action="store_true", help=plan_only_help)
    frame_help = "the node's inertial frame (default: %(default)s)"
    ask.add_argument("--frame", default="inertial", metavar="FRAME", help=frame_help)
    budget_help = "for planning (default: the node's parameter)"
    ask.add_argument("--time-budget", type=float, metavar="SECONDS", help=budget_help)
    timeout_help = "how long to look for the node (default: %(default)g)"
    ask.add_argument("--timeout", type=float, default=10.0, metavar="SECONDS", help=timeout_help)
    ask.add_argument("--json", type=Path, metavar="FILE", help="write the answer")


def add_verify(add: Add) -> None:
    """Add `verify`."""
    verify = add(
        "verify",
        "ff_planner_ros.commands.planning:verify_plans",
        "execute plans open loop in an independent physics engine",
        parents=[_how_to_plan()],
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


def add_compare(add: Add) -> None:
    """Add `compare`."""
    summary = "let every method plan a scenario: tables, figures, 3-D view"
    compare = add(
        "compare",
        "ff_planner_ros.commands.planning:compare_methods",
        summary,
        parents=[_scenario()],
    )
    compare.add_argument(
        "--output", type=Path, default="comparison", metavar="DIR", help="of the pictures"
    )


def add_robot(add: Add) -> None:
    """Add `robot`."""
    robot = add(
        "robot",
        "ff_planner_ros.commands.planning:show_robot",
        "show what the planner makes of a URDF",
    )
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


def add_demo(add: Add) -> None:
    """Add `demo`."""
    demo = add(
        "demo",
        "ff_planner_ros.commands.planning:show_demo",
        "plan the paper's capture over ROS, show the result",
    )
    testbed = demo.add_argument(
        "--testbed",
        choices=("lemur", "lines", "planar", "tumbling", "following"),
        default="lemur",
        help="lemur: the paper's capture in space, the whole robot kept clear (default); lines: "
        "the same with the arm's centre lines kept clear, as in the paper; planar: one on an "
        "air-bearing table; tumbling: of a body that tumbles; following: by an arm that is heavier "
        "than its model, and planned again five times a second",
    )
    add_renamed(demo, "--scene", testbed)
    demo.add_argument("--output", type=Path, default="demo_output", metavar="DIR")


def add_node(add: Add) -> None:
    """Add `node`."""
    epilog = "Everything else goes to ROS (--ros-args ...)."
    add("node", "ff_planner_ros.commands.planning:run_node", "run the planner node", epilog=epilog)


def _scenario() -> ArgumentParser:
    scenario = ArgumentParser(add_help=False)
    scenario.add_argument("scenario", type=Path, metavar="SCENARIO")
    return scenario


def _how_to_plan() -> ArgumentParser:
    """Return the options of all that plans."""
    options = ArgumentParser(add_help=False)
    options.add_argument(
        "--objective",
        metavar="{length,attitude,WEIGHTS}",
        help="instead of the scenario's weights: one of the two names, or a pair such as 1,10: "
        "weights of joint path length and chaser attitude, and of the duration if there is a third",
    )
    options.add_argument(
        "--method",
        choices=METHODS,
        default=OPTIMAL,
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
