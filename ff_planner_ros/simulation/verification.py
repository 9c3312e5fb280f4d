"""Does a plan come true? Its torques, executed open loop by an engine that knows nothing of it."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.sound_samples import require_sound_samples
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import Execution, execute, start_state
from ff_planner_ros.simulation.feed_forward import feed_forward

# As much as the planner's check allows a plan to miss its target: physics may not add more. Errors
# of interpolation and integration are less than a tenth of this.
POSITION_TOLERANCE = 1e-3  # [m]
ORIENTATION_TOLERANCE = np.deg2rad(0.05)  # [rad]

# Relative. Nothing pushes the system. If its momentum changes, the integration is too coarse for
# the motion, and the poses prove nothing. Sound plans stay below 1e-7.
MOMENTUM_TOLERANCE = 1e-6

# In one step neither a joint nor the chaser turns further [rad]: the error of RK4 is then below a
# hundredth of the tolerances. At least four steps, because the motion varies between two points.
STEP_TURN, MIN_STEPS_PER_POINT = 0.01, 4


@dataclass(frozen=True)
class Deviation:
    """How far an execution is from a plan."""

    final_position_error: float  # of the end effector at the last point [m]
    final_orientation_error: float  # of the end effector at the last point [rad]
    max_chaser_position_error: float  # of the chaser, at the worst of all points [m]
    max_chaser_orientation_error: float  # of the chaser, at the worst of all points [rad]


ALLOWED = Deviation(
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE, POSITION_TOLERANCE, ORIENTATION_TOLERANCE
)


@dataclass(frozen=True, eq=False)
class Verification:
    """What became of a plan in the independent engine."""

    execution: Execution  # what the system did
    deviation: Deviation  # from the plan
    momentum_drift: float  # largest change of the total momentum, relative

    @property
    def passed(self) -> bool:
        """Whether the plan came true within the tolerances."""
        found, allowed = astuple(self.deviation), astuple(ALLOWED)
        kept = all(value <= most for value, most in zip(found, allowed, strict=True))
        return kept and self.momentum_drift <= MOMENTUM_TOLERANCE


def verify(robot: Robot, trajectory: Trajectory) -> Verification:
    """Execute a plan's torques open loop in MuJoCo, and compare the motion with the plan.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    require_sound_samples(robot, trajectory)
    command = feed_forward(robot, trajectory, steps_per_point(trajectory))
    execution = execute(Engine(robot), start_state(trajectory), command)
    change = np.linalg.norm(execution.momentum - execution.momentum[0], axis=1).max()
    # A system whose total is zero is measured against the chaser's own momentum.
    speed = np.linalg.norm(trajectory.chaser_linear_velocities, axis=1).max()
    chaser_momentum = robot.model.inertias[1].mass * speed
    scale = max(np.linalg.norm(execution.momentum[0]), chaser_momentum, np.finfo(float).tiny)
    return Verification(execution, deviation(execution, trajectory), float(change / scale))


def steps_per_point(trajectory: Trajectory) -> int:
    """Return into how many steps the time between two points is cut."""
    fastest = max(
        np.abs(trajectory.joint_velocities).max(),
        np.linalg.norm(trajectory.chaser_angular_velocities, axis=1).max(),
    )
    turn = fastest * np.diff(trajectory.time).max()
    return max(MIN_STEPS_PER_POINT, int(np.ceil(turn / STEP_TURN)))


def deviation(execution: Execution, trajectory: Trajectory) -> Deviation:
    """Return how far an execution is from a plan."""
    chaser = np.linalg.norm(execution.chaser_positions - trajectory.chaser_positions, axis=1)
    chaser_turn = _angles(execution.chaser_quaternions_xyzw, trajectory.chaser_quaternions_xyzw)
    final = np.linalg.norm(execution.ee_positions[-1] - trajectory.ee_positions[-1])
    final_turn = _angles(execution.ee_quaternions_xyzw[-1:], trajectory.ee_quaternions_xyzw[-1:])
    return Deviation(
        final_position_error=float(final),
        final_orientation_error=float(final_turn[0]),
        max_chaser_position_error=float(chaser.max()),
        max_chaser_orientation_error=float(chaser_turn.max()),
    )


def _angles(quaternions_xyzw: Array, others_xyzw: Array) -> Array:
    """Return the angles between attitudes. Shape (points,) [rad]."""
    one, other = (
        quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        for quaternions in (quaternions_xyzw, others_xyzw)
    )
    # Both signs are the same attitude: that of the nearer one counts.
    other = np.copysign(1.0, (one * other).sum(axis=1, keepdims=True)) * other
    apart, together = np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1)
    return np.asarray(4.0 * np.arctan2(apart, together), np.float64)
