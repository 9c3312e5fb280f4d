"""Initial guesses of joint splines: near the paper's path, straight to goal postures, and detours.

A goal posture is one in which the end effector is at the goal after the joints have moved straight
to it, while the start's motion fades. Several are found, by Gauss-Newton from different postures.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.paths.chaser_loops import with_loops
from ff_planner_ros.planning.paths.end_effector_polynomial import applies, end_effector_families
from ff_planner_ros.planning.paths.even_normals import even_normals
from ff_planner_ros.planning.paths.path_guesses import path_guesses
from ff_planner_ros.planning.paths.spline_basis import FIXED
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.target import conditions_of
from ff_planner_ros.robot.model import Robot

if TYPE_CHECKING:
    from ff_planner_ros.planning.paths.joint_spline import JointSplines

# Damping of the paper's path near a singularity: a path that it leaves there is a guess, too.
_DAMPING = 0.05
# Number of the paper's guesses: the straight path, and the detours around what blocks it.
_PAPERS_GUESSES = 5
# Weight of a spline's curvature in a fit, in rad for each rad of change in the whole duration:
# small, but it keeps control points between the samples bounded.
_CURVATURE = 3e-3
# Few points are accurate enough for a path to a posture.
_POINTS = 9
# Gauss-Newton towards a posture: iterations, damping at first and how it falls and grows, and the
# error [m, rad] that is small enough for a guess.
_LEAST_DAMPING = 1e-9  # else a long arm with a joint to spare has a singular system in the end
_ITERATIONS, _FIRST_DAMPING, _LESS, _MORE, _NEAR = 30, 1e-2, 0.25, 6.0, 1e-3
# From the start's posture the first damping is higher, and no joint moves by more in an iteration
# [rad], or else the nearest posture may be missed. From others that is welcome: more are found.
_NEAR_DAMPING, _SHORT_STEP = 0.3, 0.5
# Guesses that end in contact and wait for others; when there are more, the first of them is tried.
_WAITING = 8
# Standard deviations of postures to begin at and of detours, and distance of postures from position
# limits [rad].
_POSTURES, _DETOURS, _FROM_LIMITS = 1.0, 0.5, 0.02


def spline_guesses(
    family: JointSplines, obstacles: Sequence[Obstacle], points: int
) -> Iterator[Array]:
    """Yield initial guesses without end, as free control points, always the same for one problem.

    If the robot has bodies, guesses that end in contact come later.
    """
    guesses = _guesses(family, obstacles, points)
    if np.isfinite(family.problem.chaser_goal.most):
        guesses = with_loops(family, guesses)
    return _touching_later(family, guesses) if family.robot.bodies else guesses


def _touching_later(family: JointSplines, guesses: Iterator[Array]) -> Iterator[Array]:
    """Yield guesses; those whose last posture is in contact come after some others."""
    waiting = deque[Array]()
    for guess in guesses:
        end = family.motion(guess, _POINTS).q[-1]
        if deepest_contact(family.problem, end, family.problem.duration) is None:
            yield guess
            continue
        waiting.append(guess)
        if len(waiting) > _WAITING:
            yield waiting.popleft()


def _guesses(family: JointSplines, obstacles: Sequence[Obstacle], points: int) -> Iterator[Array]:
    if family.problem.posture is not None:
        yield from _ways_of_joints(family, family.problem.posture)
        return
    if family.problem.path is not None:
        yield from path_guesses(family)
        return
    ways, begin = list[Array](), family.problem.start.joint_positions
    for guess in _near_papers_path(family, obstacles, points, slice(1)):
        ways.append(guess)
        yield guess
    ways.append(_way_to_posture(family, begin, _NEAR_DAMPING, _SHORT_STEP))
    yield ways[-1]
    yield from _near_papers_path(family, obstacles, points, slice(1, _PAPERS_GUESSES))
    bump = _bump(family)
    for number, (aside, across) in enumerate(_drawn(family.robot)):
        if number % 2 == 0:
            ways.append(_way_to_posture(family, begin + _POSTURES * aside))
            yield ways[-1]
        way = ways[(number // 2) % len(ways)]
        yield way + np.outer(_DETOURS * across, bump).ravel()


def _drawn(robot: Robot) -> Iterator[tuple[Array, Array]]:
    """Yield pairs of normal numbers, two for each joint, that fill the space evenly.

    Joints of more weight move less.
    """
    for normals in even_normals(2 * robot.joints):
        aside, across = np.split(normals, 2)
        yield aside / robot.joint_weights, across / robot.joint_weights


def _ways_of_joints(family: JointSplines, posture: Posture) -> Iterator[Array]:
    """Yield straight paths to a posture, or to rest in any, and detours from them without end."""
    yield _way_of_joints(family, posture, np.zeros(family.robot.joints))
    bump = _bump(family)
    for aside, across in _drawn(family.robot):
        way = _way_of_joints(family, posture, _POSTURES * aside)
        yield way + np.outer(_DETOURS * across, bump).ravel()


def _way_of_joints(family: JointSplines, posture: Posture, aside: Array) -> Array:
    """Return a straight path to a posture: the start's motion fades, the rest is made up smoothly.

    Args:
        aside: If any posture will do, the offset from where the joints would come to rest [rad].
    """
    robot, start = family.robot, family.problem.start
    s = np.linspace(0.0, 1.0, 4 * _POINTS)[:, None]
    way = family.basis.duration * start.joint_velocities
    fading = start.joint_positions + way * (s - s**3 + s**4 / 2.0)
    end = posture.positions
    if end is None:
        lowest = robot.lower_position_limits + _FROM_LIMITS
        highest = robot.upper_position_limits - _FROM_LIMITS
        end = np.clip(fading[-1] + aside, lowest, highest)
    return _fitted(family, fading + _smooth(s) * (end - fading[-1]))


def _near_papers_path(
    family: JointSplines, obstacles: Sequence[Obstacle], points: int, which: slice
) -> Iterator[Array]:
    """Yield splines near paths of the paper's family, if it applies.

    Args:
        which: Selects from its initial guesses, those of each direction if there are two.
    """
    if not applies(family.problem):
        return
    for ways in end_effector_families(family.problem):
        guesses = ways.first_guesses(obstacles, points, _DAMPING)
        for guess in islice(guesses, which.start, which.stop):
            motion = ways.motion(guess, points, _DAMPING)
            if motion.singular_at is None:
                yield _fitted(family, motion.q[:, 7:])


def _way_to_posture(
    family: JointSplines,
    posture: Array,
    damping: float = _FIRST_DAMPING,
    longest_step: float = np.inf,
) -> Array:
    """Return the straight path to the goal posture, or nearly one, that is found from a posture.

    Damped Gauss-Newton on the pose at the end of the path, with the last angles as variables.

    Args:
        damping: At first.
        longest_step: Of a joint in an iteration [rad]; one of more weight moves less.
    """
    robot, problem = family.robot, family.problem
    rows = sum(conditions_of(robot, problem.target).values())
    straight = _straight(family)
    hold = np.repeat(family.fixed[-1:], family.basis.count - FIXED, axis=0).T.ravel()
    by_posture = np.kron(np.eye(robot.joints), straight[:, None])
    lowest = robot.lower_position_limits + _FROM_LIMITS
    highest = robot.upper_position_limits - _FROM_LIMITS
    rest = family.fixed[-1]
    there = np.clip(posture, lowest, highest)
    best: Array = there
    error: Array = np.full(rows, np.inf)
    jacobian = np.empty((rows, robot.joints))
    for _ in range(_ITERATIONS):
        motion = family.motion(hold + by_posture @ (there - rest), _POINTS)
        missed = motion.goal_error[:rows]
        if missed @ missed < error @ error:
            best, error = there, missed
            if np.abs(error).max(initial=0.0) < _NEAR:
                break
            jacobian = family.goal_error_by_x(motion)[:rows] @ by_posture
            damping = max(_LESS * damping, _LEAST_DAMPING)
        else:
            damping *= _MORE
        normal = jacobian.T @ jacobian + damping * np.eye(robot.joints)
        step = np.linalg.solve(normal, jacobian.T @ error)
        longest = np.abs(robot.joint_weights * step).max()
        if longest > longest_step:
            step *= longest_step / longest
        there = np.clip(best - step, lowest, highest)
    x: Array = hold + by_posture @ (best - rest)
    return x


def _fitted(family: JointSplines, angles: Array) -> Array:
    """Return the free control points of splines that fit joint angles at equal steps.

    Args:
        angles: Shape (points, joints) [rad].
    """
    rows, wanted = _with_curvature(family, angles)
    free, *_ = np.linalg.lstsq(family.free(rows), wanted - family.known(rows))
    x: Array = np.asarray(free.T.ravel(), np.float64)
    return x


def _straight(family: JointSplines) -> Array:
    """Return the free control points of a joint that goes from 0 to 1 smoothly."""
    s = np.linspace(0.0, 1.0, 4 * _POINTS)
    rows, wanted = _with_curvature(family, _smooth(s)[:, None])
    free, *_ = np.linalg.lstsq(rows[:, FIXED:], wanted)
    return np.asarray(free[:, 0], np.float64)


def _smooth(s: Array) -> Array:
    """Return the quintic from 0 to 1 whose first two derivatives are zero at its ends."""
    way: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return way


def _bump(family: JointSplines) -> Array:
    """Return the free control points of a joint that goes from 0 to 1 and back."""
    s = np.linspace(0.0, 1.0, 4 * _POINTS)
    rows, wanted = _with_curvature(family, (64.0 * s**3 * (1.0 - s) ** 3)[:, None])
    free, *_ = np.linalg.lstsq(family.free(rows), wanted)
    return np.asarray(free[:, 0], np.float64)


def _with_curvature(family: JointSplines, values: Array) -> tuple[Array, Array]:
    """Return rows and right-hand sides of a fit to values at equal steps with low curvature."""
    basis = family.basis
    curvature = _CURVATURE * basis.duration**2 * basis.on_grid(4 * basis.spans + 1, 2)
    rows = np.concatenate([basis.on_grid(len(values)), curvature])
    return rows, np.concatenate([values, np.zeros((len(curvature), values.shape[1]))])
