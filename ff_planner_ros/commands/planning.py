"""The commands that make or test plans: plan, verify, compare, robot, demo, node."""

from __future__ import annotations

import argparse
import json
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.analysis.plan_json import (
    plan_dictionary,
    planned_motion,
    planned_scene,
    refusal_dictionary,
    uncertainty_in,
)
from ff_planner_ros.analysis.summary import plan_rows, robot_rows
from ff_planner_ros.commands import NO_PLAN, OPTIMAL, SOLVED
from ff_planner_ros.commands.printed import print_notes, print_table
from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import Limits, Objective, Parametrisation, lasting
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.robust.robust import withstood
from ff_planner_ros.planning.scenario.library_file import load_library
from ff_planner_ros.planning.scenario.scenario import (
    Defaults,
    limits_from,
    load_scenario,
    load_task,
)
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.library import Library
from ff_planner_ros.planning.task.task import Method, PlanningTask, perform, without_search
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, read_urdf, robot_from_urdf_text
from ff_planner_ros.time_budget import TimeBudget

OBJECTIVES = {"length": Objective(1.0, 0.0), "attitude": Objective(0.0, 1.0)}


def plan_scenario(options: argparse.Namespace) -> int:
    """Plan a scenario file, print what came of it, and write it down."""
    if options.pareto:
        return _plan_pareto_front(options)
    try:
        task, watch = _task(options.scenario, options)
        if options.bag is not None:
            from ff_planner_ros.runs.offline_bag import record_answer, require_recordable

            require_recordable(task)
    except FfPlannerError as error:
        _write_json(options.json, refusal_dictionary(error, solve_time=0.0))
        raise
    answer: Plan | FfPlannerError
    begun = time.perf_counter()
    try:
        answer = perform(task, watch, _method(options.method))
    except FfPlannerError as error:
        answer = error
    solve_time = time.perf_counter() - begun

    if isinstance(answer, Plan):
        _write_json(options.json, plan_dictionary(answer, task, solve_time))
    else:
        _write_json(options.json, refusal_dictionary(answer, solve_time, task.digest))
    if options.bag is not None:
        record_answer(options.bag, task, answer, solve_time, options.scenario, options.method)
    if isinstance(answer, FfPlannerError):
        raise answer
    chosen = task.problem.duration_range is not None
    print_table(plan_rows(answer, solve_time, task.digest, chosen, task.problem.limits))
    return SOLVED


def _plan_pareto_front(options: argparse.Namespace) -> int:
    """Plan a scenario with one pair of weights after the other, and show what they trade."""
    from ff_planner_ros.analysis import pareto_front
    from ff_planner_ros.common.text_table import print_table as print_columns

    for name, default in (("objective", None), ("method", OPTIMAL), ("bag", None)):
        value = getattr(options, name)
        if value != default:
            allowed = "not beside --pareto, which plans with weights of its own"
            raise InvalidInput(Status.UNSUPPORTED, f"--{name}", value, allowed)
    begun = time.perf_counter()
    try:
        points = pareto_front.pareto_front(*_task(options.scenario, options), time.perf_counter)
    except FfPlannerError as error:
        _write_json(options.json, refusal_dictionary(error, time.perf_counter() - begun))
        raise
    _write_json(options.json, pareto_front.front_dictionary(points))
    title = "Joint path against chaser attitude"
    print_columns(title, pareto_front.COLUMNS, pareto_front.front_rows(points))
    print()
    print(pareto_front.save_front(points, options.output))
    return SOLVED


def _write_json(file: Path | None, answer: dict[str, Any]) -> None:
    if file is not None:
        file.write_text(json.dumps(answer) + "\n")


