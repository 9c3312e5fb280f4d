"""What the planner answers."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ff_planner_ros.arrays import Array, frozen


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
class Metrics:
    """What the plan is worth, computed by the check after the solve.

    The objectives and the final errors are those at the goal; all others hold for a tail after it,
    too.

    Attributes:
        joint_path_length: Eq. (44) [rad].
        max_chaser_euler: Eq. (45) [rad].
        min_clearance: Of any link line from any sphere, certified between the points too [m];
            infinite without obstacles.
        min_joint_margin: To the nearest joint limit [rad].
        min_velocity_margin: Of any joint rate to its limit in the URDF, at the points [rad/s];
            negative beyond it, which only a problem that limits the rates forbids.
        peak_joint_torques: Largest absolute torque of each joint at the points [N m]; between them
            nothing is certified.
        torque_error: Largest difference of the plan's torques to those that its joint accelerations
            need while nothing pushes the chaser [N m].
        penalty: R_obst of Eqs. (46) and (47); zero for a collision-free plan.
        final_position_error: Of the end effector against the target [m].
        final_orientation_error: Of the end effector against the target [rad].
        momentum_error: Largest change of the total momentum along the plan, relative.
        min_singular_value: Smallest singular value of the generalised Jacobian J_D at the points;
            zero in a dynamic singularity.
        start_velocity_jump: Largest difference between the plan's first joint rates and the
            start state's [rad/s]. Eq. (31) has no null-space motion; a start that has is left.
    """

    joint_path_length: float
    max_chaser_euler: float
    min_clearance: float
    min_joint_margin: float
    min_velocity_margin: float
    peak_joint_torques: tuple[float, ...]
    torque_error: float
    penalty: float
    final_position_error: float
    final_orientation_error: float
    momentum_error: float
    min_singular_value: float
    start_velocity_jump: float


@dataclass(frozen=True)
class SolverReport:
    """How the solver came to its answer.

    Attributes:
        starts: First guesses tried.
        iterations: Quadratic programs solved, over all starts.
        rollouts: Over all starts, each with derivatives.
        optimality: First-order optimality at the answer (norm of the Lagrangian's gradient);
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
    """

    joint_names: tuple[str, ...]
    trajectory: Trajectory
    xi: Array
    orientation_reading: str
    metrics: Metrics
    solver: SolverReport

    def __post_init__(self) -> None:
        """Make the decision variables read-only."""
        object.__setattr__(self, "xi", frozen(self.xi))
