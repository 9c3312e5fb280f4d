"""The planner's settings, parameters `planner.*`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ff_planner_ros.common.declared import check_declared, declare, tunable
from ff_planner_ros.common.declared_parts import changes
from ff_planner_ros.common.forms import a_number, a_whole_number


def _deviation(default: float, of: str) -> Any:
    """Declare a standard deviation, up to 1."""
    return tunable(default, f"Standard deviation of {of}", (0.0, 1.0))


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
        0.0,
        "Number of its standard deviations that every margin of a plan keeps, under the errors "
        "below; 0.0: none",
        (0.0, MOST_SIGMAS),
    )
    mass: float = _deviation(0.01, "each body's mass, relative")
    inertia: float = _deviation(0.01, "each body's inertia about its centre of mass, relative")
    center_of_mass: float = _deviation(0.0, "each body's centre of mass, along each axis [m]")
    linear_velocity: float = _deviation(
        0.0, "the chaser's velocity at the start, along each axis [m/s]"
    )
    angular_velocity: float = _deviation(
        0.000175, "the chaser's angular velocity at the start, about each axis [rad/s]"
    )

    def __post_init__(self) -> None:
        """Check every value against its declaration."""
        check_declared(self, "planner.robust")


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of the planner: its search, tolerances and margins.

    Raises:
        InvalidInput: A value of the wrong type or out of its range.
    """

    robust: RobustSettings = declare(
        changes(RobustSettings),
        "margins for errors of the model and of the start",
        optional=True,
    )
    clearance_margin: float = tunable(
        0.002,
        "Clearance at the points, so that the certified one between them stays positive [m]",
        (0.0, 1.0),
    )
    penalty_gain: float = tunable(2.5, "g1 of Eq. (47)")
    penalty_exponent: float = tunable(1.0, "g2 of Eq. (47)", (0.0, 100.0))
    joint_path_tie_break: float = tunable(
        0.005, "Weight of the joint path if only the attitude has a weight", (0.0, 1.0)
    )
    starts: int = tunable(
        20,
        "Number of initial guesses (multi-start): the straight path, then deterministic detours; "
        "the first that leads to a path is kept",
        (1, 1_000),
    )
    search: SearchDepth = tunable(
        SearchDepth.NORMAL,
        "Depth of the search for a better attitude, if it has a weight: quick, normal or "
        "thorough; a deeper search never gives a worse plan",
        words=SearchDepth,
    )
    joint_spline_spans: int = tunable(
        6,
        "Spans of each joint's spline; more follow more winding paths, at a higher cost",
        (1, 100),
    )
    joint_spline_smoothing: float = tunable(
        0.05,
        "Weight of T times the integral of squared joint velocities, for joint splines",
        (0.0, 100.0),
    )
    max_iterations: int = tunable(
        100, "Iteration limit of the solver for each initial guess", (1, 10_000)
    )
    optimality_tolerance: float = tunable(
        0.001, "First-order optimality at which the solver stops", (1e-12, 1.0)
    )
    position_tolerance: float = tunable(
        0.001,
        "Allowed final error of the end effector position, or of prismatic joints [m]",
        (1e-12, 1.0),
    )
    orientation_tolerance: float = tunable(
        0.001, "Allowed final error of the orientation, or of revolute joints [rad]", (1e-12, 1.0)
    )
    momentum_tolerance: float = tunable(
        1e-09, "Allowed relative change of the total momentum", (1e-15, 1.0)
    )
    singular_value_threshold: float = tunable(
        0.02,
        "Least singular value of the generalised Jacobian; below, a plan is refused",
        (0.0, 1.0),
    )
    start_velocity_tolerance: float = tunable(
        0.01,
        "Allowed jump of joint velocities at the start; the planner's own plans have none [rad/s]",
        (0.0, 10.0),
    )

    capture_velocity_tolerance: float = declare(
        a_number(at_least=0.0, at_most=1.0),
        "Largest velocity of the end effector relative to the grasp at contact that navigation "
        "leaves: it gives the capture's impulse",
        unit="m/s",
        brief=True,
        default=0.0,
    )
    capture_turn_rate_tolerance: float = declare(
        a_number(at_least=0.0, at_most=1.0),
        "Largest angular velocity of the end effector relative to the grasp then, likewise",
        unit="rad/s",
        brief=True,
        default=0.0,
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
