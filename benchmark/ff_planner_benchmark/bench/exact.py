"""SLSQP, a general-purpose solver, on the planner's own functions and derivatives.

Such a solver needs a fixed number of rows. It gets the lowest margins in ascending order, which are
continuous functions of the path, and one more variable above the max terms.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from ff_planner_benchmark.bench.direct import Stop
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.paths.path_family import singular_refusal

# Rows given to the solver, of the constraints and of the max terms; the others are further away.
_ROWS = 80
_FAR = 10.0
TOLERANCE = 1e-6


def solve_by_slsqp(program: PathProgram, max_iterations: int, x: Array | None = None) -> Stop:
    """Solve by SciPy's SLSQP with exact gradients; x: initial path, None: the straight one."""
    functions = ExactFunctions(program)
    result = minimize(
        functions.objective,
        functions.start(x),
        jac=functions.gradient,
        method="SLSQP",
        constraints={"type": "ineq", "fun": functions.constraints, "jac": functions.jacobian},
        options={"maxiter": max_iterations, "ftol": TOLERANCE},
    )
    return functions.stop(result.x, result.message)


@dataclass(eq=False)
class ExactFunctions:
    """Objective, constraints and derivatives for the solver, from one linearisation per point.

    Variables z are those of a path and, if the program has max terms, an upper bound of these.
    """

    program: PathProgram
    rollouts: int = 0  # linearisations so far
    _x: Array = field(default_factory=lambda: np.empty(0))
    _here: Linearisation | None = None
    _sound: Linearisation | None = None  # the last that is defined

    def start(self, x: Array | None = None) -> Array:
        """Return z of a path; None: of the straight path."""
        x = np.zeros(self.program.family.variables) if x is None else x
        max_terms = self._at(x).max_terms
        return np.append(x, max_terms.max()) if max_terms.size else x

    def objective(self, z: Array) -> float:
        """Return the objective at z."""
        return self._at(z).value + float(z[self._size :].sum())

    def gradient(self, z: Array) -> Array:
        """Return the gradient of `objective`."""
        return np.append(self._at(z).gradient, np.ones(len(z) - self._size))

    def constraints(self, z: Array) -> Array:
        """Return the values that must not be negative at z."""
        return self._rows(z)[0]

    def jacobian(self, z: Array) -> Array:
        """Return the Jacobian of `constraints`."""
        return self._rows(z)[1]

    def stop(self, z: Array, message: str) -> Stop:
        """Return the path at z as the point where the solver stopped."""
        return Stop(z[: self._size], self.rollouts, message)

    @property
    def _size(self) -> int:
        return self.program.family.variables

    def _rows(self, z: Array) -> tuple[Array, Array]:
        here = self._at(z)
        values, rows = _lowest(here.constraints, here.constraints_jacobian)
        if len(z) == self._size:
            return values, rows
        below, peak_rows = _lowest(z[-1] - here.max_terms, -here.max_terms_jacobian)
        no, yes = np.zeros((_ROWS, 1)), np.ones((_ROWS, 1))
        return np.append(values, below), np.block([[rows, no], [peak_rows, yes]])

    def _at(self, z: Array) -> Linearisation:
        x = z[: self._size]
        if self._here is None or not np.array_equal(x, self._x):
            self._x, self.rollouts = x.copy(), self.rollouts + 1
            here = self.program.linearise(x)
            if here.is_defined:
                self._here = self._sound = here
            elif self._sound is None:
                time = here.motion.singular_at or 0.0
                raise singular_refusal(time, self.program.problem.duration)
            else:  # a singularity: nothing there is worth going to
                self._here = replace(self._sound, value=self._sound.value + 1e3)
        return self._here


def _lowest(values: Array, rows: Array) -> tuple[Array, Array]:
    """Return the lowest values in ascending order with their rows, filled up to `_ROWS`."""
    order = np.argsort(values, kind="stable")[:_ROWS]
    filled, filled_rows = np.full(_ROWS, _FAR), np.zeros((_ROWS, rows.shape[1]))
    filled[: len(order)], filled_rows[: len(order)] = values[order], rows[order]
    return filled, filled_rows
