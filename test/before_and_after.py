"""The compiled core beside the references by numpy in its place, all in one process.

    .venv/bin/python test/before_and_after.py              # a minute, or a few
    .venv/bin/python test/before_and_after.py --each 1

Every plan is made twice, with the core and without it, and both must be the same. The paper's way,
`direct`, is run on both, too. Times are processor time on one core.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ff_planner_ros.common.process_environment import ONE_THREAD

if __name__ == "__main__":  # before numpy reads them
    os.environ.update(ONE_THREAD)

import numpy as np
from reference_core import core_by_reference

from ff_planner_ros.bench.direct import solve_directly
from ff_planner_ros.bench.measurement import OBJECTIVES, Stopwatch
from ff_planner_ros.bench.report import machine
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.objectives import weighted_sum
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies, tumbling, witnessed
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario

SETTINGS = load_parameters().planner
# Plans with and without the core are the same to this [rad].
SAME = 1e-6
# With the core the best of so many plans counts: a short time is easily disturbed.
REPEATED = 3
DIRECT_ITERATIONS = 200

HEADER = (
    *("what is planned", "plans", "core [s]", "worst [s]", "references [s]", "references / core"),
    *("same plan", "apart [rad]"),
)
DIRECT_HEADER = (
    *("objective", "ff_planner [s]", "direct on the core [s]", "/ ours"),
    *("direct on the references [s]", "/ ours"),
)


@dataclass(frozen=True)
class Pair:
    """One plan with the core and without it."""

    kind: str
    core: float  # processor time [s]
    reference: float  # [s]
    rollouts: tuple[int, int]  # with the core, without it
    apart: float  # of the joints, at most [rad]
    values: tuple[float, float]  # of the objective, with the core and without it [rad]


def captures() -> dict[str, PlanningProblem]:
    """Return the paper's capture, for each objective."""
    problem = load_scenario(share_directory() / "config/scenarios/lemur_capture.yaml")
    return {name: replace(problem, objective=asked) for name, asked in OBJECTIVES.items()}


def tasks(each: int) -> Iterator[tuple[str, PlanningTask]]:
    """Yield the paper's capture, and so many problems of each class."""
    for name, problem in captures().items():
        yield f"lemur_capture, {name}", PlanningTask(problem, SETTINGS)
        if problem.objective.chaser_attitude > 0.0:
            quick = replace(SETTINGS, search=SearchDepth.QUICK)
            yield f"lemur_capture, {name}, quick", PlanningTask(problem, quick)
    for kind, problem in problems(each):
        yield kind, PlanningTask(problem, SETTINGS)


def problems(each: int) -> Iterator[tuple[str, PlanningProblem]]:
    """Yield so many problems of each class."""
    yield (
        "planar_capture",
        load_scenario(share_directory() / "config/scenarios/planar_capture.yaml"),
    )
    for kind in ("ordinary", "cluttered"):
        for index in range(each):
            number, robot = divmod(index, len(ROBOTS))
            yield kind, scenario(kind, ROBOTS[robot], number, turned=False).problem
    for number in range(each):
        yield "planar", witnessed.problem("planar", number)
    for drawn in bodies.problems(each):
        yield "bodies", drawn.problem
    for problem in tumbling.problems("tumbling", each):
        yield "tumbling", problem


def pair(kind: str, task: PlanningTask, repeated: int = REPEATED) -> Pair:
    """Plan with the core and without it."""
    made, core = _timed(task, repeated)
    with core_by_reference():
        expected, reference = _timed(task, 1)
    asked = task.problem.objective
    positions = made.trajectory.joint_positions - expected.trajectory.joint_positions
    return Pair(
        kind,
        core,
        reference,
        rollouts=(made.solver.rollouts, expected.solver.rollouts),
        apart=float(np.abs(positions).max()),
        values=(
            weighted_sum(asked, made.metrics),
            weighted_sum(asked, expected.metrics),
        ),
    )


def _timed(task: PlanningTask, times: int) -> tuple[Plan, float]:
    stopwatch, seconds = Stopwatch(), np.inf
    for _ in range(times):
        made = perform(task, method=stopwatch)
        seconds = min(seconds, stopwatch.seconds)
    return made, seconds


def rows(pairs: Sequence[Pair]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each kind of problem."""
    for kind in dict.fromkeys(one.kind for one in pairs):
        mine = [one for one in pairs if one.kind == kind]
        core = np.array([one.core for one in mine])
        reference = np.array([one.reference for one in mine])
        yield (
            kind,
            f"{len(mine)}",
            f"{np.median(core):.3f}",
            f"{core.max():.3f}",
            f"{np.median(reference):.3f}",
            f"{np.median(reference / core):.1f}",
            f"{sum(one.apart <= SAME for one in mine)}",
            f"{max(one.apart for one in mine):.0e}",
        )


def direct_rows(iterations: int, ours: dict[str, float]) -> Iterator[tuple[str, ...]]:
    """Yield what the paper's way takes on the core and on the reference; ours: times [s]."""
    for name, problem in captures().items():
        problem = in_own_frame(problem)
        on_core = _direct(problem, iterations)
        with core_by_reference():
            on_reference = _direct(problem, iterations)
        yield (
            name,
            f"{ours[name]:.3f}",
            f"{on_core:.2f}",
            f"{on_core / ours[name]:.0f}",
            f"{on_reference:.2f}",
            f"{on_reference / ours[name]:.0f}",
        )


def _direct(problem: PlanningProblem, iterations: int) -> float:
    program = path_program(problem, end_effector_paths(problem), SETTINGS)
    begun = time.process_time()
    solve_directly(SETTINGS, program, iterations)
    return time.process_time() - begun


def main(each: int, iterations: int) -> int:
    """Print both tables; exit code 1 if a plan is another without the core.

    That of least attitude may be: many joint paths turn the chaser equally little, and rounding
    decides for one of them.
    """
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    for name, value in machine().items():
        print(f"{name:8}  {value}")
    _timed(PlanningTask(captures()["min(L)"], SETTINGS), 1)  # warm
    pairs = []
    for kind, task in tasks(each):
        pairs.append(pair(kind, task))
        if pairs[-1].apart > SAME:
            print(f"another plan: {pairs[-1]}", flush=True)
    print_table("With the core and with its references in its place", HEADER, list(rows(pairs)))
    ours = {one.kind.removeprefix("lemur_capture, "): one.core for one in pairs}
    print_table("The paper's way", DIRECT_HEADER, list(direct_rows(iterations, ours)))
    return 0 if all(one.apart <= SAME for one in pairs if "min(Theta)" not in one.kind) else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=6, help="problems of each class")
    parser.add_argument("--iterations", type=int, default=DIRECT_ITERATIONS, help="of direct")
    asked = parser.parse_args()
    sys.exit(main(asked.each, asked.iterations))
