"""Margins of a plan's constraints, and their first-order change with model and start errors.

A margin is a distance to a limit at one time of a plan with controlled joints; it must not be
negative. There are margins of obstacles, of the chaser's Euler angles and rotation angle, of the
approach corridor and of joint torques. Joint positions, velocities and accelerations, and distances
between the robot's bodies, do not change with the errors. The wrench and the impulse of a grasp and
the view of a camera do, and have no margin: a note says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.problem import Limits
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Directions
from ff_planner_ros.planning.robust.base_spread import (
    BaseSpread,
    TrackedMotion,
    torques_by_errors,
)
from ff_planner_ros.planning.robust.grasp_frames import grasp_frames
from ff_planner_ros.planning.robust.nearness import Nearness
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_from_rotation,
    rotation_vector_from_quaternion,
)
from ff_planner_ros.robot.rotation import euler_from_rotation, euler_rate_map

CLEARANCE, CORRIDOR, TORQUE = "clearance", "corridor", "torque"
ATTITUDE, ROTATION = "chaser_attitude", "chaser_rotation"
# Units, and names in messages.
UNITS = {CLEARANCE: "m", ATTITUDE: "rad", ROTATION: "rad", CORRIDOR: "m", TORQUE: "N m"}
WORDS = {
    CLEARANCE: "the clearance from obstacle",
    ATTITUDE: "the margin of limits.chaser_attitude",
    ROTATION: "the margin of limits.chaser_rotation",
    CORRIDOR: "the margin of the approach",
    TORQUE: "the torque margin of joint",
}

# A smaller angle has no axis [rad].
_NO_ANGLE = 1e-9
# Relative tolerance of a margin.
_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of one kind along a plan, to first order."""

    kind: str
    values: Array  # as planned; shape (rows,)
    by_errors: Array  # shape (rows, errors)
    which: Indices  # obstacle, joint or Euler angle that each is of, or zero; shape (rows,)
    time: Array  # shape (rows,) [s]

    @property
    def sigmas(self) -> Array:
        """Standard deviation of each margin. Shape (rows,)."""
        return np.asarray(np.linalg.norm(self.by_errors, axis=1), np.float64)

    def deviations(self, sigmas: float) -> Array:
        """Return the standard deviation of each margin, of a corridor an equivalent one-sided one.

        A normal error exceeds k deviations to one side with probability 1 - Phi(k), a 2-D error
        exceeds c of them to any side with exp(-c^2 / 2). The deviation of a corridor is scaled by
        c / k with c of equal probability.
        """
        if self.kind != CORRIDOR:
            return self.sigmas
        from scipy.special import log_ndtr  # slow to load, and only robust plans come here

        return float(np.sqrt(-2.0 * log_ndtr(-sigmas))) / sigmas * self.sigmas

    def lacking(self, sigmas: float) -> Indices:
        """Return the indices of margins that are less than so many deviations."""
        return np.flatnonzero(self.values < sigmas * self.deviations(sigmas) * (1.0 - _TOLERANCE))

    def in_deviations(self, sigmas: float) -> Array:
        """Return the margins in units of their deviations; infinite without a deviation."""
        deviations = self.deviations(sigmas)
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Array = np.where(deviations > 0.0, self.values / deviations, np.inf)
        return found

    def least(self, errors: Array) -> Array:
        """Return the least margin of each run, to first order; errors: shape (runs, errors)."""
        least: Array = (self.values + errors @ self.by_errors.T).min(axis=1)
        return least


def margins(
    motion: TrackedMotion,
    scene: Scene,
    near: Nearness,
    limits: Limits,
    of: Directions,
    spread: BaseSpread,
) -> list[Margins]:
    """Return the margins of a plan by kind, without kinds that have no limit.

    Args:
        scene: In the frame of the motion.
        near: `nearness` of the motion.
        of: Directions of the errors.
        spread: `base_spread` of the motion.
    """
    found = []
    if not near.is_empty:
        rows = near.rows_near(spread.pose)
        distances = near.by_errors(spread.pose, rows)
        found.append(
            Margins(CLEARANCE, near.distance[rows], distances, rows[2], motion.time[rows[0]])
        )
    if np.isfinite(limits.chaser_attitude):
        euler, by_errors = _attitude(motion, spread)
        most = np.full(3, limits.chaser_attitude)
        found.append(_both_ways(ATTITUDE, euler, by_errors, most, np.arange(3), motion.time))
    if limits.chaser_rotation < np.pi:
        angles, by_errors = _rotation(motion, spread)
        values, which = limits.chaser_rotation - angles, np.zeros(len(angles), np.intp)
        found.append(Margins(ROTATION, values, -by_errors, which, motion.time))
    corridor = _corridor(motion, scene, spread)
    if corridor is not None:
        found.append(corridor)
    if limits.joint_torques and np.isfinite(motion.robot.effort_limits).any():
        torques, by_errors = torques_by_errors(motion, of, spread)
        (limited,) = np.nonzero(np.isfinite(motion.robot.effort_limits))
        torques, by_errors = torques[:, limited], by_errors[:, limited]
        efforts, time = motion.robot.effort_limits[limited], motion.joints.time
        found.append(_both_ways(TORQUE, torques, by_errors, efforts, limited, time))
    return found