def _task(scenario: Path, options: argparse.Namespace) -> tuple[PlanningTask, Watch]:
    """Return what to plan, and who watches the time."""
    parameters = load_parameters(options.parameters)
    defaults, budget = Defaults(parameters.planner), options.time_budget
    if budget is not None:
        budget = finite_number("--time-budget", budget, above=0.0)
    if options.parameters is not None:
        defaults = parameters.of_scenarios()
        budget = budget or parameters.time_budget
    task = load_task(scenario, defaults)
    print_notes(task.problem.robot.notes)
    if options.objective is not None:
        problem = replace(task.problem, objective=_weights(options.objective))
        task = replace(task, problem=problem)
    if options.parametrisation is not None:
        named = Parametrisation(options.parametrisation)
        task = replace(task, problem=replace(task.problem, parametrisation=named))
    if options.library is not None:
        task = _with_guess(task, load_library(options.library, "--library"))
    elif parameters.library:
        task = _with_guess(task, load_library(Path(parameters.library), "planner.library"))
    return task, Watch() if budget is None else TimeBudget(budget)


def _with_guess(task: PlanningTask, library: Library) -> PlanningTask:
    """Return a task with the nearest plan of a library as its first guess, if it has none."""
    if task.first_guess is not None:
        print_notes(["the scenario has a first guess: the library is not asked for one"])
        return task
    guess = library.first_guess(task)
    if guess is None:
        print_notes([f"of the {len(library.plans)} plans in the library none is near"])
    return replace(task, first_guess=guess)


def _weights(text: str) -> Objective:
    """Return the weights that `--objective` names or gives."""
    if text in OBJECTIVES:
        return OBJECTIVES[text]
    try:
        length, attitude, *duration = map(float, text.split(","))
        return Objective(length, attitude, *duration)
    except (ValueError, TypeError):
        names = ", ".join(OBJECTIVES)
        allowed = f"it must be one of {names}, or two weights such as 1,10 and that of the duration"
        raise InvalidInput(Status.UNSUPPORTED, "--objective", text, allowed) from None


def _method(name: str) -> Method:
    if name == OPTIMAL:
        return plan
    if name == "straight":
        from ff_planner_ros.baselines.straight_line import straight_line

        return without_search(straight_line)
    from ff_planner_ros.baselines.artificial_potential_field import artificial_potential_field
    from ff_planner_ros.baselines.potential_field import load_parameters as load_potential_field

    field = load_potential_field(share_directory() / "config" / "baselines.yaml")
    return without_search(partial(artificial_potential_field, parameters=field))


def verify_plans(options: argparse.Namespace) -> int:
    """Execute plans in an independent physics engine."""
    from ff_planner_ros.commands.verify import Draw, print_monte_carlo, print_verdict

    total, asked = _runs_asked_for(options)
    verdicts, answers = list[bool](), list[dict[str, Any]]()
    for one in _motions(options.source, options):
        motion = one.name, one.robot, one.trajectory
        verdicts.append(print_verdict(*motion, options.sensitivity, one.scene))
        answers.append({"name": one.name, "passed": verdicts[-1]})
        if total is not None:
            draw = Draw(total, options.seed, options.execution, asked or one.uncertainty)
            found = print_monte_carlo(*motion, one.scene, one.limits, draw)
            answers[-1]["monte_carlo"] = found
    _write_json(options.json, {"plans": answers})
    return SOLVED if all(verdicts) else NO_PLAN


def _runs_asked_for(options: argparse.Namespace) -> tuple[int | None, Uncertainty | None]:
    """Return how many runs to make, and of what systems; None: none, and of the usual ones."""
    from ff_planner_ros.commands.verify import uncertainty_of
    from ff_planner_ros.simulation.monte_carlo import require_runs

    if options.monte_carlo is None:
        for name, default in (("seed", 0), ("execution", "tracked"), ("uncertainty", None)):
            value = getattr(options, name)
            if value != default:
                allowed = "it counts beside --monte-carlo alone"
                raise InvalidInput(Status.UNSUPPORTED, f"--{name}", value, allowed)
        return None, None
    require_runs(options.monte_carlo, options.seed)
    told = options.uncertainty
    return options.monte_carlo, None if told is None else uncertainty_of(told)


class _Motion(NamedTuple):
    """A plan to execute."""

    name: str
    robot: Robot
    trajectory: Trajectory
    scene: Scene | None  # None: it is not known
    limits: Limits = Limits()
    uncertainty: Uncertainty = Uncertainty()  # that it was planned for, or else the usual one


