"""The solver of a path program on its grids, with the effort and the best paths so far."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import EndedBy, Failure
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.watch import (
    CHECKING,
    REFINING,
    SEARCHING,
    Progress,
    Watch,
    in_time,
)
from ff_planner_ros.planning.optimisation.evaluated_path import (
    EvaluatedPath,
    PathLinearisation,
    seen,
)
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.optimisation.restoration import nearest_feasible
from ff_planner_ros.planning.optimisation.solver import Solution, Stop, minimise
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.planning.requirements.limits.wheels import WheelLimits, exceeds_at_points
from ff_planner_ros.planning.search.candidate import (
    Candidate,
    CheckedPlan,
    Effort,
    plan_of_path,
)
from ff_planner_ros.planning.search.grid import Grid, grids_of

PathSolution: TypeAlias = Solution[PathLinearisation]

# Rounds of constraint tightening; each leaves a tenth or less of the violation between points.
_ROUNDS = 6
# Fraction of the check's tolerances at the goal that the tracked motion may miss.
_MISS = 0.1
# From a violation below this [unit of the constraint], restoration reaches a feasible path in at
# most this many steps.
SMALL_VIOLATION, _RESTORATION_ITERATIONS = 3e-2, 6


class GridSolver:
    """Solves a program on its grids."""

    def __init__(
        self,
        program: PathProgram,
        settings: PlannerSettings,
        watch: Watch,
        effort: Effort | None = None,
    ) -> None:
        """Prepare the grids of a program.

        Args:
            effort: Counts what is tried. None: from zero.
        """
        self.program, self.settings, self.watch = program, settings, watch
        self.grids = grids_of(program, settings)
        self.effort = Effort() if effort is None else effort
        self._solved: list[PathSolution] = []
        self._on_all_points: list[PathSolution] = []
        self._best_visited: EvaluatedPath | None = None

    @property
    def problem(self) -> PlanningProblem:
        """The planning problem."""
        return self.program.problem

    def with_rows_but_for(self, on_demand: frozenset[str]) -> None:
        """Add the rows of requirements that are not among those on demand any more."""
        self._keep(self.program.on_demand - on_demand)

    def initial_guesses(self) -> Iterator[Array]:
        """Yield the family's own initial guesses without end."""
        stage, obstacles = self.grids[0].stage, self.problem.obstacles
        return self.program.family.first_guesses(obstacles, stage.points, stage.damping)

    def evaluate(self, grid: Grid, x: Array) -> PathLinearisation:
        """Return objective and constraints of x, with derivatives by the solver's variables."""
        return seen(self._watched(grid)(grid.along(x)))

    def solve(
        self,
        grid: Grid,
        start: Array,
        curvature: Array | None = None,
        at_start: EvaluatedPath | None = None,
    ) -> PathSolution:
        """Minimise on a grid from decision variables; see `minimise`."""
        stage = grid.stage
        solution = minimise(
            self._watched(grid),
            grid.along(start),
            stage.iterations,
            stage.optimality,
            stage.progress,
            grid.radius,
            curvature,
            stage.tolerated,
            at_start,
        )
        return self._record(solution)

    def solve_coarsely(self, guess: Array) -> PathSolution:
        """Minimise on the coarsest grid, again with limits of wheels if the result exceeds them.

        It often does, and to find that out on all points costs four times as much a step.
        """
        grid, wheels = self.grids[0], frozenset({WheelLimits.name})
        coarse = self.solve(grid, guess)
        at_x = coarse.at_x
        if not (at_x.is_defined and wheels <= grid.program.on_demand):
            return coarse
        motion, accelerations = at_x.motion, at_x.acceleration[:, 6:]
        if not exceeds_at_points(self.problem, motion.q, motion.v, accelerations):
            return coarse
        self._keep(wheels)
        return self.solve(self.grids[0], coarse.x)

    def nearest(
        self, grid: Grid, x: Array, at_x: PathLinearisation, iterations: int
    ) -> PathSolution:
        """Return the nearest feasible path, as far as so many steps lead there."""
        watched = self._watched(grid)

        def linearise(along: Array) -> PathLinearisation:
            return seen(watched(along))

        return self._record(nearest_feasible(linearise, grid.along(x), at_x, iterations))

    def restore(self, grid: Grid, solution: PathSolution, iterations: int) -> PathSolution:
        """Return a solution with its violations mended, as far as possible (restoration)."""
        if solution.feasible or not solution.at_x.is_defined:
            return solution
        nearest = self.nearest(grid, solution.x, solution.at_x, iterations)
        return replace(nearest, curvature=solution.curvature)

    def solve_and_restore(self, grid: Grid, start: Array) -> PathSolution:
        """Minimise from a start, then mend what is violated."""
        return self.restore(grid, self.solve(grid, start), _RESTORATION_ITERATIONS)

    def solve_feasibly(self, grid: Grid, x: Array, curvature: Array | None) -> PathSolution:
        """Solve, and return the best feasible path on the way if the solver does not end at one.

        Steps along curved constraints violate them a little until the solver converges; small
        steps undo that.
        """
        self._best_visited = None
        solution = self.solve(grid, x, curvature)
        if solution.at_x.violation < SMALL_VIOLATION:
            restored = self.restore(grid, solution, _RESTORATION_ITERATIONS)
            solution = restored if restored.feasible else solution
        if solution.feasible or self._best_visited is None:
            return solution
        at_best = self.solve(grid.with_stage(iterations=0), self._best_visited.x)
        reason = "good enough: the best on the way that keeps the constraints"
        curvature = solution.curvature
        return replace(at_best, stop=Stop.ENOUGH, stop_reason=reason, curvature=curvature)

    def tighten(
        self, grid: Grid, solution: PathSolution, solve: Callable[[Grid, Array], PathSolution]
    ) -> tuple[PathSolution, FollowedMotion | None]:
        """Tighten constraints until the tracked motion keeps them between the points, too.

        Args:
            solution: Solution of the grid's program, to begin with.
            solve: Solves a tighter program from a path that is nearly feasible.

        Returns:
            The solution, and its tracked motion if that keeps all requirements, else None.
        """
        program = grid.program
        for _ in range(_ROUNDS):
            if not solution.feasible:
                break
            motion = program.followed(solution.at_x)
            slacks = program.slacks(motion)
            is_sound = min(slacks.values()) >= 0.0
            if is_sound and self._is_at_goal(motion):
                return solution, motion
            # More than the violation, by half of the first margin: the next motion differs.
            margins = {
                name: margin + (self.program.margins[name] / 2 - slacks[name])
                if slacks[name] < 0.0 and name not in program.on_demand
                else margin
                for name, margin in program.margins.items()
            }
            violated = frozenset(name for name, slack in slacks.items() if slack < 0.0)
            if violated and violated <= program.on_demand:
                # If no path keeps those, this one is the best attempt to report.
                self._on_all_points.append(solution)
            self._keep(violated)
            program = program.with_correction(solution.at_x.motion, motion).with_requirements(
                violated
            )
            program = replace(program, margins=margins)
            if is_sound:  # only the aim must be corrected: that needs no new optimum
                aimed = program.linearise(solution.x)
                if aimed.violation <= FEASIBILITY_TOLERANCE:
                    solution = replace(solution, at_x=aimed)
                    continue
            solution = solve(replace(grid, program=program), solution.x)
        return solution, None

    def sound_plans(
        self, solution: PathSolution, followed: FollowedMotion | None
    ) -> Iterator[Plan]:
        """Yield the plan along a path on all points, if it is regular and passes the check.

        Args:
            followed: Its tracked motion; None: not computed yet.
        """
        if solution.at_x.is_defined:
            self.watch.require_time(CHECKING)
            self.watch.report(self._progress(CHECKING, solution.at_x))
            plan, failures = self._plan_along(solution, followed)
            if not failures:
                self.watch.offer(plan)
                yield plan

    def keep_attempt(self, found: PathSolution) -> None:
        """Keep a path on all points that failed, for a refusal to report the best of them."""
        if found.at_x.is_defined:
            self._on_all_points.append(found)

    def best_attempt(self) -> tuple[Plan | None, list[tuple[str, Failure]], float]:
        """Return the plan along the best path so far, and what it violates.

        Returns:
            The plan, None if there is no path yet or the best is singular; its failures with the
            names of their requirements, those first that the fewest initial paths met; and the time
            at which the best path is singular [s].
        """
        attempts = self._on_all_points or self._solved
        if not attempts:
            return None, [], 0.0
        best = min(attempts, key=rank)
        if best.at_x.motion.singular_at is not None:
            return None, [], best.at_x.motion.singular_at
        plan, failures = self._plan_along(best, None)
        plan = replace(plan, solver=replace(plan.solver, ended_by=""))  # the search goes on, or not
        hardest_first = sorted(failures, key=lambda one: self.effort.met[one[0]])
        return plan, hardest_first, 0.0

    def report(self, solution: PathSolution) -> SolverReport:
        """Return the report of a solution, with the effort of the whole search so far."""
        ended_by = EndedBy.CONVERGED if solution.stop.is_good_enough else EndedBy.EXHAUSTED
        found = SolverReport(0, 0, 0, solution.optimality, solution.stop_reason, ended_by)
        return self.effort.report(found)

    def _plan_along(self, solution: PathSolution, followed: FollowedMotion | None) -> CheckedPlan:
        path = Candidate(solution.at_x, self.report(solution), followed)
        return plan_of_path(self.problem, self.settings, self.program.family, path)

    def _keep(self, violated: frozenset[str]) -> None:
        """Add requirements that a path has violated to all grids from now on."""
        if not violated:
            return
        self.program = self.program.with_requirements(violated)
        self.grids = [
            replace(grid, program=grid.program.with_requirements(violated)) for grid in self.grids
        ]

    def _is_at_goal(self, motion: FollowedMotion) -> bool:
        problem, settings = self.problem, self.settings
        if problem.posture is not None:  # met by construction at the last point
            return True
        position, turn = np.linalg.norm(miss(problem.robot, motion.q[-1], problem.target), axis=1)
        return bool(
            position <= _MISS * settings.position_tolerance
            and turn <= _MISS * settings.orientation_tolerance
        )

    def _record(self, found: Solution[Any]) -> PathSolution:
        """Convert a solution to decision variables, and keep it."""
        at_x = seen(found.at_x)
        solution: PathSolution = replace(found, x=at_x.x, at_x=at_x)
        self._solved.append(solution)
        self.effort.iterations += solution.iterations
        return solution

    def _watched(self, grid: Grid) -> Callable[[Array], EvaluatedPath]:
        """Return a function that evaluates on a grid, counts effort and reports to the watch."""
        is_finest = grid.stage.points == self.program.points
        phase = REFINING if is_finest else SEARCHING
        is_initial = True

        def evaluate(along: Array) -> EvaluatedPath:
            nonlocal is_initial
            self.watch.require_time(phase)
            at_x = in_time(self.watch, grid.evaluate, along)
            if at_x.is_defined:
                if is_initial:
                    self.effort.met.update(grid.program.met(at_x))
                    is_initial = False
                self.effort.rollouts += 1
                progress = self._progress(phase, at_x)
                self.watch.report(progress)
                best = self._best_visited
                if progress.violation <= FEASIBILITY_TOLERANCE and (
                    best is None or progress.objective < best.objective
                ):
                    self._best_visited = at_x
            return at_x

        return evaluate

    def _progress(self, phase: str, at_x: EvaluatedPath) -> Progress:
        effort = self.effort
        return Progress(phase, effort.starts, effort.rollouts, at_x.objective, at_x.violation)


def rank(solution: PathSolution, tolerated: float = FEASIBILITY_TOLERANCE) -> tuple[bool, float]:
    """Return a key to sort by: feasible before infeasible, then by objective or by violation.

    Args:
        tolerated: Largest violation that counts as feasible.
    """
    at_x = solution.at_x
    is_infeasible = not at_x.violation <= tolerated
    return is_infeasible, at_x.violation if is_infeasible else at_x.objective
