"""Errors of a capture: pose and velocity of the end effector relative to the target's grasp.

In MuJoCo the target is a free body without forces. As nothing touches it before the capture, it is
integrated in a model of its own. `captured` compares two measurements instead; `corridor` is the
margin of a motion to the approach corridor, `path_followed` its errors along a path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.path.followed import PathToFollow
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.deviation import ORIENTATION_TOLERANCE, POSITION_TOLERANCE

if TYPE_CHECKING:
    from ff_planner_ros.simulation.engine import Engine
    from ff_planner_ros.simulation.execution import Execution

# Largest rotation of the body in one step of the engine's RK4 [rad], and fewest steps.
_STEP_TURN, _LEAST_STEPS = 0.005, 100


@dataclass(frozen=True)
class Capture:
    """Errors of the end effector's pose and velocity relative to the grasp, at the capture."""

    position_error: float  # [m]
    orientation_error: float  # [rad]
    linear_speed: float  # relative to the body's point at the end effector [m/s]
    angular_speed: float  # relative to the body [rad/s]


# The errors of pose that the planner's check allows, and as much in a second.
ALLOWED_AT_CAPTURE = Capture(1e-3, np.deg2rad(0.05), 1e-3, np.deg2rad(0.05))


def is_soft(found: Capture) -> bool:
    """Tell whether all errors of a capture are within `ALLOWED_AT_CAPTURE`."""
    pairs = zip(astuple(found), astuple(ALLOWED_AT_CAPTURE), strict=True)
    return all(value <= allowed for value, allowed in pairs)


def capture(body: TargetBody, time: float, execution: Execution) -> Capture:
    """Return the errors of a capture in an execution; NaN if the execution has diverged.

    Args:
        body: In its state at the plan's first point, in the execution's inertial frame.
        time: Time of the capture, from the plan's first point on; one of the execution's [s].
    """
    at = int(np.abs(execution.time - time).argmin())
    if not np.isfinite(execution.ee_positions[at]).all():
        return Capture(np.nan, np.nan, np.nan, np.nan)
    positions, attitudes, twists = moved_in_engine(body, execution.time[at : at + 1])
    position, attitude, twist = positions[0], attitudes[0], twists[0]
    grasp_attitude = attitude * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    lever = attitude.apply(body.grasp_position.copy())
    way = execution.ee_positions[at] - (position + lever)
    turn = Rotation.from_quat(execution.ee_quaternions_xyzw[at].copy()) * grasp_attitude.inv()
    linear, angular = np.split(execution.ee_twists[at], 2)
    # Of the body's point where the end effector is.
    there = twist[:3] + np.cross(twist[3:], lever + way)
    return Capture(
        position_error=float(np.linalg.norm(way)),
        orientation_error=float(turn.magnitude()),
        linear_speed=float(np.linalg.norm(linear - there)),
        angular_speed=float(np.linalg.norm(angular - twist[3:])),
    )


def captured(robot: Robot, state: SystemState, body: TargetBody) -> Capture:
    """Return the errors of a capture from measured states of robot and body at one time."""
    pose, twist = end_effector_motion(robot, state)
    grasp = body.grasp(np.zeros(1))
    way, seen = pose.translation - grasp.positions[0], grasp.twists[0]
    turn = Rotation.from_matrix(pose.rotation @ grasp.rotations[0].T)
    # Of the body's point where the end effector is.
    there = seen[:3] + np.cross(seen[3:], way)
    return Capture(
        position_error=float(np.linalg.norm(way)),
        orientation_error=float(turn.magnitude()),
        linear_speed=float(np.linalg.norm(twist[:3] - there)),
        angular_speed=float(np.linalg.norm(twist[3:] - seen[3:])),
    )


