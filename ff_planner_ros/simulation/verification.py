"""Verification of a plan: its torques, executed open loop by an independent physics engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.motion import from_trajectory, state_at
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import angular_momenta
from ff_planner_ros.simulation.capture import Capture, capture, is_soft
from ff_planner_ros.simulation.contacts import Contact, Touch
from ff_planner_ros.simulation.corridor import Corridor, corridor
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import (
    Execution,
    execution_of,
    states_after_steps,
)
from ff_planner_ros.simulation.feed_forward import FeedForward, feed_forward

# The final errors that the planner's check allows: physics may not add more. Errors of
# interpolation and integration are less than a tenth of this.
POSITION_TOLERANCE = 1e-3  # [m]
ORIENTATION_TOLERANCE = np.deg2rad(0.05)  # [rad]

# Of what holds the chaser's attitude [N m].
TORQUE_TOLERANCE = 1e-6

# Relative. Momentum is conserved: if it changes, the integration is too coarse for the motion, and
# the poses prove nothing. Sound plans stay below 1e-7.
MOMENTUM_TOLERANCE = 1e-6

# In one step neither a joint nor the chaser turns further [rad]: the error of RK4 is then below a
# hundredth of the tolerances. At least eight steps, because the motion varies between two points.
STEP_TURN, MIN_STEPS_PER_POINT = 0.01, 8
# Factors by which steps are refined while momentum or deviation exceed their tolerances: an arm of
# many joints, or with a heavy payload, diverges from its plan faster than it moves.
_FINER = (1, 2, 4, 8)
# A deviation that a refinement changes by less than this share of its tolerance is an error of the
# plan, not of RK4.
_CONVERGED = 0.01
_STANDSTILL = 1e-6  # [m/s]
# Of a whole execution: ten thousand points of a sound plan need less. It takes ten seconds.
MOST_STEPS = 100_000

_EMPTY = Scene()


@dataclass(frozen=True)
class Deviation:
    """Deviations of an execution from a plan."""

    final_position_error: float  # of the end effector at the last point [m]
    final_orientation_error: float  # of the end effector at the last point [rad]
    max_chaser_position_error: float  # of the chaser, at the worst of all points [m]
    max_chaser_orientation_error: float  # of the chaser, at the worst of all points [rad]


ALLOWED = Deviation(
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE, POSITION_TOLERANCE, ORIENTATION_TOLERANCE
)


@dataclass(frozen=True, eq=False)
class Verification:
    """The result of executing a plan in the independent engine."""

    execution: Execution  # what the system did, in the plan's inertial frame
    deviation: Deviation  # from the plan
    momentum_drift: float  # largest change of the total momentum, relative
    contacts: tuple[Contact, ...] = ()  # the earliest first
    pairs: int = 0  # number of pairs that were checked for contacts
    capture: Capture | None = None  # of the target body; None: there is none
    corridor: Corridor | None = None  # of the approach; None: there is none
    # Largest difference, over three axes and all points, between the torque that holds the base
    # and the plan's wheel torque [N m]; None: no wheels hold the base
    holding_torque_error: float | None = None

    @property
    def came_true(self) -> bool:
        """Whether pose deviations, capture, holding torque and momentum are within tolerances."""
        kept = _is_allowed(self.deviation)
        soft = self.capture is None or is_soft(self.capture)
        held = (self.holding_torque_error or 0.0) <= TORQUE_TOLERANCE
        return kept and soft and held and self.momentum_drift <= MOMENTUM_TOLERANCE

    @property
    def passed(self) -> bool:
        """Whether the plan was reproduced, kept its corridor, and had no forbidden contact."""
        return self.came_true and self.kept_corridor and not self.contacts

    @property
    def kept_corridor(self) -> bool:
        """Whether the end effector stayed in its corridor, within `POSITION_TOLERANCE`."""
        return self.corridor is None or self.corridor.margin >= -POSITION_TOLERANCE


def verify(robot: Robot, trajectory: Trajectory, scene: Scene = _EMPTY) -> Verification:
    """Execute a plan's torques open loop in MuJoCo, and compare the motion with the plan.

    All contacts of the executed motion are found, of the robot's bodies, or of its centre lines
    with obstacles. A target body is a second free body.

    Args:
        scene: In the plan's inertial frame, at the plan's first point.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    require_sound_samples(robot, trajectory)
    engine = Engine(robot)
    planned = beside_center_of_mass(engine, trajectory)
    steps = steps_per_point(planned)
    coarser: Deviation | None = None
    for finer in _FINER:
        if finer > 1 and finer * steps * (len(planned.time) - 1) > MOST_STEPS:
            break
        command = feed_forward(robot, planned, finer * steps)
        states = states_after_steps(engine, state_at(planned, 0), command)
        execution = execution_of(engine, states, command)
        drift = _momentum_drift(robot, engine, planned, execution)
        found = deviation(execution, planned)
        if drift <= MOMENTUM_TOLERANCE and (_is_allowed(found) or _has_converged(found, coarser)):
            break
        coarser = found
    origin, velocity = engine.center_of_mass(state_at(trajectory, 0))
    seen = scene.captured_at(float(trajectory.time[-1])).seen_from(origin, velocity)
    touch = Touch(robot, seen)
    return Verification(
        execution=_seen_in(execution, origin, velocity, engine.mass),
        deviation=found,
        momentum_drift=drift,
        contacts=touch.along(states, command.time[::2]),
        pairs=touch.pairs,
        capture=_capture(seen, execution),
        corridor=corridor(seen, robot.base, engine, states, command.time[::2]),
        holding_torque_error=_holding_torque_error(robot, engine, planned, states, command),
    )


