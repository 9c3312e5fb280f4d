"""The paper's path family: the motions that follow from polynomial paths of the end effector.

At each stage of a Runge-Kutta step the velocity map gives joint velocities and chaser twist, Eqs.
(27) and (31). The end effector's pose, twist and acceleration at both ends are those of start and
goal for all decision variables. Null-space motion of the start fades out along the path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.paths.detours import detours, scattered
from ff_planner_ros.planning.paths.path_family import GoalMotion, Motion
from ff_planner_ros.planning.paths.polynomial import (
    COMPONENTS,
    DIRECTIONS,
    FREE_TERMS,
    PARAMETERS,
    EndEffectorMotion,
    EndEffectorPolynomial,
    end_effector_polynomials,
)
from ff_planner_ros.planning.paths.start_motion import NullSpaceFade, start_motion
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem, Target
from ff_planner_ros.robot.model import Base, Robot

# Fewest joints that a pose of the end effector needs.
PAPERS_JOINTS = 6

# Normalised time at which an initial guess reaches the corridor, if there is one, and the distance
# from the grasp then, in lengths of the corridor.
_ENTERED, _BEFORE = 0.75, 1.2


@dataclass(frozen=True, eq=False)
class EndEffectorPaths:
    """The motions of one robot from one start, one for each choice of 18 coefficients."""

    robot: Robot
    q_start: Array  # configuration at the first point; shape (7 + joints,)
    momentum: Array  # constant total P and L about the inertial origin; shape (6,)
    polynomial: EndEffectorPolynomial
    null_space: NullSpaceFade | None = None  # motion of the start beyond Eq. (31); None: none
    entry: Array | None = None  # before the corridor of the approach; shape (3,) [m]; None: none
    goal_motion: GoalMotion | None = None  # if the duration is one more variable
    # Derivative of the polynomial's quintic by the duration; empty if that is given
    quintic_by_duration: Array = field(default_factory=lambda: np.empty(0))

    name: ClassVar[str] = "end_effector_polynomial"
    variables: ClassVar[int] = PARAMETERS  # coefficients of six components
    stride: ClassVar[float] = 1.0
    directions: ClassVar[Array] = DIRECTIONS

    @property
    def reading(self) -> str:
        """How the Euler angles are defined: `inertial` or `along_turn`, see `polynomial`."""
        return self.polynomial.reading

    def decision_variables(self, x: Array) -> Array:
        """Return the paper's xi: a6, a7, a8 of each component, Eq. (42). Shape (18,)."""
        return self.polynomial.decision_variables(x.reshape(COMPONENTS, FREE_TERMS))

    def first_guesses(
        self, obstacles: Sequence[Obstacle], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield the straight path, detours around what blocks it, and scattered ones without end.

        With a corridor, a path through its open end comes second.
        """
        straight = np.zeros(PARAMETERS)
        yield straight
        if self.entry is not None:
            yield self.polynomial.through(self.entry, _ENTERED).ravel()
        motion = self.motion(straight, points, damping)
        if motion.singular_at is None:
            yield from detours(self.robot, motion, self.polynomial.duration, obstacles)
        yield from scattered()

    def near(self, q: Array) -> Array:
        """Return the coefficients of the path that fits a motion best, apart from its ends."""
        model, data, tip = self.robot.model, self.robot.model.createData(), self.robot.tip_frame_id
        poses = []
        for sample in q:
            pin.forwardKinematics(model, data, sample)
            pose = pin.updateFramePlacement(model, data, tip)
            poses.append((pose.translation.copy(), pose.rotation.copy()))
        positions, rotations = (np.array(part) for part in zip(*poses, strict=True))
        return self.polynomial.near(positions, rotations)

    def towards(self, target: Target) -> EndEffectorPaths:
        """Return the motions to a target near this one; the coefficients keep their meaning."""
        return replace(self, polynomial=self.polynomial.towards(_end(target)))

    def lasting(
        self, problem: PlanningProblem, goal_motion: GoalMotion | None = None
    ) -> EndEffectorPaths:
        """Return the motions of this problem with another duration, with the same A and B."""
        duration, null_space = problem.duration, self.null_space
        if null_space is not None:
            seconds = null_space.seconds * duration / self.polynomial.duration
            null_space = replace(null_space, seconds=seconds)
        polynomial = self.polynomial.lasting(duration, _end(problem.target))
        return replace(
            self,
            polynomial=polynomial,
            null_space=null_space,
            entry=_entry(problem),
            goal_motion=goal_motion,
            quintic_by_duration=np.empty(0)
            if goal_motion is None
            else polynomial.quintic_by_duration(
                goal_motion.place, goal_motion.twist, goal_motion.acceleration
            ),
        )

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Integrate the motion of one path; x: coefficients of the free terms, flattened."""
        found = self.on_grid(points, damping).motion(x)
        if isinstance(found, float):
            nothing = np.empty(0)
            return Motion(
                x=x, q=nothing, v=nothing, q_half_way=nothing, goal_error=nothing, singular_at=found
            )
        q, v, q_half_way, goal_error = found
        return Motion(x=x, q=q, v=v, q_half_way=q_half_way, goal_error=goal_error)

    def on_grid(self, points: int, damping: float) -> compiled.PathsOnGrid:
        """Return the family as the core has it."""
        moved = np.empty(0) if self.goal_motion is None else self.goal_motion.place
        return compiled.end_effector_paths(*self._in_core, points, damping, moved)

    @cached_property
    def _in_core(
        self,
    ) -> tuple[
        compiled.Chain, Array, Array, compiled.EndEffectorPolynomial, compiled.NullSpaceFade
    ]:
        """Chain, configuration at the start, momentum, path and null-space motion."""
        no_rates = np.zeros(self.robot.joints)
        null_space = self.null_space or NullSpaceFade(no_rates, no_rates, seconds=1.0)
        path = compiled.EndEffectorPolynomial(
            self.polynomial.duration,
            self.polynomial.quintic,
            self.polynomial.rotation_outer,
            self.quintic_by_duration,
        )
        fade = compiled.NullSpaceFade(
            null_space.rates, null_space.accelerations, null_space.seconds
        )
        return chain_of(self.robot), self.q_start, self.momentum, path, fade


def applies(problem: PlanningProblem) -> bool:
    """Tell whether this family is defined for a problem's arm, base and target."""
    return (
        problem.robot.joints >= PAPERS_JOINTS
        and problem.robot.base is Base.FREE_FLYER
        and problem.target.orientation is Orientation.FIXED
        and problem.path is None
    )


def end_effector_families(problem: PlanningProblem) -> list[EndEffectorPaths]:
    """Return the paper's family of motions from the start state to the target.

    If the end effector has to rotate by half a turn, there are two families, one per direction.
    """
    start = start_motion(problem.robot, problem.start, problem.duration)
    end, entry = _end(problem.target), _entry(problem)
    return [
        EndEffectorPaths(
            problem.robot, start.q, start.momentum, polynomial, start.null_space, entry
        )
        for polynomial in end_effector_polynomials(start.end_effector, end, problem.duration)
    ]


def end_effector_paths(problem: PlanningProblem) -> EndEffectorPaths:
    """Return the first, and nearly always the only one, of `end_effector_families`."""
    return end_effector_families(problem)[0]


def _entry(problem: PlanningProblem) -> Array | None:
    """Return where an initial guess enters the corridor, shape (3,) [m]; None: there is none."""
    approach = problem.approach
    if approach is None:
        return None
    before = -_BEFORE * approach.distance * approach.direction
    grasp = GraspSeen(problem, np.array([_ENTERED * problem.duration]))
    return np.asarray(grasp.is_at(before[None])[0], np.float64)


def _end(target: Target) -> EndEffectorMotion:
    """Return the end effector's motion at the target."""
    return EndEffectorMotion(
        position=target.position,
        rotation_ee_to_inertial=pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
        twist=np.concatenate([target.linear_velocity, target.angular_velocity]),
        acceleration=np.concatenate([target.linear_acceleration, target.angular_acceleration]),
    )
