"""Optimisation of path and duration together, on coarse grids, from one initial guess.

It runs to the optimum of both, or stops as soon as it is unlikely to lead to a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.watch import SEARCHING, Progress, Watch, in_time
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation
from ff_planner_ros.planning.optimisation.free_program import FreeProgram
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.optimisation.restoration import nearest_feasible
from ff_planner_ros.planning.optimisation.solver import FIRST_RADIUS, minimise
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import DurationRange, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.joint_limits import (
    JointAccelerations,
    JointPositions,
    JointRates,
)
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.grid import COARSE, Stage
from ff_planner_ros.planning.search.grid_solver import SMALL_VIOLATION
from ff_planner_ros.planning.search.multi_start import PROMISING_VIOLATION

# The first trust region lets the duration change by this fraction of the range.
_STRIDE = 0.1
# The solver stays a little inside the range: a duration this near to an end means the end [s].
_AT_END = 1e-4
# A moment that violates less is feasible on its grid.
_KEPT = 1e-4
# Fraction of a shortest duration that is added to it: at the shortest itself there is one path
# only, and none that keeps accelerations between the points, too.
_ROOM = 2e-3
# Entrants whose duration and objective differ by less than this fraction count as one.
_ALIKE = 1e-2
# A glance: iterations, and the largest violation after so many; after twice as many the path must
# be promising. Of 16 guesses that led to a plan, 15 were.
_GLANCE, _FAR = 4, 4e-2
# Requirements on the joints alone.
_OF_JOINTS = {JointPositions.name, JointRates.name, JointAccelerations.name}


@dataclass(frozen=True, eq=False)
class Moment:
    """A duration, and a path of it that is optimal, and feasible or nearly so, on a coarse grid."""

    duration: float  # [s]
    family: Parametrisation
    x: Array  # decision variables of the path
    objective: float  # with the weight of the duration
    violation: float  # of the worst requirement

    @property
    def is_certain(self) -> bool:
        """Whether the path is feasible on the coarse grid: else more points may allow less time."""
        return self.violation <= _KEPT

    def is_like(self, other: Moment, part: float) -> bool:
        """Tell whether it adds nothing to another moment: durations differ by less than `part`."""
        near = abs(self.duration - other.duration) < part * other.duration
        return near and self.family is other.family and self.is_certain


@dataclass(frozen=True, eq=False)
class Entrant:
    """A path and a duration between an initial guess and the optimum of both."""

    along: Array  # the solver's variables: those of the path, then the duration in its unit
    duration: float  # [s]
    radius: float  # of the trust region, to go on with
    curvature: Array | None = None  # SR1 approximation so far
    objective: float = np.inf  # with the weight of the duration; infinite: not evaluated yet
    violation: float = np.inf  # of the worst requirement
    number: int = 0  # of its search among those of a race

    @property
    def lead(self) -> tuple[bool, float]:
        """A key to sort by, best first; a small violation counts as none."""
        is_far = not self.violation <= SMALL_VIOLATION
        return is_far, self.violation if is_far else self.objective

    def is_like(self, other: Entrant) -> bool:
        """Tell whether two paths and their durations hardly differ."""
        apart = abs(self.duration - other.duration), abs(self.objective - other.objective)
        return apart[0] <= _ALIKE * other.duration and apart[1] <= _ALIKE * abs(other.objective)


@dataclass(frozen=True, eq=False)
class FreeSearch:
    """Optimisation of path and duration together, from one duration and in one family."""

    problem: PlanningProblem  # with a range of durations
    fixed: PlanningProblem  # of the duration to begin with
    family: PathFamily
    settings: PlannerSettings

    @property
    def _radius(self) -> float:
        return FIRST_RADIUS * self.family.stride

    @property
    def _unit(self) -> float:
        """Unit of the duration, as the solver sees it [s]."""
        window = self.problem.durations
        return _STRIDE * (window.maximum - window.minimum) / self._radius

    def _duration(self, along: Array) -> float:
        """Return the duration that the solver's variables stand for [s]."""
        window = self.problem.durations
        return float(np.clip(along[-1] * self._unit, window.minimum, window.maximum))

    def guesses(self) -> Iterator[Array]:
        """Yield the family's initial guesses, without end."""
        stage = COARSE[0]
        return self.family.first_guesses(self.fixed.obstacles, stage.points, stage.damping)

    def _program(self) -> PathProgram:
        asked = self.problem.objective
        least = self.settings.joint_path_tie_break * max(
            asked.chaser_attitude, asked.wheel_momentum, asked.duration
        )
        path = replace(asked, joint_path_length=asked.joint_path_length or least)
        return path_program(replace(self.fixed, objective=path), self.family, self.settings)

    def _free(self, program: PathProgram, stage: Stage) -> FreeProgram:
        on_points = replace(program, points=stage.points, damping=stage.damping)
        return FreeProgram(self.problem, on_points, self.problem.objective.duration, self._unit)

    def glance(
        self, guess: Array, watch: Watch, effort: Effort, *, joints_alone: bool = False
    ) -> Array | None:
        """Return a path that is nearly feasible on a coarse grid; None: a few steps reach none.

        Args:
            joints_alone: Only the joints' own limits count. They are linear in a spline's control
                points at a given duration: if no path near a known one keeps them, none does.
        """
        program, stage = self._program(), COARSE[0]
        if joints_alone:
            others = {one.name for one in program.requirements} - _OF_JOINTS
            program, stage = replace(program, on_demand=frozenset(others)), COARSE[-1]
        free = self._free(program, stage)
        linearise, along = _watched(free, watch, effort), self._along(guess)
        here = linearise(along)
        if not here.is_defined:
            return None
        for allowed in (PROMISING_VIOLATION,) if joints_alone else (_FAR, PROMISING_VIOLATION):
            solution = nearest_feasible(linearise, along, here, _GLANCE)
            effort.iterations += solution.iterations
            along, here = solution.x, solution.at_x
            if here.violation > allowed:
                return None
        return along[:-1]

    def entrant(self, guess: Array) -> Entrant:
        """Return an initial guess, with the duration to begin at, as an entrant."""
        along = self._along(guess)
        return Entrant(along, self._duration(along), self._radius)

    def optimum(self, guess: Array, watch: Watch, effort: Effort) -> Moment | None:
        """Return the optimum from an initial guess; None: the path became singular."""
        return self.optimum_ahead_of(self.entrant(guess), watch, effort)

    def further(
        self, entrant: Entrant, iterations: int, watch: Watch, effort: Effort
    ) -> Entrant | None:
        """Return the entrant after some iterations on the coarsest grid; None: it is singular."""
        stage, free = COARSE[0], self._free(self._program(), COARSE[0])
        solution = minimise(
            _watched(free, watch, effort),
            entrant.along,
            iterations,
            stage.optimality,
            stage.progress,
            entrant.radius,
            entrant.curvature,
        )
        effort.iterations += solution.iterations
        at_x = solution.at_x
        if not at_x.is_defined:
            return None
        return replace(
            entrant,
            along=solution.x,
            duration=self._duration(solution.x),
            radius=solution.radius,
            curvature=solution.curvature,
            objective=at_x.objective,
            violation=at_x.violation,
        )

    def optimum_ahead_of(self, entrant: Entrant, watch: Watch, effort: Effort) -> Moment | None:
        """Return the optimum that an entrant leads to; None: the path became singular."""
        along, program = entrant.along, self._program()
        stages = self._stages(program)
        radius, curvature = entrant.radius, entrant.curvature
        while stages:
            stage = stages[0]
            free = self._free(program, stage)
            linearise = _watched(free, watch, effort)
            solution = minimise(
                linearise,
                along,
                stage.iterations,
                stage.optimality,
                stage.progress,
                radius,
                curvature,
            )
            radius, curvature = self._radius, None
            effort.iterations += solution.iterations
            if not solution.at_x.is_defined:
                return None
            along = solution.x
            violated = free.at(free.duration(along)).violated_on_demand(solution.at_x)
            program = program.with_requirements(violated)
            stages = stages if violated else stages[1:]
        room = _ROOM if self._is_of_joints else 0.0
        return Moment(
            _chosen(self.problem.durations, free.duration(along), room),
            Parametrisation(self.family.name),
            along[:-1],
            solution.at_x.objective,
            solution.at_x.violation,
        )

    @property
    def _is_of_joints(self) -> bool:
        """Whether joints must reach a posture as soon as possible: accelerations decide when."""
        return self.problem.objective.only_duration and self.problem.posture is not None

    def _stages(self, program: PathProgram) -> list[Stage]:
        """Return the grids to solve on: few points do not show how high accelerations rise."""
        fine = replace(COARSE[-1], points=program.points)
        return [COARSE[0], fine] if self._is_of_joints else [*COARSE]

    def _along(self, guess: Array) -> Array:
        return np.append(guess, self.fixed.duration / self._unit)