def _holding_torque_error(
    robot: Robot,
    engine: Engine,
    planned: Trajectory,
    states: Sequence[Array],
    command: FeedForward,
) -> float | None:
    """Return the largest difference between the torque on a held base and the plan's wheel torque.

    None: no wheels hold the base. Infinite: the motion has diverged.
    """
    if robot.wheels is None:
        return None
    q, v = from_trajectory(robot, planned)
    _, rates = angular_momenta(robot, q, v, planned.joint_accelerations)
    at_points = states[:: command.steps_per_point]
    if len(at_points) < len(q):
        return np.inf
    torques = command.torques[:: 2 * command.steps_per_point]
    pairs = zip(at_points, torques, strict=True)
    holding = np.array([engine.holding_torque(*at) for at in pairs])
    return float(np.abs(holding - rates).max())


def _capture(scene: Scene, execution: Execution) -> Capture | None:
    """Return the errors of the capture of a scene's target body; None: there is none."""
    if scene.target_body is None or scene.capture_time is None:
        return None
    return capture(scene.target_body, scene.capture_time, execution)


def _momentum_drift(
    robot: Robot, engine: Engine, planned: Trajectory, execution: Execution
) -> float:
    """Return the largest change of the total momentum, relative."""
    kept = execution.momentum[:, robot.base.rows]
    change = np.linalg.norm(kept - kept[0], axis=1).max()
    # If the total is zero, the scale is the chaser's own momentum; at rest, that of a slow motion.
    speed = np.linalg.norm(planned.chaser_linear_velocities, axis=1).max()
    of_chaser = robot.model.inertias[1].mass * speed
    scale = max(np.linalg.norm(kept[0]), of_chaser, engine.mass * _STANDSTILL)
    return float(change / scale)


def beside_center_of_mass(engine: Engine, trajectory: Trajectory) -> Trajectory:
    """Return a plan in the inertial frame that moves with the system's centre of mass.

    The axes are the same. Far from the origin, or at high velocity, MuJoCo would lose digits.
    """
    origin, velocity = engine.center_of_mass(state_at(trajectory, 0))
    way = np.outer(trajectory.time, velocity)
    return replace(
        trajectory,
        chaser_positions=(trajectory.chaser_positions - origin) - way,
        chaser_linear_velocities=trajectory.chaser_linear_velocities - velocity,
        ee_positions=(trajectory.ee_positions - origin) - way,
        ee_linear_velocities=trajectory.ee_linear_velocities - velocity,
    )


def _seen_in(execution: Execution, origin: Array, velocity: Array, mass: float) -> Execution:
    """Return an execution in the plan's inertial frame: the inverse of `beside_center_of_mass`."""
    centers = origin + np.outer(execution.time, velocity)
    linear, angular = np.split(execution.momentum, 2, axis=1)
    linear = linear + mass * velocity
    return replace(
        execution,
        chaser_positions=execution.chaser_positions + centers,
        ee_positions=execution.ee_positions + centers,
        ee_twists=execution.ee_twists + np.concatenate([velocity, np.zeros(3)]),
        momentum=np.hstack([linear, angular + np.cross(centers, linear)]),
    )


def steps_per_point(trajectory: Trajectory) -> int:
    """Return the number of integration steps between two points.

    Raises:
        InvalidInput: There would be too many: the motion rotates too far between two points.
    """
    fastest = max(
        np.abs(trajectory.joint_velocities).max(),
        np.linalg.norm(trajectory.chaser_angular_velocities, axis=1).max(),
    )
    longest, pieces = np.diff(trajectory.time).max(), len(trajectory.time) - 1
    with np.errstate(over="ignore"):
        steps = max(MIN_STEPS_PER_POINT, np.ceil(fastest * longest / STEP_TURN))
    if not steps * pieces <= MOST_STEPS:
        found = f"{pieces + 1} points, up to {longest:.3g} s apart"
        allowed = (
            f"with rates of up to {fastest:.3g} rad/s that takes {steps * pieces:.3g} steps to "
            f"integrate, and it must not be more than {MOST_STEPS}"
        )
        raise InvalidInput(Status.OUT_OF_RANGE, "time", found, allowed)
    return int(steps)


def _is_allowed(found: Deviation) -> bool:
    return all(value <= most for value, most in zip(astuple(found), astuple(ALLOWED), strict=True))


def _has_converged(found: Deviation, coarser: Deviation | None) -> bool:
    """Tell whether a deviation is that of twice as long steps, but for a share of the tolerance."""
    if coarser is None:
        return False
    values = zip(astuple(found), astuple(coarser), astuple(ALLOWED), strict=True)
    return all(abs(one - other) <= _CONVERGED * most for one, other, most in values)


def deviation(execution: Execution, trajectory: Trajectory) -> Deviation:
    """Return the deviations of an execution from a plan in the same inertial frame."""
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
    # q and -q are the same attitude: the nearer one counts.
    other = np.copysign(1.0, (one * other).sum(axis=1, keepdims=True)) * other
    apart, together = np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1)
    return np.asarray(4.0 * np.arctan2(apart, together), np.float64)
