"""The tables of the benchmark.

One process makes them all, on one core, and warms up before it takes times. It is a process of its
own, because numerical libraries read the number of threads from the environment when they load.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.bench.attitude import BEST_KNOWN, Steadiness, steadiness
from ff_planner_ros.bench.beliefs import BELIEFS, BeliefResult, belief_results
from ff_planner_ros.bench.captures import HEADER as CAPTURES_HEADER
from ff_planner_ros.bench.captures import capture_attempts, capture_rows
from ff_planner_ros.bench.families import HEADER, family_attempts, side_by_side
from ff_planner_ros.bench.free_moments import HEADER as FREE_HEADER
from ff_planner_ros.bench.free_moments import free_attempts, free_rows
from ff_planner_ros.bench.geometries import HEADER as GEOMETRIES_HEADER
from ff_planner_ros.bench.geometries import (
    crowded_problems,
    crowds,
    geometry_attempts,
    geometry_rows,
)
from ff_planner_ros.bench.methods import OURS, Result, method_results
from ff_planner_ros.bench.replanning import HEADER as REPLANNING_HEADER
from ff_planner_ros.bench.replanning import replanned, rows
from ff_planner_ros.bench.scaling import Growth, with_joints, with_points, with_spheres
from ff_planner_ros.bench.starts import StartAttempt, joins, null_space_starts
from ff_planner_ros.bench.success import Attempt, attempts, solved_and_times
from ff_planner_ros.common.one_thread import ONE_THREAD
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import KINDS
from ff_planner_ros.robot.bodies import Geometry

# Scenarios of each class whose plans are executed: as many as in a published check by others.
_EXECUTED = 40
# Scenarios that are planned from starts in motion.
_STARTS = 20
# Rounds of search for the attitude that are compared: a race alone, and with hops, the default.
_ROUNDS = (0, 1, 3)
# Problems of each class that are planned in both path families.
_FAMILIES = 40
# Problems that are planned with lines and with shapes.
_GEOMETRIES = 60
# Bodies of each class that are captured, and the plans executed.
_CAPTURES = 60
# Of which the planner chooses the duration, in each range; a sweep over durations follows.
_FREE = 20


def run_on_one_core(quick: bool, scenarios: int | None, json_file: Path | None) -> int:
    """Print the tables from a process of their own, and return its exit code.

    Args:
        quick: Whether to use smaller sizes and to stop the other methods early.
        scenarios: Of each class; None: 200, or 4 if quick.
    """
    arguments = [str(int(quick)), str(scenarios or (4 if quick else 200)), str(json_file or "")]
    command = [sys.executable, "-u", "-m", "ff_planner_ros.bench.report", *arguments]
    return subprocess.run(command, env=os.environ | ONE_THREAD, check=False).returncode


def main(quick: bool, scenarios: int, json_file: str) -> None:
    """Print the tables, and write all figures to a JSON file if its name is not empty."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    config = share_directory() / "config"
    problem = load_scenario(config / "scenarios" / "lemur_capture.yaml")
    settings = load_parameters().planner
    figures: dict[str, Any] = {"machine": machine()}
    for name, value in figures["machine"].items():
        print(f"{name:8}  {value}")
    figures["methods"] = print_methods(problem, settings, quick=quick)
    figures["scaling"] = print_scaling(problem, settings, quick=quick)
    figures["scenarios"] = print_success(scenarios, settings)
    figures["starts"] = print_starts(min(scenarios, _STARTS), settings)
    figures["replanning"] = print_replanning(problem, min(scenarios, _STARTS), settings)
    figures["families"] = print_families(min(scenarios, _FAMILIES), settings)
    figures["geometries"] = print_geometries(min(scenarios, _GEOMETRIES), settings)
    figures["crowds"] = print_crowds(settings, quick=quick)
    figures["captures"] = print_captures(1 if quick else min(scenarios, _CAPTURES), settings)
    figures["free moments"] = print_free_moments(min(scenarios, _FREE), settings, quick=quick)
    figures["steadiness"] = print_steadiness(1 if quick else len(BEST_KNOWN), settings)
    figures["executions"] = print_executions(1 if quick else min(scenarios, _EXECUTED), settings)
    if json_file:
        Path(json_file).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def machine() -> dict[str, str]:
    """Return what the figures depend on."""
    cpu = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            cpu = line.partition(":")[2].strip()
            break
    versions = [
        f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "pin", "piqp", "scipy")
    ]
    threads = [f"{name}={os.environ.get(name, 'not set')}" for name in ONE_THREAD]
    return {
        "machine": f"{cpu}, {len(os.sched_getaffinity(0))} core of {os.cpu_count()} used",
        "threads": ", ".join(threads),
        "versions": ", ".join([f"Python {platform.python_version()}", *versions]),
    }


