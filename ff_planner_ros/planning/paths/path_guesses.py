"""Initial guesses of joint splines along a path to follow, by resolved motion rates.

In each step the end effector moves to where the path is then, and the base as momentum is conserved
(the generalised Jacobian). What joints are to spare keeps their velocities small, or turns the
chaser little, and may follow a detour.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, cycle, repeat
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.even_normals import even_normals
from ff_planner_ros.planning.paths.spline_basis import FIXED, SplineBasis
from ff_planner_ros.planning.problem.path.curve import Poses
from ff_planner_ros.planning.problem.path.followed import curve_of
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.kinematics import arm_reach
from ff_planner_ros.robot.momentum import mass_matrix, total_momentum

if TYPE_CHECKING:
    from ff_planner_ros.planning.paths.joint_spline import JointSplines

# Steps of a guess, or so many a point of the path, but no more than the most.
_STEPS, _STEPS_EACH, _MOST_STEPS = 200, 4, 1000
# Singular values of the generalised Jacobian below this are damped.
_DAMPING = 3e-4
# Weights of the chaser's rotation, as multiples of the joints' own where the plan begins.
_WEIGHTS, _WEIGHTS_OF_LITTLE_TURN = (0.0, 10.0, 1000.0), (10.0, 1.0, 100.0)
# Joints nearer to their limits move less, down to the least room [rad].
_ROOM, _LEAST_ROOM = 0.3, 0.01
# Standard deviation of detours [rad].
_DETOURS = 0.5
# Numbers of spans to choose from, and the part of the tolerances that the fit of a guess may miss,
# root mean square.
_SPANS, _MISSED = (8, 10, 12, 16, 20, 24, 32), 0.3


def path_guesses(family: JointSplines) -> Iterator[Array]:
    """Yield splines along the path that a problem's end effector follows, without end."""
    problem, robot = family.problem, family.robot
    weighs = problem.objective.chaser_attitude > 0.0
    weights = _WEIGHTS_OF_LITTLE_TURN if weighs else _WEIGHTS
    straight = repeat(np.zeros(robot.joints), len(weights))
    for weight, aside in zip(cycle(weights), chain(straight, even_normals(robot.joints))):
        joints = _along(problem, weight, _DETOURS * aside / robot.joint_weights)
        yield family.near(np.hstack([np.zeros((len(joints), 7)), joints]))


def spans_along(problem: PlanningProblem, settings: PlannerSettings) -> tuple[int, Array]:
    """Return how many spans joint splines along a path need, and their accelerations at the start.

    Twice as many where the attitude has a weight, for which the joints move to and fro. The
    accelerations are the start's, if they are known, shape (joints,) [rad/s2].
    """
    path, robot = problem.path, problem.robot
    if path is None:
        raise ValueError("the problem has no path to follow")
    joints = _along(problem, _WEIGHTS[0], np.zeros(robot.joints))
    allowed = path.position_tolerance / arm_reach(robot)
    if path.turns:
        allowed = min(allowed, path.orientation_tolerance)
    given, usual = problem.start, settings.joint_spline_spans
    accelerations, fixed = given.joint_accelerations, FIXED
    if accelerations is None:
        accelerations, fixed = np.zeros(robot.joints), FIXED - 1
    for spans in (usual, *(more for more in _SPANS if more > usual)):
        basis = SplineBasis(problem.duration, spans)
        rows = basis.on_grid(len(joints))
        first = basis.start(given.joint_positions, given.joint_velocities, accelerations)[:fixed]
        behind, *_ = np.linalg.lstsq(rows[:, fixed:], joints - rows[:, :fixed] @ first)
        controls = np.concatenate([first, behind])
        if np.sqrt(((rows @ controls - joints) ** 2).mean()) <= _MISSED * allowed:
            break
    weighs = problem.objective.chaser_attitude > 0.0
    return (1 + weighs) * spans, basis.on_grid(1, 2)[0] @ controls


