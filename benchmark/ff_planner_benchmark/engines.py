"""Plans of each class flown in two engines: docs/engines.json, and the table of the page.

`engines.py COUNT` plans and flies so many problems of each class; it needs MuJoCo and Drake (`make
.venv/extras_ci`). Without an argument it writes the table of docs/explanation/validation.md anew.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ff_planner_benchmark.problems import (
    all_features,
    captured,
    joint_goals,
    shapes,
    tumbling,
    witnessed,
)
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies, scenarios

DOCS = Path(__file__).resolve().parents[2] / "docs"
RESULTS = DOCS / "engines.json"
PAGE = DOCS / "explanation" / "validation.md"
BLOCK = re.compile(r"(<!-- engines -->\n)(.*?)(<!-- end -->)", re.DOTALL)


class Miss(NamedTuple):
    """How far a plan was from what an engine did: end effector at the end, chaser at worst."""

    position: float  # [m]
    orientation: float  # [rad]
    chaser: float  # [m]


def tasks(name: str, number: int) -> PlanningTask:
    """Return one problem of a class as a task."""
    settings = load_parameters().planner
    if name in captured.KINDS:
        return captured.problem(name, number).task(settings)
    robot = bodies.ROBOTS[number % len(bodies.ROBOTS)]
    if name in scenarios.KINDS:
        problem = scenarios.scenario(
            name, ("lemur", "arm6")[number % 2], number, turned=False
        ).problem
    elif name in witnessed.KINDS:
        problem = witnessed.problem(name, number)
    elif name in tumbling.KINDS:
        problem = tumbling.problem(name, number)
    elif name in joint_goals.KINDS:
        problem = joint_goals.problem(name, number).problem
    else:
        others: dict[str, Any] = {
            "bodies": bodies.problem(robot, number),
            "shapes": shapes.problem(number),
        }
        problem = (others | {"all features": all_features.problem(number)})[name].problem
    return PlanningTask(problem, settings)


CLASSES = (
    *scenarios.KINDS,
    *witnessed.KINDS,
    "bodies",
    "shapes",
    *tumbling.KINDS,
    "all features",
    *joint_goals.KINDS,
    *captured.KINDS,
)


def flown(task: PlanningTask) -> Iterator[tuple[Miss, bool, Miss]]:
    """Yield for each phase of a task what MuJoCo did, whether it passed, and what Drake did."""
    from ff_planner_benchmark.second_engine import flown_in_drake
    from ff_planner_ros.simulation.verification import verify

    for one, plan in phase_tasks(task, perform(task)):
        problem, motion = one.problem, plan.trajectory
        first = verify(problem.robot, motion, scene_of(problem))
        second = flown_in_drake(problem.robot, motion)
        off = first.deviation
        yield (
            Miss(
                off.final_position_error,
                off.final_orientation_error,
                off.max_chaser_position_error,
            ),
            first.passed,
            Miss(second.position, second.orientation, second.chaser),
        )


def row(name: str, count: int) -> list[str]:
    """Fly a class, and return its row."""
    found: list[tuple[Miss, bool, Miss]] = []
    missed = 0
    for number in range(count):
        try:
            found += flown(tasks(name, number))
        except FfPlannerError:
            missed += 1
    cells = [name, f"{len(found)}", f"{missed}", f"{sum(passed for _, passed, _ in found)}"]
    to_units = 1e3 * np.array([1.0, np.rad2deg(1e-3), 1.0])
    for engine in (0, 2):
        worst = to_units * np.array([one[engine] for one in found]).max(axis=0)
        cells += [f"{value:.4f}" for value in worst]
    return cells


def table() -> str:
    """Return the table of all classes."""
    header = (
        *("class", "plans", "no plan", "passed in MuJoCo"),
        *("MuJoCo: end effector [mm]", "[deg]", "chaser [mm]"),
        *("Drake: end effector [mm]", "[deg]", "chaser [mm]"),
    )
    rows = [header, ["---"] * len(header), *json.loads(RESULTS.read_text(encoding="utf-8"))]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows) + "\n"


def expected(text: str) -> str:
    """Return the page with its marked block as it must be."""
    return BLOCK.sub(lambda block: block[1] + table() + block[3], text)


if __name__ == "__main__":
    if sys.argv[1:]:
        rows = []
        for name in CLASSES:
            rows.append(row(name, int(sys.argv[1])))
            RESULTS.write_text(json.dumps(rows) + "\n", encoding="utf-8")
            print(*rows[-1], flush=True)
    PAGE.write_text(expected(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
