"""What comes of a plan's samples: a controller follows them, and nothing pushes the system.

The joints move on the quintics through the samples, and the base as the momentum demands. That
is the motion which a plan promises, at its points and between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.forward import carried_base
from ff_planner_ros.planning.joint_motion import JointMotion
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum

# In one step of the integration nothing turns further [rad]: RK4 is off by less than 1e-7 then.
# A motion has this many steps at least: what is looked at between the points lies at their ends.
_STEP_TURN, _STEPS = 0.1, 98
# So fast [rad/s] a motion is refused, however well it is integrated.
_FASTEST = 20.0


@dataclass(frozen=True, eq=False)
class FollowedMotion:
    """The motion that follows from samples of the joints, at equal steps between two samples."""

    joints: JointMotion  # through the samples
    pieces: int  # steps from one sample to the next
    time: Array  # shape (times,) [s]
    q: Array  # configurations; shape (times, 7 + joints)
    v: Array  # tangent velocities; shape (times, 6 + joints)


def followed(
    robot: Robot, q_start: Array, v_start: Array, joints: JointMotion, multiple: int = 1
) -> FollowedMotion:
    """Return what comes of samples of the joints.

    Args:
        q_start: Configuration at the first sample. Shape (7 + joints,).
        v_start: Tangent velocity there; it says what the momentum is. Shape (6 + joints,).
        multiple: Of which the steps from one sample to the next are.
    """
    momentum = total_momentum(robot, robot.model.createData(), q_start, v_start)
    count, steps = len(joints.time) - 1, np.diff(joints.time)
    # What the arm's motion adds to the chaser's turn is less than what its joints turn.
    rates = np.linalg.norm(v_start[3:6]) + np.abs(joints.velocities).sum(axis=1).max()
    turn = min(float(rates), _FASTEST) * steps.max()
    pieces = max(_STEPS / count, turn / _STEP_TURN)
    pieces = multiple * int(np.ceil(pieces / multiple - 1e-9))
    time = np.interp(np.arange(pieces * count + 1), pieces * np.arange(count + 1), joints.time)
    q, v = carried_base(robot, q_start, momentum, joints, time)
    return FollowedMotion(joints, pieces, time, q, v)


def followed_path(
    problem: PlanningProblem, q: Array, v: Array, acceleration: Array
) -> FollowedMotion:
    """Return what comes of the points of a path that its plan holds: every first, second, ...

    Its steps end at all points of the path and half-way between them.

    Args:
        q: Configurations at equal steps of time. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        acceleration: dv/dt. Shape (points, 6 + joints).
    """
    every = points_per_sample(len(q), problem.points)
    time = np.linspace(0.0, 1.0, len(q[::every])) * problem.duration
    samples = (rows[::every] for rows in (q[:, 7:], v[:, 6:], acceleration[:, 6:]))
    return followed(problem.robot, q[0], v[0], JointMotion(time, *samples), 2 * every)


def points_per_sample(points: int, samples: int) -> int:
    """Return which points of a path a plan holds: every one, every second, ..."""
    every, rest = divmod(points - 1, samples - 1)
    return every if every and not rest else 1  # a path that fell short of its grid is shown whole
