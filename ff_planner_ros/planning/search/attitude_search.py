"""From a plan of minimum joint path to one that weighs the chaser's attitude, too.

The attitude has many local optima, the joint path few. So the plan of minimum joint path and other
initial guesses go through successive halving on the coarsest grid, where an evaluation is cheap,
first for a smooth norm of the Euler angles, then for the largest; basin hopping follows from the
best optimum. The answer is never worse than the plan of minimum joint path in the objective of the
request, by the plans' metrics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, cycle, islice

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.objectives import weighted_sum, with_tie_break
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.planning.search.grid import Grid
from ff_planner_ros.planning.search.grid_solver import (
    SMALL_VIOLATION,
    GridSolver,
    PathSolution,
    rank,
)
from ff_planner_ros.planning.search.portfolio import (
    HOPS_OF_PAPERS_PATHS,
    NEAREST,
    RACE,
    ROUNDS,
    Round,
)

# Weights of the attitude relative to the joint path's that are tried below the requested one: each
# about three times the last; below the first the joint path alone decides.
_LOWER_WEIGHTS = (6.0, 15.0, 45.0)
# Iterations from a survivor of successive halving to its optimum on the coarsest grid.
_TO_OPTIMUM = 24
# Basin hops from the best path: random steps along each direction, of these two standard deviations
# in turn, for so many iterations. One whose objective is below so many times the best is optimised.
_SPREADS, _AFTER_HOP, _NEARLY = (0.1, 0.2), 14, 1.3
# First trust region, far from an optimum: half that along single coefficients, as the path moves
# along all directions at once.
_FIRST_RADIUS = 0.25
# Violations that do not stop the solver's steps, far from an optimum and near one.
_TOLERATED, _TOLERATED_NEAR = 2e-2, 5e-3
# First-order optimality and progress on the coarsest grid: good enough to compare two paths.
_OPTIMALITY, _COMPARED = 1e-5, 1e-4
# At most this many paths of a round are refined, each by so many iterations on each finer grid from
# near the optimum, with this trust region and this relative progress.
_REFINED, _ITERATIONS, _RADIUS, _PROGRESS = 2, 12, 0.1, 2e-4
# Iterations of a refined path where constraints are tightened.
_TIGHTENING_ITERATIONS = 6
# Singular values stay above so many times their threshold: they may fall between the points.
_AWAY = 1.2
# A coarse path whose objective exceeds so many times that of the best plan is not refined.
_PROMISING = 1.02
# Shares of the attitude in the cost of the plan of minimum joint path. Below the first, no other
# guesses are tried. Up to the second, they are only if one of the first `_LOOKED_AT` of them, after
# `_LOOK` iterations, lowers the objective to `_GAIN`: nearly always the nearest optimum is best.
_NEGLIGIBLE, _MINOR, _GAIN, _LOOKED_AT, _LOOK = 2e-4, 0.3, 0.98, 3, 10

NO_BETTER = "good enough: no better attitude was found than that of the least joint path"


@dataclass(frozen=True, eq=False)
class _Optimum:
    """A path that is locally optimal on the coarsest grid, and feasible there."""

    path: PathSolution
    cost: float  # on the next finer grid


@dataclass(eq=False)
class AttitudeSearch:
    """The search from a plan of minimum joint path, among the paths of one family."""

    solver: GridSolver  # of that family
    asked: Objective  # of the request
    shortest: Plan  # of minimum joint path
    seeds: Sequence[Array] = ()  # paths of the family, tried before its own initial guesses
    best: Plan = field(init=False)
    _optima: list[_Optimum] = field(default_factory=list, init=False)
    _refined: list[_Optimum] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        """Begin with the plan of minimum joint path."""
        self.best = self.shortest
        self._objective = with_tie_break(self.asked, self.solver.settings)

    def best_plan(self) -> Plan:
        """Search, and return the best plan found, at worst the plan of minimum joint path.

        Raises:
            OutOfTime: By the watch.
        """
        guesses = chain(self.seeds, self.solver.initial_guesses())
        random, is_papers = np.random.default_rng(0), self._grids()[0].directions is not None
        for number, one in enumerate(self._rounds()):
            if number == 1 and self._is_minor and not self._is_more_in_sight():
                break
            self._race(list(islice(guesses, one.guesses)))
            hops = one.hops * (HOPS_OF_PAPERS_PATHS if is_papers else 1)
            for _, spread in zip(range(hops), cycle(_SPREADS), strict=False):
                if self._optima:
                    self._hop(random, spread)
            self._refine()
            if number == 0 and self.best is self.shortest:
                self._climb()
        return self._with_effort()

    @property
    def _attitude_share(self) -> float:
        """Share of the attitude in the cost of the plan of minimum joint path."""
        attitude = self.asked.chaser_attitude * self.shortest.metrics.max_chaser_euler
        return attitude / weighted_sum(self.asked, self.shortest.metrics)

    @property
    def _is_minor(self) -> bool:
        return self._attitude_share <= _MINOR

    def _rounds(self) -> tuple[Round, ...]:
        rounds = ROUNDS[self.solver.settings.search]
        if self._attitude_share <= _NEGLIGIBLE:
            return (NEAREST,)
        return (NEAREST, *rounds[1:]) if self._is_minor else rounds

    def _race(self, guesses: Sequence[Array]) -> None:
        """Find optima by successive halving of the paths from initial guesses."""
        solver = self.solver
        solver.effort.starts += len(guesses)
        starts = guesses
        for stage in RACE:
            grid = self._coarsest(stage.norm).with_stage(iterations=stage.iterations)
            paths = [solver.solve(grid, start) for start in starts]
            leading = sorted(paths, key=_lead)[: stage.go_on]
            starts = [path.x for path in leading]
        for path in leading:
            self._optima += self._optimum(path)

    def _hop(self, random: np.random.Generator, spread: float) -> None:
        """Search for another optimum from a random step beside the best one."""
        grid, best = self._coarsest(), self._leading(1)[0].path
        self.solver.effort.starts += 1
        aside = random.normal(scale=spread, size=len(best.x))
        if grid.directions is not None:
            aside = grid.directions @ aside
        begin = best.x + aside, best.curvature
        path = self.solver.solve(grid.with_stage(iterations=_AFTER_HOP), *begin)
        if not _lead(path)[0] and path.at_x.objective < _NEARLY * best.at_x.objective:
            self._optima += self._optimum(path)

    def _optimum(self, path: PathSolution) -> list[_Optimum]:
        """Return the optimum that a path leads to, unless it is infeasible on the next finer grid.

        Between few points a path may be singular or in collision.
        """
        grid = self._coarsest().with_stage(
            tolerated=_TOLERATED_NEAR, iterations=_TO_OPTIMUM, radius=path.radius
        )
        path = self.solver.solve_feasibly(grid, path.x, path.curvature)
        if not path.feasible:
            return []
        finer = self.solver.solve(self._grids()[1].with_stage(iterations=0), path.x).at_x
        if not finer.violation < SMALL_VIOLATION:
            return []
        alone = self.asked.joint_path_length == 0.0
        cost = float(finer.max_terms.max()) if alone else finer.objective
        return [_Optimum(path, cost)]

    def _leading(self, count: int) -> list[_Optimum]:
        return sorted(self._optima, key=lambda optimum: optimum.cost)[:count]

    def _refine(self) -> None:
        """Solve the best optima on finer grids, and keep the plans."""
        for optimum in self._leading(_REFINED):
            none_yet = self.best is self.shortest
            limit = np.inf if none_yet else weighted_sum(self.asked, self.best.metrics)
            if optimum in self._refined or optimum.cost > _PROMISING * limit:
                continue
            self._refined.append(optimum)
            path = optimum.path
            found = list(self._plans_near(self._objective, path.x, path.curvature))
            self._keep(found)
            if not found:  # nor is anything gained near it
                self._optima.remove(optimum)

    def _keep(self, plans: Sequence[Plan]) -> None:
        """Keep the best plan, the first where several are equal."""
        self.best = min(
            [self.best, *plans], key=lambda plan: weighted_sum(self.asked, plan.metrics)
        )

    def better_at(self, guess: Array) -> Plan:
        """Return the best plan near a given path, at worst the plan of minimum joint path.

        Raises:
            OutOfTime: By the watch.
        """
        # As it is, then improved: the better plan is kept.
        grid, path = self._path_at(guess)
        found, followed = self.solver.tighten(grid, path, self.solver.solve_and_restore)
        self._keep(list(self.solver.sound_plans(found, followed)))
        self._keep(list(self._plans_near(self._objective, guess, None)))
        return self.best

    def _is_more_in_sight(self) -> bool:
        """Tell whether a few iterations from other initial guesses beat the best optimum."""
        if not self._optima:
            return True
        grid = self._coarsest().with_stage(iterations=_LOOK)
        enough = _GAIN * self._leading(1)[0].path.at_x.objective
        for other in islice(self.solver.initial_guesses(), _LOOKED_AT):
            self.solver.effort.starts += 1
            is_infeasible, value = rank(self.solver.solve(grid, other), SMALL_VIOLATION)
            if not is_infeasible and value < enough:
                return True
        return False

    def _climb(self) -> None:
        """Raise the weight of the attitude in steps, as long as the plans pass the check.

        Near the minimum of the attitude there may be no plan, because of a singularity or a limit
        that the search does not keep; at a lower weight there often is one.
        """
        for weight in _LOWER_WEIGHTS:
            if weight * self.asked.joint_path_length >= self.asked.chaser_attitude:
                break
            lower = replace(self.asked, joint_path_length=self.asked.chaser_attitude / weight)
            before = self.best
            begin = self.seeds[0] if before is self.shortest else before.coefficients
            self._keep(list(self._plans_near(lower, begin, None)))
            if self.best is before:
                break

    def _plans_near(
        self, objective: Objective, x: Array, curvature: Array | None
    ) -> Iterator[Plan]:
        """Yield the plan along the best path near x on the finest grid, if it passes the check."""
        grids = self._grids_for(objective)[1:]
        for grid in grids:
            near = (grid.with_correction(x) if grid is grids[-1] else grid).with_stage(
                progress=max(grid.stage.progress, _PROGRESS),
                iterations=_ITERATIONS,
                tolerated=_TOLERATED_NEAR,
                radius=_RADIUS,
            )
            found = self.solver.solve_feasibly(near, x, curvature)
            if found.at_x.is_defined:
                x, curvature = found.x, found.curvature
        near = near.with_stage(iterations=_TIGHTENING_ITERATIONS)
        yield from self.solver.sound_plans(
            *self.solver.tighten(near, found, self.solver.solve_and_restore)
        )

    def _path_at(self, x: Array) -> tuple[Grid, PathSolution]:
        """Return the finest grid, and the path of x on it, unimproved; it may be singular."""
        grid = self._grids()[-1].with_correction(x).with_stage(iterations=0)
        return grid, self.solver.solve(grid, x)

    def _with_effort(self) -> Plan:
        """Return the best plan with the effort of the whole search."""
        report = self.solver.effort.report(self.best.solver)
        if self.best is self.shortest:
            report = replace(report, stop_reason=NO_BETTER)
        return replace(self.best, solver=report)

    def _coarsest(self, norm: float = np.inf) -> Grid:
        """Return the coarsest grid, with a p-norm in place of the largest Euler angle."""
        grid = self._grids()[0]
        return replace(grid, program=replace(grid.program, attitude_norm=norm)).with_stage(
            optimality=_OPTIMALITY,
            progress=_COMPARED,
            tolerated=_TOLERATED,
            radius=_FIRST_RADIUS,
        )

    def _grids(self) -> list[Grid]:
        return self._grids_for(self._objective)

    def _grids_for(self, objective: Objective) -> list[Grid]:
        """Return the grids, coarse to fine, with another objective.

        None is damped: a path that damping leads through a singularity would fail the check.
        """
        away = _AWAY * self.solver.settings.singular_value_threshold
        found = []
        for grid in self.solver.grids:
            margins = {**grid.program.margins, SingularValues.name: away}
            program = replace(grid.program, objective=objective, damping=0.0, margins=margins)
            # Directions are as long as a bold step by themselves.
            directions = program.family.directions
            found.append(replace(grid, program=program, stride=1.0, directions=directions))
        return found


def _lead(path: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by, best first; small violations count as none, to be mended later."""
    return rank(path, SMALL_VIOLATION)
