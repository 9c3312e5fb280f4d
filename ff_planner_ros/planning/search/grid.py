"""The time grids that a program is solved on, coarse to fine, and when the solver stops on each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.evaluated_path import EvaluatedPath
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.optimisation.solver import FIRST_RADIUS
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.clear_of_itself import ClearOfItself
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles

# Requirements whose margins are distances.
CLEARANCES = (ClearOfObstacles.name, ClearOfItself.name)


@dataclass(frozen=True)
class Stage:
    """A time grid, and when the solver stops on it."""

    points: int
    optimality: float
    progress: float  # fraction of the objective that another step must predict
    iterations: int
    damping: float = 0.0  # of the velocity map, so that no singularity stops the search
    extra_margin: float = 0.0  # of clearance [m]: the gaps between fewer points are wider
    radius: float = FIRST_RADIUS  # of the first trust region, in units of the stride
    tolerated: float = 0.0  # violation that does not stop the solver's steps


# The coarsest grid finds the way around the obstacles at a tenth of the cost; the next one brings
# the path so near its optimum that on all points a few iterations remain.
COARSE = (
    Stage(13, 1e-2, 2e-3, 40, damping=0.005, extra_margin=0.001),
    Stage(25, 3e-3, 2e-4, 40),
)
# Where all points are many, this many find the optimum: on 500 points, one step remains.
_MIDDLE = 100
# Progress on all points: so small a fraction of a joint path or an angle means nothing to a user.
# Of many points, where a step takes five times as long, the larger one.
_FINE_PROGRESS, _PROGRESS_OF_MANY = 2e-5, 1e-4
# And of the joint path where a search of the attitude alone begins: what that finds does not depend
# on the rest, which takes up to twenty steps.
BEGINNING = 1e-3


@dataclass(frozen=True, eq=False)
class Grid:
    """The optimisation problem of one stage."""

    stage: Stage
    program: PathProgram
    stride: float  # a bold step along one of the solver's variables
    # Basis of the solver's variables, a column each; None: the decision variables themselves
    directions: Array | None = None

    @property
    def radius(self) -> float:
        """Radius of the first trust region."""
        return self.stage.radius * self.stride

    def along(self, x: Array) -> Array:
        """Return the solver's variables of the decision variables x."""
        if self.directions is None:
            return x
        return np.asarray(np.linalg.solve(self.directions, x), np.float64)

    def evaluate(self, along: Array) -> EvaluatedPath:
        """Return objective and constraints, with derivatives by the solver's variables."""
        if self.directions is None:
            return self.program.evaluate(along)
        return self.program.linearise(self.directions @ along).by(self.directions)

    def with_stage(self, **changes: Any) -> Grid:
        """Return the grid with other values of its stage."""
        return replace(self, stage=replace(self.stage, **changes))

    def with_correction(self, x: Array) -> Grid:
        """Return the grid corrected for the tracked motion near x, if the plan skips grid points.

        If the plan holds every point of the grid, tracked motion and path hardly differ.
        """
        program = self.program
        if program.points > program.problem.points:
            at_x = program.linearise(x)
            if at_x.is_defined:
                program = program.with_correction(at_x.motion, program.followed(at_x))
        return replace(self, program=program)


def grids_of(program: PathProgram, settings: PlannerSettings) -> list[Grid]:
    """Return the grids to solve a program on, coarse to fine; the last is the program's own."""
    fine = Stage(
        program.points, settings.optimality_tolerance, _FINE_PROGRESS, settings.max_iterations
    )
    coarse = COARSE[:1] if _is_smooth_in_splines(program) else COARSE
    stages = [stage for stage in coarse if stage.points < program.points]
    if program.points > 2 * _MIDDLE:
        fine = replace(fine, progress=_PROGRESS_OF_MANY)
        stages.append(replace(fine, points=_MIDDLE))
    stages.append(fine)
    return [Grid(stage, _on_stage(program, stage), program.family.stride) for stage in stages]


def _is_smooth_in_splines(program: PathProgram) -> bool:
    """Tell whether the coarsest grid shows the optimum so well that a middle grid gains nothing.

    That holds for minimum joint paths of splines: without it, none of 140 problems had a path
    longer by 0.1 %, and each took a sixth less time. Torques of wheels need more points.
    """
    asked = program.objective
    is_smooth = not (asked.chaser_attitude or asked.wheel_momentum or program.problem.robot.wheels)
    return isinstance(program.family, JointSplines) and is_smooth


def _on_stage(program: PathProgram, stage: Stage) -> PathProgram:
    margins = dict(program.margins)
    for name in CLEARANCES:
        margins[name] += stage.extra_margin
    return replace(program, points=stage.points, margins=margins, damping=stage.damping)
