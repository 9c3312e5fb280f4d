"""The time grids that a program is solved on, coarse to fine, and when the solver stops on each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.optimisation.solver import FIRST_RADIUS
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_clearance import BodyClearance, SelfClearance
from ff_planner_ros.planning.requirements.clearance import Clearance
from ff_planner_ros.planning.requirements.obstacle_clearance import ObstacleClearance

# Requirements whose margins are distances.
CLEARANCES = (Clearance.name, BodyClearance.name, SelfClearance.name, ObstacleClearance.name)


@dataclass(frozen=True)
class Stage:
    """A time grid, and when the solver stops on it."""

    points: int
    optimality: float
    progress: float  # part of the objective that another step must predict
    iterations: int
    damping: float = 0.0  # where a singularity in the way shall not stop the search
    extra_margin: float = 0.0  # of clearance [m]: the gaps between fewer points are wider
    radius: float = FIRST_RADIUS  # of the first trust region
    tolerated: float = 0.0  # violation that does not stop the solver's steps


# The coarsest grid finds the way around the obstacles at a tenth of the price; the next one brings
# the path so near its optimum that on all points a few iterations remain.
COARSE = (
    Stage(13, 1e-2, 2e-3, 40, damping=0.005, extra_margin=0.001),
    Stage(25, 3e-3, 2e-4, 40),
)
# On all points. So small a part of a joint path or of an angle makes no difference to a user.
_FINE_PROGRESS = 2e-5


@dataclass(frozen=True, eq=False)
class Grid:
    """The optimisation problem of one stage."""

    stage: Stage
    program: PathProgram
    stride: float  # how long a step of the solver along one of its variables is bold
    # In which the solver steps, a column each; None: it changes one decision variable each
    directions: Array | None = None

    @property
    def radius(self) -> float:
        """First trust region."""
        return self.stage.radius * self.stride

    def along(self, x: Array) -> Array:
        """Return how far a path is along each direction."""
        if self.directions is None:
            return x
        return np.asarray(np.linalg.solve(self.directions, x), np.float64)

    def linearise(self, along: Array) -> PathLinearisation:
        """Return objective and constraints of a path with their derivatives by the directions."""
        if self.directions is None:
            return self.program.linearise(along)
        return self.program.linearise(self.directions @ along).by(self.directions)

    def with_stage(self, **changes: Any) -> Grid:
        """Return the grid with other values of its stage."""
        return replace(self, stage=replace(self.stage, **changes))

    def with_correction(self, x: Array) -> Grid:
        """Return a grid that knows what a controller makes of a path, if points are left out.

        Where the plan holds every point of the grid, that hardly differs from the path.
        """
        program = self.program
        if program.points > program.problem.points:
            at_x = program.linearise(x)
            if at_x.is_defined:
                program = program.with_correction(at_x.motion, program.followed(at_x))
        return replace(self, program=program)


def grids_of(program: PathProgram, settings: PlannerSettings) -> list[Grid]:
    """Return the grids of a program on all points, coarse to fine; it is that of the last one."""
    fine = Stage(
        program.points, settings.optimality_tolerance, _FINE_PROGRESS, settings.max_iterations
    )
    coarse = COARSE[:1] if _is_smooth_in_splines(program) else COARSE
    stages = [stage for stage in coarse if stage.points < program.points] + [fine]
    return [Grid(stage, _on_stage(program, stage), program.family.stride) for stage in stages]


def _is_smooth_in_splines(program: PathProgram) -> bool:
    """Tell whether few points show the optimum so well that a grid between brings nothing.

    That is the least joint path of splines: of 140 problems none has one longer by 0.1 %, and each
    takes a sixth less time. What wheels give is not known as well on few points.
    """
    asked = program.objective
    is_smooth = not (asked.chaser_attitude or asked.wheel_momentum or program.problem.robot.wheels)
    return isinstance(program.family, JointSplines) and is_smooth


def _on_stage(program: PathProgram, stage: Stage) -> PathProgram:
    margins = dict(program.margins)
    for name in CLEARANCES:
        margins[name] += stage.extra_margin
    return replace(program, points=stage.points, margins=margins, damping=stage.damping)
