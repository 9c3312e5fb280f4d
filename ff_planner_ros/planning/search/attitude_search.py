"""From a plan of least joint path to one that weighs the chaser's attitude, too.

The attitude has many local optima, the joint path few. So the plan of least joint path and other
initial guesses are successively halved, and from the best of them the search hops from basin to
basin, most of it on the coarsest grid, where it is cheap. The answer is never worse than the plan
of least joint path in the objective asked for, as the plans' metrics measure it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, islice

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.objectives import weighted_sum, with_tie_break
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.planning.search.basin_hopping import TOLERATED_NEAR, BasinHopping, Optimum
from ff_planner_ros.planning.search.grid import Grid
from ff_planner_ros.planning.search.grid_solver import SMALL_VIOLATION, PathSolution, rank
from ff_planner_ros.planning.search.search import Search

# Weights of the attitude, where the joint path's is one, that are tried below the one asked for.
# Each about three times the last; below the first the joint path alone decides.
_LOWER_WEIGHTS = (6.0, 15.0, 45.0)
# Initial guesses that a round halves, the first the plan of least joint path.
_GUESSES = 24
# Rounds of hops that leave more than this part of the best path's cost lead nowhere: after so many
# in a row the next round restarts from other guesses.
_GAIN, _IN_VAIN = 0.98, 2
# At most this many paths of a round are refined, each in so many iterations on each finer grid:
# they begin near the optimum, with this trust region. An objective known to this part is enough.
_REFINED, _ITERATIONS, _RADIUS, _PROGRESS = 2, 12, 0.1, 2e-4
# Iterations of a refined path where constraints are tightened.
_TIGHTENING_ITERATIONS = 6
# Singular values stay so many times above their threshold: they may fall between the points.
_AWAY = 1.2
# Of the best plan's objective: a path on the coarsest grid that is above it is not refined.
_PROMISING = 1.02
# Parts of the cost of the plan of least joint path. Where the attitude is less than the first, no
# other guesses are tried; up to the other they are, only if one of so many of them, so many
# iterations far, gains: the optimum nearest to that plan nearly always is the best.
_NEGLIGIBLE, _MINOR, _LOOKED_AT, _LOOK = 2e-4, 0.3, 5, 6

NO_BETTER = "good enough: no better attitude was found than that of the least joint path"


class AttitudeSearch(Search):
    """Looks for a path of least joint path, and from there for a better attitude."""

    def best_plan(self, asked: Objective, shortest: Plan) -> Plan:
        """Return the best plan found, at worst the plan of least joint path.

        More rounds never give a worse plan: each begins where the one before it ended. Without any
        the search goes from the plan of least joint path to the nearest optimum, at a tenth of the
        price; so it does where the attitude is but a minor part and nothing better is in sight.

        Raises:
            OutOfTime: By the watch.
        """
        objective = with_tie_break(asked, self._settings)
        best = self.better_at_guess(asked, shortest)
        hopping = BasinHopping(
            self, lambda: self._grids_for(objective), asked.joint_path_length == 0.0
        )
        guesses, refined = self._restart_guesses(shortest), list[Optimum]()
        in_vain = 0
        rounds = self._rounds(asked, shortest)
        for number, count in enumerate(rounds):
            is_after_nearest = number == 1 and rounds[0] == 1 and best is not shortest
            if is_after_nearest and not self._is_more_in_sight(shortest, hopping):
                break
            if hopping.found and in_vain < _IN_VAIN:
                reached = hopping.best(1)[0].cost
                hopping.hop(number)
                gains = hopping.best(1)[0].cost < _GAIN * reached
                in_vain = 0 if gains else in_vain + 1
            else:
                hopping.halve(list(islice(guesses, count)))
                in_vain = 0 if count > 1 else _IN_VAIN
            for optimum in hopping.best(_REFINED):
                limit = np.inf if best is shortest else weighted_sum(asked, best.metrics)
                if optimum in refined or optimum.cost > _PROMISING * limit:
                    continue
                refined.append(optimum)
                path = optimum.path
                plans = list(self._plans_near(objective, path.x, path.curvature))
                best = _better(asked, best, *plans)
                if not plans:  # nor is anything gained near it
                    hopping.found.remove(optimum)
            if number == 0 and best is shortest:
                best = self._climb(asked, shortest)
        if best is shortest:
            _, at_best = self._path_at(objective, best.coefficients)
            optimality, reason = at_best.optimality, NO_BETTER
        else:
            optimality, reason = best.solver.optimality, best.solver.stop_reason
        effort = self.report(self._solved[-1])
        return replace(best, solver=replace(effort, optimality=optimality, stop_reason=reason))

    def _rounds(self, asked: Objective, shortest: Plan) -> list[int]:
        """Return the number of initial guesses of each round, if it restarts."""
        rounds = [_GUESSES] * self._settings.attitude_rounds
        attitude = asked.chaser_attitude * shortest.metrics.max_chaser_euler
        cost = weighted_sum(asked, shortest.metrics)
        if not rounds or attitude <= _NEGLIGIBLE * cost:
            return [1]
        return [1, *rounds] if attitude <= _MINOR * cost else rounds

    def _is_more_in_sight(self, shortest: Plan, hopping: BasinHopping) -> bool:
        """Tell whether a look at other initial guesses shows a better one than what is found."""
        if not hopping.found:
            return True
        grid = hopping.grid.with_stage(iterations=_LOOK)
        enough = _GAIN * hopping.best(1)[0].path.at_x.objective
        for other in islice(self._restart_guesses(shortest), 1, 1 + _LOOKED_AT):
            self.starts += 1
            is_infeasible, value = rank(self.solve(grid, other), SMALL_VIOLATION)
            if not is_infeasible and value < enough:
                return True
        return False

    def _restart_guesses(self, shortest: Plan) -> Iterator[Array]:
        """Yield where the paths of the rounds begin, without end."""
        return chain([shortest.coefficients], self.initial_guesses())

    def better_at_guess(self, asked: Objective, shortest: Plan) -> Plan:
        """Return the best plan at the first guess, at worst the plan of least joint path.

        Raises:
            OutOfTime: By the watch.
        """
        guess, objective = self._first_guess, with_tie_break(asked, self._settings)
        if guess is None:
            return shortest
        # As it is, and improved: that may be worth more.
        as_it_is = self.tighten(*self._path_at(objective, guess), self.solve_and_restore)
        plans = chain(self.sound_plans(*as_it_is), self._plans_near(objective, guess, None))
        return _better(asked, shortest, *plans)

    def _climb(self, asked: Objective, shortest: Plan) -> Plan:
        """Raise the weight of the attitude on all points, as long as the plans pass the check.

        Near the least attitude there may be no plan, because of a singularity or a limit that the
        search does not keep. Below it there often is one.
        """
        best = shortest
        for weight in _LOWER_WEIGHTS:
            if weight * asked.joint_path_length >= asked.chaser_attitude:
                break
            lower = replace(asked, joint_path_length=asked.chaser_attitude / weight)
            better = _better(asked, best, *self._plans_near(lower, best.coefficients, None))
            if better is best:
                break
            best = better
        return best

    def _plans_near(
        self, objective: Objective, x: Array, curvature: Array | None
    ) -> Iterator[Plan]:
        """Yield the plan along the best path on all points near x, if it is sound."""
        grids = self._grids_for(objective)[1:]
        for grid in grids:
            near = (grid.with_correction(x) if grid is grids[-1] else grid).with_stage(
                progress=max(grid.stage.progress, _PROGRESS),
                iterations=_ITERATIONS,
                tolerated=TOLERATED_NEAR,
                radius=_RADIUS,
            )
            found = self.solve_feasibly(near, x, curvature)
            if found.at_x.is_defined:
                x, curvature = found.x, found.curvature
        near = near.with_stage(iterations=_TIGHTENING_ITERATIONS)
        yield from self.sound_plans(*self.tighten(near, found, self.solve_and_restore))

    def _path_at(self, objective: Objective, x: Array) -> tuple[Grid, PathSolution]:
        """Return the path of x as it is, on all points, with its grid; it may be singular."""
        grid = self._grids_for(objective)[-1].with_correction(x).with_stage(iterations=0)
        return grid, self.solve(grid, x)

    def _grids_for(self, objective: Objective) -> list[Grid]:
        """Return the grids, coarse to fine, with another objective.

        None is damped: what damping leads through a singularity would be refused in the end.
        """
        away = _AWAY * self._settings.singular_value_threshold
        found = []
        for grid in self.grids:
            margins = {**grid.program.margins, SingularValues.name: away}
            program = replace(grid.program, objective=objective, damping=0.0, margins=margins)
            found.append(replace(grid, program=program, directions=program.family.directions))
        return found


def _better(objective: Objective, *plans: Plan) -> Plan:
    """Return the best of several plans, the first where they are equal."""
    return min(plans, key=lambda plan: weighted_sum(objective, plan.metrics))
