"""The corridor of the last stretch to a grasp: a cone in the frame of the grasp.

The cone's axis is the direction of the approach, against which it opens. Its apex lies beyond the
grasp, where the cone has the radius `RADIUS_AT_GRASP`. Wherever the end effector is within the
distance from the grasp, it must be inside the cone: it enters the sphere of this distance through
the cone's mouth only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import DIRECTION, a_number
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status

# Default half angle of a corridor [rad]: 1.5 times that of vehicles which dock over hundreds of
# metres, because over decimetres an arm has less room to steer.
HALF_ANGLE = math.radians(15.0)
# No corridor is shorter [m]: the check of a plan could not see it.
_SHORTEST = 1e-6
# Radius of the corridor at the grasp [m], as no end effector meets a point: five times the allowed
# final position error.
RADIUS_AT_GRASP = 0.005

# Planes that approximate the cone, to less than 1 % of the lateral offset.
_PLANES = 24


class Margins(NamedTuple):
    """Signed distances of places from the forbidden region; negative inside it."""

    values: Array  # with Lipschitz constant 1 in the place; shape (places,) [m]
    gradients: Array  # by the place, in grasp axes; shape (places, 3)
    by_cone: Array  # whether the value is that of the cone, else of the distance; shape (places,)


@dataclass(frozen=True, eq=False)
class Approach:
    """The corridor of the last stretch, in the frame of the end effector at the goal.

    Raises:
        InvalidInput: Wrong size, not finite, a direction of no length, a distance below 1e-6 m, or
            a half angle that is not between zero and a right angle.
    """

    direction: Array = declare(
        DIRECTION,
        "direction of motion of the end effector, any length but zero",
        frame="in its frame at the goal",
        message="direction",
    )
    distance: float = declare(
        a_number(above=0.0, at_least=_SHORTEST),
        "distance from the goal within which the end effector stays in the corridor",
        unit="m",
        message="distance",
    )
    half_angle: float = declare(
        a_number(above=0.0),
        "of the corridor, a cone about the direction, below a right angle; 0.2618 is 15 deg",
        unit="rad",
        default=HALF_ANGLE,
        message="half_angle",
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "approach")
        if not self.half_angle < math.pi / 2:
            allowed = "it must be less than a right angle, 1.5708 rad"
            raise InvalidInput(Status.OUT_OF_RANGE, "approach.half_angle", self.half_angle, allowed)

    @property
    def back_off(self) -> float:
        """By how much the corridor is narrower than the cone, all along it [m]."""
        return 0.0

    def words(self) -> tuple[str, ...]:
        """Return lines for a reader of a report."""
        axis = ", ".join(format(entry, ".3g") for entry in self.direction)
        cone = f"a cone of {math.degrees(self.half_angle):.3g} deg to each side"
        return f"[{axis}], in the goal's axes", f"the last {1e3 * self.distance:.4g} mm in {cone}"

    def _along_and_aside(self, places: Array) -> tuple[Array, Array]:
        """Return distances before the grasp, (places,), and lateral offsets, (places, 3) [m]."""
        along = -(places @ self.direction)
        return along, places + along[:, None] * self.direction

    def angles(self, places: Array) -> Array:
        """Return the angles of places off the cone's axis, seen from its apex. (places,) [rad]."""
        along, aside = self._along_and_aside(places)
        beyond = RADIUS_AT_GRASP / math.tan(self.half_angle)
        angles: Array = np.arctan2(np.linalg.norm(aside, axis=1), along + beyond)
        return angles

    def planes(self, places: Array) -> tuple[Array, Array]:
        """Return distances of places inside planes tangent to the cone, all round, and gradients.

        The margin of the cone has no gradient on its axis, where all walls are equally near; planes
        have. The first plane is the nearest.

        Returns:
            Shapes (places, planes) [m] and (places, planes, 3).
        """
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        along, aside = self._along_and_aside(places)
        lateral = np.linalg.norm(aside, axis=1)
        across = np.cross(self.direction, np.eye(3)[np.abs(self.direction).argmin()])
        across /= np.linalg.norm(across)
        first = np.where(
            (lateral > 0.0)[:, None],
            aside / np.where(lateral > 0.0, lateral, 1.0)[:, None],
            across,
        )
        angles = np.linspace(0.0, 2 * math.pi, _PLANES, endpoint=False)[:, None]
        outward = np.cos(angles) * first[:, None]
        outward = outward + np.sin(angles) * np.cross(self.direction, first)[:, None]
        values = np.array(RADIUS_AT_GRASP * cosine + along * sine)[:, None]
        values = values - cosine * np.einsum("ti,tpi->tp", aside, outward)
        return values, -sine * self.direction - cosine * outward

    def margins(self, places: Array) -> Margins:
        """Return how far places are inside the cone, or beyond the distance: the larger of both.

        With s the distance before the grasp, l the lateral offset, r the radius at the grasp and a
        the half angle, the cone is r cos(a) + s sin(a) - l cos(a) >= 0.

        Args:
            places: Of the end effector in the grasp's frame. Shape (places, 3) [m].
        """
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        along, aside = self._along_and_aside(places)
        lateral, away = np.linalg.norm(aside, axis=1), np.linalg.norm(places, axis=1)
        in_cone = RADIUS_AT_GRASP * cosine + along * sine - lateral * cosine
        beyond = away - self.distance
        nothing = np.finfo(float).tiny
        inward = -sine * self.direction - cosine * aside / np.maximum(lateral, nothing)[:, None]
        outward = places / np.maximum(away, nothing)[:, None]
        by_cone = in_cone >= beyond
        return Margins(
            np.where(by_cone, in_cone, beyond),
            np.where(by_cone[:, None], inward, outward),
            by_cone,
        )
