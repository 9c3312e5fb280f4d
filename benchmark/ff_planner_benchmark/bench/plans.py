"""How often and how fast the planner finds a plan of problems that are known to have one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import (
    OBJECTIVES,
    Experiment,
    Row,
    attempt,
    each,
    is_solved,
    missed,
    planned,
)
from ff_planner_benchmark.bench.touching import touching
from ff_planner_benchmark.problems.classes import (
    ALL_FEATURES,
    BODIES,
    JOINT_GOALS,
    SCENARIOS,
    SHAPES,
    WITNESSED,
    ProblemClass,
)
from ff_planner_benchmark.problems.shapes import SITUATIONS
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Parametrisation
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.geometry import Geometry

STARTS = {"starts": columns.value("starts", max, "d")}


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
    {"scenarios": columns.count, **columns.TIMES, **columns.WORST, **STARTS},
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
        "problems": columns.among(columns.count, _is_papers),
        "paper's: solved": columns.among(columns.solved, _is_papers),
        "splines: solved": columns.among(columns.solved, _is_spline),
        "paper's: median [s]": columns.among(columns.value("seconds"), _is_papers, is_solved),
        "splines: median [s]": columns.among(columns.value("seconds"), _is_spline, is_solved),
        "joint path, splines / paper's": columns.ratio("joint_path", *_BOTH),
        "attitude, splines / paper's": columns.ratio("attitude", *_BOTH),
    },
    most=40,
    remark=missed("{kind} {number}, {objective}", _is_spline),
)


def _geometries(one: ProblemClass, index: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a problem for every objective, with lines and with shapes, and look for contacts."""
    robot, whole = one.robot(index), one.draw(index).problem

    def contacts(made: Plan | None) -> Row:
        found = touching(whole.robot, made.trajectory, whole.obstacles) if made else ()
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


_touch = columns.share(lambda row: row["touches"])
GEOMETRIES = Experiment(
    "geometries",
    "Lines and shapes side by side, contacts looked for 1000 times a second",
    each([BODIES], _geometries),
    {"objective": "objective"},
    {
        "problems": columns.among(columns.count, _has_lines),
        "lines: solved": columns.among(columns.solved, _has_lines),
        "lines: touch": columns.among(_touch, _has_lines, is_solved),
        "shapes: solved": columns.among(columns.solved, _has_shapes),
        "shapes: touch": columns.among(_touch, _has_shapes, is_solved),
        "time, shapes / lines": columns.ratio("seconds", "geometry", "shapes", "lines", ".2f"),
    },
    parts=("robot",),
    part="robot",
    most=60,
    remark=_of_geometry,
)


def _among_shapes(drawn: Drawn[Any], made: Plan | None) -> Row:
    return starts_of(made) | {"geometry": drawn.problem.robot.geometry.value}


def _situation(row: Row) -> str:
    return SITUATIONS[row["number"] % len(SITUATIONS)]


SHAPES_PLANS = Experiment(
    "shapes",
    "Problems among bodies of any shape",
    each([SHAPES], planned(_among_shapes)),
    {},
    {"problems": columns.count, **columns.TIMES, **columns.WORST, **STARTS},
    parts=(_situation, "robot", "geometry"),
    remark=missed("{robot} {number}"),
)


def _joint_goal(drawn: Drawn[Any], made: Plan | None) -> Row:
    row: Row = {"iterations": made.solver.iterations if made else 0, "error": None, "longer": None}
    if made:
        row["error"] = max(made.metrics.final_position_error, made.metrics.final_orientation_error)
        if made.duration and drawn.problem.duration_range and drawn.witness:
            row["longer"] = made.duration / float(drawn.witness.time[-1])
    return starts_of(made) | row


JOINT_GOAL_PLANS = Experiment(
    "joint goals",
    "Chasers held by wheels, rails, and goals of the joints",
    each(JOINT_GOALS, planned(_joint_goal)),
    {"kind": "kind"},
    {
        "problems": columns.count,
        **columns.TIMES,
        **columns.WORST,
        **STARTS,
        "iterations": columns.among(columns.value("iterations", form=".1f"), is_solved),
        "largest error [m, rad]": columns.value("error", max, ".0e"),
        "duration / reference's": columns.value("longer", form=".2f"),
    },
    remark=missed("{kind} {robot} {number}"),
)


def _all_features(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan problems; of one alone not the first, which takes twenty times the median."""
    first = int(count == 1)
    for number in range(first, first + count):
        yield from planned(_of_witness)(ALL_FEATURES, number, settings)


def _of_witness(drawn: Drawn[Any], made: Plan | None) -> Row:
    """Return the chosen duration over the witness's; None for a miss."""
    chosen = made.duration if made else None
    return {"of_witness": chosen / float(drawn.witness.times[-1]) if chosen else None}


ALL_FEATURES_PLANS = Experiment(
    "all features",
    "All features at once",
    _all_features,
    {},
    {
        "problems": columns.count,
        "solved": columns.solved,
        "median [s]": columns.value("seconds"),
        "90 % [s]": columns.value("seconds", columns.quantile_90),
        "95 % [s]": columns.TIMES["95 % [s]"],
        **columns.WORST,
        "duration / reference's, median": columns.value("of_witness"),
    },
    parts=("robot",),
    part="robot",
    most=100,
    remark=missed("{robot} {number}"),
)
