"""The optimisation problem of Eq. (43): objectives and requirements as functions of the path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.objectives import terms, with_tie_break
from ff_planner_ros.planning.path_family import Motion, PathFamily
from ff_planner_ros.planning.problem import Objective, PlanningProblem
from ff_planner_ros.planning.requirements import REQUIREMENTS
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import Linearisation


@dataclass(frozen=True, eq=False, kw_only=True)
class PathLinearisation(Linearisation):
    """What the solver wants to know of a path, and the motion that it comes from."""

    motion: Motion  # may be singular
    acceleration: Array  # dv/dt at each point; shape (points, 6 + joints)


@dataclass(frozen=True, eq=False)
class PathProgram:
    """Objectives and requirements of one planning problem on one time grid."""

    problem: PlanningProblem
    family: PathFamily
    objective: Objective
    margins: Mapping[str, float]  # kept more of each requirement at the points, by its name
    points: int  # of the grid
    damping: float = 0.0  # of the motion, where a singularity in the way shall not stop the search

    def linearise(self, x: Array) -> PathLinearisation:
        """Return objective and constraints of a path with their derivatives."""
        motion = self.family.motion(x, self.points, self.damping)
        if motion.singular_at is not None:
            return _undefined(motion)
        sensitivity = self.family.sensitivity(motion, self.damping)
        step, robot = self.problem.duration / (self.points - 1), self.problem.robot
        variables = len(x)
        value, gradient = 0.0, np.zeros(variables)
        hessian = np.zeros((variables, variables))
        peaks, peaks_jacobian = [np.empty(0)], [np.empty((0, variables))]
        for term in terms(self.objective, robot, motion, sensitivity, step):
            value, gradient = value + term.value, gradient + term.gradient
            hessian = hessian + term.hessian
            peaks.append(term.peaks)
            peaks_jacobian.append(term.peaks_jacobian)
        rows = [
            required.rows(self.problem, motion, sensitivity, self.margins[required.name])
            for required in REQUIREMENTS
        ]
        kept = [found for found in rows if found is not None]
        return PathLinearisation(
            value=value,
            gradient=gradient,
            hessian=hessian,
            peaks=np.concatenate(peaks),
            peaks_jacobian=np.concatenate(peaks_jacobian),
            constraints=np.concatenate([values for values, _ in kept]),
            constraints_jacobian=np.concatenate([jacobian for _, jacobian in kept]),
            motion=motion,
            acceleration=sensitivity.acceleration,
        )

    def slacks_between(self, motion: Motion) -> Mapping[str, float]:
        """Return what is left of each requirement between the points; negative: it is violated."""
        return {
            required.name: required.slack_between(self.problem, motion) for required in REQUIREMENTS
        }


def path_program(
    problem: PlanningProblem, family: PathFamily, settings: PlannerSettings
) -> PathProgram:
    """Return the optimisation problem on all points of the plan."""
    margins = {required.name: required.margin(problem, settings) for required in REQUIREMENTS}
    objective = with_tie_break(problem.objective, settings)
    return PathProgram(problem, family, objective, margins, problem.points)


def _undefined(motion: Motion) -> PathLinearisation:
    """Return what the solver learns of a path that meets a singularity: it is a wall."""
    nothing = np.empty((0, len(motion.x)))
    return PathLinearisation(
        value=np.inf,
        gradient=np.zeros(len(motion.x)),
        hessian=nothing,
        peaks=np.empty(0),
        peaks_jacobian=nothing,
        constraints=np.empty(0),
        constraints_jacobian=nothing,
        is_defined=False,
        motion=motion,
        acceleration=nothing,
    )
