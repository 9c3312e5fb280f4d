"""How often and how fast the planner finds a plan of problems that are known to have one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ff_planner_benchmark.bench.experiment import (
    OBJECTIVES,
    SOLVED,
    TIMES,
    WORST,
    Experiment,
    Row,
    among,
    attempt,
    count,
    each,
    is_solved,
    missed,
    quantile_90,
    ratio,
    share,
    solved,
    timed_plan,
    value,
)
from ff_planner_benchmark.problems.classes import (
    ALL_FEATURES,
    BODIES,
    CAPTURED,
    JOINT_GOALS,
    SCENARIOS,
    SHAPES,
    TUMBLING,
    WITNESSED,
    ProblemClass,
)
from ff_planner_benchmark.problems.shapes import SITUATIONS
from ff_planner_ros.analysis.touching import touching
from ff_planner_ros.errors import FfPlannerError, NoPlanFound
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.geometry import Geometry

STARTS = {"starts": value("starts", max, "d")}


def starts_of(made: Plan | None) -> Row:
    """Return the initial guesses tried; 0 for a miss."""
    return {"starts": made.solver.starts if made else 0}


def _scenario(one: ProblemClass, index: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a scenario: the robots in turn, each as drawn and in a turned inertial frame."""
    pair, turned = divmod(index, 2)
    robot, number = one.robot(pair), pair // len(one.robots)
    problem = scenario(one.name, robot, number, turned=bool(turned)).problem
    labels = {"kind": one.name, "robot": robot, "number": number, "turned": bool(turned)}
    yield attempt(PlanningTask(problem, settings), starts_of, **labels)


SCENARIO_PLANS = Experiment(
    "scenarios",
    "Scenarios that have a plan",
    each(SCENARIOS, _scenario),
    {"class": "kind"},
    {"scenarios": count, **TIMES, **WORST, **STARTS},
    parts=("robot", lambda row: "frame turned" if row["turned"] else "as drawn"),
    remark=lambda row: missed(
        "{kind} {robot} {number}, turned" if row["turned"] else "{kind} {robot} {number}"
    )(row),
)

# The path families, and what part of a class is also planned for min(Theta), which takes ten times
# as long.
_PAPERS, _SPLINES = Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE
_STEADY = 8


