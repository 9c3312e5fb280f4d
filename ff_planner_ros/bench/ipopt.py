"""IPOPT on the planner's own functions and exact derivatives, where CasADi is installed.

The Hessian is IPOPT's own approximation.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from ff_planner_ros.bench.direct import Stop
from ff_planner_ros.bench.exact import TOLERANCE, ExactFunctions
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.program import PathProgram


def solve_by_ipopt(program: PathProgram, max_iterations: int) -> Stop | None:
    """Solve by IPOPT with exact gradients; None where `casadi`, which brings it, is missing."""
    try:
        casadi = importlib.import_module("casadi")
    except ModuleNotFoundError:
        return None
    functions = ExactFunctions(program)
    start = functions.start()
    variables = casadi.MX.sym("z", len(start))
    rows, size = len(functions.constraints(start)), len(start)
    objective = _with_jacobian(casadi, (1, size), functions.objective, functions.gradient)
    constraints = _with_jacobian(casadi, (rows, size), functions.constraints, functions.jacobian)
    program_in_casadi = {"x": variables, "f": objective(variables), "g": constraints(variables)}
    limits = {"max_iter": max_iterations, "tol": TOLERANCE}
    quiet = {"print_level": 0, "sb": "yes"}
    options = {"hessian_approximation": "limited-memory", **limits, **quiet}
    solver = casadi.nlpsol(
        "solver", "ipopt", program_in_casadi, {"print_time": False, "ipopt": options}
    )
    result = solver(x0=start, lbg=0.0, ubg=np.inf)
    return functions.stop(np.array(result["x"]).ravel(), solver.stats()["return_status"])


def _with_jacobian(
    casadi: Any,
    shape: tuple[int, int],
    value: Callable[[Array], Any],
    jacobian: Callable[[Array], Array],
) -> Any:
    """Wrap a function and its Jacobian of a shape; the caller must keep what is returned alive."""
    rows, size = shape
    inputs = casadi.Sparsity.dense(size, 1), casadi.Sparsity.dense(rows, 1)

    class Function(casadi.Callback):  # type: ignore[misc]
        def __init__(self, of: Callable[[Array], Any], columns: int, derivative: Any) -> None:
            casadi.Callback.__init__(self)
            self.of, self.shape_out, self.derivative = of, (rows, columns), derivative
            self.construct("function", {})

        def get_n_in(self) -> int:
            return 1 if self.has_jacobian() else 2  # a Jacobian is given the value there, too

        def get_sparsity_in(self, index: int) -> Any:
            return inputs[index]

        def get_sparsity_out(self, _: int) -> Any:
            return casadi.Sparsity.dense(*self.shape_out)

        def eval(self, arguments: Any) -> list[Any]:
            return [np.reshape(self.of(np.array(arguments[0]).ravel()), self.shape_out)]

        def has_jacobian(self) -> bool:
            return self.derivative is not None

        def get_jacobian(self, *_: Any) -> Any:
            return self.derivative

    return Function(value, 1, Function(jacobian, size, None))