def _along(problem: PlanningProblem, weight: float, aside: Array) -> Array:
    """Return joint positions at equal steps along a path. Shape (steps + 1, joints).

    Args:
        weight: Of the chaser's rotation.
        aside: Offset of the joints half-way, as far as the end effector leaves them free [rad].
    """
    robot = problem.robot
    q, v = configuration(robot, problem.start)
    curve = curve_of(problem)
    steps = min(max(_STEPS, _STEPS_EACH * len(curve.spline.x)), _MOST_STEPS)
    times = np.linspace(0.0, problem.duration, steps + 1)
    rates = _Rates(problem, weight, q, v)
    poses, step = curve.at(times), times[1]
    bump = 64.0 * (times / times[-1]) ** 3 * (1.0 - times / times[-1]) ** 3
    offsets = np.diff(bump)[:, None] * aside / step
    found = np.empty((steps + 1, robot.joints))
    found[0] = q[7:]
    for k in range(steps):
        wanted = rates.to(q, poses, k + 1) / step
        half_way = pin.integrate(robot.model, q, rates.at(q, wanted, offsets[k]) * step / 2.0)
        q = pin.integrate(robot.model, q, rates.at(half_way, wanted, offsets[k]) * step)
        found[k + 1] = q[7:]
    return found


class _Rates:
    """Tangent velocities with which the end effector moves as wanted, at constant momentum."""

    def __init__(self, problem: PlanningProblem, weight: float, q: Array, v: Array) -> None:
        self.robot, self.turns = problem.robot, curve_of(problem).spline.c.shape[2] > 3
        self.data = self.robot.model.createData()
        self.momentum = total_momentum(self.robot, self.data, q, v)
        base = self.robot.base
        self.rows = [row for row in base.tip_rows if self.turns or row < 3]
        self.cost = np.diag(self.robot.joint_weights**2)
        self.turning = [k for k, row in enumerate(base.rows) if row >= 3]
        of_base, _ = self._base(q)
        size = float((of_base[self.turning] ** 2).sum()) / self.robot.joints
        self.weight = weight / size if size > 0.0 else 0.0

    def to(self, q: Array, poses: Poses, number: int) -> Array:
        """Return the way from a configuration's end effector to a pose of the path. (rows,)."""
        pin.forwardKinematics(self.robot.model, self.data, q)
        tip = pin.updateFramePlacement(self.robot.model, self.data, self.robot.tip_frame_id)
        turn = np.zeros(3)
        if poses.rotations is not None:
            turn = pin.log3(poses.rotations[number] @ tip.rotation.T)
        way: Array = np.concatenate([poses.positions[number] - tip.translation, turn])[self.rows]
        return way

    def at(self, q: Array, wanted: Array, bias: Array) -> Array:
        """Return the velocity of least cost. Shape (6 + joints,).

        Args:
            wanted: Velocity of the end effector. Shape (rows,) [m/s, rad/s].
            bias: Joint velocities that cost nothing. Shape (joints,) [rad/s].
        """
        robot, base = self.robot, self.robot.base.rows
        of_base, drift = self._base(q)
        axes = pin.LOCAL_WORLD_ALIGNED
        every = pin.computeFrameJacobian(robot.model, self.data, q, robot.tip_frame_id, axes)
        every = every[self.rows]
        jacobian = every[:, 6:] + every[:, base] @ of_base
        turning = of_base[self.turning]
        cost = self.cost + self.weight * turning.T @ turning
        pull = self.cost @ bias - self.weight * turning.T @ drift[self.turning]
        # Near its limits a joint moves little.
        room = np.minimum(q[7:] - robot.lower_position_limits, robot.upper_position_limits - q[7:])
        cost += np.diag(np.maximum((_ROOM / np.maximum(room, _LEAST_ROOM)) ** 2 - 1.0, 0.0) ** 2)
        solved = np.linalg.solve(cost, np.column_stack([pull, jacobian.T]))
        free, by_force = solved[:, 0], solved[:, 1:]
        lacks = wanted - every[:, base] @ drift - jacobian @ free
        normal = jacobian @ by_force + _DAMPING**2 * np.eye(len(self.rows))
        joints = free + by_force @ np.linalg.solve(normal, lacks)
        v = np.zeros(6 + robot.joints)
        v[base], v[6:] = of_base @ joints + drift, joints
        return v

    def _base(self, q: Array) -> tuple[Array, Array]:
        """Return the base's rates per joint rate, and those of the momentum with joints at rest."""
        robot, data, rows = self.robot, self.data, self.robot.base.rows
        mass = mass_matrix(robot, data, q)[rows]
        pin.forwardKinematics(robot.model, data, q)
        momentum = data.oMi[1].actInv(pin.Force(self.momentum)).vector[rows]
        right = np.column_stack([-mass[:, 6:], momentum])
        solved = np.linalg.solve(mass[:, rows], right)
        return solved[:, :-1], solved[:, -1]
