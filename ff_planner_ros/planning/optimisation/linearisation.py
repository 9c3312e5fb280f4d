"""The functions of a nonlinear program and their first derivatives at one x.

The program is: minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices

# A constraint violated by less counts as kept [unit of g]; well below any tolerance that a
# user sets, well above the accuracy of the quadratic programs.
FEASIBILITY_TOLERANCE = 1e-6


class Evaluation(Protocol):
    """What a search asks of the functions at one x; the solver reads a `Linearisation`'s arrays."""

    @property
    def is_defined(self) -> bool:
        """Whether the functions are defined at x."""

    @property
    def objective(self) -> float:
        """Sum of f and the largest max term."""

    @property
    def violation(self) -> float:
        """Largest violation of a constraint."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The functions and their first derivatives at one x."""

    value: float  # f
    gradient: Array  # of f; shape (variables,)
    hessian: Array  # positive semidefinite approximation for f; shape (variables, variables)
    max_terms: Array  # p; shape (max terms,), may be empty
    max_terms_jacobian: Array  # shape (max terms, variables)
    constraints: Array  # g; shape (constraints,), may be empty
    constraints_jacobian: Array  # shape (constraints, variables)
    equalities: Array = field(default_factory=lambda: np.empty(0))  # h; may be empty
    # Shape (equalities, variables); ignored where there are none
    equalities_jacobian: Array = field(default_factory=lambda: np.empty((0, 0)))
    # Of the constraints at x, which may be others at another x: equal names, equal constraints
    names: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    is_defined: bool = True  # whether the functions are defined at x; if not, ignore the values

    @cached_property
    def objective(self) -> float:
        """Sum of f and the largest max term."""
        return self.value + (float(self.max_terms.max()) if self.max_terms.size else 0.0)

    @cached_property
    def violation(self) -> float:
        """Largest violation of a constraint; infinite where the functions are not defined."""
        return violation(self.constraints, self.equalities) if self.is_defined else np.inf


def violation(constraints: Array, equalities: Array) -> float:
    """Return the L-infinity norm of the violations of g >= 0 and h = 0."""
    below = -constraints.min(initial=0.0)
    return float(max(0.0, below, np.abs(equalities).max(initial=0.0)))