# An entrant and the iterations that it runs; instead of their number: to its optimum.
Leg: TypeAlias = tuple[Entrant, int]
TO_OPTIMUM = 0


def run_leg(
    searches: Sequence[FreeSearch], leg: Leg, watch: Watch, effort: Effort
) -> Entrant | Moment | None:
    """Return where a leg of a race leads; None: the path became singular."""
    entrant, iterations = leg
    search = searches[entrant.number]
    if iterations == TO_OPTIMUM:
        return search.optimum_ahead_of(entrant, watch, effort)
    return search.further(entrant, iterations, watch, effort)


def _watched(
    free: FreeProgram, watch: Watch, effort: Effort
) -> Callable[[Array], PathLinearisation]:
    """Return a function that linearises, counts the effort and reports to the watch."""
    is_initial = True

    def linearise(along: Array) -> PathLinearisation:
        nonlocal is_initial
        watch.require_time()
        at_x = in_time(watch, free.linearise, along)
        if is_initial and at_x.is_defined:
            effort.met.update(free.program.met(at_x))
            is_initial = False
        effort.rollouts += 1
        watch.report(
            Progress(SEARCHING, effort.starts, effort.rollouts, at_x.objective, at_x.violation)
        )
        return at_x

    return linearise


def _chosen(window: DurationRange, duration: float, room: float) -> float:
    """Return an end of the range if the solver is at it, or else a duration with some room [s].

    Args:
        room: As a fraction of the duration.
    """
    ends = (window.minimum, window.maximum)
    later = min((1.0 + room) * duration, window.maximum)
    return next((end for end in ends if abs(duration - end) < _AT_END), later)
