"""The target body in the engine: how the end effector is to its grasp when it captures the body.

The body is a second free body that nothing acts on. Until it is captured it touches nothing, so it
is moved in a model of its own; the robot's stays as it is. `captured` compares two measurements.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

if TYPE_CHECKING:
    from ff_planner_ros.simulation.execution import Execution

# In one step of the engine's RK4 the body turns no further [rad]; it takes so many steps at least.
_STEP_TURN, _LEAST_STEPS = 0.005, 100


@dataclass(frozen=True)
class Capture:
    """How the end effector is to the grasp, and moves to it, when the plan captures the body."""

    position_error: float  # [m]
    orientation_error: float  # [rad]
    linear_speed: float  # of the end effector as the grasp sees it [m/s]
    angular_speed: float  # [rad/s]


# As much as the planner's check allows a plan to miss its target, and so much in a second.
ALLOWED_AT_CAPTURE = Capture(1e-3, np.deg2rad(0.05), 1e-3, np.deg2rad(0.05))


def is_soft(found: Capture) -> bool:
    """Tell whether a capture is within what is allowed."""
    pairs = zip(astuple(found), astuple(ALLOWED_AT_CAPTURE), strict=True)
    return all(value <= allowed for value, allowed in pairs)


def capture(body: TargetBody, time: float, execution: Execution) -> Capture:
    """Return how an execution captures a body, both in one inertial frame.

    Args:
        time: Of the capture, from the plan's first point on; one of the execution's [s].
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
    """Return how the end effector is to the grasp of a body, and moves to it, at one moment."""
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
    """Return pose and twist of the end effector in a state, in inertial axes, linear first."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, *configuration(robot, state))
    pose = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy()
    axes = pin.LOCAL_WORLD_ALIGNED
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, axes).vector
    return pose, np.array(twist)


def moved_in_engine(body: TargetBody, times: Array) -> tuple[Array, Rotation, Array]:
    """Return where the engine moves a body: centre of mass, attitude and twist at each time.

    Args:
        times: From where the body is told, ascending. Shape (times,) [s].
    """
    # MuJoCo refuses moments that are far from its own units; only their ratios matter.
    moments, axes = np.linalg.eigh(body.inertia / np.trace(body.inertia))
    axes[:, 0] *= np.linalg.det(axes)
    to_body = Rotation.from_matrix(axes)
    from ff_planner_ros.simulation.engine import mujoco  # who compares measurements needs none

    spec = mujoco.MjSpec()
    free = spec.worldbody.add_body(mass=1.0, inertia=moments, explicitinertial=True)
    free.add_freejoint()
    model = spec.compile()
    model.opt.gravity = 0.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    longest = times[-1] / max(_LEAST_STEPS, np.ceil(body.fastest_turn * times[-1] / _STEP_TURN))
    data = mujoco.MjData(model)
    # Beside its centre of mass, whose motion is no question: far away digits would be lost. The
    # axes are the main ones of its inertia.
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
