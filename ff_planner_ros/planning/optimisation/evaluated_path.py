"""Objective and constraints of a path with their derivatives, as the core or Python has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.paths.path_family import Motion


@dataclass(frozen=True, eq=False, kw_only=True)
class PathLinearisation(Linearisation):
    """Objective and constraints of a path with their derivatives, and the motion behind them."""

    motion: Motion  # may be singular
    acceleration: Array  # dv/dt at each point; shape (points, 6 + joints)

    @property
    def x(self) -> Array:
        """The decision variables of the path. Shape (variables,)."""
        return self.motion.x

    def by(self, directions: Array) -> PathLinearisation:
        """Return the linearisation in steps along directions, one a column."""
        if not self.is_defined:
            return self
        return replace(
            self,
            gradient=self.gradient @ directions,
            hessian=directions.T @ self.hessian @ directions,
            # In one thread: where several share the work, the last bit depends on their number.
            max_terms_jacobian=np.einsum("rx,xd->rd", self.max_terms_jacobian, directions),
            constraints_jacobian=np.einsum("rx,xd->rd", self.constraints_jacobian, directions),
            equalities_jacobian=np.einsum("rx,xd->rd", self.equalities_jacobian, directions),
        )


# A path with what a program says of it, as the core or Python has it.
EvaluatedPath: TypeAlias = compiled.EvaluatedPath | PathLinearisation


def seen(found: EvaluatedPath) -> PathLinearisation:
    """Return what the core found at a path as Python has it."""
    if isinstance(found, PathLinearisation):
        return found
    singular_at = found.singular_at
    if singular_at is not None:
        nothing = np.empty(0)
        return undefined(
            Motion(
                x=found.x,
                q=nothing,
                v=nothing,
                q_half_way=nothing,
                goal_error=nothing,
                singular_at=singular_at,
            )
        )
    return PathLinearisation(
        value=found.value,
        gradient=found.gradient,
        hessian=found.hessian,
        max_terms=found.max_terms,
        max_terms_jacobian=found.max_terms_jacobian,
        constraints=found.constraints,
        constraints_jacobian=found.constraints_jacobian,
        equalities=found.goal_error,
        equalities_jacobian=found.goal_error_by_x,
        names=found.names,
        motion=Motion(
            x=found.x,
            q=found.q,
            v=found.v,
            q_half_way=found.q_half_way,
            goal_error=found.goal_error,
        ),
        acceleration=found.acceleration,
    )


def undefined(motion: Motion) -> PathLinearisation:
    """Return the linearisation of a path that meets a singularity: not defined."""
    nothing = np.empty((0, len(motion.x)))
    return PathLinearisation(
        value=np.inf,
        gradient=np.zeros(len(motion.x)),
        hessian=nothing,
        max_terms=np.empty(0),
        max_terms_jacobian=nothing,
        constraints=np.empty(0),
        constraints_jacobian=nothing,
        is_defined=False,
        motion=motion,
        acceleration=nothing,
    )