def end_effector_motion(robot: Robot, state: SystemState) -> tuple[pin.SE3, Array]:
    """Return the end effector's inertial pose and twist, linear first, (6,) [m/s, rad/s]."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, *configuration(robot, state))
    pose = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy()
    axes = pin.LOCAL_WORLD_ALIGNED
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, axes).vector
    return pose, np.array(twist)


def moved_in_engine(body: TargetBody, times: Array) -> tuple[Array, Rotation, Array]:
    """Return a free body's motion in MuJoCo: centre of mass, attitude and twist at each time.

    All are inertial; shapes (times, 3) [m], (times,) rotations and (times, 6) [m/s, rad/s].

    Args:
        times: Since the body's state, ascending. Shape (times,) [s].
    """
    # MuJoCo refuses moments that are far from its own units; only their ratios matter.
    moments, axes = np.linalg.eigh(body.inertia / np.trace(body.inertia))
    axes[:, 0] *= np.linalg.det(axes)
    to_body = Rotation.from_matrix(axes)
    from ff_planner_ros.simulation.mujoco_model import (
        mujoco,  # who compares measurements needs none
    )

    spec = mujoco.MjSpec()
    free = spec.worldbody.add_body(mass=1.0, inertia=moments, explicitinertial=True)
    free.add_freejoint()
    model = spec.compile()
    model.opt.gravity = 0.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    longest = times[-1] / max(_LEAST_STEPS, np.ceil(body.fastest_turn * times[-1] / _STEP_TURN))
    data = mujoco.MjData(model)
    # The centre of mass moves uniformly, so only the attitude is integrated: far away digits would
    # be lost. To MuJoCo the body's axes are its principal ones.
    main = Rotation.from_quat(body.quaternion_xyzw.copy()) * to_body
    data.qpos[3:] = np.roll(main.as_quat(), 1)
    data.qvel[3:] = main.as_matrix().T @ body.angular_velocity
    turns, rates = np.empty((len(times), 4)), np.empty((len(times), 3))
    for number, way in enumerate(np.diff(times, prepend=0.0)):
        if way > 0.0:
            # But for rounding, as many steps as there would be to the last time alone.
            steps = max(1, round(way / longest + 0.5 - 1e-9))
            model.opt.timestep = way / steps
            mujoco.mj_step(model, data, steps)
        turns[number], rates[number] = np.roll(data.qpos[3:], -1), data.qvel[3:]
    mains = Rotation.from_quat(turns)
    linear = np.broadcast_to(body.linear_velocity, rates.shape)
    positions = body.position + np.outer(times, body.linear_velocity)
    return positions, mains * to_body.inv(), np.hstack([linear, mains.apply(rates)])


@dataclass(frozen=True)
class Corridor:
    """How far an execution stays inside the approach corridor."""

    margin: float  # smallest distance to the corridor's side; negative: outside [m]
    time: float  # of this margin, from the start of the plan [s]
    inside_from: float  # from then on the end effector stays within the approach's distance [s]


def corridor(
    scene: Scene, base: Base, engine: Engine, states: Sequence[Array], times: Array
) -> Corridor | None:
    """Return how far a motion stays inside the corridor until the capture; None: there is none.

    Args:
        states: States of the engine, in the scene's inertial frame.
        times: From the start of the plan, at least as many as states. Shape (times,) [s].
    """
    captured, approach = scene.capture_time, scene.approach
    if approach is None or captured is None:
        return None
    # The last one is that at the capture, but for rounding.
    count = int(np.searchsorted(times[: len(states)], captured + np.diff(times).min() / 2))
    grasps = _grasps(scene, times[:count], captured)
    if grasps is None:
        return None
    positions, turns = grasps
    points = np.array([engine.observe(state).ee_position for state in states[:count]])
    # With a planar base the height does not count.
    way = np.isin(range(3), base.rows) * (points - positions)
    places = turns.inv().apply(way)
    margins, away = approach.margins(places).values, np.linalg.norm(places, axis=1)
    least, outside = int(margins.argmin()), np.flatnonzero(away > approach.distance)
    inside = min(int(outside[-1]) + 1, count - 1) if outside.size else 0
    return Corridor(float(margins[least]), float(times[least]), float(times[inside]))


def _grasps(scene: Scene, times: Array, captured: float) -> tuple[Array, Rotation] | None:
    """Return positions and orientations of the grasp at times; of a body, by the engine.

    None: the goal is not known.
    """
    body, target = scene.target_body, scene.target
    if body is not None:
        positions, attitudes, _ = moved_in_engine(body, times)
        turns = attitudes * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
        return positions + attitudes.apply(body.grasp_position.copy()), turns
    if target is None:
        return None
    later = times - captured
    turned = Rotation.from_rotvec(np.outer(later, target.angular_velocity))
    positions = target.position + np.outer(later, target.linear_velocity)
    return positions, turned * Rotation.from_quat(target.quaternion_xyzw.copy())


@dataclass(frozen=True)
class PathFollowed:
    """The largest errors of an execution's end effector along a path."""

    position_error: float  # [m]
    orientation_error: float | None  # [rad]; None: the orientation is free
    time: float  # of the largest position error, from the start of the plan [s]

    def is_within(self, path: PathToFollow) -> bool:
        """Tell whether the errors are within a path's tolerances and those of an execution."""
        turn = self.orientation_error or 0.0
        return (
            self.position_error <= path.position_tolerance + POSITION_TOLERANCE
            and turn <= path.orientation_tolerance + ORIENTATION_TOLERANCE
        )


def path_followed(
    path: PathToFollow | None,
    base: Base,
    planned: Trajectory,
    engine: Engine,
    states: Sequence[Array],
    times: Array,
) -> PathFollowed | None:
    """Return the largest errors of a motion along a path; None: there is no path.

    Args:
        path: In the inertial frame of the motion.
        planned: Its first point is where the path begins, likewise.
        states: States of the engine.
        times: From the start of the plan, at least as many as states. Shape (times,) [s].
    """
    if path is None:
        return None
    count = int((times[: len(states)] <= path.duration * (1.0 + 1e-12)).sum())
    twist = (planned.ee_linear_velocities[0], planned.ee_angular_velocities[0])
    poses = path.curve(np.concatenate(twist)).at(times[:count])
    seen = [engine.observe(state) for state in states[:count]]
    counts = np.isin(range(6), base.tip_rows)
    apart = counts[:3] * (np.array([one.ee_position for one in seen]) - poses.positions)
    away, turn = np.linalg.norm(apart, axis=1), None
    if poses.quaternions is not None:
        wanted = Rotation.from_quat(poses.quaternions)
        turned = Rotation.from_quat([one.ee_quaternion_xyzw for one in seen]) * wanted.inv()
        turn = float(np.linalg.norm(counts[3:] * turned.as_rotvec(), axis=1).max())
    return PathFollowed(float(away.max()), turn, float(times[int(away.argmax())]))
