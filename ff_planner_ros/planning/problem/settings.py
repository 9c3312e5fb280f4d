"""The planner's settings, parameters `planner.*`; their values are in `config/planner.yaml`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import changes
from ff_planner_ros.common.forms import a_number, a_whole_number, a_word


class Strictness(NamedTuple):
    """Order of a tunable's values: a stricter one lets fewer plans, states or requests pass."""

    of: Callable[[Any], float | list[float]]  # larger if stricter; of several values, one for each
    as_strict: str  # values at least as strict as {}, in words
    mark: str  # of the parameter in tables

    def is_kept(self, value: Any, now: Any) -> bool:
        """Tell whether a value is at least as strict as another one, in every part."""
        parts, parts_now = np.atleast_1d(self.of(value)), np.atleast_1d(self.of(now))
        fits = len(parts_now) in (1, len(parts)) or len(parts) == 1
        # Written so that NaN is never strict enough.
        return fits and bool((parts >= parts_now).all())


STRICT_IF_LOW = Strictness(lambda value: -value, "at most {}", "<")
STRICT_IF_HIGH = Strictness(lambda value: value, "at least {}", ">")
# Zero stands for no limit at all.
STRICT_IF_LOW_NOT_ZERO = Strictness(
    lambda value: -(value or math.inf), "above 0 and at most {}", "<"
)
# Of several, or one for all.
STRICT_IF_LOW_EACH = Strictness(
    lambda values: [-(value or math.inf) for value in values or (0.0,)],
    "above 0 and at most {}",
    "<",
)


def strict_if(strict: object) -> Strictness:
    """Return the strictness of a choice with one strict value."""
    return Strictness(lambda value: value == strict, "{}", "=")


def tunable(
    description: str,
    minimum: float | None = None,
    maximum: float | None = None,
    unit: str = "",
    strictness: Strictness | None = None,
) -> Any:
    """Declare a tunable once, as a dataclass field. Without minimum or maximum it is unbounded.

    Args:
        strictness: Of tolerances, margins and limits, which a running node only tightens. None: the
            tunable does not decide whether anything passes.
    """
    bounds = {"minimum": minimum, "maximum": maximum}
    said = {"description": description, "unit": unit, "strictness": strictness}
    return field(metadata={**said, **bounds})


def _deviation(of: str, unit: str = "") -> Any:
    """Declare a standard deviation, up to 1."""
    return tunable(f"Standard deviation of {of}", 0.0, 1.0, unit, STRICT_IF_HIGH)


class SearchDepth(StrEnum):
    """Depth of the search for a smaller base attitude change, if that has a weight."""

    QUICK = "quick"
    NORMAL = "normal"
    THOROUGH = "thorough"


# A normal error exceeds three standard deviations to one side once in 740 times.
USUAL_SIGMAS = 3.0
# No model of errors is good enough for more.
MOST_SIGMAS = 10.0


