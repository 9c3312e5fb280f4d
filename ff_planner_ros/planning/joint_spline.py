"""Joint splines: each joint on a quintic B-spline, the base as the momentum demands.

theta(t) = B(t) c. Start angle, rate and acceleration fix the first three control points; the others
are the decision variables. Nothing is inverted but the system's inertia, so that a motion knows no
singularities, and any number of joints will do. Its end need not be at the goal: what it misses is
the goal error, which the solver brings to zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, cast

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.base_turn import (
    BaseTurn,
    TurnDerivatives,
    base_turn,
    momentum_maps,
    turn_derivatives,
)
from ff_planner_ros.planning.end_conditions import EndPoint, end_conditions
from ff_planner_ros.planning.path_family import JointHull, Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem, Sphere, Target
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.spline_basis import FIXED, SplineBasis
from ff_planner_ros.planning.spline_guesses import spline_guesses
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import base_acceleration
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.rotation import skew


@dataclass(frozen=True, eq=False, kw_only=True)
class SplineMotion(Motion):
    """A motion with what its derivatives need."""

    joints: tuple[Array, Array, Array]  # angles, rates, accelerations; shape (half steps, joints)
    turn: BaseTurn


@dataclass(frozen=True, eq=False)
class JointSplines:
    """The motions of one robot from one start, one for each choice of control points."""

    problem: PlanningProblem
    basis: SplineBasis
    q_start: Array  # configuration at the first point; shape (7 + joints,)
    center: Array  # centre of mass at the first point; shape (3,) [m]
    momentum: Array  # constant total P, and L about the centre of mass; shape (6,)
    fixed: Array  # control points that the start fixes; shape (3, joints) [rad]

    name: ClassVar[str] = "joint_spline"
    reading: ClassVar[str] = ""
    stride: ClassVar[float] = 0.4  # 0.2 rad is a bold first step

    @property
    def directions(self) -> Array:
        """Each control point by itself."""
        return np.eye(self.variables)

    @property
    def robot(self) -> Robot:
        """Whose motions these are."""
        return self.problem.robot

    @property
    def variables(self) -> int:
        """Free control points of all joints, those of the first joint first."""
        return self.robot.joints * (self.basis.count - FIXED)

    def decision_variables(self, x: Array) -> Array:
        """Return nothing: the paper has no such variables."""
        return np.empty(0)

    def first_guesses(
        self, obstacles: Sequence[Sphere], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield splines near the paper's path, ways to goal postures, and detours without end."""
        return spline_guesses(self, obstacles, points)

    def towards(self, target: Target) -> JointSplines:
        """Return the motions to a target near this one; the control points stay what they are."""
        return replace(self, problem=replace(self.problem, target=target))

    def control_points(self, x: Array) -> Array:
        """Return all control points of a spline. Shape (control points, joints) [rad]."""
        return np.concatenate([self.fixed, x.reshape(self.robot.joints, -1).T])

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Integrate the base along one spline; there is nothing to damp."""
        robot, duration, controls = self.robot, self.basis.duration, self.control_points(x)
        joints = tuple(rows @ controls for rows in _rows(self.basis, points))
        angles, rates, accelerated = joints
        rotation = pin.Quaternion(self.q_start[3:7]).toRotationMatrix()
        maps = momentum_maps(robot, angles)
        turn = base_turn(maps, rates, rotation, self.momentum[3:], duration / (points - 1))
        drift = self.momentum[:3] / pin.computeTotalMass(robot.model)
        centers = self.center + np.linspace(0.0, duration, len(angles))[:, None] * drift
        q, q_half_way = (
            np.hstack(
                [
                    centers[at] - np.einsum("pij,pj->pi", rotations, maps.center[at]),
                    Rotation.from_matrix(rotations).as_quat(),
                    angles[at],
                ]
            )
            for rotations, at in ((turn.rotations, np.s_[::2]), (turn.half_way, np.s_[1::2]))
        )
        base_rates = turn.rates[::4]
        linear = drift @ turn.rotations - np.cross(base_rates, maps.center[::2])
        linear -= np.einsum("pij,pj->pi", maps.of_center[::2], rates[::2])
        v = np.hstack([linear, base_rates, rates[::2]])
        if robot.base is Base.PLANAR:  # the table takes up what an axis is off its normal
            q[:, 2] = q_half_way[:, 2] = self.q_start[2]
            v[:, 2] = 0.0
        of_base = base_acceleration(robot, robot.model.createData(), q[-1], v[-1], accelerated[-1])
        none = np.empty((robot.model.nv, 0))
        end = EndPoint(q[-1], v[-1], np.append(of_base, accelerated[-1]), none, none, none[6:])
        goal_error, _ = end_conditions(robot, self.problem.target, end, duration)
        hull = JointHull(*(matrix @ controls for matrix in _hulls(self.basis)))
        return SplineMotion(
            x=x,
            q=q,
            v=v,
            q_half_way=q_half_way,
            goal_error=goal_error,
            hull=hull,
            joints=(angles, rates, accelerated),
            turn=turn,
        )

    def sensitivity(self, motion: Motion, damping: float = 0.0) -> Sensitivity:
        """Differentiate a motion of this family, exact as discretised."""
        motion = cast(SplineMotion, motion)
        robot, duration, points = self.robot, self.basis.duration, len(motion.q)
        of_angles, of_rates, of_accelerations = _by_x(self.basis, points, robot.joints)
        step, maps = duration / (points - 1), motion.turn.maps
        of_turn = turn_derivatives(
            robot, motion.turn, motion.joints[:2], (of_angles, of_rates), step
        )
        q, q_half_way = (
            np.concatenate(
                [skew(maps.center[at]) @ turns - maps.of_center[at] @ by_x, turns, by_x], axis=1
            )
            for turns, at, by_x in (
                (of_turn.turns, np.s_[::2], of_angles[::2]),
                (of_turn.half_way, np.s_[1::2], of_angles[1::2]),
            )
        )
        mass = pin.computeTotalMass(robot.model)
        drift = self.momentum[:3] / mass @ motion.turn.rotations
        linear = skew(drift) @ of_turn.turns + skew(maps.center[::2]) @ of_turn.rates
        linear -= of_turn.of_linear / mass @ of_angles[::2]
        linear -= maps.of_center[::2] @ of_rates[::2]
        v = np.concatenate([linear, of_turn.rates, of_rates[::2]], axis=1)
        if robot.base is Base.PLANAR:
            q[:, 2] = q_half_way[:, 2] = v[:, 2] = 0.0
        acceleration = self._acceleration(motion, of_turn)
        end = EndPoint(
            motion.q[-1], motion.v[-1], acceleration[-1], q[-1], v[-1], of_accelerations[-1]
        )
        _, goal_error = end_conditions(robot, self.problem.target, end, duration)
        hulls = (_of_joints(matrix, robot.joints) for matrix in _hulls(self.basis))
        return Sensitivity(
            q=q,
            v=v,
            q_half_way=q_half_way,
            goal_error=goal_error,
            acceleration=acceleration,
            hull=JointHull(*hulls),
        )

    def _acceleration(self, motion: SplineMotion, of_turn: TurnDerivatives) -> Array:
        """Return dv/dt at the points, from the momenta's derivative in time. (points, 6 + joints).

        In base axes:  d/dt (I omega + A theta') = -omega x R^T L, and likewise for P.
        """
        maps, base_rates = motion.turn.maps, motion.turn.rates[::4]
        _, rates, accelerated = (of_time[::2, :, None] for of_time in motion.joints)
        mass = pin.computeTotalMass(self.robot.model)
        drift = self.momentum[:3] / mass @ motion.turn.rotations
        angular = -np.cross(base_rates, motion.turn.momenta[::4])
        angular -= (of_turn.of_angular @ rates + maps.coupling[::2] @ accelerated)[:, :, 0]
        angular = np.einsum("pij,pj->pi", maps.to_rate[::2], angular)
        linear = -np.cross(base_rates, drift) - np.cross(angular, maps.center[::2])
        linear -= (of_turn.of_linear / mass @ rates + maps.of_center[::2] @ accelerated)[:, :, 0]
        if self.robot.base is Base.PLANAR:
            linear[:, 2] = 0.0
        return np.hstack([linear, angular, accelerated[:, :, 0]])


def joint_splines(problem: PlanningProblem, settings: PlannerSettings) -> JointSplines:
    """Return the joint splines from the start state of a problem.

    Where the start's joint accelerations are not known, the joints begin without.
    """
    robot, start = problem.robot, problem.start
    q, v = configuration(robot, start)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    center = np.array(pin.centerOfMass(robot.model, data, q))
    momentum[3:] -= np.cross(center, momentum[:3])
    accelerated = start.joint_accelerations
    if accelerated is None:
        accelerated = np.zeros(robot.joints)
    basis = SplineBasis(problem.duration, settings.joint_spline_spans)
    fixed = basis.start(start.joint_positions, start.joint_velocities, accelerated)
    return JointSplines(problem, basis, q, center, momentum, fixed)


@lru_cache(maxsize=32)
def _rows(basis: SplineBasis, points: int) -> tuple[Array, Array, Array]:
    """Return what control points contribute to angles, rates and accelerations at half steps."""
    s = np.linspace(0.0, 1.0, 2 * points - 1)
    return basis.rows(s), basis.rows(s, 1), basis.rows(s, 2)


@lru_cache(maxsize=32)
def _by_x(basis: SplineBasis, points: int, joints: int) -> tuple[Array, Array, Array]:
    """Return the derivatives of angles, rates and accelerations by x at half steps.

    Each of shape (half steps, joints, variables).
    """
    angles, rates, accelerated = (_of_joints(rows, joints) for rows in _rows(basis, points))
    return angles, rates, accelerated


@lru_cache(maxsize=32)
def _hulls(basis: SplineBasis) -> tuple[Array, Array]:
    """Return the matrices from control points to the hulls of angles and rates.

    What the start alone decides is left out.
    """
    angles, rates = basis.hull(), basis.hull(1)
    return angles[FIXED:], rates[FIXED - 1 :]


def _of_joints(rows: Array, joints: int) -> Array:
    """Return rows for the free control points of one joint as those for all. (rows, joints, x)."""
    free = rows[:, FIXED:]
    of_joints = np.zeros((len(rows), joints, joints, free.shape[1]))
    of_joints[:, range(joints), range(joints)] = free[:, None]
    return of_joints.reshape(len(rows), joints, -1)
