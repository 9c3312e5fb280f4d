"""The free-floating motion that follows from a plan's samples, at its points and between them.

The joints move on the quintics through the samples, as a controller interpolates them, and the base
follows from the conserved momentum. The check computes this motion by `followed`, with Pinocchio;
the search by `followed_path.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum

# Largest rotation in one integration step [rad]: the error of RK4 is below 1e-7 then. And the
# fewest steps of a motion: between the points it is examined at their ends.
_STEP_TURN, _STEPS = 0.1, 98
# A faster motion [rad/s] is refused anyway, however well it is integrated.
_FASTEST = 20.0


@dataclass(frozen=True, eq=False)
class FollowedMotion:
    """The motion that follows from samples of the joints, at equal steps between two samples."""

    joints: JointMotion  # through the samples
    pieces: int  # steps from one sample to the next
    time: Array  # shape (times,) [s]
    q: Array  # configurations; shape (times, 7 + joints)
    v: Array  # tangent velocities; shape (times, 6 + joints)
    joint_accelerations: Array  # shape (times, joints) [rad/s2, m/s2]
    maps: Array | None = None  # of `momentum_maps`; None: not computed


def followed(
    robot: Robot, q_start: Array, v_start: Array, joints: JointMotion, multiple: int = 1
) -> FollowedMotion:
    """Return the free-floating motion that follows from samples of the joints.

    Args:
        q_start: Configuration at the first sample. Shape (7 + joints,).
        v_start: Tangent velocity there, which gives the momentum. Shape (6 + joints,).
        multiple: Divides the number of steps from one sample to the next.
    """
    momentum = total_momentum(robot, robot.model.createData(), q_start, v_start)
    pieces, time = steps_of(joints, v_start, multiple)
    return FollowedMotion(joints, pieces, time, *carried(robot, q_start, momentum, joints, time))


def steps_of(joints: JointMotion, v_start: Array, multiple: int) -> tuple[int, Array]:
    """Return the number of integration steps from one sample to the next, and the times of all [s].

    Args:
        v_start: Tangent velocity at the first sample. Shape (6 + joints,).
        multiple: Divides the number of steps.
    """
    count, steps = len(joints.time) - 1, np.diff(joints.time)
    # The arm's motion adds less to the chaser's rotation than its joints rotate.
    rates = np.linalg.norm(v_start[3:6]) + np.abs(joints.velocities).sum(axis=1).max()
    turn = min(float(rates), _FASTEST) * steps.max()
    pieces = max(_STEPS / count, turn / _STEP_TURN)
    pieces = multiple * int(np.ceil(pieces / multiple - 1e-9))
    return pieces, np.interp(
        np.arange(pieces * count + 1), pieces * np.arange(count + 1), joints.time
    )


class Peaks(NamedTuple):
    """The value of largest modulus of each of several quantities, its sign kept, and its time."""

    values: Array  # shape (quantities,)
    times: Array  # shape (quantities,) [s]


def peaks_of_steps(values: Array, motion: FollowedMotion) -> Peaks:
    """Return the peaks of quantities that are known at each step of a motion.

    They are the vertices of parabolas through three steps; those of torques are exact to 5e-4. No
    parabola crosses a sample, where torques have a kink, unless all steps end at samples.

    Args:
        values: At the times of the motion. Shape (times, quantities).
    """
    before, there, after = values[:-2], values[1:-1], values[2:]
    slope, curvature = (after - before) / 2, before + after - 2 * there
    aside = np.divide(-slope, curvature, out=np.zeros_like(slope), where=curvature != 0.0)
    at_point = np.arange(1, len(values) - 1) % motion.pieces == 0
    aside[(np.abs(aside) > 1.0) | (at_point[:, None] & (motion.pieces > 1))] = 0.0
    peaks = np.concatenate(
        [values[:1], there + slope * aside + curvature * aside**2 / 2, values[-1:]]
    )
    each, largest = np.arange(values.shape[1]), np.abs(peaks).argmax(axis=0)
    at_ends = np.zeros((1, values.shape[1]))
    steps = largest + np.concatenate([at_ends, aside, at_ends])[largest, each]
    times = np.interp(steps, np.arange(len(values)), motion.time)
    return Peaks(peaks[largest, each], times)