@dataclass(frozen=True)
class RobustSettings:
    """Normal errors of model and measured start that every margin of a plan withstands.

    Raises:
        InvalidInput: A value of the wrong type or out of its range.
    """

    sigmas: float = tunable(
        "Number of its standard deviations that every margin of a plan keeps, under the errors "
        "below; 0.0: none",
        minimum=0.0,
        maximum=MOST_SIGMAS,
        strictness=STRICT_IF_HIGH,
    )
    mass: float = _deviation("each body's mass, relative")
    inertia: float = _deviation("each body's inertia about its centre of mass, relative")
    center_of_mass: float = _deviation("each body's centre of mass, along each axis", "m")
    linear_velocity: float = _deviation(
        "the chaser's velocity at the start, along each axis", "m/s"
    )
    angular_velocity: float = _deviation(
        "the chaser's angular velocity at the start, about each axis", "rad/s"
    )

    def __post_init__(self) -> None:
        """Check every value against its declaration."""
        check_declared(self, "planner.robust")


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of the planner, with the names of the ROS parameters under `planner.`.

    Raises:
        InvalidInput: A value of the wrong type or out of its range.
    """

    robust: RobustSettings = declare(
        changes(RobustSettings),
        "margins for errors of the model and of the start",
        optional=True,
    )
    clearance_margin: float = tunable(
        "Clearance that the search keeps at the points, so that the certified clearance between "
        "them stays positive",
        minimum=0.0,
        maximum=1.0,
        unit="m",
        strictness=STRICT_IF_HIGH,
    )
    penalty_gain: float = tunable("g1 of Eq. (47)", minimum=0.0, maximum=None)
    penalty_exponent: float = tunable("g2 of Eq. (47)", minimum=0.0, maximum=100.0)
    joint_path_tie_break: float = tunable(
        "Weight of the joint path if only the attitude has a weight; the pure minimax optimum does "
        "not determine the joints",
        minimum=0.0,
        maximum=1.0,
    )
    starts: int = tunable(
        "Number of initial guesses (multi-start): the straight path, then deterministic detours; "
        "the first that leads to a path is kept",
        minimum=1,
        maximum=1_000,
    )
    search: SearchDepth = declare(
        a_word(SearchDepth),
        "Depth of the search for a better attitude, if it has a weight: quick, normal or thorough; "
        "a deeper search never gives a worse plan. If attitude is a minor part of the objective "
        "and no other guess looks better, the optimum nearest to the plan of minimum joint path is "
        "kept",
        optional=True,
    )
    joint_spline_spans: int = tunable(
        "Spans of each joint's spline; more spans follow more winding paths around obstacles, at a "
        "higher cost",
        minimum=1,
        maximum=100,
    )
    joint_spline_smoothing: float = tunable(
        "Weight of T times the integral of the squared joint velocities, beside the joint path, "
        "for joint splines: joint path length does not depend on timing",
        minimum=0.0,
        maximum=100.0,
    )
    max_iterations: int = tunable(
        "Iteration limit of the solver for each initial guess", minimum=1, maximum=10_000
    )
    optimality_tolerance: float = tunable(
        "First-order optimality at which the solver stops",
        minimum=1e-12,
        maximum=1.0,
        strictness=STRICT_IF_LOW,
    )
    position_tolerance: float = tunable(
        "Allowed final error of the end effector position, and of prismatic joints in a posture",
        minimum=1e-12,
        maximum=1.0,
        unit="m",
        strictness=STRICT_IF_LOW,
    )
    orientation_tolerance: float = tunable(
        "Allowed final error of the end effector orientation, and of revolute joints in a posture",
        minimum=1e-12,
        maximum=1.0,
        unit="rad",
        strictness=STRICT_IF_LOW,
    )
    momentum_tolerance: float = tunable(
        "Allowed relative change of the total momentum",
        minimum=1e-15,
        maximum=1.0,
        strictness=STRICT_IF_LOW,
    )
    singular_value_threshold: float = tunable(
        "Smallest singular value of the generalised Jacobian below which a plan is refused",
        minimum=0.0,
        maximum=1.0,
        strictness=STRICT_IF_HIGH,
    )
    start_velocity_tolerance: float = tunable(
        "Allowed difference between the plan's first joint velocities and those of the start "
        "state; the planner's own plans have none",
        minimum=0.0,
        maximum=10.0,
        unit="rad/s",
        strictness=STRICT_IF_LOW,
    )

    capture_velocity_tolerance: float = declare(
        a_number(at_least=0.0, at_most=1.0),
        "largest velocity of the end effector relative to the grasp at contact, in any direction, "
        "that navigation leaves: it gives the capture's impulse",
        unit="m/s",
        brief=True,
        default=0.0,
        strictness=STRICT_IF_HIGH,
    )
    capture_turn_rate_tolerance: float = declare(
        a_number(at_least=0.0, at_most=1.0),
        "largest angular velocity of the end effector relative to the grasp then, likewise",
        unit="rad/s",
        brief=True,
        default=0.0,
        strictness=STRICT_IF_HIGH,
    )

    threads: int = declare(
        a_whole_number(1, 64),
        "Processes that share a search for a better attitude or duration, if there are as many "
        "cores; the plan does not depend on it",
        brief=True,
        default=4,
    )

    def __post_init__(self) -> None:
        """Check every value against its declaration."""
        check_declared(self, "planner")