def _families(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan problems of each class with both parameterisations."""
    for one in (*SCENARIOS, *WITNESSED):
        for index in range(count):
            problem, names = one.draw(index).problem, ["min(L)"]
            if one in SCENARIOS and index < count // _STEADY:
                names.append("min(Theta)")
            for name in names:
                for family in (_PAPERS, _SPLINES):
                    asked = replace(problem, objective=OBJECTIVES[name], parametrisation=family)
                    labels = {"kind": one.name, "objective": name, "number": index}
                    labels |= {"parametrisation": family.value}
                    yield attempt(PlanningTask(asked, settings), _lengths, **labels)


def _lengths(made: Plan | None) -> Row:
    joint_path, attitude = (
        (made.metrics.joint_path_length, made.metrics.max_chaser_euler) if made else (None, None)
    )
    return {"joint_path": joint_path, "attitude": attitude}


def _is_papers(row: Row) -> bool:
    return bool(row["parametrisation"] == _PAPERS.value)


def _is_spline(row: Row) -> bool:
    return bool(row["parametrisation"] == _SPLINES.value)


_BOTH = ("parametrisation", _SPLINES.value, _PAPERS.value)
FAMILIES = Experiment(
    "families",
    "Path families side by side",
    _families,
    {"class": "kind", "objective": "objective"},
    {
        "problems": among(count, _is_papers),
        "paper's: solved": among(solved, _is_papers),
        "splines: solved": among(solved, _is_spline),
        "paper's: median [s]": among(value("seconds"), _is_papers, is_solved),
        "splines: median [s]": among(value("seconds"), _is_spline, is_solved),
        "joint path, splines / paper's": ratio("joint_path", *_BOTH),
        "attitude, splines / paper's": ratio("attitude", *_BOTH),
    },
    most=40,
    remark=missed("{kind} {number}, {objective}", _is_spline),
)


def _geometries(one: ProblemClass, index: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a problem for every objective, with lines and with shapes, and look for contacts."""
    robot, whole = one.robot(index), one.draw(index).problem

    def contacts(made: Plan | None) -> Row:
        found = touching(whole.robot, made.trajectory, whole.spheres) if made else ()
        return {"touches": sorted(found)}

    for name, objective in OBJECTIVES.items():
        for geometry in (Geometry.LINES, Geometry.SHAPES):
            asked = replace(whole, objective=objective, robot=bench_robot(robot, geometry))
            labels = {"robot": robot, "number": index // len(one.robots), "objective": name}
            labels |= {"geometry": geometry.value}
            yield attempt(PlanningTask(asked, settings), contacts, **labels)


def _has_lines(row: Row) -> bool:
    return bool(row["geometry"] == Geometry.LINES.value)


def _has_shapes(row: Row) -> bool:
    return not _has_lines(row)


def _of_geometry(row: Row) -> str:
    """Return what is told of a plan with shapes that is missing, or touches something."""
    name = "{robot} {number}, {objective}"
    if _has_shapes(row) and row["touches"]:
        return f"touches: {name.format_map(row)}: {row['touches']}"
    return missed(name, _has_shapes)(row)


_touch = share(lambda row: row["touches"])
GEOMETRIES = Experiment(
    "geometries",
    "Lines and shapes side by side, contacts looked for 1000 times a second",
    each([BODIES], _geometries),
    {"objective": "objective"},
    {
        "problems": among(count, _has_lines),
        "lines: solved": among(solved, _has_lines),
        "lines: touch": among(_touch, _has_lines, is_solved),
        "shapes: solved": among(solved, _has_shapes),
        "shapes: touch": among(_touch, _has_shapes, is_solved),
        "time, shapes / lines": ratio("seconds", "geometry", "shapes", "lines", ".2f"),
    },
    parts=("robot",),
    part="robot",
    most=60,
    remark=_of_geometry,
)


def _among_shapes(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
    task = one.task(number, settings)
    situation, lines = SITUATIONS[number % len(SITUATIONS)], not task.problem.robot.bodies
    labels = {"situation": situation, "robot": one.robot(number), "lines": lines, "number": number}
    yield attempt(task, starts_of, **labels)


SHAPES_PLANS = Experiment(
    "shapes",
    "Problems among bodies of any shape",
    each([SHAPES], _among_shapes),
    {},
    {"problems": count, **TIMES, **WORST, **STARTS},
    parts=("situation", "robot", lambda row: "lines" if row["lines"] else "shapes"),
    remark=missed("{robot} {number}, {situation}"),
)


def _joint_goal(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
    drawn = one.draw(number)

    def measured(made: Plan | None) -> Row:
        row: Row = {"iterations": made.solver.iterations if made else 0, "error": None}
        row["longer"] = None
        if made:
            row["error"] = max(
                made.metrics.final_position_error, made.metrics.final_orientation_error
            )
            if made.duration and drawn.problem.duration_range and drawn.witness:
                row["longer"] = made.duration / float(drawn.witness.time[-1])
        return starts_of(made) | row

    labels = {"kind": one.name, "robot": one.robot(number), "number": number}
    yield attempt(drawn.task(settings), measured, **labels)


JOINT_GOAL_PLANS = Experiment(
    "joint goals",
    "Chasers held by wheels, rails, and goals of the joints",
    each(JOINT_GOALS, _joint_goal),
    {"kind": "kind"},
    {
        "problems": count,
        **TIMES,
        **WORST,
        **STARTS,
        "iterations": among(value("iterations", form=".1f"), is_solved),
        "largest error [m, rad]": value("error", max, ".0e"),
        "duration / reference's": value("longer", form=".2f"),
    },
    remark=missed("{kind} {robot} {number}"),
)


def _captured(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a task with a captured body; its time is the mean of its phases."""
    task, begun = one.task(number, settings), time.process_time()
    row: Row = {"kind": one.name, "robot": one.robot(number), "number": number, "force": None}
    outcome = {"status": SOLVED, "message": ""}
    try:
        row["force"] = perform(task).phases[-1].metrics.peak_grasp_force  # [N]
    except FfPlannerError as error:
        outcome = {"status": error.status.name, "message": str(error)}
    seconds = (time.process_time() - begun) / (1 + len(task.then))
    yield row | outcome | {"seconds": seconds}


CAPTURED_PLANS = Experiment(
    "captured",
    "With a captured body, time of each phase",
    each(CAPTURED, _captured),
    {"kind": "kind"},
    {
        "problems": count,
        **TIMES,
        **WORST,
        "largest grasp force [N]": value("force", max, ".1f"),
    },
    most=60,
    remark=missed("{kind} {robot} {number}"),
)


def _capture(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a capture, and execute the plan."""
    task = one.task(number, settings)
    labels = {"kind": one.name, "number": number}
    yield attempt(task, lambda made: _errors(task.problem, made), **labels)


def _errors(problem: PlanningProblem, made: Plan | None) -> Row:
    """Return the end effector's errors against the grasp, at the capture in MuJoCo.

    Position [m], orientation [rad], velocity [m/s]; None for a miss, and without MuJoCo.
    """
    names = "position_error", "orientation_error", "linear_speed"
    try:
        from ff_planner_ros.simulation.verification import verify
    except FfPlannerError:  # the rest of the table needs none
        return dict.fromkeys(names)
    found = made and verify(problem.robot, made.trajectory, scene_of(problem)).capture
    return {name: getattr(found, name) if found else None for name in names}


CAPTURES = Experiment(
    "captures",
    "Captures of bodies that tumble",
    each(TUMBLING, _capture),
    {"class": "kind"},
    {
        "problems": count,
        **TIMES,
        "apart in MuJoCo [mm]": value("position_error", max, ".4f", 1e3),
        "[deg]": value("orientation_error", max, ".4f", float(np.rad2deg(1.0))),
        "moving apart [mm/s]": value("linear_speed", max, ".4f", 1e3),
    },
    most=60,
    remark=missed("{kind} {number}"),
)

# Ranges of durations over the witness's: around it, and down to what no arm can do.
RANGES = {"70 %": (0.7, 1.3), "10 %": (0.1, 1.3)}
# Of the sweep, in parts of the duration that was chosen, the longest first.
_SWEPT = (0.98, 0.96, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)


def _fastest(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan captures of minimum duration, and sweep over fixed ones unless there is only one."""
    one = TUMBLING[0]
    for name, part in RANGES.items():
        for index in range(count):
            given = one.draw(index).problem
            problem = fastest(given, part)

            def measured(
                made: Plan | None,
                given: PlanningProblem = given,
                problem: PlanningProblem = problem,
            ) -> Row:
                if made is None:
                    return {"of_witness": None, "of_sweep": None}
                chosen = problem.duration if made.duration is None else made.duration
                swept = _swept(problem, chosen, settings) if count > 1 else chosen
                return {"of_witness": chosen / given.duration, "of_sweep": chosen / swept}

            labels = {"shortest": name, "number": index}
            yield attempt(PlanningTask(problem, settings), measured, **labels)


def fastest(problem: PlanningProblem, part: tuple[float, float]) -> PlanningProblem:
    """Return a problem of minimum duration; part: shortest and longest over the given duration."""
    shortest, longest = (one * problem.duration for one in part)
    body = problem.target_body
    return replace(
        problem,
        duration=longest,
        target=problem.target if body is None else body.target(longest),
        duration_range=DurationRange(shortest, longest),
        objective=Objective(0.0, 0.0, duration=1.0),
    )


def _swept(problem: PlanningProblem, chosen: float, settings: PlannerSettings) -> float:
    """Return the shortest fixed duration [s] with a plan, up to the chosen one."""
    found = chosen
    for part in _SWEPT:
        if part * chosen >= problem.durations.minimum:
            try:
                perform(PlanningTask(lasting(problem, part * chosen), settings))
            except NoPlanFound:
                continue
            found = part * chosen
    return found


FREE_MOMENTS = Experiment(
    "free moments",
    "Fastest captures",
    _fastest,
    {"from": "shortest"},
    {
        "problems": count,
        **TIMES,
        "slowest / reference's": value("of_witness", max),
        "slowest / sweep's": value("of_sweep", max),
    },
    most=20,
    remark=missed("{shortest} {number}"),
)


def _all_features(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan problems; of one alone not the first, which takes twenty times the median."""
    one, first = ALL_FEATURES, count == 1
    for index in range(first, first + count):
        drawn = one.draw(index)
        made, outcome = timed_plan(drawn.task(settings))
        part = made.duration / float(drawn.witness.times[-1]) if made and made.duration else None
        labels = {"robot": one.robot(index), "number": index, "of_witness": part}
        yield labels | outcome


ALL_FEATURES_PLANS = Experiment(
    "all features",
    "All features at once",
    _all_features,
    {},
    {
        "problems": count,
        "solved": solved,
        "median [s]": value("seconds"),
        "90 % [s]": value("seconds", quantile_90),
        "95 % [s]": TIMES["95 % [s]"],
        **WORST,
        "duration / reference's, median": value("of_witness"),
    },
    parts=("robot",),
    part="robot",
    most=100,
    remark=missed("{robot} {number}"),
)