def _motions(source: Path, options: argparse.Namespace) -> Iterator[_Motion]:
    """Yield each plan that a file or bag holds or asks for."""
    if source.suffix in (".yaml", ".yml"):
        task, watch = _task(source, options)
        planned = perform(task, watch, _method(options.method))
        problem = lasting(task.problem, planned.duration)
        usual = withstood(task.settings.robust)
        motion = planned.trajectory
        scene = scene_of(problem)
        yield _Motion(source.name, problem.robot, motion, scene, problem.limits, usual)
    elif source.suffix == ".json":
        yield _motion_in_json(source)
    elif source.is_dir() or source.suffix == ".mcap":
        from ff_planner_ros.bag.robot_plans import robot_plans

        recorded = robot_plans(source)
        print_notes(recorded.notes)
        for plan_id, motion in recorded.motions.items():
            seen, limits = recorded.scenes.get(plan_id), recorded.limits[plan_id]
            yield _Motion(plan_id, recorded.robot, motion, seen, limits, recorded.uncertainty)
    else:
        allowed = "it must be a scenario (.yaml), an answer (.json) or a bag (directory or .mcap)"
        raise InvalidInput(Status.UNSUPPORTED, "what to verify", source, allowed)


def _motion_in_json(source: Path) -> _Motion:
    answer = read_json(source)
    try:
        robot, motion = planned_motion(answer)
        scene = planned_scene(answer)
        limits = limits_from(answer.get("limits", {}), Limits())
        told = uncertainty_in(answer)
        return _Motion(source.name, robot, motion, scene, limits, told)
    except InvalidInput as error:
        field = f"{source}: {error.field}"
        raise InvalidInput(error.status, field, error.value, error.allowed) from None


def compare_methods(options: argparse.Namespace) -> int:
    """Let every method plan a scenario, and show the plans side by side."""
    from ff_planner_ros.baselines.potential_field import load_parameters as load_potential_field
    from ff_planner_ros.commands.compare import compare

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


def show_robot(options: argparse.Namespace) -> int:
    """Show what the planner makes of a URDF."""
    robot = robot_from_urdf_text(
        read_urdf(options.urdf),
        options.base_link,
        options.tip_link,
        geometry=None if options.geometry is None else Geometry(options.geometry),
        directory=options.urdf.resolve().parent,
    )
    print_notes(robot.notes)
    print_table(robot_rows(robot))
    if options.draw is not None:
        from ff_planner_ros.analysis.drawing.robot_view import save_robot

        save_robot(robot, options.draw)
        print(f"\n{options.draw}  {options.draw.stat().st_size / 1e6:.1f} MB")
    if options.srdf is not None:
        _write_srdf(options.srdf, robot)
    return SOLVED


def _write_srdf(file: Path, robot: Robot) -> None:
    """Write which links may touch, as MoveIt's assistant does."""
    from ff_planner_ros.robot.collision.pairs import moveit_pairs
    from ff_planner_ros.robot.urdf.srdf import srdf_text

    if robot.geometry is Geometry.LINES:
        allowed = "only links with a <collision> can touch, and this robot is planned with lines"
        raise InvalidInput(Status.UNSUPPORTED, "--srdf", file, allowed)
    if file.exists():
        allowed = "it is there: an SRDF may hold more, and is not replaced"
        raise InvalidInput(Status.UNSUPPORTED, "--srdf", file, allowed)
    tree = ElementTree.fromstring(robot.urdf)
    pairs = moveit_pairs(tree, robot.model, robot.bodies)
    file.write_text(srdf_text(tree.get("name", ""), pairs), encoding="utf-8")
    print(f"\n{file}: {len(pairs)} pairs of links that may touch")


def show_demo(options: argparse.Namespace) -> int:
    """Plan the paper's capture over ROS."""
    import rclpy  # noqa: F401 (the processes of the demo need it: said before they start)

    from ff_planner_ros.demo.run import run_demo

    return run_demo(options.output, testbed=options.testbed)


def run_node(options: argparse.Namespace) -> int:
    """Run the planner node."""
    from ff_planner_ros.ros.node import main as node_main

    return node_main([sys.argv[0], *options.rest])
