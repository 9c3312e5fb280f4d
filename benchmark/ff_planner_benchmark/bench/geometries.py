"""The same problems planned with lines and with shapes: success rate, contacts and time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_benchmark.bench.measurement import (
    OBJECTIVES,
    Attempt,
    Measurement,
    median,
    misses,
    timed_plan,
    timed_plans,
)
from ff_planner_ros.analysis.touching import touching
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies
from ff_planner_ros.problems.bodies import Swept, sphere_gap
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot

# Clearance of added spheres from the bodies along the plan [m].
_APART = 0.05
_NAME = "{0.robot} {0.number}, {0.objective}"  # of a problem
_HEADER = (
    *("objective", "robot", "problems", "lines: solved", "lines: touch", "shapes: solved"),
    *("shapes: touch", "time, shapes / lines"),
)
_CROWD_HEADER = (
    *("problem", "spheres", "lines [s]", "shapes [s]", "shapes / lines"),
    *("lines: rollouts", "shapes: rollouts"),
)


@dataclass(frozen=True)
class GeometryAttempt(Attempt):
    """The planner's result on one problem with one geometry."""

    robot: str
    number: int
    objective: str  # key of `OBJECTIVES`
    geometry: Geometry  # that was planned with
    touches: tuple[str, ...]  # pairs of bodies that touch along the plan, with either geometry


@dataclass(frozen=True)
class Crowd:
    """Planning times of one problem among many spheres."""

    problem: str
    spheres: int  # number
    lines: float  # median processor time with lines [s]
    shapes: float  # median processor time with shapes [s]
    lines_rollouts: int  # of the search with lines
    shapes_rollouts: int  # of the search with shapes, which has more constraints


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` problems for every objective, with lines and with shapes."""
    tried = list(geometry_attempts(count, settings))
    title = "Lines and shapes side by side, contacts looked for 1000 times a second"
    shapes = [each for each in tried if each.geometry is Geometry.SHAPES]
    contacts = [f"touches: {_NAME.format(each)}: {each.touches}" for each in shapes if each.touches]
    table = Table(title, _HEADER, [*geometry_rows(tried)])
    return Measurement(tried, [table], [*misses(shapes, _NAME), *contacts])


def geometry_attempts(count: int, settings: PlannerSettings) -> Iterator[GeometryAttempt]:
    """Plan `count` problems for every objective, with lines and with shapes; robots in turn."""
    for index in range(count):
        number, robot = divmod(index, len(bodies.ROBOTS))
        for objective in OBJECTIVES:
            for geometry in (Geometry.LINES, Geometry.SHAPES):
                yield geometry_attempt(bodies.ROBOTS[robot], number, objective, geometry, settings)


def geometry_attempt(
    robot: str, number: int, objective: str, geometry: Geometry, settings: PlannerSettings
) -> GeometryAttempt:
    """Plan one problem with one geometry, and look for contacts of bodies along the plan."""
    whole = replace(bodies.problem(robot, number).problem, objective=OBJECTIVES[objective])
    asked = replace(whole, robot=bench_robot(robot, geometry))
    made, outcome = timed_plan(PlanningTask(asked, settings))
    found = touching(whole.robot, made.trajectory, whole.spheres) if made else ()
    return GeometryAttempt(robot, number, objective, geometry, tuple(sorted(found)), **outcome)


def geometry_rows(tried: Sequence[GeometryAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each objective and robot, and for all robots."""
    for objective in OBJECTIVES:
        for robot in ("all", *bodies.ROBOTS):
            group = [
                each
                for each in tried
                if each.objective == objective and robot in ("all", each.robot)
            ]
            lines, shapes = (
                [e for e in group if e.geometry is g] for g in (Geometry.LINES, Geometry.SHAPES)
            )
            if not lines:
                continue
            cells = list[str]()
            for one in (lines, shapes):
                found = [each for each in one if each.solved]
                touch = sum(bool(each.touches) for each in found)
                cells.append(percent(len(found) / len(one)))
                cells.append(percent(touch / len(found)) if found else "-")
            ratios = [
                b.seconds / a.seconds
                for a, b in zip(lines, shapes, strict=True)
                if a.solved and b.solved
            ]
            cells.append(median(ratios, 2))
            yield (objective, robot, f"{len(lines)}", *cells)


def crowd_measurement(settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Compare planning times with lines and with shapes, among few and many spheres."""
    runs, sizes = (1, (3, 30)) if quick else (5, (3, 200))
    found = list(crowds(crowded_problems(), settings, sizes, runs))
    rows = [
        (
            *(each.problem, f"{each.spheres}", f"{each.lines:.3f}", f"{each.shapes:.3f}"),
            *(f"{each.shapes / each.lines:.2f}", f"{each.lines_rollouts}"),
            f"{each.shapes_rollouts}",
        )
        for each in found
    ]
    title = "Processor time with lines and with shapes, min(L)"
    return Measurement(found, [Table(title, _CROWD_HEADER, rows)])


def crowded_problems() -> dict[str, PlanningProblem]:
    """Return problems of robots with shapes among three spheres."""
    scenarios = share_directory() / "config" / "scenarios"
    found = {
        name: load_scenario(scenarios / f"{name}.yaml")
        for name in ("lemur_capture_bodies", "canadarm2_capture")
    }
    drawn = bodies.problem("arm6", 0).problem
    return found | {"arm6": replace(drawn, obstacles=drawn.obstacles[:3])}


def crowds(
    problems: dict[str, PlanningProblem],
    settings: PlannerSettings,
    sizes: Sequence[int],
    runs: int,
) -> Iterator[Crowd]:
    """Yield planning times with lines and with shapes among increasing numbers of spheres.

    Added spheres stay clear of the plan among the problem's own.

    Args:
        problems: Problems of robots with shapes, by name.
        sizes: Numbers of spheres.
        runs: Number of timed runs, after one to warm up; the median counts.
    """
    for name, problem in problems.items():
        q, _ = from_trajectory(problem.robot, perform(PlanningTask(problem, settings)).trajectory)
        spheres = _more_spheres(problem, Swept(problem.robot, q), max(sizes))
        for size in sizes:
            crowded = replace(problem, obstacles=spheres[:size])
            as_lines = replace(crowded, robot=_with_lines(problem))
            lines, of_lines = _measured(as_lines, settings, runs)
            shapes, of_shapes = _measured(crowded, settings, runs)
            yield Crowd(name, size, lines, shapes, of_lines, of_shapes)


def _with_lines(problem: PlanningProblem) -> Robot:
    return replace(problem.robot, geometry=Geometry.LINES, bodies=(), pairs=())


def _more_spheres(problem: PlanningProblem, way: Swept, count: int) -> tuple[Sphere, ...]:
    """Return a problem's spheres and others around the robot, clear of its bodies on the way."""
    rng = np.random.default_rng(0)
    spheres = list(problem.spheres)
    middle, reach = way.centers.mean(axis=(0, 1)), np.ptp(way.centers, axis=(0, 1)).max()
    while len(spheres) < count:
        center = middle + rng.uniform(-1.5 * reach, 1.5 * reach, 3)
        sphere = Sphere(f"far{len(spheres)}", center, reach * rng.uniform(0.02, 0.08))
        if sphere_gap(way, sphere, _APART) > _APART:
            spheres.append(sphere)
    return tuple(spheres)


def _measured(problem: PlanningProblem, settings: PlannerSettings, runs: int) -> tuple[float, int]:
    """Return the median time of a plan [s] after one that does not count, and its rollouts."""
    plans, seconds = timed_plans([problem] * (1 + runs), settings, warm_up=1)
    return seconds, plans[0].solver.rollouts
