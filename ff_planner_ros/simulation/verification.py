"""Verification of a plan: its torques, executed open loop by an independent physics engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.motion import from_trajectory, state_at
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import angular_momenta
from ff_planner_ros.simulation.capture import (
    Capture,
    Corridor,
    PathFollowed,
    capture,
    corridor,
    is_soft,
    path_followed,
)
from ff_planner_ros.simulation.contacts import Contact, Touch
from ff_planner_ros.simulation.deviation import (
    POSITION_TOLERANCE,
    Deviation,
    deviation,
    has_converged,
    is_allowed,
)
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import (
    Execution,
    execution_of,
    states_after_steps,
)
from ff_planner_ros.simulation.feed_forward import FeedForward, feed_forward

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
_FINER = (2, 4, 8)
# Deviations that are larger at the end of an execution than half-way by this factor grow
# exponentially: under constant errors of the torques they grow with the square of time, fourfold.
_UNSTABLE = 50.0
# Numbers of parts that an unstable motion is executed in, two numbers each time.
_PARTS = ((4, 5), (12, 13))
_STANDSTILL = 1e-6  # [m/s]
# Of a whole execution: ten thousand points of a sound plan need less. It takes ten seconds.
MOST_STEPS = 100_000

_EMPTY = Scene()


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
    path: PathFollowed | None = None  # of the path to follow; None: there is none
    kept_path: bool = True  # whether it was followed within its tolerances
    # Largest difference, over three axes and all points, between the torque that holds the base
    # and the plan's wheel torque [N m]; None: no wheels hold the base
    holding_torque_error: float | None = None
    parts: int = 1  # that the plan was executed in, each from a state of the plan; see `verify`

    FACTS = ("passed", "deviation", "momentum_drift", "contacts", "pairs")
    __repr__ = in_a_line

    @property
    def came_true(self) -> bool:
        """Whether pose deviations, capture, holding torque and momentum are within tolerances."""
        soft = self.capture is None or is_soft(self.capture)
        return soft and _is_reproduced(self)

    @property
    def passed(self) -> bool:
        """Whether the plan was reproduced, kept corridor and path, and had no forbidden contact."""
        return self.came_true and self.kept_corridor and self.kept_path and not self.contacts

    @property
    def kept_corridor(self) -> bool:
        """Whether the end effector stayed in its corridor, within `POSITION_TOLERANCE`."""
        return self.corridor is None or self.corridor.margin >= -POSITION_TOLERANCE


def verify(robot: Robot, trajectory: Trajectory, scene: Scene = _EMPTY) -> Verification:
    """Execute a plan's torques open loop in MuJoCo, and compare the motion with the plan.

    All contacts of the executed motion are found, of the robot's bodies, or of its centre lines
    with obstacles. A target body is a second free body.

    Without feedback an arm of many joints, or with a heavy payload, may be unstable: the smallest
    error grows exponentially, in any engine. Such a motion is executed in parts that each begin on
    the plan. The sum of the parts' deviations is multiplied by the number of parts, so that a
    constant error of the torques counts as much as in an execution of the whole plan.

    Args:
        scene: In the plan's inertial frame, at the plan's first point.

    Raises:
        InvalidInput: An argument is of another kind, the samples cannot be executed, or MuJoCo
            refuses the robot's URDF.
    """
    an_object("robot", robot, Robot)
    an_object("trajectory", trajectory, Trajectory)
    an_object("scene", scene, Scene)
    require_sound_samples(robot, trajectory)
    engine = Engine(robot)
    planned = beside_center_of_mass(engine, trajectory)
    found = _executed_whole(robot, engine, planned)
    if not _is_reproduced(found) and _is_unstable(found.execution, planned):
        found = _executed_in_parts(robot, engine, planned, found)
    origin, velocity = engine.center_of_mass(state_at(trajectory, 0))
    seen = scene.captured_at(float(trajectory.time[-1])).seen_from(origin, velocity)
    touch, times = Touch(robot, seen), found.command.time[::2]
    path = path_followed(seen.path, robot.base, planned, engine, found.states, times)
    return Verification(
        execution=_seen_in(found.execution, origin, velocity, engine.mass),
        deviation=found.deviation,
        momentum_drift=found.momentum_drift,
        contacts=touch.along(found.states, times),
        pairs=touch.pairs,
        capture=_capture(seen, found.execution),
        corridor=corridor(seen, robot.base, engine, found.states, times),
        path=path,
        kept_path=path is None or seen.path is None or path.is_within(seen.path),
        holding_torque_error=found.holding_torque_error,
        parts=found.parts,
    )


@dataclass(frozen=True, eq=False)
class _Run:
    """An execution of a plan, in so many parts that each begin on the plan."""

    parts: int
    command: FeedForward
    states: Sequence[Array]
    execution: Execution
    deviation: Deviation
    momentum_drift: float
    holding_torque_error: float | None


def _is_reproduced(found: _Run | Verification) -> bool:
    held = (found.holding_torque_error or 0.0) <= TORQUE_TOLERANCE
    return is_allowed(found.deviation) and held and found.momentum_drift <= MOMENTUM_TOLERANCE


def _run(robot: Robot, engine: Engine, planned: Trajectory, steps: int, parts: int) -> _Run:
    command = feed_forward(robot, planned, steps)
    ends = np.linspace(0, len(planned.time) - 1, parts + 1).astype(int)[1:]
    begins = {int(end) * steps: state_at(planned, int(end)) for end in ends[:-1]}
    states = states_after_steps(engine, state_at(planned, 0), command, begins)
    execution = execution_of(engine, states, command)
    return _Run(
        parts=parts,
        command=command,
        states=states,
        execution=execution,
        deviation=deviation(execution, planned, ends.tolist()),
        momentum_drift=_momentum_drift(robot, engine, planned, execution),
        holding_torque_error=_holding_torque_error(robot, engine, planned, states, command),
    )


def _executed_whole(robot: Robot, engine: Engine, planned: Trajectory) -> _Run:
    """Return the execution of a whole plan, with steps as fine as it needs."""
    steps = steps_per_point(planned)
    found = _run(robot, engine, planned, steps, 1)
    for finer in _FINER:
        if _is_reproduced(found):
            break
        if finer * steps * (len(planned.time) - 1) > MOST_STEPS:
            break
        coarser, found = found.deviation, _run(robot, engine, planned, finer * steps, 1)
        if found.momentum_drift <= MOMENTUM_TOLERANCE and has_converged(found.deviation, coarser):
            break
    return found


def _is_unstable(execution: Execution, planned: Trajectory) -> bool:
    """Tell whether deviations grow as no constant error of the torques lets them."""
    off = np.abs(execution.joint_positions - planned.joint_positions).max(axis=1)
    off = off[np.isfinite(off)]
    return bool(off[-1] > _UNSTABLE * off[len(off) // 2])


def _executed_in_parts(robot: Robot, engine: Engine, planned: Trajectory, whole: _Run) -> _Run:
    """Return the worse of two executions in parts, if both reproduce the plan, or else `whole`.

    An error just before the end of a part hardly counts; in the other execution, that part goes on.
    """
    steps = whole.command.steps_per_point
    for pair in _PARTS:
        if len(planned.time) <= 2 * max(pair):
            break
        found = [_run(robot, engine, planned, steps, parts) for parts in pair]
        if all(map(_is_reproduced, found)):
            return max(found, key=lambda one: one.deviation.final_position_error)
    return whole


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
