"""The plan: a motion, its metrics, and how it was found."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from ff_planner_ros.arrays import Array, frozen
from ff_planner_ros.planning.metrics import Metrics as Metrics


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The sampled motion of the system, in the inertial frame; one row per point.

    The chaser frame has its origin at the centre of mass of the chaser alone and the axes of
    the base link; quaternions turn chaser or end effector axes to inertial axes.

    Attributes:
        time: From the start of the plan, at equal steps to the goal and, where there is a tail, at
            equal steps after it. Shape (points,) [s].
        joint_positions: Shape (points, joints) [rad].
        joint_velocities: Shape (points, joints) [rad/s].
        joint_accelerations: Shape (points, joints) [rad/s2].
        joint_torques: What makes the joints move so, Eq. (20). Shape (points, joints) [N m].
        chaser_positions: Shape (points, 3) [m].
        chaser_quaternions_xyzw: Shape (points, 4).
        chaser_linear_velocities: Of the chaser centre of mass. Shape (points, 3) [m/s].
        chaser_angular_velocities: Shape (points, 3) [rad/s].
        ee_positions: Shape (points, 3) [m].
        ee_quaternions_xyzw: Shape (points, 4).
        ee_linear_velocities: Shape (points, 3) [m/s].
        ee_angular_velocities: Shape (points, 3) [rad/s].
    """

    time: Array
    joint_positions: Array
    joint_velocities: Array
    joint_accelerations: Array
    joint_torques: Array
    chaser_positions: Array
    chaser_quaternions_xyzw: Array
    chaser_linear_velocities: Array
    chaser_angular_velocities: Array
    ee_positions: Array
    ee_quaternions_xyzw: Array
    ee_linear_velocities: Array
    ee_angular_velocities: Array

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for item in fields(self):
            object.__setattr__(self, item.name, frozen(getattr(self, item.name)))


@dataclass(frozen=True)
class SolverReport:
    """How the solver came to a path.

    Attributes:
        starts: First guesses tried.
        iterations: Quadratic programs solved, over all starts.
        rollouts: Over all starts, each with derivatives.
        optimality: First-order optimality of the path (norm of the Lagrangian's gradient);
            infinite where nothing was optimised.
        stop_reason: Why it stopped, a sentence.
    """

    starts: int
    iterations: int
    rollouts: int
    optimality: float
    stop_reason: str


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan that a consumer can trust: motion, metrics, and why the solver stopped.

    Attributes:
        joint_names: In the order of the trajectory's columns.
        trajectory: The sampled motion.
        xi: The paper's decision variables a6..a8 of the six components, Eq. (42). Shape (18,);
            empty where the end effector's path is no such polynomial.
        orientation_reading: What the last nine of them describe (see `polynomial`), or empty.
        metrics: What the plan is worth.
        solver: How it was found.
        family: Name of the path family; empty where the motion is no path of a family.
        coefficients: The path among its family's, flattened: a first guess for another plan. Shape
            (variables,), empty without a family.
    """

    joint_names: tuple[str, ...]
    trajectory: Trajectory
    xi: Array
    orientation_reading: str
    metrics: Metrics
    solver: SolverReport
    family: str = ""
    coefficients: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Make the decision variables read-only."""
        for name in ("xi", "coefficients"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
