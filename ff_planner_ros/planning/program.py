"""The optimisation problem of Eq. (43): objective and constraints as functions of the path.

The summed penalty R_obst = 0 of the paper has no gradient on its feasible side. The distances
themselves are constrained instead, which says the same: every segment of the arm stays outside
every sphere at every point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import (
    arm_points_with_derivatives,
    clearance_gradients,
    clearances,
    near_box,
    segments,
)
from ff_planner_ros.planning.objectives import (
    chaser_euler,
    chaser_euler_derivative,
    joint_path_length,
    joint_path_length_derivatives,
)
from ff_planner_ros.planning.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem import Objective, Sphere
from ff_planner_ros.planning.rollout import Rollout, RolloutModel, Sensitivity
from ff_planner_ros.planning.solver import Linearisation
from ff_planner_ros.robot.model import Robot

# A sphere further from a segment than this, or a joint further from its limit [rad], cannot be
# reached by one step of the solver that the linearisation still describes; nor can the limit of a
# joint rate that is below this part of it.
_DISTANCE_OF_INTEREST, _RATE_OF_INTEREST = 0.25, 0.4


@dataclass(frozen=True, eq=False)
class PathLinearisation(Linearisation):
    """What the solver wants to know of a path, and the motion that it comes from.

    Attributes:
        rollout: The motion.
        acceleration: dv/dt at each point. Shape (points, 6 + joints).
    """

    rollout: Rollout
    acceleration: Array


@dataclass(frozen=True, eq=False)
class PathProgram:
    """Objective and constraints of one planning problem on one time grid.

    Attributes:
        robot: The robot.
        rollouts: Gives the motion of a path.
        step: Time between two points [s].
        spheres: The obstacles.
        objective: The weights.
        clearance_margin: Clearance to keep at the points [m].
        limit_joint_velocities: Whether to keep the joint rates within the robot's limits.
        keep_going: Called before each linearisation; raises when there shall be no further one.
    """

    robot: Robot
    rollouts: RolloutModel
    step: float
    spheres: Sequence[Sphere]
    objective: Objective
    clearance_margin: float
    limit_joint_velocities: bool
    keep_going: Callable[[], None]

    def linearise(self, x: Array) -> PathLinearisation:
        """Return objective and constraints with their derivatives.

        Args:
            x: Coefficients of the path's free terms, flattened. Shape (18,).

        Raises:
            NoPlanFound: The path meets a dynamic singularity.
            OutOfTime: By `keep_going`.
        """
        self.keep_going()
        rollout = self.rollouts.roll_out(x.reshape(COMPONENTS, FREE_TERMS))
        sensitivity = self.rollouts.sensitivity(rollout)
        joint_rates, joint_rates_by_x = rollout.v[:, 6:], sensitivity.v[:, 6:]
        gradient, hessian = joint_path_length_derivatives(joint_rates, joint_rates_by_x, self.step)
        weight = self.objective.joint_path_length
        peaks, peaks_jacobian = self._peaks(rollout, sensitivity)
        rows = [
            self._clearance(rollout, sensitivity),
            self._joint_margins(rollout, sensitivity),
            self._velocity_margins(rollout, sensitivity),
        ]
        return PathLinearisation(
            value=weight * joint_path_length(joint_rates, self.step),
            gradient=weight * gradient,
            hessian=weight * hessian,
            peaks=peaks,
            peaks_jacobian=peaks_jacobian,
            constraints=np.concatenate([values for values, _ in rows]),
            constraints_jacobian=np.concatenate([jacobian for _, jacobian in rows]),
            rollout=rollout,
            acceleration=sensitivity.acceleration,
        )

    def _peaks(self, rollout: Rollout, sensitivity: Sensitivity) -> tuple[Array, Array]:
        """Return the Euler angles whose largest modulus is J_Theta, Eq. (45)."""
        columns = sensitivity.q.shape[2]
        weight = self.objective.chaser_attitude
        if weight == 0.0:
            return np.empty(0), np.empty((0, columns))
        euler = weight * chaser_euler(self.robot, rollout.q).ravel()
        jacobian = weight * chaser_euler_derivative(self.robot, rollout.q, sensitivity.q)
        jacobian = jacobian.reshape(-1, columns)
        return np.concatenate([euler, -euler]), np.concatenate([jacobian, -jacobian])

    def _clearance(self, rollout: Rollout, sensitivity: Sensitivity) -> tuple[Array, Array]:
        """Return the distances of interest, less the margin, at points and half-way between."""
        positions, derivatives = arm_points_with_derivatives(
            self.robot,
            np.concatenate([rollout.q[1:], rollout.q_half_way]),
            np.concatenate([sensitivity.q[1:], sensitivity.q_half_way]),
        )
        starts = segments(positions)
        near = near_box(positions, self.spheres, _DISTANCE_OF_INTEREST)
        clear = clearances(positions, starts, near)
        rows = np.nonzero(clear.distance < _DISTANCE_OF_INTEREST)
        jacobian = clearance_gradients(clear, derivatives, starts, rows)
        return clear.distance[rows] - self.clearance_margin, jacobian

    def _joint_margins(self, rollout: Rollout, sensitivity: Sensitivity) -> tuple[Array, Array]:
        """Return the distances of interest to the joint limits."""
        return _margins(
            rollout.q[1:, 7:],
            sensitivity.q[1:, 6:],
            self.robot.lower_position_limits,
            self.robot.upper_position_limits,
            _DISTANCE_OF_INTEREST,
        )

    def _velocity_margins(self, rollout: Rollout, sensitivity: Sensitivity) -> tuple[Array, Array]:
        """Return the margins of interest to the limits of the joint rates."""
        rates, jacobian = rollout.v[1:, 6:], sensitivity.v[1:, 6:]
        if not self.limit_joint_velocities:
            return np.empty(0), np.empty((0, jacobian.shape[2]))
        limits = self.robot.velocity_limits
        return _margins(rates, jacobian, -limits, limits, (1.0 - _RATE_OF_INTEREST) * limits)


def _margins(
    values: Array, jacobian: Array, lower: Array, upper: Array, interest: Array | float
) -> tuple[Array, Array]:
    """Return the distances to both limits that are below the interest, with their derivatives."""
    margins = np.stack([upper - values, values - lower])
    rows = np.nonzero(margins < interest)
    return margins[rows], np.stack([-jacobian, jacobian])[rows]
