"""Deviations of an executed motion from its plan, and which are allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory

if TYPE_CHECKING:
    from ff_planner_ros.simulation.execution import Execution

# The final errors that the planner's check allows: physics may not add more. Errors of
# interpolation and integration are less than a tenth of this.
POSITION_TOLERANCE = 1e-3  # [m]
ORIENTATION_TOLERANCE = np.deg2rad(0.05)  # [rad]
# A deviation that a refinement changes by less than this share of its tolerance is an error of the
# plan, not of RK4.
_CONVERGED = 0.01


@dataclass(frozen=True)
class Deviation:
    """Deviations of an execution from a plan."""

    final_position_error: float  # of the end effector at the last point [m]
    final_orientation_error: float  # of the end effector at the last point [rad]
    max_chaser_position_error: float  # of the chaser, at the worst of all points [m]
    max_chaser_orientation_error: float  # of the chaser, at the worst of all points [rad]


ALLOWED = Deviation(
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE, POSITION_TOLERANCE, ORIENTATION_TOLERANCE
)


def is_allowed(found: Deviation) -> bool:
    """Tell whether all deviations are within their tolerances."""
    return all(value <= most for value, most in zip(astuple(found), astuple(ALLOWED), strict=True))


def has_converged(found: Deviation, coarser: Deviation) -> bool:
    """Tell whether a deviation is that of twice as long steps, but for a share of the tolerance."""
    values = zip(astuple(found), astuple(coarser), astuple(ALLOWED), strict=True)
    return all(abs(one - other) <= _CONVERGED * most for one, other, most in values)


def deviation(
    execution: Execution, trajectory: Trajectory, ends: Sequence[int] | None = None
) -> Deviation:
    """Return the deviations of an execution from a plan in the same inertial frame.

    Args:
        ends: Last points of the parts that it was executed in; see `verify`. None: it was whole.
    """
    chaser = np.linalg.norm(execution.chaser_positions - trajectory.chaser_positions, axis=1)
    chaser_turn = _angles(execution.chaser_quaternions_xyzw, trajectory.chaser_quaternions_xyzw)
    lasts = np.array([len(chaser) - 1] if ends is None else ends)
    final = np.linalg.norm(execution.ee_positions[lasts] - trajectory.ee_positions[lasts], axis=1)
    final_turn = _angles(
        execution.ee_quaternions_xyzw[lasts], trajectory.ee_quaternions_xyzw[lasts]
    )
    worst, worst_turn = (
        [part.max() for part in np.split(each, lasts[:-1] + 1)] for each in (chaser, chaser_turn)
    )
    parts = len(lasts)
    return Deviation(
        final_position_error=float(parts * final.sum()),
        final_orientation_error=float(parts * final_turn.sum()),
        max_chaser_position_error=float(parts * np.sum(worst)),
        max_chaser_orientation_error=float(parts * np.sum(worst_turn)),
    )


def _angles(quaternions_xyzw: Array, others_xyzw: Array) -> Array:
    """Return the angles between attitudes. Shape (points,) [rad]."""
    one, other = (
        quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        for quaternions in (quaternions_xyzw, others_xyzw)
    )
    # q and -q are the same attitude: the nearer one counts.
    other = np.copysign(1.0, (one * other).sum(axis=1, keepdims=True)) * other
    apart, together = np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1)
    return np.asarray(4.0 * np.arctan2(apart, together), np.float64)