def print_methods(
    problem: PlanningProblem, settings: PlannerSettings, *, quick: bool
) -> list[dict[str, Any]]:
    """Compare methods, stop the others early if quick, and return the figures."""
    runs, iterations = (1, 2) if quick else (7, 200)
    results = list(method_results(problem, settings, runs, iterations))
    ours = {result.objective: result for result in results if result.method == OURS}
    header = (
        "objective", "method", "time / ours", "time [s]", "rollouts", "value [rad]",
        "optimality", "clearance [mm]", "why it stopped",
    )  # fmt: skip
    rows = [
        (
            r.objective, r.method, f"{r.seconds / ours[r.objective].seconds:.1f}",
            f"{r.seconds:.3f}", f"{r.rollouts}", *_of_path(r), r.message,
        )
        for r in results
    ]  # fmt: skip
    print_table("The paper's capture, 50 points", header, rows)
    if not any(result.method.startswith("IPOPT") for result in results):
        print("IPOPT is not installed (`pip install casadi` brings it along)")
    return _figures(results)


def _of_path(result: Result) -> Iterator[str]:
    """Yield value, optimality and clearance [mm] of where a method ended."""
    if result.value is None or result.optimality is None or result.clearance is None:
        yield from ("singular", "-", "-")
        return
    yield f"{result.value:.4f}"
    yield f"{result.optimality:.1e}"
    yield f"{result.clearance * 1e3:.1f}"


def print_scaling(
    problem: PlanningProblem, settings: PlannerSettings, *, quick: bool
) -> list[dict[str, Any]]:
    """Show how time grows, leave out the large sizes if quick, and return the figures."""
    runs, count = (1, 1) if quick else (5, 20)
    spheres, points = ((3, 30), (50, 100)) if quick else ((3, 30, 100, 1000), (50, 100, 200, 500))
    joints = (7, 6) if quick else (7, 6, 9)
    growth: list[Growth] = []
    for what, found in (
        (
            "spheres: the paper's capture, more that leave the plan as it is",
            with_spheres(problem, settings, spheres, runs),
        ),
        ("points: the paper's capture", with_points(problem, settings, points, runs)),
        (
            f"joints: arms on {count} ordinary scenarios, medians",
            with_joints(settings, joints, count),
        ),
    ):
        first, *others = found
        growth += [first, *others]
        rows = [
            (f"{r.size}", f"{r.seconds / first.seconds:.2f}", f"{r.seconds:.3f}", f"{r.rollouts:g}")
            for r in (first, *others)
        ]
        header = (first.of, f"time / {first.size}", "time [s]", "rollouts")
        print_table(f"Time grows with {what}", header, rows)
    return _figures(growth)


