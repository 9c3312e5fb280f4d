"""The objective that is minimised, and the range of durations to choose from."""

from __future__ import annotations

from dataclasses import dataclass, field

from ff_planner_ros.common.arrays import Array, finite_vector, zero_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import a_number
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status


@dataclass(frozen=True)
class Objective:
    """Weights of the joint path, Eq. (44), the chaser's attitude, Eq. (45), duration and wheels.

    Raises:
        InvalidInput: A weight that is not finite or negative, or all zero.
    """

    joint_path_length: float = declare(
        a_number(at_least=0.0),
        "weight of Eq. (44)",
        message="joint_path_length",
    )
    chaser_attitude: float = declare(
        a_number(at_least=0.0),
        "weight of Eq. (45)",
        message="chaser_attitude",
    )
    duration: float = declare(
        a_number(at_least=0.0),
        "weight of the duration; of no effect where the duration is given",
        unit="rad/s",
        brief=True,
        default=0.0,
        message="duration",
    )
    wheel_momentum: float = declare(
        a_number(at_least=0.0),
        "weight of the largest momentum of any wheel, on a base that is attitude_held",
        unit="rad/(N m s)",
        brief=True,
        default=0.0,
        message="wheel_momentum",
    )

    def __post_init__(self) -> None:
        """Check the weights."""
        check_declared(self, "objective")
        if self.only_duration and self.duration == 0.0:
            raise InvalidInput(
                Status.OUT_OF_RANGE, "objective", "all zero", "one weight must be positive"
            )

    @property
    def only_duration(self) -> bool:
        """Whether the duration alone has a weight: the shortest plan is the best."""
        return self.joint_path_length == self.chaser_attitude == self.wheel_momentum == 0.0


# No plan is shorter [s]: no controller samples it more often, and powers of much shorter times
# underflow.
SHORTEST = 1e-3


@dataclass(frozen=True, eq=False)
class DurationRange:
    """The range from which the planner chooses the duration.

    Raises:
        InvalidInput: Shorter than 1 ms, or in the wrong order.
    """

    minimum: float = declare(
        a_number(above=0.0, at_least=SHORTEST),
        "the shortest",
        key="min",
        unit="s",
        message="duration",
    )
    maximum: float = declare(a_number(), "the longest", key="max", unit="s", message="duration_max")
    # Derivative of the target position by the duration: in a frame that moves, a target at rest is
    # elsewhere for another duration; shape (3,) [m/s]
    target_velocity: Array = field(default_factory=zero_vector)

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "duration")
        if self.maximum < self.minimum:
            allowed = f"it must not be less than the shortest, {self.minimum:g} s"
            raise InvalidInput(Status.OUT_OF_RANGE, "duration.max", self.maximum, allowed)
        checked_velocity = finite_vector("target_velocity", self.target_velocity, 3)
        object.__setattr__(self, "target_velocity", checked_velocity)
