"""From a plan of minimum joint path to one that weighs the chaser's attitude, too.

The attitude has many local optima, the joint path few. So the plan of minimum joint path and other
initial guesses go through successive halving on the coarsest grid, where an evaluation is cheap,
first for a smooth norm of the Euler angles, then for the largest; basin hopping follows from the
best optimum. The answer is never worse than the plan of minimum joint path in the objective of the
request, by the plans' metrics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, cycle, islice
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import EndedBy
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.objectives import weighted_sum, with_tie_break
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.grid import Grid
from ff_planner_ros.planning.search.grid_solver import (
    SMALL_VIOLATION,
    GridSolver,
    PathSolution,
    rank,
)
from ff_planner_ros.planning.search.portfolio import (
    AFTER_HOP,
    GLANCE,
    HOPS_AT_ONCE,
    HOPS_OF_PAPERS_PATHS,
    MINOR,
    NEARLY,
    RACE,
    SPREADS,
    TO_OPTIMUM,
    RaceStage,
    rounds_of,
)
from ff_planner_ros.planning.search.side_by_side import SideBySide

Value = TypeVar("Value")
# A part of the search or what it found, and the requirements that have no rows yet.
_Part: TypeAlias = "tuple[Callable[[AttitudeSearch], Any], frozenset[str]]"
_Found: TypeAlias = tuple[Any, frozenset[str]]

# Weights of the attitude relative to the joint path's that are tried below the requested one: each
# about three times the last; below the first the joint path alone decides.
_LOWER_WEIGHTS = (6.0, 15.0, 45.0)
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
# Where the attitude is a minor part, other guesses are only tried if one of the first `_LOOKED_AT`,
# after `_LOOK` iterations, lowers the objective to `_GAIN`: nearly always the nearest is best.
_GAIN, _LOOKED_AT, _LOOK = 0.98, 3, 10

NO_BETTER = "good enough: no better attitude was found than that of the least joint path"


class _Path(NamedTuple):
    """A path on the coarsest grid, as the solver left it."""

    x: Array
    curvature: Array | None
    radius: float
    value: float  # of the objective
    lead: tuple[bool, float]  # a key to sort by, best first; violations to be mended do not count

    @staticmethod
    def of(found: PathSolution) -> _Path:
        """Return what the next stage needs of a solution."""
        lead = rank(found, SMALL_VIOLATION)
        return _Path(found.x, found.curvature, found.radius, found.at_x.objective, lead)


@dataclass(frozen=True, eq=False)
class _Optimum:
    """A path that is locally optimal on the coarsest grid, and feasible there."""

    path: _Path
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
    _parts: SideBySide[_Part, _Found] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Begin with the plan of minimum joint path."""
        self.best = self.shortest
        self._objective = with_tie_break(self.asked, self.solver.settings)

    def best_plan(self) -> Plan:
        """Search, and return the best plan found, at worst the plan of minimum joint path.

        Raises:
            OutOfTime: By the watch.
        """
        if weighted_sum(self.asked, self.shortest.metrics) == 0.0:
            return self._with_effort()  # nothing costs less: wheels hold the chaser
        guesses = chain(self.seeds, self.solver.initial_guesses())
        random, is_papers = np.random.default_rng(0), self._grids()[0].directions is not None
        solver, threads = self.solver, self.solver.settings.threads
        compute = partial(self._compute, solver.program)
        self._parts = SideBySide(compute, solver.watch, solver.effort, threads)
        with closing(self._parts):
            for number, one in enumerate(rounds_of(solver.settings.search, self._attitude_share)):
                if number == 1 and self._is_minor and not self._is_more_in_sight():
                    break
                self._race(list(islice(guesses, one.guesses)), number == 0 and not self._is_minor)
                self._hop(random, one.hops * (HOPS_OF_PAPERS_PATHS if is_papers else 1))
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
        return self._attitude_share <= MINOR

    def _race(self, guesses: Sequence[Array], glance: bool) -> None:
        """Find optima by successive halving of the paths from initial guesses."""
        self.solver.effort.starts += len(guesses)
        starts = guesses
        for stage in RACE:
            runs = [partial(AttitudeSearch._run, stage=stage, start=start) for start in starts]
            paths = list(self._found(runs))
            if glance and stage is RACE[0]:  # for a better plan, early
                self._keep(self._plans_near(self._objective, paths[0].x, None, glance=True))
            leading = sorted(paths, key=lambda path: path.lead)[: stage.go_on]
            starts = [path.x for path in leading]
        parts = [partial(AttitudeSearch._optimum, path=path) for path in leading]
        self._optima += chain.from_iterable(self._found(parts))

    def _run(self, stage: RaceStage, start: Array) -> _Path:
        """Return where one stage of the race leads."""
        grid = self._coarsest(stage.norm).with_stage(iterations=stage.iterations)
        return _Path.of(self.solver.solve(grid, start))

    def _hop(self, random: np.random.Generator, count: int) -> None:
        """Search for other optima from random steps beside the best one."""
        spreads = islice(cycle(SPREADS), count)
        while self._optima and (some := list(islice(spreads, HOPS_AT_ONCE))):
            best = self._leading(1)[0].path
            asides = [random.normal(scale=spread, size=len(best.x)) for spread in some]
            self.solver.effort.starts += len(asides)
            # From behind: far steps, which take longest, should not begin last.
            hops = [partial(AttitudeSearch._hopped, best=best, aside=one) for one in asides[::-1]]
            self._optima += chain.from_iterable(self._found(hops))

    def _hopped(self, best: _Path, aside: Array) -> list[_Optimum]:
        """Return the optimum that a step aside from the best one leads to, if there is one."""
        grid = self._coarsest().with_stage(iterations=AFTER_HOP)
        if grid.directions is not None:
            aside = grid.directions @ aside
        path = _Path.of(self.solver.solve(grid, best.x + aside, best.curvature))
        if path.lead[0] or path.value >= NEARLY * best.value:
            return []
        return self._optimum(path)

    def _optimum(self, path: _Path) -> list[_Optimum]:
        """Return the optimum that a path leads to, unless it is infeasible on the next finer grid.

        Between few points a path may be singular or in collision.
        """
        grid = self._coarsest().with_stage(
            tolerated=_TOLERATED_NEAR, iterations=TO_OPTIMUM, radius=path.radius
        )
        found = self.solver.solve_feasibly(grid, path.x, path.curvature)
        if not found.feasible:
            return []
        finer = self.solver.solve(self._grids()[1].with_stage(iterations=0), found.x).at_x
        if not finer.violation < SMALL_VIOLATION:
            return []
        alone = self.asked.joint_path_length == 0.0
        cost = float(finer.max_terms.max()) if alone else finer.objective
        return [_Optimum(_Path.of(found), cost)]

    def _leading(self, count: int) -> list[_Optimum]:
        return sorted(self._optima, key=lambda optimum: optimum.cost)[:count]

    def _refine(self) -> None:
        """Solve the best optima on finer grids, and keep the plans."""
        cost = np.inf if self.best is self.shortest else weighted_sum(self.asked, self.best.metrics)
        leading = [one for one in self._leading(_REFINED) if one not in self._refined]
        chosen = [one for one in leading if one.cost <= _PROMISING * cost]
        self._refined += chosen
        near = partial(AttitudeSearch._plans_near, objective=self._objective)
        parts = [partial(near, x=one.path.x, curvature=one.path.curvature) for one in chosen]
        for optimum, plans in zip(chosen, self._found(parts), strict=True):
            for plan in plans:
                told = replace(plan, solver=self.solver.effort.report(plan.solver))
                self.solver.watch.offer(told)
                self._keep([told])
            if not plans:  # nor is anything gained near it
                self._optima.remove(optimum)

    def _found(self, parts: Sequence[Callable[[AttitudeSearch], Value]]) -> Iterator[Value]:
        """Yield what parts of the search find, each from what is known now."""
        known = self.solver.program.on_demand
        for value, on_demand in self._parts.values([(part, known) for part in parts]):
            self.solver.with_rows_but_for(on_demand)
            yield value

    def _compute(self, program: PathProgram, part: _Part, watch: Watch, effort: Effort) -> _Found:
        """Compute a part with a solver of its own, which knows nothing of parts beside it."""
        search, (compute, on_demand) = copy(self), part
        search.solver = GridSolver(program, self.solver.settings, watch, effort)
        search.solver.with_rows_but_for(on_demand)
        return compute(search), search.solver.program.on_demand

    def _keep(self, plans: Iterable[Plan]) -> None:
        """Keep the best plan, the first where several are equal."""
        self.best = min([self.best, *plans], key=lambda one: weighted_sum(self.asked, one.metrics))

    def better_at(self, guess: Array) -> Plan:
        """Return the best plan near a given path, at worst the plan of minimum joint path.

        Raises:
            OutOfTime: By the watch.
        """
        # As it is, then improved: the better plan is kept.
        grid = self._grids()[-1].with_correction(guess).with_stage(iterations=0)
        path = self.solver.solve(grid, guess)
        found, followed = self.solver.tighten(grid, path, self.solver.solve_and_restore)
        self._keep(self.solver.sound_plans(found, followed))
        self._keep(self._plans_near(self._objective, guess, None))
        return self.best

    def _is_more_in_sight(self) -> bool:
        """Tell whether a few iterations from other initial guesses beat the best optimum."""
        if not self._optima:
            return True
        grid = self._coarsest().with_stage(iterations=_LOOK)
        for other in islice(self.solver.initial_guesses(), _LOOKED_AT):
            self.solver.effort.starts += 1
            is_infeasible, value = rank(self.solver.solve(grid, other), SMALL_VIOLATION)
            if not is_infeasible and value < _GAIN * self._leading(1)[0].path.value:
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
            self._keep(self._plans_near(lower, begin, None))
            if self.best is before:
                break

    def _plans_near(
        self, objective: Objective, x: Array, curvature: Array | None, glance: bool = False
    ) -> list[Plan]:
        """Return the plan along the best path near x on the finest grid, if it passes the check.

        A glance takes a few iterations, on that grid alone.
        """
        grids = self._grids(objective)[-1 if glance else 1 :]
        for grid in grids:
            near = (grid.with_correction(x) if grid is grids[-1] else grid).with_stage(
                progress=max(grid.stage.progress, _PROGRESS),
                iterations=GLANCE if glance else _ITERATIONS,
                tolerated=_TOLERATED_NEAR,
                radius=_RADIUS,
            )
            found = self.solver.solve_feasibly(near, x, curvature)
            if found.at_x.is_defined:
                x, curvature = found.x, found.curvature
        near = near.with_stage(iterations=_TIGHTENING_ITERATIONS)
        tightened = self.solver.tighten(near, found, self.solver.solve_and_restore)
        return list(self.solver.sound_plans(*tightened))

    def _with_effort(self) -> Plan:
        """Return the best plan with the effort of the whole search."""
        ended = self.best.solver
        if self.best is self.shortest:
            ended = replace(ended, stop_reason=NO_BETTER, ended_by=EndedBy.CONVERGED)
        return replace(self.best, solver=self.solver.effort.report(ended))

    def _coarsest(self, norm: float = np.inf) -> Grid:
        """Return the coarsest grid, with a p-norm in place of the largest Euler angle."""
        grid = self._grids()[0]
        return replace(grid, program=replace(grid.program, attitude_norm=norm)).with_stage(
            optimality=_OPTIMALITY,
            progress=_COMPARED,
            tolerated=_TOLERATED,
            radius=_FIRST_RADIUS,
        )

    def _grids(self, objective: Objective | None = None) -> list[Grid]:
        """Return the grids, coarse to fine, with an objective; None: the one that is asked for.

        None is damped: a path that damping leads through a singularity would fail the check.
        """
        objective = objective or self._objective
        away = _AWAY * self.solver.settings.singular_value_threshold
        found = []
        for grid in self.solver.grids:
            margins = {**grid.program.margins, SingularValues.name: away}
            program = replace(grid.program, objective=objective, damping=0.0, margins=margins)
            # Directions are as long as a bold step by themselves.
            directions = program.family.directions
            found.append(replace(grid, program=program, stride=1.0, directions=directions))
        return found
