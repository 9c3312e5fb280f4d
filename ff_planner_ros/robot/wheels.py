"""Reaction wheels that hold the chaser's attitude, and the momentum that they take up.

No external torque acts, so the angular momentum of chaser, arm and wheels about the centre of mass
is constant. With L the momentum of chaser and arm at held attitude, in axes of the base link, S the
axes of the wheels as columns, and h their momenta,

    S h(t) = S h(0) + L(0) - L(t),    h(t) = h(0) + S^+ (L(0) - L(t)).

The pseudo-inverse S^+ distributes it among more than three wheels by the least sum of squares; the
part of h(0) in the null space of S stays. A wheel's torque is dh/dt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector, frozen, unit_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import ONE_OR_EACH, ROWS, or_none
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.state import STORED, SystemState

# Measured angular velocity of a held chaser that counts as an error of measurement [rad/s].
MAX_TURN_RATE = 1e-3
# Smallest singular value of the unit axes; axes nearly in a plane cannot hold an attitude.
_LEAST_SPREAD = 1e-3
# More wheels than any chaser has.
_MOST_WHEELS = 16


def _own_axes() -> Array:
    return np.eye(3)


@dataclass(frozen=True, eq=False)
class Wheels:
    """Reaction wheels: their axes and limits.

    Raises:
        InvalidInput: An axis has no length, the axes are fewer than 3 or more than 16 or do not
            span the space, or limits are not positive or not one for each wheel.
    """

    axes: Array = declare(  # of unit length; shape (wheels, 3)
        ROWS,
        "axis of each wheel, any length but zero; default: the three of the base link",
        frame="in axes of the base link",
        default_factory=_own_axes,
    )
    momentum: tuple[float, ...] | None = declare(  # None: any
        or_none(ONE_OR_EACH),
        "largest momentum of each wheel either way, or one for all",
        unit="N m s",
        default=None,
    )
    torque: tuple[float, ...] | None = declare(  # None: any
        or_none(ONE_OR_EACH),
        "largest torque of each wheel either way, or one for all",
        unit="N m",
        default=None,
    )

    __repr__ = in_a_line

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
            allowed = "they must not lie in one plane: no wheel turns about its normal"
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
        """S^+: from momentum in axes of the base link to wheel momenta. Shape (wheels, 3)."""
        return frozen(np.linalg.pinv(self.axes.T))

    @property
    def momentum_limits(self) -> Array:
        """Largest momentum of each wheel; infinite: no limit. Shape (wheels,) [N m s]."""
        return np.full(self.count, np.inf) if self.momentum is None else np.array(self.momentum)

    @property
    def torque_limits(self) -> Array:
        """Largest torque of each wheel; infinite: no limit. Shape (wheels,) [N m]."""
        return np.full(self.count, np.inf) if self.torque is None else np.array(self.torque)


def held(wheels: Wheels, state: SystemState) -> SystemState:
    """Return a state at held attitude: with zero angular velocity, and with wheel momenta.

    It is the state itself, where that has both.

    Raises:
        InvalidInput: The angular velocity exceeds the error of a measurement, or the momenta are
            not one for each wheel.
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
    momenta, still = momenta_of(wheels, state), np.zeros(3)
    if state.wheel_momenta is not None and omega.tobytes() == still.tobytes():
        return state
    return replace(state, angular_velocity_chaser_in_inertial=still, wheel_momenta=momenta)


def momenta_of(wheels: Wheels, state: SystemState) -> Array:
    """Return the wheel momenta of a state, zero if it has none. Shape (wheels,) [N m s].

    Raises:
        InvalidInput: The state has momenta of another number of wheels.
    """
    if state.wheel_momenta is None:
        return np.zeros(wheels.count)
    return finite_vector(STORED, state.wheel_momenta, wheels.count)