def ee_positions(motion: TrackedMotion) -> Array:
    """Return planned end-effector positions, in the frame of the motion. (times, 3) [m]."""
    return arm_points(motion.robot, motion.q)[:, -1]


def ee_by_errors(motion: TrackedMotion, spread: BaseSpread) -> Array:
    """Return the end effector's displacement by each error, linear first. (times, 6, errors)."""
    points, (linear, angular) = ee_positions(motion), np.split(spread.pose, 2, axis=1)
    moved = linear + np.cross(angular, points[:, :, None], axis=1)
    return np.concatenate([moved, angular], axis=1)


def turned_from_start(motion: TrackedMotion, rotations: Array) -> Array:
    """Return the chaser's Euler angles relative to its planned first attitude. (..., 3) [rad].

    Args:
        rotations: Base to inertial. Shape (..., 3, 3).
    """
    chaser = motion.robot.rotation_chaser_to_base
    start = rotation_base_to_inertial(motion.q[:1])[0] @ chaser
    return euler_from_rotation(start.T @ rotations @ chaser)


def _attitude(motion: TrackedMotion, spread: BaseSpread) -> tuple[Array, Array]:
    rotations = rotation_base_to_inertial(motion.q)
    euler = turned_from_start(motion, rotations)
    start = rotations[0] @ motion.robot.rotation_chaser_to_base
    return euler, np.linalg.solve(euler_rate_map(euler), start.T @ spread.pose[:, 3:])


def rotated_since_start(motion: TrackedMotion, rotations: Array) -> Array:
    """Return the chaser's rotation angles from its planned first attitude. Shape (...) [rad].

    Args:
        rotations: Base to inertial. Shape (..., 3, 3).
    """
    start = rotation_base_to_inertial(motion.q[:1])[0]
    return angle_of_quaternion(quaternion_from_rotation(start.T @ rotations))


def _rotation(motion: TrackedMotion, spread: BaseSpread) -> tuple[Array, Array]:
    """Return the angles of the chaser's rotation, and how they change with the errors.

    An error changes the angle by its rotation about the axis of the chaser's rotation. At the start
    there is no axis, and the derivative is taken as zero: the margin there is the whole limit.
    """
    rotations = rotation_base_to_inertial(motion.q)
    since = quaternion_from_rotation(rotations[0].T @ rotations)
    vectors, angles = rotation_vector_from_quaternion(since), angle_of_quaternion(since)
    axes = vectors / np.maximum(angles, _NO_ANGLE)[:, None]  # in those of the start
    return angles, np.einsum("ti,ji,tje->te", axes, rotations[0], spread.pose[:, 3:])


def _corridor(motion: TrackedMotion, scene: Scene, spread: BaseSpread) -> Margins | None:
    if scene.approach is None:
        return None
    frames = grasp_frames(scene, motion.robot.base, motion.time)
    if frames is None:
        return None
    count = frames.until
    places = frames.sees(ee_positions(motion)[:count])
    moved = np.einsum("tji,tje->tie", frames.rotations, ee_by_errors(motion, spread)[:count, :3])
    # Beyond the distance that is the margin, within it the planes all round the cone are.
    inside, (values, gradients) = scene.approach.margins(places), scene.approach.planes(places)
    far = np.flatnonzero(inside.by_cone == 0.0)
    values[far, 0], gradients[far, 0] = inside.values[far], inside.gradients[far]
    counts = np.ones_like(values, bool)
    counts[far, 1:] = False
    time, plane = np.nonzero(counts)
    return Margins(
        CORRIDOR,
        values[time, plane],
        np.einsum("ri,rie->re", gradients[time, plane], moved[time]),
        np.zeros(len(time), np.intp),
        motion.time[time],
    )


def _both_ways(
    kind: str, values: Array, by_errors: Array, limits: Array, which: Indices, time: Array
) -> Margins:
    """Return margins of values to their limits of both signs; values: shape (times, values)."""
    both = np.stack([limits - values, limits + values])
    return Margins(
        kind,
        both.reshape(-1),
        np.stack([-by_errors, by_errors]).reshape(both.size, -1),
        np.broadcast_to(which, both.shape).reshape(-1),
        np.broadcast_to(time[:, None], both.shape).reshape(-1),
    )
