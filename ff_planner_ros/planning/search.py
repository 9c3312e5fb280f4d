"""Where the solver starts, and which of its answers is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.check import certified_clearance
from ff_planner_ros.planning.polynomial import COMPONENTS, FREE_TERMS, PARAMETERS
from ff_planner_ros.planning.program import PathProgram
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import Solution, minimise

# Most of the work is done on this many points, where a solve costs half and a wrong way around an
# obstacle shows as well as on fifty; the extra margin makes up for the wider gaps [m].
_COARSE_POINTS, _COARSE_MARGIN = 25, 0.004
# Where every start is tried, so many iterations tell the promising ones, and so many of them go on.
_SCREENING_ITERATIONS, _PROMISING = 15, 2
# Each round roughly halves what is missing between the points.
_MARGIN_ROUNDS = 4
# Spread of the detours that further starts take: wide enough to come to the other side of an
# obstacle, not so wide that most leave the workspace [m, rad].
_DETOUR_POSITION, _DETOUR_ANGLE = 0.5, 0.5


@dataclass(frozen=True, eq=False)
class Search:
    """The best path found and what it took.

    Attributes:
        best: On all points.
        starts: First guesses tried.
        iterations: Quadratic programs solved, over all of them.
        evaluations: Rollouts with derivatives, over all of them.
    """

    best: Solution
    starts: int
    iterations: int
    evaluations: int


def search(
    program: Callable[[int, float], PathProgram],
    points: int,
    settings: PlannerSettings,
    *,
    every_start: bool,
) -> Search:
    """Solve from several starts on few points, then from the best of these on all points.

    Args:
        program: Gives the optimisation problem for a number of points and a clearance margin [m].
        points: Of the plan.
        settings: The planner's tunables.
        every_start: Whether to try all starts instead of keeping the first that leads to a path.

    Raises:
        NoPlanFound: Every start meets a dynamic singularity.
    """
    solved: list[Solution] = []
    refusals: list[NoPlanFound] = []

    def solve(on: PathProgram, start: Array, iterations: int) -> Solution | None:
        try:
            solved.append(minimise(on.linearise, start, iterations, settings.optimality_tolerance))
        except NoPlanFound as refusal:
            refusals.append(refusal)
            return None
        return solved[-1]

    coarse = program(min(points, _COARSE_POINTS), settings.clearance_margin + _COARSE_MARGIN)
    candidates: list[Solution] = []
    for start in _starts(settings.starts):
        iterations = _SCREENING_ITERATIONS if every_start else settings.max_iterations
        candidate = solve(coarse, start, iterations)
        if candidate is not None:
            candidates.append(candidate)
            if candidate.converged and not every_start:
                break
    tried = len(candidates) + len(refusals)

    settled = [
        candidate if candidate.converged else solve(coarse, candidate.x, settings.max_iterations)
        for candidate in sorted(candidates, key=_rank)[:_PROMISING]
    ]
    answers: list[Solution] = []
    fine = program(points, settings.clearance_margin)
    for promising in sorted(filter(None, settled), key=_rank):
        answer = _solve_between_points(solve, fine, promising.x, settings)
        if answer is not None:
            answers.append(answer)
            if answer.feasible:
                break
    if not answers:
        raise refusals[0]
    return Search(
        best=min(answers, key=_rank),
        starts=tried,
        iterations=sum(solution.iterations for solution in solved),
        evaluations=sum(solution.evaluations for solution in solved),
    )


def _starts(count: int) -> Iterator[Array]:
    """Yield first guesses: the straight path, then low-discrepancy detours, always the same."""
    yield np.zeros(PARAMETERS)
    spread = np.repeat([_DETOUR_POSITION] * 3 + [_DETOUR_ANGLE] * 3, FREE_TERMS)
    sequence = qmc.MultivariateNormalQMC(
        np.zeros(PARAMETERS), engine=qmc.Halton(PARAMETERS, rng=np.random.default_rng(0))
    )
    for _ in range(count - 1):
        yield sequence.random(1)[0] * spread


def _rank(solution: Solution) -> tuple[bool, float]:
    """Feasible before infeasible, then by objective or by violation."""
    at_x = solution.at_x
    return not solution.feasible, at_x.objective if solution.feasible else at_x.violation


def _solve_between_points(
    solve: Callable[[PathProgram, Array, int], Solution | None],
    program: PathProgram,
    start: Array,
    settings: PlannerSettings,
) -> Solution | None:
    """Solve, and raise the margin at the points until the motion between them is clear too."""
    solution = None
    for _ in range(_MARGIN_ROUNDS):
        solution = solve(program, start, settings.max_iterations)
        if solution is None or not solution.feasible:
            break
        rollout = program.rollouts.roll_out(solution.x.reshape(COMPONENTS, FREE_TERMS))
        clearance = certified_clearance(
            program.robot, rollout.q, rollout.v, program.step, program.spheres
        )
        if clearance >= 0.0:
            break
        missing = settings.clearance_margin / 2 - clearance
        program = replace(program, clearance_margin=program.clearance_margin + missing)
        start = solution.x
    return solution
