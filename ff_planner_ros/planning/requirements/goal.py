"""The end effector is at its target, or the joints in their posture, at the goal time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.problem.problem import Orientation, Posture, Target
from ff_planner_ros.planning.requirements.requirement import (
    Assessment,
    Requirement,
    Samples,
    too_large,
)
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Robot

# A motion leaves its path where steps are long, or where a singularity lies between two.
_FOLLOW = "more points"
# Of two axes that are opposite but for less than this [rad] rounding says which one is across both,
# and it may say one of theirs.
_OPPOSITE = 1e-8


class Goal(Requirement):
    """The end effector reaches the target pose, or the joints their posture, at the goal time.

    It has no rows: a path family meets the goal by construction, or by equality constraints.
    """

    name = "goal"

    def assess(self, samples: Samples) -> Assessment:
        """Return the final errors [m, rad]: the larger of those of samples and tracked motion."""
        robot, target, settings = samples.problem.robot, samples.problem.target, samples.settings
        if samples.problem.posture is not None:  # of the end effector nothing is asked
            none = {"final_position_error": 0.0, "final_orientation_error": 0.0}
            return Assessment(none, tuple(_off_posture(samples, samples.problem.posture)))
        motion = samples.followed
        reached = motion.q[motion.pieces * samples.goal]
        misses = [miss(robot, q, target) for q in (reached, samples.q[samples.goal])]
        position, turn = np.linalg.norm(misses, axis=2).max(axis=0).tolist()
        found, advice = dict[str, float](), (_FOLLOW, "a nearer goal")
        failures = list[Failure]()
        for name, error, tolerance, unit in (
            ("final_position_error", position, settings.position_tolerance, " m"),
            ("final_orientation_error", turn, settings.orientation_tolerance, " rad"),
        ):
            found[name] = error
            failures += too_large(name, error, tolerance, unit, *advice)
        return Assessment(found, failures)


def _off_posture(samples: Samples, posture: Posture) -> Iterator[Failure]:
    """Yield how far the joints are from a posture, or from rest, at the goal."""
    motion, goal, robot = samples.trajectory, samples.goal, samples.problem.robot
    turn, way = samples.settings.orientation_tolerance, samples.settings.position_tolerance
    allowed = np.array([way if robot.slides(k) else turn for k in range(robot.joints)])
    off = [(motion.joint_velocities[goal] - posture.rates, "is faster", "/s")]
    if posture.positions is not None:
        off.append((motion.joint_positions[goal] - posture.positions, "is further", ""))
    for misses, verb, per_time in off:
        worst = int((np.abs(misses) / allowed).argmax())
        unit = robot.unit(worst) + per_time
        if not abs(misses[worst]) <= allowed[worst]:
            yield Failure(
                Status.CHECK_FAILED,
                f"at the goal joint {robot.joint_names[worst]} {verb} than asked "
                f"by {misses[worst]:.3g} {unit}, allowed is {allowed[worst]:.3g} {unit}",
                (_FOLLOW, "a longer duration"),
            )


def miss(robot: Robot, q: Array, target: Target) -> Array:
    """Return translation [m] and rotation vector [rad] from end effector to target, inertial axes.

    The rotation is the least that meets the target's orientation constraint; on a planar base,
    components out of the plane are zero.

    Returns:
        Shape (2, 3).
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    missed = np.concatenate(
        [target.position - tip.translation, _turn_to(target, np.asarray(tip.rotation))]
    )
    in_plane = np.zeros(6)
    in_plane[robot.base.tip_rows] = missed[robot.base.tip_rows]
    return in_plane.reshape(2, 3)


def _turn_to(target: Target, rotation: Array) -> Array:
    """Return the least turn to the target's orientation [rad], inertial axes; zero where free."""
    to_inertial = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    if target.orientation is Orientation.FREE:
        return np.zeros(3)
    if target.free_axis_in_ee is None:
        return np.asarray(pin.log3(to_inertial @ rotation.T), np.float64)
    here, there = rotation @ target.free_axis_in_ee, to_inertial @ target.free_axis_in_ee
    normal = np.cross(here, there)
    sine, cosine = float(np.linalg.norm(normal)), float(here @ there)
    # The same axis, or the opposite one: about any axis across it.
    if sine == 0.0 or (sine < _OPPOSITE and cosine < 0.0):
        across = np.eye(3)[int(np.abs(here).argmin())]
        normal = np.cross(here, across)
    angle = math.atan2(sine, cosine)
    return np.asarray(angle * normal / np.linalg.norm(normal), np.float64)


def beside(target: Target, way: Array, turn: Array) -> Target:
    """Return a target moved by a translation [m] and a rotation vector [rad], inertial axes."""
    by = pin.Quaternion(eigen_quaternion(pin.exp3(turn)))
    turned = by * pin.Quaternion(target.quaternion_xyzw)
    return replace(
        target, position=target.position + way, quaternion_xyzw=turned.normalized().coeffs()
    )
