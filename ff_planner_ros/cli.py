"""The command `ff-planner`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.analysis.answer import plan_dictionary, refusal_dictionary
from ff_planner_ros.arrays import Array, finite_number
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import Objective
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.settings import load_settings
from ff_planner_ros.robot.model import Robot, read_urdf, robot_from_urdf_text
from ff_planner_ros.robot.urdf import only_leaf_link, root_link
from ff_planner_ros.share import share_directory
from ff_planner_ros.time_budget import time_budget

SOLVED, BAD_INPUT, NO_PLAN = 0, 2, 3

_OBJECTIVES = {"length": Objective(1.0, 0.0), "attitude": Objective(0.0, 1.0)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        Exit code: 0 done, 2 bad input, 3 no plan found.
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
        epilog="Exit code: 0 done, 2 bad input, 3 no plan found.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    bench = commands.add_parser("bench", help="measure speed and success rate")
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench.add_argument(
        "--scenarios", type=int, metavar="N", help="of each class (default: 200; quick: 4)"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    bench.set_defaults(command=_bench)

    demo = commands.add_parser("demo", help="plan the paper's capture over ROS, show the result")
    demo.add_argument("--output", type=Path, default=Path("demo_output"), metavar="DIR")
    demo.set_defaults(command=_demo)

    node = commands.add_parser(
        "node", help="run the planner node", epilog="Everything else goes to ROS (--ros-args ...)."
    )
    node.set_defaults(command=_node)

    plan_command = commands.add_parser("plan", help="plan a scenario file, without ROS")
    plan_command.add_argument("scenario", type=Path, metavar="SCENARIO")
    plan_command.add_argument(
        "--objective", choices=_OBJECTIVES, help="instead of the scenario's weights"
    )
    plan_command.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="planner settings, as the node reads them (default: config/planner.yaml)",
    )
    plan_command.add_argument(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="give up after this time (default: take what it takes)",
    )
    plan_command.add_argument("--json", type=Path, metavar="FILE", help="write the answer")
    plan_command.add_argument(
        "--bag", type=Path, metavar="DIR", help="write question and answer as a new bag"
    )
    plan_command.set_defaults(command=_plan)

    robot = commands.add_parser("robot", help="show what the planner makes of a URDF")
    robot.add_argument("urdf", type=Path, metavar="URDF")
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    robot.add_argument("--tip-link", metavar="LINK", help="default: the only link without children")
    robot.set_defaults(command=_robot)
    return parser


def _bench(options: argparse.Namespace) -> int:
    from ff_planner_ros.bench.report import run_on_one_core

    return run_on_one_core(options.quick, options.scenarios, options.json)


# The commands that talk to ROS import it themselves: the others run where it is not installed.


def _demo(options: argparse.Namespace) -> int:
    from ff_planner_ros.ros.demo import run_demo

    return run_demo(options.output)


def _node(options: argparse.Namespace) -> int:
    from ff_planner_ros.ros.node import main as node_main

    return node_main([sys.argv[0], *options.rest])


def _plan(options: argparse.Namespace) -> int:
    parameters = options.parameters or share_directory() / "config" / "planner.yaml"
    answer: Plan | FfPlannerError
    problem, begun = None, time.perf_counter()
    try:
        settings = load_settings(parameters)
        problem = load_scenario(options.scenario)
        if options.objective is not None:
            problem = replace(problem, objective=_OBJECTIVES[options.objective])
        begun = time.perf_counter()
        answer = plan(problem, settings, _keep_going(options.time_budget))
    except FfPlannerError as error:
        answer = error
    solve_time = time.perf_counter() - begun

    if options.json is not None:
        options.json.write_text(json.dumps(_dictionary(answer, solve_time)) + "\n")
    if options.bag is not None and problem is not None:
        from ff_planner_ros.ros.offline_bag import record_answer

        record_answer(options.bag, problem, settings, answer, solve_time)
    if isinstance(answer, FfPlannerError):
        raise answer
    _print_table(_plan_rows(answer, solve_time))
    return SOLVED


def _keep_going(budget: float | None) -> Callable[[], None]:
    if budget is None:
        return lambda: None
    return time_budget(finite_number("--time-budget", budget, above=0.0))


def _dictionary(answer: Plan | FfPlannerError, solve_time: float) -> dict[str, Any]:
    if isinstance(answer, Plan):
        return plan_dictionary(answer, solve_time)
    return refusal_dictionary(answer, solve_time)


def _plan_rows(answer: Plan, solve_time: float) -> list[tuple[str, str]]:
    metrics, solver = answer.metrics, answer.solver
    clearance = metrics.min_clearance
    return [
        ("status", Status.SOLVED.name.lower()),
        ("joint path length", f"{metrics.joint_path_length:.4f} rad"),
        ("largest chaser attitude", f"{np.rad2deg(metrics.max_chaser_euler):.2f} deg"),
        ("clearance", f"{clearance * 1e3:.1f} mm" if np.isfinite(clearance) else "no obstacles"),
        ("margin to joint limits", f"{np.rad2deg(metrics.min_joint_margin):.1f} deg"),
        ("margin to velocity limits", f"{np.rad2deg(metrics.min_velocity_margin):.2f} deg/s"),
        ("final position error", f"{metrics.final_position_error * 1e3:.4f} mm"),
        ("final orientation error", f"{np.rad2deg(metrics.final_orientation_error):.5f} deg"),
        ("momentum error", f"{metrics.momentum_error:.1e} relative"),
        ("solver", f"{solver.stop_reason}, optimality {solver.optimality:.1e}"),
        ("effort", f"{solver.starts} starts, {solver.rollouts} rollouts, {solve_time:.2f} s"),
    ]


def _robot(options: argparse.Namespace) -> int:
    text = read_urdf(options.urdf)
    base_link = options.base_link or root_link(text)
    tip_link = options.tip_link or only_leaf_link(text)
    _print_table(_robot_rows(robot_from_urdf_text(text, base_link, tip_link)))
    return SOLVED


def _robot_rows(robot: Robot) -> list[tuple[str, str]]:
    chaser = robot.model.inertias[1]
    moments = np.linalg.eigvalsh(chaser.inertia)
    rows = [
        ("base link", f"{robot.base_link} (the chaser, with all that is fixed to it)"),
        ("  mass", f"{chaser.mass:g} kg"),
        ("  centre of mass", f"{_vector(robot.position_chaser_in_base)} m in the root link"),
        ("  principal moments", f"{_vector(moments)} kg m2"),
        ("tip link", f"{robot.tip_link} (the end effector)"),
        ("joints", str(robot.joints)),
    ]
    lower, upper = np.rad2deg(robot.lower_position_limits), np.rad2deg(robot.upper_position_limits)
    rates = np.rad2deg(robot.velocity_limits)
    for k, name in enumerate(robot.joint_names):
        moved = f"moves {robot.model.inertias[2 + k].mass:g} kg"
        limits = f"{lower[k]:7.1f} to {upper[k]:6.1f} deg, {rates[k]:6.1f} deg/s"
        rows.append((f"  {name}", f"{limits}, {moved}"))
    return rows


def _vector(values: Array) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _print_table(rows: Sequence[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")


if __name__ == "__main__":
    sys.exit(main())
