"""How far the arm of P5 reaches in each of 98 directions, while its chaser turns by little.

The source pulls the hand along a straight line, under one velocity law, until the cube has turned
by the limit, the arm comes within 2 cm of the cube, or the hand stalls. Here a point on that line
counts if there is a plan to it, by any way, that keeps limit and distance, also between its points;
links of the arm must not touch each other either. The time of a motion does not matter: with the
momentum zero, the cube turns by what the joints do, however fast.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from ff_planner_benchmark.bench.report import machine
from ff_planner_benchmark.gallery.recomputed import HERE
from ff_planner_ros.analysis.json_file import json_text, read_json
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, built_task
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import robot_from_urdf_text

LIMITS = (0.5, 1.0, 2.0)  # of the chaser's rotation [deg]
# Least, median and farthest reach [cm] and volume [m3], as printed in DECISIONS.md, D30
PUBLISHED = {0.5: ("", "26", "", ""), 1.0: ("", "", "", ""), 2.0: ("24", "45", "75", "0.585")}
PUBLISHED_SECONDS = 85.0  # for all directions, on one thread
_STEP = 8  # from a point to the next one outward, before the last step is halved [cm]
_STRIDE = 37  # between two directions that are tried one after the other
_GUESSES = 5  # initial guesses, beside the plan to the point before
_KEPT = 0.02  # by the arm from the cube [m]
_HEAD = """`ff-planner-benchmark reach --json FILE` asks for plans outward from the start pose, in
each of the source's 98 directions (to all points of a grid of 5 x 5 x 5), until none is found one
centimetre on: any orientation at the end, 2 cm from the cube, no contact of the arm with itself,
joint limits, and the turn never above the limit, also between the points. In brackets: as
published, for straight lines under one velocity law. Beyond, there may be plans that were not
found."""
_SCENARIOS = HERE / "scenarios"


class Reach(NamedTuple):
    """How far the arm reaches in one direction."""

    direction: Array  # unit vector, shape (3,)
    centimetres: tuple[int, ...]  # for each limit: there is a plan, and none was found 1 cm on
    turns: tuple[float, ...]  # largest rotation of the chaser in these plans [deg]
    plans: int  # that were asked for
    seconds: float  # of a processor


def directions() -> Array:
    """Return the source's 98 directions: to all points of a grid of five by five by five.

    Shape (98, 3), unit vectors.
    """
    grid = [point for point in product((-2, -1, 0, 1, 2), repeat=3) if any(point)]
    units = (np.array(point) / np.linalg.norm(point) for point in grid)
    return np.array(sorted({tuple(np.round(unit, 6).tolist()) for unit in units}))


def task_of(settings: PlannerSettings) -> PlanningTask:
    """Return the task of P5 to a point, of which `reach` changes the point and the limit.

    Its cube is larger by the distance that the arm keeps, in collisions alone.
    """
    few = replace(settings, threads=1, starts=_GUESSES)
    task = built_task(read_yaml(_SCENARIOS / "p5_reach.yaml"), _SCENARIOS, Defaults(few))
    cube, larger = '<box size="1 1 1"/>', f'<box size="{" ".join([str(1 + 2 * _KEPT)] * 3)}"/>'
    urdf = (HERE / "models" / "compliance_300.urdf").read_text(encoding="utf-8")
    robot = robot_from_urdf_text(urdf.replace(cube, larger), "base", "end_effector")
    problem = replace(task.problem, robot=robot, objective=Objective(1.0, 0.0))
    return replace(task, problem=problem)


def reach(direction: Array, task: PlanningTask) -> Reach:
    """Return how far the arm reaches in a direction, to the first point without a plan.

    Args:
        direction: Unit vector. Shape (3,).
        task: Of `task_of`.
    """
    begun, start = time.process_time(), _start(task.problem)
    near, plans, asked, nearest = 0, 0, task, 0.0
    found, turns = list[int](), list[float]()
    for limit in LIMITS:
        step = _STEP
        while step:
            plan = _plan(asked, start + (near + step) / 100.0 * direction, limit)
            plans += 1
            if plan is None:
                step //= 2
            else:
                near += step
                nearest = float(np.rad2deg(plan.metrics.max_chaser_rotation))
                asked = _beginning_with(task, plan)
        found.append(near)
        turns.append(nearest)
    return Reach(direction, tuple(found), tuple(turns), plans, time.process_time() - begun)


def _plan(task: PlanningTask, goal: Array, limit: float) -> Plan | None:
    """Return a plan to a point, if there is one.

    Args:
        goal: In the inertial frame. Shape (3,) [m].
        limit: Of the chaser's rotation [deg].
    """
    problem = task.problem
    limits = replace(problem.limits, chaser_rotation=float(np.deg2rad(limit)))
    target = replace(problem.target, position=goal)
    try:
        return perform(replace(task, problem=replace(problem, target=target, limits=limits)))
    except FfPlannerError:
        return None


def _beginning_with(task: PlanningTask, plan: Plan) -> PlanningTask:
    """Return a task whose first guess is a plan."""
    named = Parametrisation(plan.family)
    problem = replace(task.problem, parametrisation=named)
    return replace(task, problem=problem, first_guess=plan.coefficients)


def _start(problem: PlanningProblem) -> Array:
    """Return where the end effector is at the start, in the inertial frame. Shape (3,) [m]."""
    model, data = problem.robot.model, problem.robot.model.createData()
    pin.framesForwardKinematics(model, data, configuration(problem.robot, problem.start)[0])
    place: Array = data.oMf[problem.robot.tip_frame_id].translation.copy()
    return place


def volume(reaches: Sequence[float], towards: Array) -> float:
    """Return the volume of the cage through the ends of all directions, as the source counts it.

    Args:
        reaches: In each direction.
        towards: Unit vectors, shape (directions, 3).
    """
    ends = np.array(reaches)[:, None] * towards
    faces = ends[ConvexHull(towards).simplices]
    return float(np.abs(np.linalg.det(faces)).sum() / 6.0)


def write_figures(file: Path, count: int) -> None:
    """Add the reach in so many directions to a file of the gallery's figures, one by one.

    What the file has stays; directions that it has are not asked for again.
    """
    figures: dict[str, Any] = read_json(file) if file.exists() else {"problems": {}}
    there = figures.setdefault("reach", {"rows": []})
    there["machine"] = machine() | {"date": time.strftime("%Y-%m-%d")}
    rows, task, every = there["rows"], task_of(load_parameters().planner), directions()
    # A stride without a common factor visits all of them, and the first few are spread evenly.
    order = [number * _STRIDE % len(every) for number in range(count)]
    for number in order[len(rows) :]:
        found = reach(every[number], task)
        rows.append(
            {
                "direction": every[number].tolist(),
                "reach_cm": found.centimetres,
                "turn_deg": found.turns,
                "plans": found.plans,
                "seconds": found.seconds,
            }
        )
        file.write_text(json_text(figures, indent=1) + "\n", encoding="utf-8")
        print(
            f"{len(rows)} of {count}: {found.centimetres} cm in {found.seconds:.1f} s", flush=True
        )


def summary(figures: dict[str, Any]) -> Iterator[str]:
    """Yield what a page says of the rows that `write_figures` has written, in Markdown."""
    rows = figures["rows"]
    every, towards = len(directions()), np.array([row["direction"] for row in rows])
    yield "### How far the arm reaches while the chaser turns by little"
    yield ""
    yield from _HEAD.splitlines()
    yield ""
    yield "| largest turn [deg] | least reach [cm] | median | farthest | volume [m3] |"
    yield "| --- | --- | --- | --- | --- |"
    for index, limit in enumerate(LIMITS):
        told = [row["reach_cm"][index] for row in rows]
        whole = f"{volume(told, towards) / 1e6:.3f}" if len(rows) == every else ""
        ours = (f"{min(told)}", f"{median(told):g}", f"{max(told)}", whole)
        pairs = zip(ours, PUBLISHED[limit], strict=True)
        cells = [f"{one} ({of})".strip() if of else one for one, of in pairs]
        yield f"| {limit:g} | {' | '.join(cells)} |"
    plans, total = sum(row["plans"] for row in rows), sum(row["seconds"] for row in rows)
    yield ""
    yield f"{len(rows)} of {every} directions, {plans} plans asked for, {total:.0f} s of one"
    yield f"processor: {len(rows) / total:.2f} directions a second. Theirs take"
    yield f"{PUBLISHED_SECONDS:.0f} s for all on one thread, {every / PUBLISHED_SECONDS:.2f} a"
    yield "second, by a velocity law that does not search."
