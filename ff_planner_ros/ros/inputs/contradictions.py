"""Contradictions of two messages on one quantity: differences that no motion explains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle, Sphere, TargetBody, carried
from ff_planner_ros.robot.configuration import without_turns
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.from_odometry import ChaserPart, JointPart

# Measurements of one thing differ by noise and by what a filter makes of it. The same distances as
# those within which a published plan may begin (publication.max_position and others) [m, rad].
_FURTHEST = 0.02


def of_states(before: SystemState, after: SystemState, time: float, robot: Robot) -> str:
    """Return in words how two states contradict each other; empty: they agree.

    Args:
        time: From the measurement of `before` to that of `after` [s]; may be negative.
        robot: Robot that the states are of.
    """
    return of_chasers(_chaser(before), _chaser(after), time) or of_joints(
        _joints(before), _joints(after), time, robot
    )


def of_chasers(before: ChaserPart, after: ChaserPart, time: float) -> str:
    """Return how two chaser motions contradict each other, as `of_states` does."""
    moved, explained = _moved(before[0], after[0], before[2], after[2], time)
    off = np.abs(moved) - explained
    if off.max() > _FURTHEST:
        return f"the chaser is {off.max():.3g} m away from where the other says"
    rate = (before[3] + after[3]) / 2.0
    predicted = Rotation.from_rotvec(rate * time) * Rotation.from_quat(before[1])
    angle = float((predicted.inv() * Rotation.from_quat(after[1])).magnitude())
    angle -= float(np.linalg.norm(after[3] - before[3])) * abs(time) / 2.0
    if angle > _FURTHEST:
        return f"the chaser is turned by {angle:.3g} rad from how the other says"
    return ""


def of_joints(before: JointPart, after: JointPart, time: float, robot: Robot) -> str:
    """Return how two joint states contradict each other, as `of_states` does."""
    moved, explained = _moved(before[0], after[0], before[1], after[1], time)
    off = np.abs(without_turns(moved, robot.continuous)) - explained
    if off.max() > _FURTHEST:
        joint = int(off.argmax())
        name, unit = robot.joint_names[joint], robot.unit(joint)
        return f"{name} is {before[0][joint]:.4g} and {after[0][joint]:.4g} {unit}"
    return ""


def of_bodies(before: TargetBody, after: TargetBody, time: float) -> str:
    """Return how two target bodies contradict each other, as `of_states` does."""
    there = before.after(time)
    off = float(np.linalg.norm(after.position - there.position))
    if off > _FURTHEST:
        return f"the body is {off:.3g} m away from where the other says"
    turn = Rotation.from_quat(there.quaternion_xyzw).inv() * Rotation.from_quat(
        after.quaternion_xyzw
    )
    if turn.magnitude() > _FURTHEST:
        return f"the body is turned by {turn.magnitude():.3g} rad from how the other says"
    return ""


def of_obstacles(before: Sequence[Obstacle], after: Sequence[Obstacle], time: float) -> str:
    """Return how two scenes contradict each other, as `of_states` does."""
    return next(_differences(before, after, time), "")


def _differences(
    before: Sequence[Obstacle], after: Sequence[Obstacle], time: float
) -> Iterator[str]:
    there = {one.id: one for one in carried(tuple(before), time)}
    here = {one.id: one for one in after}
    for name in sorted(there.keys() ^ here.keys()):
        yield f"one of them alone has {name}"
    for name, one in here.items():
        off = _apart(there[name], one)
        if off > _FURTHEST:
            how = f"by {off:.3g} m" if math.isfinite(off) else "in its shape"
            yield f"{name} differs {how}"


def _apart(before: Obstacle, after: Obstacle) -> float:
    """Return how far points of two obstacles are apart at most [m]; infinite: of other shapes."""
    if isinstance(before, Sphere) and isinstance(after, Sphere):
        off = float(np.linalg.norm(after.center - before.center))
        return off + abs(after.radius - before.radius)
    if isinstance(before, Sphere) or isinstance(after, Sphere):
        return math.inf
    one, other = before.solid, after.solid
    if one.kind != other.kind or one.corners.shape != other.corners.shape:
        return math.inf
    turn = Rotation.from_quat(before.quaternion_xyzw).inv() * Rotation.from_quat(
        after.quaternion_xyzw
    )
    off = float(np.linalg.norm(after.position - before.position))
    off += float(turn.magnitude()) * one.reach
    grown = np.linalg.norm(one.corners - other.corners, axis=1).max(initial=0.0)
    return off + float(np.abs(one.sizes - other.sizes).max(initial=0.0) + grown)


def _moved(
    before: Array, after: Array, rate: Array, later_rate: Array, time: float
) -> tuple[Array, Array]:
    """Return how far values are from where the mean rate leads, and what its change explains."""
    moved: Array = after - before - time * (rate + later_rate) / 2.0
    explained: Array = np.abs(time * (later_rate - rate)) / 2.0
    return moved, explained


def _chaser(state: SystemState) -> ChaserPart:
    return (
        state.position_chaser_in_inertial,
        state.quaternion_chaser_to_inertial_xyzw,
        state.linear_velocity_chaser_in_inertial,
        state.angular_velocity_chaser_in_inertial,
    )


def _joints(state: SystemState) -> JointPart:
    return state.joint_positions, state.joint_velocities
