"""A camera that is fixed to a link, and keeps the goal in view on the way to it.

The view is a cone about the camera's axis, with its apex in the camera. The goal must be inside
until the camera is nearer to it than `until`; for a target body, the goal is its moving grasp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import DIRECTION, TEXT, a_number, a_vector
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that is fixed to a link of the robot.

    Raises:
        InvalidInput: Wrong size, not finite, an axis of no length, an angle that is not between
            zero and a right angle, or a negative distance.
    """

    link: str = declare(TEXT, "link of the URDF that the camera is fixed to", message="link")
    position: Array = declare(
        a_vector(), "of the camera", unit="m", frame="in the link's frame", message="position"
    )
    axis: Array = declare(
        DIRECTION,
        "along which the camera looks, any length but zero",
        frame="in the link's frame",
        message="axis",
    )
    half_angle: float = declare(
        a_number(above=0.0),
        "of the cone that the camera sees, below a right angle",
        unit="rad",
        message="half_angle",
    )
    until: float = declare(
        a_number(at_least=0.0),
        "distance of the camera to the goal, nearer than which the goal may leave the view; "
        "default: the goal stays in view to the end",
        unit="m",
        default=0.0,
        message="until",
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "camera")
        if not self.half_angle < math.pi / 2:
            allowed = "it must be less than a right angle, 1.5708 rad"
            raise InvalidInput(Status.OUT_OF_RANGE, "camera.half_angle", self.half_angle, allowed)

    def words(self) -> tuple[str, ...]:
        """Return lines for a reader of a report."""
        view = f"on {self.link}, sees {math.degrees(self.half_angle):.4g} deg to each side"
        until = f"until it is {self.until:g} m from the goal" if self.until else "to the goal"
        return view, f"the goal stays in view {until}"

    def angles(self, places: Array) -> Array:
        """Return the angles of places off the camera's axis. Shape (places,) [rad].

        Args:
            places: In the link's axes, from the camera. Shape (places, 3) [m].
        """
        along, aside = self._along_and_aside(places)
        return np.asarray(np.arctan2(np.linalg.norm(aside, axis=1), along), np.float64)

    def margins(self, places: Array) -> Array:
        """Return how far places are inside the cone or nearer than `until`: the larger of both.

        With s the distance along the axis, l the lateral offset and a the half angle, the cone is
        s sin(a) - l cos(a) >= 0. The Lipschitz constant is 1. Shape (places,) [m].
        """
        margins: Array = np.maximum(self.in_cone(places), self.nearness(places))
        return margins

    def in_cone(self, places: Array) -> Array:
        """Return how far places are inside the cone; negative: beside it. Shape (places,) [m]."""
        along, aside = self._along_and_aside(places)
        lateral = np.linalg.norm(aside, axis=1)
        inside: Array = along * math.sin(self.half_angle) - lateral * math.cos(self.half_angle)
        return inside

    def nearness(self, places: Array) -> Array:
        """Return how much nearer than `until` places are. Shape (places,) [m]."""
        return np.asarray(self.until - np.linalg.norm(places, axis=1), np.float64)

    def _along_and_aside(self, places: Array) -> tuple[Array, Array]:
        """Return distances along the axis, (places,), and lateral offsets, (places, 3) [m]."""
        along = places @ self.axis
        return along, places - along[:, None] * self.axis
