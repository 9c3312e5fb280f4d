"""The optimisation problem of Eq. (43): objectives and requirements as functions of the path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.followed_path import followed_path
from ff_planner_ros.planning.optimisation.evaluated_path import (
    EvaluatedPath,
    PathLinearisation,
    seen,
)
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE
from ff_planner_ros.planning.optimisation.objectives import (
    objective_in_core,
    with_tie_break,
)
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.paths.path_family import GoalMotion, Motion, PathFamily, Sensitivity
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem, Target
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements import requirements_of
from ff_planner_ros.planning.requirements.goal import beside, miss
from ff_planner_ros.planning.requirements.requirement import Requirement, Rows
from ff_planner_ros.robot.configuration import configuration

# Fewest intervals of the grid, however few points the plan has: on fewer, the motion is not exact
# to a tenth of what the check allows.
_LEAST_INTERVALS = 40
# Largest rotation of a tumbling chaser in one interval [rad], and how many intervals are enough.
_GRID_TURN, _MOST_INTERVALS = 0.25, 200

# Margins are eased by this multiple of the violation: on its way the path may come nearer.
_EASED = 1.5
# No requirement has as many rows: the names of all of them differ.
_NAMES = compiled.NAMES_EACH


@dataclass(frozen=True, eq=False)
class Correction:
    """Difference between a path's motion and the controller's interpolation of the plan's points.

    It hardly changes with the path, so that its derivative is neglected.
    """

    q: Array  # tangent steps at the points; shape (points, 6 + joints)
    v: Array  # of the velocities at the points; shape (points, 6 + joints)
    q_half_way: Array  # tangent steps half-way between; shape (points - 1, 6 + joints)

    @staticmethod
    def between(model: pin.Model, motion: Motion, driven: FollowedMotion) -> Correction:
        """Return the difference from a motion to its interpolation on the same or a finer grid."""
        every = (len(driven.time) - 1) // (2 * len(motion.q) - 2)
        steps = [
            np.array([pin.difference(model, *at) for at in zip(q, to, strict=True)])
            for q, to in (
                (motion.q, driven.q[:: 2 * every]),
                (motion.q_half_way, driven.q[every :: 2 * every]),
            )
        ]
        return Correction(steps[0], driven.v[:: 2 * every] - motion.v, steps[1])


@dataclass(frozen=True, eq=False)
class PathProgram:
    """Objectives and requirements of one planning problem on one time grid."""

    problem: PlanningProblem
    family: PathFamily
    objective: Objective
    margins: Mapping[str, float]  # added to each requirement at the points, by its name
    points: int  # of the grid; the plan holds every k-th of them
    damping: float = 0.0  # of the motion, so that a singularity on it does not stop the search
    # From the path's motion to the controller's interpolation; None: not known yet
    correction: Correction | None = None
    aim: Target | None = None  # goal of the family, beside the problem's target; None: that target
    smoothing: float = 0.0  # weight of smooth joint velocities relative to the joint path
    attitude_norm: float = np.inf  # p of the p-norm that approximates the largest Euler angle
    # Names of requirements that get rows once a path violates them; none of these has rows yet
    on_demand: frozenset[str] = frozenset()

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """The requirements that a plan must keep."""
        return requirements_of(self.problem)

    @cached_property
    def in_core(self) -> compiled.PathProgram:
        """The program as the core has it."""
        problem, goal_motion = self.problem, self.family.goal_motion
        requirements: list[tuple[int, compiled.PathRequirement | Callable[..., Rows | None]]] = []
        for number, required in enumerate(self.requirements):
            if required.name in self.on_demand or not required.concerns(problem):
                continue
            margin = self.margins[required.name]
            known = required.in_core(problem, self.points, margin)
            by_python = (partial(_rows_by_python, required, problem, margin, goal_motion),)
            requirements += [(number, one) for one in (by_python if known is None else known)]
        corrected = None
        if self.correction is not None:
            steps = self.correction
            corrected = compiled.Correction(steps.q, steps.v, steps.q_half_way)
        return compiled.PathProgram(
            self.family.on_grid(self.points, self.damping),
            problem.duration / (self.points - 1),
            objective_in_core(self.objective, problem, self.smoothing, self.attitude_norm),
            requirements,
            corrected,
        )

    def evaluate(self, x: Array) -> EvaluatedPath:
        """Return objective and constraints of a path with their derivatives, as the core has them.

        A search asks for hundreds, of which it looks at the last.
        """
        return self.in_core.at(x)

    def linearise(self, x: Array) -> PathLinearisation:
        """Return objective and constraints of a path with their derivatives."""
        return seen(self.evaluate(x))

    def followed(self, at_x: PathLinearisation) -> FollowedMotion:
        """Return the controller's interpolation of the points of a path that its plan holds."""
        return followed_path(self.problem, at_x.motion.q, at_x.motion.v, at_x.acceleration)

    def with_correction(self, motion: Motion, driven: FollowedMotion) -> PathProgram:
        """Return the program corrected to the interpolation of a path, with its goal offset."""
        robot, target = self.problem.robot, self.problem.target
        if self.problem.posture is not None:  # the last point has the goal's own joints
            return replace(self, correction=Correction.between(robot.model, motion, driven))
        aim = beside(self.aim or target, *miss(robot, driven.q[-1], target))
        return replace(
            self,
            family=self.family.towards(aim),
            correction=Correction.between(robot.model, motion, driven),
            aim=aim,
        )

    def slacks(self, motion: FollowedMotion) -> Mapping[str, float]:
        """Return the slack of each requirement along a motion, by name; negative: violated."""
        return {
            required.name: required.slack(self.problem, motion) for required in self.requirements
        }

    def violated_on_demand(self, at_x: PathLinearisation) -> frozenset[str]:
        """Return the names of the requirements on demand that a path violates."""
        if not self.on_demand:
            return self.on_demand
        motion = self.followed(at_x)
        return frozenset(
            required.name
            for required in self.requirements
            if required.name in self.on_demand and required.slack(self.problem, motion) < 0.0
        )

    def with_eased_margins(self, at_x: PathLinearisation, names: Sequence[str]) -> PathProgram:
        """Return the program with smaller margins for requirements that a path keeps without them.

        A plan that begins beside an obstacle cannot keep the whole margin there. The program is
        unchanged if the path keeps all margins.

        Args:
            at_x: Linearisation at a regular path.
            names: Names of the requirements whose margins are eased.
        """
        margins = dict(self.margins)
        for number, required in enumerate(self.requirements):
            if required.name in names:
                values = at_x.constraints[at_x.names // _NAMES == number]
                missing, margin = -float(values.min(initial=0.0)), margins[required.name]
                if missing < margin:
                    margins[required.name] = max(margin - _EASED * missing, 0.0)
        return self if margins == self.margins else replace(self, margins=margins)

    def met(self, at_x: EvaluatedPath) -> frozenset[str]:
        """Return the names of the requirements that a regular path keeps, margins included.

        Those on demand, which have no rows yet, are left out.
        """
        violated = set((at_x.names[at_x.constraints < -FEASIBILITY_TOLERANCE] // _NAMES).tolist())
        return frozenset(
            required.name
            for number, required in enumerate(self.requirements)
            if number not in violated and required.name not in self.on_demand
        )

    def with_requirements(self, violated: frozenset[str]) -> PathProgram:
        """Return the program with the rows of requirements on demand that a path has violated."""
        return replace(self, on_demand=self.on_demand - violated)


def _rows_by_python(
    required: Requirement,
    problem: PlanningProblem,
    margin: float,
    goal_motion: GoalMotion | None,
    of: compiled.MotionOfPath,
) -> Rows | None:
    """Return the rows of a requirement that the core does not know."""
    return required.rows(problem, *_motion_of(of, goal_motion), margin)


@lru_cache(maxsize=1)  # several requirements ask for the same
def _motion_of(
    path: compiled.MotionOfPath, goal_motion: GoalMotion | None
) -> tuple[Motion, Sensitivity]:
    """Return the motion of a path that the core has evaluated, and its derivatives."""
    of_q, of_v, of_q_half_way = path.q_by_x, path.v_by_x, path.q_half_way_by_x
    return (
        Motion(
            x=path.x,
            q=path.q,
            v=path.v,
            q_half_way=path.q_half_way,
            goal_error=path.goal_error,
        ),
        Sensitivity(
            of_q,
            of_v,
            of_q_half_way,
            path.goal_error_by_x,
            path.acceleration,
            goal_motion=goal_motion,
        ),
    )


def path_program(
    problem: PlanningProblem, family: PathFamily, settings: PlannerSettings
) -> PathProgram:
    """Return the optimisation problem on the fine grid, which holds all points of the plan."""
    every = requirements_of(problem)
    margins = {required.name: required.margin(problem, settings) for required in every}
    objective = with_tie_break(problem.objective, settings)
    # The timing of an end effector's path is its polynomials'; that of a spline is free.
    smoothing = settings.joint_spline_smoothing if isinstance(family, JointSplines) else 0.0
    points = _grid_points(problem)
    return PathProgram(
        problem,
        family,
        objective,
        margins,
        points,
        smoothing=smoothing,
        on_demand=frozenset(required.name for required in every if required.is_on_demand),
    )


def _grid_points(problem: PlanningProblem) -> int:
    """Return the number of points of the fine grid; the plan holds every k-th of them."""
    _, v = configuration(problem.robot, problem.start)
    turn = float(np.linalg.norm(v[3:6])) * problem.duration
    intervals = problem.points - 1
    wanted = max(_LEAST_INTERVALS, min(turn / _GRID_TURN, _MOST_INTERVALS))
    return 1 + intervals * int(np.ceil(wanted / intervals))
