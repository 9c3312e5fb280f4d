"""Problems as others publish theirs: docs/comparisons.json, and the tables of the page.

`comparisons.py 50 300 FILE` plans 50 problems of each class of random starts and 300 of each class
of tumbling targets, keeps in the file what became of them and prints the table. Without arguments
it writes the tables of docs/explanation/comparisons.md anew, from docs/comparisons.json.
"""

from __future__ import annotations

import json
import platform
import re
import statistics
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.bench.measurement import timed_plan
from ff_planner_benchmark.problems import joint_goals, tumbling
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.model import Base

DOCS = Path(__file__).resolve().parents[2] / "docs"
RESULTS = DOCS / "comparisons.json"
PAGE = DOCS / "explanation" / "comparisons.md"
BLOCK = re.compile(r"(<!-- comparisons: (\w+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)

# Of random starts with momentum: the chaser drifts and turns so fast, in any direction.
DRIFT, SPIN = 0.01, np.deg2rad(0.5)  # m/s, rad/s
# Tumbling targets begin where the benchmark's, which the planner was made with, have ended.
FIRST_TUMBLING = 1000
# The view of a camera in the chaser's centre of mass, about where the grasp is at the start.
HALF_ANGLE, UNTIL = np.deg2rad(35.0), 0.1  # rad, m


def held(number: int) -> PlanningProblem:
    """As Misra and Bai have it: at rest, with a chaser that does not turn."""
    return joint_goals.problem("random start", number).problem


def free(number: int) -> PlanningProblem:
    """The same with a chaser that turns as the arm makes it turn."""
    problem = held(number)
    return replace(problem, robot=replace(problem.robot, base=Base.FREE_FLYER, wheels=None))


def moving(number: int) -> PlanningProblem:
    """The same with linear and angular momentum."""
    problem, rng = free(number), np.random.default_rng([17, number])
    drift, spin = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
    start = replace(
        problem.start,
        linear_velocity_chaser_in_inertial=DRIFT * drift,
        angular_velocity_chaser_in_inertial=SPIN * spin,
    )
    return replace(problem, start=start)


def tumbling_target(number: int) -> PlanningProblem:
    """A body that tumbles at 1 to 5 deg/s, with parts that are in the way."""
    return tumbling.problem("tumbling", FIRST_TUMBLING + number)


def tumbling_in_view(number: int) -> PlanningProblem:
    """The same, and the chaser sees the grasp until it is near."""
    problem = tumbling_target(number)
    robot, start, body = problem.robot, problem.start, problem.target_body
    if body is None:
        raise ValueError("there is no target body")
    grasp = body.grasp(np.zeros(1)).positions[0] - start.position_chaser_in_inertial
    turned = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw.copy())
    axis = robot.rotation_chaser_to_base @ turned.inv().apply(grasp)
    place = robot.position_chaser_in_base
    return replace(problem, camera=Camera(robot.base_link, place, axis, HALF_ANGLE, UNTIL))


CLASSES: dict[str, Callable[[int], PlanningProblem]] = {
    "random start, held, at rest": held,
    "random start, free, at rest": free,
    "random start, free, moving": moving,
    "tumbling target": tumbling_target,
    "tumbling target, in view": tumbling_in_view,
}


def attempts(name: str, count: int) -> Iterator[dict[str, Any]]:
    """Plan so many problems of a class."""
    settings = load_parameters().planner
    for number in range(count):
        plan, outcome = timed_plan(PlanningTask(CLASSES[name](number), settings))
        yield {
            "status": outcome["status"].name,
            "seconds": round(outcome["seconds"], 4),
            "programs": plan.solver.iterations if plan else None,
            "error": float(f"{plan.metrics.final_position_error:.2g}") if plan else None,
        } | ({} if plan else {"message": outcome["message"]})


def table(results: Path = RESULTS) -> str:
    """Return the table of all classes."""
    header = (
        *("class", "problems", "with a plan", "time: median, 95 %, worst [s]"),
        *("convex programs, mean", "largest error [m]", "why there was none"),
    )
    lines = [f"| {' | '.join(header)} |", "|" + " --- |" * len(header)]
    for name, tried in json.loads(results.read_text(encoding="utf-8"))["classes"].items():
        solved = [one for one in tried if one["status"] == "SOLVED"]
        seconds = [one["seconds"] for one in tried]
        causes = Counter(one["status"] for one in tried if one["status"] != "SOLVED")
        cells = (
            name,
            f"{len(tried)}",
            f"{len(solved)} ({len(solved) / len(tried):.1%})",
            f"{np.median(seconds):.3f}, {np.quantile(seconds, 0.95):.3f}, {max(seconds):.3f}",
            f"{statistics.mean(one['programs'] for one in solved):.1f}",
            f"{max(one['error'] for one in solved):.0e}",
            ", ".join(f"{count} {cause}" for cause, count in causes.most_common()) or "-",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def run() -> str:
    """Say what the figures were measured on."""
    told = json.loads(RESULTS.read_text(encoding="utf-8"))["run"]
    return (
        f"Measured with Python {told['python']} on {told['machine']}, processor time of one core, "
        "beside other work.\n"
    )


def expected(text: str) -> str:
    """Return the page with its marked blocks as they must be."""
    made = {"run": run, "table": table}
    return BLOCK.sub(lambda block: block[1] + made[block[2]]() + block[4], text)


def measure(counts: tuple[int, int], results: Path) -> None:
    """Plan and keep what became of it, class after class.

    Args:
        counts: Problems of each class of random starts, and of tumbling targets.
    """
    classes = dict[str, list[dict[str, Any]]]()
    for name in CLASSES:
        classes[name] = list(attempts(name, counts["tumbling" in name]))
        told = {"python": platform.python_version(), "machine": platform.machine()}
        content = {"run": told, "classes": classes}
        results.write_text(json.dumps(content) + "\n", encoding="utf-8")
        print(name, Counter(one["status"] for one in classes[name]), flush=True)


if __name__ == "__main__":
    if arguments := sys.argv[1:]:
        starts, targets, file = arguments
        measure((int(starts), int(targets)), Path(file))
        print(table(Path(file)))
    else:
        PAGE.write_text(expected(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
