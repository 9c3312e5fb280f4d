"""Reaction wheels that hold the chaser's attitude, and what they take up.

Nothing else turns the system, so the angular momentum of chaser, arm and wheels about the centre of
mass is constant. The chaser does not turn: of the bodies, the joints alone have any. With L that
part, in axes of the base link, and S the axes of the wheels,

    S h(t) = S h(0) + L(0) - L(t),    h(t) = h(0) + S^+ (L(0) - L(t)),

where the pseudo-inverse shares it among more than three wheels by the least sum of squares, and
what these hold against each other stays. A wheel's torque is the rate of its momentum: of h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector, frozen, unit_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import ONE_OR_EACH, ROWS, or_none
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.state import STORED, SystemState

# A measured chaser turns that is held by wheels: so fast an error of measurement is [rad/s].
MAX_TURN_RATE = 1e-3
# Axes nearly in a plane cannot hold an attitude: of their singular values the least, of unit axes.
_LEAST_SPREAD = 1e-3
# More wheels than any chaser has.
_MOST_WHEELS = 16


def _own_axes() -> Array:
    return np.eye(3)


@dataclass(frozen=True, eq=False)
class Wheels:
    """Reaction wheels: their axes and limits.

    Raises:
        InvalidInput: An axis of no length, axes that do not span the space, limits that are not
            positive or not one for each wheel.
    """

    axes: Array = declare(  # of unit length; shape (wheels, 3)
        ROWS,
        "axis of each wheel, any length but zero; default: the three of the base link",
        frame="in axes of the base link",
        since="0.3",
        default_factory=_own_axes,
    )
    momentum: tuple[float, ...] | None = declare(  # None: any
        or_none(ONE_OR_EACH),
        "largest momentum of each wheel either way, or one for all",
        unit="N m s",
        since="0.3",
        default=None,
    )
    torque: tuple[float, ...] | None = declare(  # None: any
        or_none(ONE_OR_EACH),
        "largest torque of each wheel either way, or one for all",
        unit="N m",
        since="0.3",
        default=None,
    )

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, "robot.wheels")
        name = "robot.wheels.axes"
        rows = list(self.axes)
        if not 3 <= len(rows) <= _MOST_WHEELS:
            allowed = f"three wheels or more hold an attitude, and at most {_MOST_WHEELS}"
            raise InvalidInput(Status.WRONG_SIZE, name, f"{len(rows)} axes", allowed)
        axes = np.array([unit_vector(f"{name}[{k}]", row) for k, row in enumerate(rows)])
        if np.linalg.svd(axes, compute_uv=False)[-1] < _LEAST_SPREAD:
            allowed = "they must not lie in one plane: no wheel turns about what is across it"
            raise InvalidInput(Status.OUT_OF_RANGE, name, axes.tolist(), allowed)
        object.__setattr__(self, "axes", frozen(axes))
        for limit in ("momentum", "torque"):
            given = getattr(self, limit)
            if given is None:
                continue
            each = tuple(given) * (len(axes) if len(given) == 1 else 1)
            finite_vector(f"robot.wheels.{limit}", each, len(axes))
            object.__setattr__(self, limit, each)

    @property
    def count(self) -> int:
        """Number of wheels."""
        return len(self.axes)

    @cached_property
    def shares(self) -> Array:
        """S^+: momentum in axes of the base link to that of each wheel. Shape (wheels, 3)."""
        return frozen(np.linalg.pinv(self.axes.T))

    @property
    def momentum_limits(self) -> Array:
        """Limit of each wheel, infinite where there is none. Shape (wheels,) [N m s]."""
        return np.full(self.count, np.inf) if self.momentum is None else np.array(self.momentum)

    @property
    def torque_limits(self) -> Array:
        """Limit of each wheel, infinite where there is none. Shape (wheels,) [N m]."""
        return np.full(self.count, np.inf) if self.torque is None else np.array(self.torque)


def held(wheels: Wheels, state: SystemState) -> SystemState:
    """Return a state of a chaser that wheels hold: it does not turn, and they have momenta.

    Raises:
        InvalidInput: It turns faster than a measurement is off, or has momenta of other wheels.
    """
    omega = state.angular_velocity_chaser_in_inertial
    if float(np.linalg.norm(omega)) > MAX_TURN_RATE:
        raise InvalidInput(
            Status.UNSUPPORTED,
            "chaser.angular_velocity",
            omega.tolist(),
            f"with robot.base attitude_held the chaser must not turn: {MAX_TURN_RATE:g} rad/s are "
            "let pass as an error of measurement; let the wheels brake it first",
        )
    momenta = momenta_of(wheels, state)
    return replace(state, angular_velocity_chaser_in_inertial=np.zeros(3), wheel_momenta=momenta)


def momenta_of(wheels: Wheels, state: SystemState) -> Array:
    """Return what the wheels hold in a state, zero where it does not tell. Shape (wheels,) [N m s].

    Raises:
        InvalidInput: It tells of another number of wheels.
    """
    if state.wheel_momenta is None:
        return np.zeros(wheels.count)
    return finite_vector(STORED, state.wheel_momenta, wheels.count)