def print_success(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Plan the scenarios, and return the figures."""
    tried = [attempt for kind in KINDS for attempt in attempts(kind, count, settings)]
    groups: list[tuple[str, Callable[[Attempt], bool]]] = [("all", lambda _: True)]
    groups += [(robot, lambda a, robot=robot: a.robot == robot) for robot in ROBOTS]  # type: ignore[misc]
    groups += [("as drawn", lambda a: not a.turned), ("frame turned", lambda a: a.turned)]
    rows = [
        (kind, name, *_summary([a for a in tried if a.kind == kind and belongs(a)]))
        for kind in KINDS
        for name, belongs in groups
    ]
    header = (
        "class",
        "which",
        "scenarios",
        "solved",
        "median [s]",
        "95 % [s]",
        "worst [s]",
        "starts",
    )
    print_table("Scenarios that have a plan", header, rows)
    for a in tried:
        if not a.solved:
            twin = ", turned" if a.turned else ""
            print(f"missed: {a.kind} {a.robot} {a.number}{twin}: {a.status.name}: {a.message}")
    return _figures(tried)


def print_starts(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Plan from starts in motion, and return the figures."""
    tried = [*joins(count, settings), *null_space_starts(count, settings)]
    rows = [
        (kind, *_joined([each for each in tried if each.kind == kind]))
        for kind in dict.fromkeys(each.kind for each in tried)
    ]
    header = ("start", "tried", "solved", "largest jump [rad/s]", "[rad/s2]")
    print_table("Starts in motion, ordinary scenarios", header, rows)
    for each in tried:
        if each.status is not Status.SOLVED:
            print(f"missed: {each.kind}, {each.robot} {each.number}: {each.message}")
    return _figures(tried)


def print_replanning(
    problem: PlanningProblem, count: int, settings: PlannerSettings
) -> list[dict[str, Any]]:
    """Print how fast plans are that take over from one that runs."""
    results = list(replanned(problem, count, settings))
    print_table("Replanning in motion", REPLANNING_HEADER, rows(results))
    return [asdict(one) for one in results]


def print_families(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Plan the same problems in both path families, and return the figures."""
    tried = list(family_attempts(count, settings))
    print_table("Path families side by side", HEADER, list(side_by_side(tried)))
    for each in tried:
        if not each.solved and each.parametrisation is Parametrisation.JOINT_SPLINE:
            print(f"missed: {each.kind} {each.number}, {each.objective}: {each.message}")
    return _figures(tried)


def print_geometries(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Plan the same problems with lines and with shapes, and return the figures."""
    tried = list(geometry_attempts(count, settings))
    title = "Lines and shapes side by side, contacts looked for 1000 times a second"
    print_table(title, GEOMETRIES_HEADER, list(geometry_rows(tried)))
    for each in tried:
        if not each.solved and each.geometry is Geometry.SHAPES:
            print(f"missed: {each.robot} {each.number}, {each.objective}: {each.message}")
        if each.touches and each.geometry is Geometry.SHAPES:
            print(f"touches: {each.robot} {each.number}, {each.objective}: {each.touches}")
    return _figures(tried)


def print_crowds(settings: PlannerSettings, *, quick: bool) -> list[dict[str, Any]]:
    """Compare times of lines and shapes among few and many spheres, and return the figures."""
    runs, sizes = (1, (3, 30)) if quick else (5, (3, 200))
    found = list(crowds(crowded_problems(), settings, sizes, runs))
    rows = [
        (
            each.problem,
            f"{each.spheres}",
            f"{each.lines:.3f}",
            f"{each.shapes:.3f}",
            f"{each.shapes / each.lines:.2f}",
            f"{each.lines_rollouts}",
            f"{each.shapes_rollouts}",
        )
        for each in found
    ]
    header = (
        *("problem", "spheres", "lines [s]", "shapes [s]", "shapes / lines"),
        *("lines: rollouts", "shapes: rollouts"),
    )
    print_table("Processor time with lines and with shapes, min(L)", header, rows)
    return _figures(found)


def print_captures(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Capture bodies that tumble, and return the figures."""
    tried = list(capture_attempts(count, settings))
    print_table("Captures of bodies that tumble", CAPTURES_HEADER, list(capture_rows(tried)))
    for each in tried:
        if each.status is not Status.SOLVED:
            print(f"missed: {each.kind} {each.number}: {each.status.name}: {each.message}")
    return _figures(tried)


def print_free_moments(
    count: int, settings: PlannerSettings, *, quick: bool
) -> list[dict[str, Any]]:
    """Plan the fastest captures, and return the figures."""
    tried = list(free_attempts(count, settings, sweep=not quick))
    print_table("Fastest captures", FREE_HEADER, list(free_rows(tried)))
    for each in tried:
        if each.status is not Status.SOLVED:
            print(f"missed: {each.shortest} {each.number}: {each.status.name}: {each.message}")
    return _figures(tried)


def print_steadiness(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Compare plans of least attitude with the best that are known, and return the figures."""
    done = [each for rounds in _ROUNDS for each in steadiness(count, rounds, settings)]
    rows = [
        (f"{rounds}", *_nearness([each for each in done if each.rounds == rounds]))
        for rounds in _ROUNDS
    ]
    header = (
        "rounds", "scenarios", "min(L)", "min(Theta) too", "worse than min(L)",
        "attitude / best, median",
        "worst", "processor time, median [s]", "worst [s]",
    )  # fmt: skip
    print_table("Chaser attitude beside the best that is known", header, rows)
    return _figures(done)


def _nearness(group: Sequence[Steadiness]) -> Iterator[str]:
    pairs = [(each.shortest, each.steadiest) for each in group if each.shortest is not None]
    both = [(short, steady) for short, steady in pairs if steady is not None]
    yield from (f"{len(group)}", f"{len(pairs)}", f"{len(both)}")
    yield f"{sum(steady > short for short, steady in both)}"
    ratios = [e.steadiest / e.best_known for e in group if e.steadiest is not None]
    seconds = [each.seconds for each in group]
    yield from (f"{np.median(ratios):.2f}", f"{max(ratios):.2f}")
    yield from (f"{np.median(seconds):.2f}", f"{max(seconds):.2f}")


def print_executions(count: int, settings: PlannerSettings) -> list[dict[str, Any]]:
    """Execute plans that misjudge the chaser on the true system, and return the figures."""
    done = [each for kind in KINDS for each in belief_results(kind, count, settings)]
    rows = [
        (kind, belief, *_misses([e for e in done if (e.kind, e.belief) == (kind, belief)]))
        for kind in KINDS
        for belief in BELIEFS
    ]
    header = (
        "class", "planned for", "scenarios", "plans", "collide", "miss, median [mm]",
        "worst [mm]", "median [deg]", "worst [deg]",
    )  # fmt: skip
    print_table("Plans executed on the true free-floating system", header, rows)
    return _figures(done)


def _figures(results: Iterable[Any]) -> list[dict[str, Any]]:
    """Return results as dictionaries for JSON, with a status by its name."""
    rows = [asdict(result) for result in results]
    return [row | ({"status": row["status"].name} if "status" in row else {}) for row in rows]


def _misses(group: Sequence[BeliefResult]) -> Iterator[str]:
    planned = [each for each in group if each.status is Status.SOLVED]
    yield from (f"{len(group)}", f"{len(planned)}")
    if not planned:
        yield from "-----"
        return
    miss = np.array([each.position_miss for each in planned], float) * 1e3
    turn = np.rad2deg(np.array([each.orientation_miss for each in planned], float))
    yield f"{sum(each.collides for each in planned) / len(planned):.0%}"
    yield from (f"{np.median(miss):.1f}", f"{miss.max():.1f}")
    yield from (f"{np.median(turn):.2f}", f"{turn.max():.2f}")


def _joined(group: Sequence[StartAttempt]) -> Iterator[str]:
    solved = [each for each in group if each.status is Status.SOLVED]
    yield from (f"{len(group)}", f"{len(solved)}")
    for jumps in ([s.rate_jump for s in solved], [s.acceleration_jump for s in solved]):
        known = [jump for jump in jumps if not np.isnan(jump)]
        yield f"{max(known):.0e}" if known else "-"


def _summary(group: Sequence[Attempt]) -> Iterator[str]:
    if not group:
        yield from "0-----"
        return
    seconds = [a.seconds for a in group]
    yield from solved_and_times([a.solved for a in group], seconds)
    yield f"{max(seconds):.3f}"
    yield f"{max((a.starts for a in group if a.solved), default=0)}"


if __name__ == "__main__":
    main(bool(int(sys.argv[1])), int(sys.argv[2]), sys.argv[3])
