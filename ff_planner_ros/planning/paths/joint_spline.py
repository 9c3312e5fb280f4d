"""Joint splines: each joint on a quintic B-spline, the base by conservation of momentum.

theta(t) = B(t) c. Start angle, rate and acceleration fix the first three control points; the others
are the decision variables. Only the system's inertia is inverted, so that there are no
singularities, and the arm may have any number of joints. The end of a motion need not be the goal:
the solver brings the goal error to zero.

A goal of the joints fixes control points instead, and there is no goal error: a posture with its
rates fixes the last three; rest in any posture makes the last three equal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar, cast

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of, start_of, target_of
from ff_planner_ros.planning.paths.path_family import GoalMotion, Motion
from ff_planner_ros.planning.paths.path_guesses import spans_along
from ff_planner_ros.planning.paths.spline_basis import FIXED, SplineBasis
from ff_planner_ros.planning.paths.spline_guesses import spline_guesses
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.problem import PlanningProblem, Target
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot


@dataclass(frozen=True, eq=False, kw_only=True)
class SplineMotion(Motion):
    """A motion with the compiled one, of which the goal error has derivatives."""

    compiled: compiled.DrivenMotion


@dataclass(frozen=True, eq=False)
class JointSplines:
    """The motions of one robot from one start, one for each choice of control points."""

    problem: PlanningProblem
    basis: SplineBasis
    goal_motion: GoalMotion | None = None  # if the duration is one more variable

    name: ClassVar[str] = "joint_spline"
    reading: ClassVar[str] = ""
    stride: ClassVar[float] = 0.4  # 0.2 rad is a bold first step
    directions: ClassVar[None] = None

    @property
    def robot(self) -> Robot:
        """The robot of the problem."""
        return self.problem.robot

    @cached_property
    def start(self) -> compiled.Start:
        """Base pose, centre of mass and momentum at the first point."""
        return start_of(self.robot, *configuration(self.robot, self.problem.start))

    @cached_property
    def fixed(self) -> Array:
        """Control points that the start fixes. Shape (3, joints) [rad]."""
        start = self.problem.start
        accelerations = start.joint_accelerations
        if accelerations is None:
            accelerations = np.zeros(len(start.joint_positions))
        return self.basis.start(start.joint_positions, start.joint_velocities, accelerations)

    @property
    def ending(self) -> str:
        """How the goal fixes the last control points: `given`, `same`, or empty: not at all."""
        posture = self.problem.posture
        return "" if posture is None else ("same" if posture.at_rest else "given")

    @cached_property
    def last(self) -> Array:
        """Part of the control points behind the start's that the goal gives, zero elsewhere.

        Shape (control points - 3, joints) [rad].
        """
        added = np.zeros((self.basis.count - FIXED, self.robot.joints))
        posture = self.problem.posture
        if posture is not None and posture.positions is not None:
            still = np.zeros(self.robot.joints)
            added[-FIXED:] = self.basis.end(posture.positions, still + posture.rates, still)
        return added

    @property
    def each(self) -> int:
        """Number of decision variables of each joint."""
        return int(_spread(self.basis.count, self.ending).shape[1])

    @property
    def variables(self) -> int:
        """Number of decision variables: those of all joints, in x one joint after the other."""
        return self.robot.joints * self.each

    def free(self, rows: Array) -> Array:
        """Return the matrix from a joint's variables to the values of `rows @ control points`.

        Shape (rows, variables of a joint).
        """
        contributed: Array = rows[:, FIXED:] @ _spread(self.basis.count, self.ending)
        return contributed

    def known(self, rows: Array) -> Array:
        """Return the part of `rows @ control points` that start and goal give. (rows, joints)."""
        contributed: Array = rows[:, :FIXED] @ self.fixed + rows[:, FIXED:] @ self.last
        return contributed

    def decision_variables(self, x: Array) -> Array:
        """Return an empty array: the paper's xi describes no splines."""
        return np.empty(0)

    def first_guesses(
        self, obstacles: Sequence[Obstacle], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield splines near the paper's paths, paths to goal postures, and detours without end."""
        return spline_guesses(self, obstacles, points)

    def near(self, q: Array) -> Array:
        """Return the free control points of the splines that fit the joint angles of a motion."""
        rows = self.basis.on_grid(len(q))
        free, *_ = np.linalg.lstsq(self.free(rows), q[:, 7:] - self.known(rows))
        return np.asarray(free.T.ravel(), np.float64)

    def towards(self, target: Target) -> JointSplines:
        """Return the motions to a target near this one; the control points stay what they are."""
        return replace(self, problem=replace(self.problem, target=target, path=None))

    @property
    def halved(self) -> JointSplines:
        """The motions on half as many spans, which are among these if their number is even."""
        return replace(self, basis=replace(self.basis, spans=self.basis.spans // 2))

    def lasting(
        self, problem: PlanningProblem, goal_motion: GoalMotion | None = None
    ) -> JointSplines:
        """Return the motions of this problem with another duration."""
        basis = replace(self.basis, duration=problem.duration)
        return replace(self, problem=problem, basis=basis, goal_motion=goal_motion)

    def control_points(self, x: Array) -> Array:
        """Return all control points of a spline. Shape (control points, joints) [rad]."""
        of_joints = x.reshape(self.robot.joints, self.each).T
        behind = _spread(self.basis.count, self.ending) @ of_joints + self.last
        return np.concatenate([self.fixed, behind])

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Integrate the base along one spline; there is nothing to damp."""
        controls = self.control_points(x)
        angles, rates, accelerations = (rows @ controls for rows in _rows(self.basis, points))
        motion = compiled.DrivenMotion(
            chain_of(self.robot), self.start, angles, rates, accelerations, self.basis.duration
        )
        return SplineMotion(
            x=x,
            q=motion.q,
            v=motion.v,
            q_half_way=motion.q_half_way,
            goal_error=np.empty(0) if self.ending else motion.goal_error(self._goal),
            compiled=motion,
        )

    def goal_error_by_x(self, motion: Motion) -> Array:
        """Differentiate the goal error of a motion of this family. Shape (rows, variables)."""
        rows = _rows_of_free(self.basis, len(motion.q), self.ending)
        return cast(SplineMotion, motion).compiled.goal_error_by_x(*rows, self._goal)

    def on_grid(self, points: int, damping: float) -> compiled.PathsOnGrid:
        """Return the family as the core has it."""
        return _on_grid(self, points)

    def moved(self, rows: Array) -> Array:
        """Return how `known` changes with the duration at fixed parts; empty if that is given.

        The control points that the start fixes are, at fixed parts, T^k times the k-th derivative
        by time that is given. Shape (rows, joints).
        """
        if self.goal_motion is None:
            return np.empty(0)
        of_start, of_end = self._ends_by_duration
        changed: Array = rows[:, :FIXED] @ of_start + rows[:, -FIXED:] @ of_end
        return changed

    @cached_property
    def _ends_by_duration(self) -> tuple[Array, Array]:
        """Derivatives of the first and the last control points by the duration."""
        start, still = self.problem.start, np.zeros(self.robot.joints)
        accelerated = still if start.joint_accelerations is None else start.joint_accelerations
        in_parts, duration = replace(self.basis, duration=1.0), self.basis.duration
        of_start = in_parts.start(still, start.joint_velocities, 2.0 * duration * accelerated)
        of_end, posture = np.zeros((FIXED, self.robot.joints)), self.problem.posture
        if posture is not None and posture.positions is not None:
            of_end = in_parts.end(still, still + posture.rates, still)
        return of_start, of_end

    @cached_property
    def _goal(self) -> compiled.Target:
        return target_of(self.problem.target)


def joint_splines(problem: PlanningProblem, settings: PlannerSettings) -> JointSplines:
    """Return the joint splines from the start state of a problem.

    If the start's joint accelerations are not known, they are zero, or those of a path to follow,
    which also takes as many spans as it needs, twice as many where the attitude has a weight.
    """
    spans = settings.joint_spline_spans
    if problem.path is not None:
        spans, accelerations = spans_along(problem, settings)
        start = replace(problem.start, joint_accelerations=accelerations)
        problem = replace(problem, start=start)
    return JointSplines(problem, SplineBasis(problem.duration, spans))


@lru_cache(maxsize=8)  # the programs of a search differ in objectives and margins
def _on_grid(family: JointSplines, points: int) -> compiled.PathsOnGrid:
    goal_motion = family.goal_motion
    positions, rates, accelerations, position_hull, rate_hull = (
        compiled.SplineRows(family.free(of), family.known(of), family.moved(of))
        for of in (*_rows(family.basis, points), *_hulls(family.basis))
    )
    return compiled.joint_splines(
        chain_of(family.robot),
        family.start,
        family._goal,  # noqa: SLF001 (of its own class)
        not family.ending,
        family.basis.duration,
        positions,
        rates,
        accelerations,
        position_hull,
        rate_hull,
        np.empty(0) if goal_motion is None else _by_duration(goal_motion),
    )


def _by_duration(goal: GoalMotion) -> Array:
    """Return the derivatives of a goal's pose, twist and acceleration by the duration. (3, 6)."""
    return np.array([goal.place, goal.twist, goal.acceleration])


@lru_cache(maxsize=32)
def _rows(basis: SplineBasis, points: int) -> tuple[Array, Array, Array]:
    """Return the matrices from control points to angles, rates, accelerations at half steps."""
    half_steps = 2 * points - 1
    return basis.on_grid(half_steps), basis.on_grid(half_steps, 1), basis.on_grid(half_steps, 2)


@lru_cache(maxsize=32)
def _spread(count: int, ending: str) -> Array:
    """Return the matrix from a joint's variables to the control points behind the start's."""
    every = np.eye(count - FIXED)
    if not ending:
        return every
    kept = every[:, : -FIXED if ending == "given" else 1 - FIXED].copy()
    if ending == "same":
        kept[-FIXED:, -1] = 1.0
    return kept


@lru_cache(maxsize=32)
def _rows_of_free(basis: SplineBasis, points: int, ending: str) -> tuple[Array, Array, Array]:
    """Return the matrices from a joint's variables to angles, rates and the last acceleration.

    Shapes (half steps, variables), twice, and (variables,).
    """
    spread = _spread(basis.count, ending)
    angles, rates, accelerations = (rows[:, FIXED:] @ spread for rows in _rows(basis, points))
    return angles, rates, accelerations[-1]


@lru_cache(maxsize=32)
def _hulls(basis: SplineBasis) -> tuple[Array, Array]:
    """Return the matrices from control points to the hulls of angles and rates.

    Points that the start alone decides are left out.
    """
    angles, rates = basis.hull(), basis.hull(1)
    return angles[FIXED:], rates[FIXED - 1 :]
