"""The commands that plan a scenario: plan, verify, compare."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.baselines import APF, METHODS, OPTIMAL, STRAIGHT
from ff_planner_ros.commands import NO_PLAN, SCENARIOS, SOLVED
from ff_planner_ros.commands.options import (
    Add,
    add_output,
    refuse_given,
    require_directory,
    require_file,
    require_new_directory,
)
from ff_planner_ros.commands.printed import print_notes, print_table, write_json
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.problem.goal_words import Parametrisation

if TYPE_CHECKING:
    from ff_planner_ros.planning.motion.plan import Plan
    from ff_planner_ros.planning.task.planning_task import PlanningTask


def add_plan(add: Add) -> None:
    """Add `plan`."""
    summary = "plan a scenario file, without ROS"
    plan = add(
        "plan",
        plan_scenario,
        summary,
        parents=[_how_to_plan(), _scenario()],
    )
    add_output(plan, "--json", "FILE", "write the answer", require_file)
    bag_help = "write task and answer as a new bag (needs ROS)"
    add_output(plan, "--bag", "DIR", bag_help, require_new_directory)
    draw_help = "draw the plan, of phases the first: figures over time as PNG and PDF, and a scene"
    add_output(plan, "--draw", "DIR", draw_help, require_directory)
    plan.add_argument(
        "--pareto",
        action="store_true",
        help="plan with several weights, from minimum joint path to minimum chaser attitude; print "
        "and draw the Pareto front",
    )
    output_help = "of the picture of --pareto (default: pareto)"
    add_output(plan, "--output", "DIR", output_help, require_directory)


def plan_scenario(options: Namespace) -> int:
    """Plan a scenario file, print the plan, and write the files that are asked for."""
    from ff_planner_ros.campaign.methods import method_of
    from ff_planner_ros.commands.tasks import task_of
    from ff_planner_ros.planning.task.task import perform

    if options.pareto:
        return _plan_pareto_front(options)
    refuse_given(options, {"output": None}, "it counts beside --pareto alone")
    _refuse_of_optimal(options)
    try:
        task, watch = task_of(options.scenario, options)
    except FfPlannerError as error:
        _write_answer(options.json, error, 0.0)
        raise
    answer: Plan | FfPlannerError
    begun = time.perf_counter()
    try:
        answer = perform(task, watch, method_of(options.method, task))
    except FfPlannerError as error:
        answer = error
    solve_time = time.perf_counter() - begun

    try:
        _write_answer(options.json, answer, solve_time, task)
        if options.bag is not None:
            from ff_planner_ros.runs.offline_bag import record_answer

            record_answer(options.bag, task, answer, solve_time, options.scenario, options.method)
    except (OSError, FfPlannerError) as error:
        # What was found is said all the same.
        if isinstance(answer, FfPlannerError):
            print_notes([str(error)])
            raise answer from None
        _print_plan(task, answer, solve_time)
        raise
    if isinstance(answer, FfPlannerError):
        raise answer
    _print_plan(task, answer, solve_time)
    if options.draw is not None:
        from ff_planner_ros.analysis.drawing.figures import plot_plan

        plot_plan(task.problem, answer, options.draw)
    return SOLVED


def _print_plan(task: PlanningTask, plan: Plan, solve_time: float) -> None:
    from ff_planner_ros.analysis.summary import PHASES, phase_rows, plan_rows
    from ff_planner_ros.common.text_table import print_table as print_columns
    from ff_planner_ros.planning.task.whole import whole

    chosen = task.problem.duration_range is not None
    total, robot, limits = whole(plan), task.problem.robot, task.problem.limits
    goals = [task.problem.chaser_goal, *(phase.chaser_goal for phase in task.then)]
    # Of several phases, each has its own, and those that ask for none may turn as they like.
    attains = not plan.then and isfinite(goals[0].most)
    print_table(plan_rows(robot, total, solve_time, task.digest, chosen, limits, attains))
    if plan.then:
        print()
        title = "Phases, each from where the one before ends"
        print_columns(title, PHASES, phase_rows(plan, goals))


def _write_answer(
    file: Path | None,
    answer: Plan | FfPlannerError,
    solve_time: float,
    task: PlanningTask | None = None,
) -> None:
    """Write an answer as JSON, if a file is named; task: None if it was refused itself."""
    if file is None:
        return
    from ff_planner_ros.analysis.plan_json import plan_dictionary, refusal_dictionary

    if isinstance(answer, FfPlannerError):
        digest = None if task is None else task.digest
        write_json(file, refusal_dictionary(answer, solve_time, digest, task))
    elif task is not None:
        write_json(file, plan_dictionary(answer, task, solve_time))


def _plan_pareto_front(options: Namespace) -> int:
    """Plan a scenario with several pairs of weights, and show the Pareto front."""
    from ff_planner_ros.analysis import pareto_front
    from ff_planner_ros.commands.tasks import task_of
    from ff_planner_ros.common.text_table import print_table as print_columns

    unused = {"objective": None, "method": OPTIMAL, "bag": None, "draw": None}
    refuse_given(options, unused, "not beside --pareto, which plans with weights of its own")
    output = options.output or Path("pareto")
    require_directory("--output", output)
    begun = time.perf_counter()
    try:
        points = pareto_front.pareto_front(*task_of(options.scenario, options), time.perf_counter)
    except FfPlannerError as error:
        _write_answer(options.json, error, time.perf_counter() - begun)
        raise
    write_json(options.json, pareto_front.front_dictionary(points))
    title = "Joint path against chaser attitude"
    print_columns(title, pareto_front.COLUMNS, pareto_front.front_rows(points))
    print()
    print(pareto_front.save_front(points, output))
    return SOLVED


def add_verify(add: Add) -> None:
    """Add `verify`."""
    verify = add(
        "verify",
        verify_plans,
        "execute plans open loop in an independent physics engine",
        parents=[_how_to_plan()],
        description="Execute plans open loop in MuJoCo, and in other engines that are installed: "
        "joint torques only, nothing fed back. Options of planning count for a scenario only.",
        epilog="Exit code: 0 every plan was reproduced, 2 bad input, 3 one was not or is none.",
    )
    verify.add_argument(
        "source",
        type=Path,
        metavar="SCENARIO|JSON|BAG",
        help="a scenario (.yaml) to plan first, an answer of `plan --json` (.json), or a bag with "
        "plans (a directory or .mcap)",
    )
    engine_help = (
        "execute them in this engine besides MuJoCo, or refuse if it is not installed; may be "
        "given several times (default: every one that is installed)"
    )
    verify.add_argument("--engine", action="append", default=[], metavar="NAME", help=engine_help)
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
    add_output(verify, "--json", "FILE", "write all numbers to a file", require_file)


def verify_plans(options: Namespace) -> int:
    """Execute plans in an independent physics engine, and print how far they are reproduced."""
    from ff_planner_ros.commands.verify import print_verdicts

    if options.source.suffix in SCENARIOS:
        _refuse_of_optimal(options)
    else:
        refuse_given(options, _HOW_TO_PLAN, "it counts for a scenario, which is planned first")
    return print_verdicts(options)


def add_compare(add: Add) -> None:
    """Add `compare`."""
    summary = "let every method plan a scenario: tables, figures, 3-D view"
    compare = add(
        "compare",
        compare_methods,
        summary,
        parents=[_scenario()],
    )
    output_help = "of the pictures (default: %(default)s)"
    add_output(compare, "--output", "DIR", output_help, require_directory)
    compare.set_defaults(output=Path("comparison"))


def compare_methods(options: Namespace) -> int:
    """Plan a scenario with every method, and show the plans side by side."""
    from ff_planner_ros.baselines.potential_field import load_parameters as load_potential_field
    from ff_planner_ros.commands.compare import compare
    from ff_planner_ros.common.share import share_directory
    from ff_planner_ros.parameters import load_parameters
    from ff_planner_ros.planning.scenario.scenario import load_scenario

    config = share_directory() / "config"
    papers_scenario = config / "scenarios" / "lemur_capture.yaml"
    any_motion = compare(
        load_scenario(options.scenario),
        load_parameters().planner,
        load_potential_field(config / "baselines.yaml"),
        options.output,
        of_the_paper=options.scenario.samefile(papers_scenario),
    )
    return SOLVED if any_motion else NO_PLAN


def _scenario() -> ArgumentParser:
    scenario = ArgumentParser(add_help=False)
    scenario.add_argument("scenario", type=Path, metavar="SCENARIO")
    return scenario


# Options of planning, and their values if they are not given.
_HOW_TO_PLAN = {"method": OPTIMAL} | dict.fromkeys(
    ("objective", "parametrisation", "library", "parameters", "time_budget")
)


def _refuse_of_optimal(options: Namespace) -> None:
    """Refuse options of the search beside a baseline, which has none."""
    if options.method == OPTIMAL:
        return
    unused = ["library", "time_budget"]
    if options.method in (STRAIGHT, APF):
        unused += ["objective", "parametrisation"]
    refuse_given(options, dict.fromkeys(unused), f"--method {options.method} makes nothing of it")


def _how_to_plan() -> ArgumentParser:
    """Return the options of commands that plan."""
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
        help="optimal, or a baseline to compare with: the straight path, an artificial potential "
        "field (config/baselines.yaml), or a plan that assumes a fixed base or zero momentum",
    )
    options.add_argument(
        "--parametrisation",
        choices=[one.value for one in Parametrisation],
        help="instead of the scenario's; auto takes the paper's paths, and joint splines if these "
        "do not apply or have no plan, or if the chaser's attitude has a weight or a limit",
    )
    library_help = "of plans (`campaign --library`), whose nearest is the initial guess"
    options.add_argument("--library", type=Path, metavar="DIR", help=library_help)
    parameters_help = (
        "the node's parameters, all or some: they count where the scenario does not say"
    )
    options.add_argument("--parameters", type=Path, metavar="FILE", help=parameters_help)
    budget_help = "answer after this time with the best plan so far (default: search to the end)"
    options.add_argument("--time-budget", type=float, metavar="SECONDS", help=budget_help)
    return options
