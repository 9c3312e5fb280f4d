"""Compiled joint splines against the same mathematics by numpy and Pinocchio."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from core_rows import sensitivity_of
from reference_joint_spline import reference_motion, reference_sensitivity
from robots import random_state
from test_core import FREE, PLANAR, SLIDING, agree, chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.followed import followed
from ff_planner_ros.planning.motion.followed_path import followed_path
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.paths.joint_spline import JointSplines, joint_splines
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem, Target
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.state import SystemState

SETTINGS = load_parameters().planner
DURATION, POINTS = 6.0, 9


def drawn_start(robot: Robot, rng: np.random.Generator, still: bool) -> SystemState:
    """Draw a state; on a table one that the table allows."""
    start = random_state(robot, rng)
    if robot.base is Base.PLANAR:
        turn = rng.uniform(-np.pi, np.pi) / 2.0
        start = replace(
            start,
            position_chaser_in_inertial=start.position_chaser_in_inertial * [1.0, 1.0, 0.0],
            quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, np.sin(turn), np.cos(turn)]),
            linear_velocity_chaser_in_inertial=start.linear_velocity_chaser_in_inertial
            * [1.0, 1.0, 0.0],
            angular_velocity_chaser_in_inertial=start.angular_velocity_chaser_in_inertial
            * [0.0, 0.0, 1.0],
        )
    if not still:
        return replace(start, joint_accelerations=rng.normal(scale=0.1, size=robot.joints))
    return replace(
        start,
        linear_velocity_chaser_in_inertial=np.zeros(3),
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(robot.joints),
    )


def drawn_target(robot: Robot, orientation: Orientation, rng: np.random.Generator) -> Target:
    """Draw a moving target, far from where any motion ends."""
    quaternion = rng.normal(size=4)
    if robot.base is Base.PLANAR:
        quaternion[:2] = 0.0
    quaternion /= np.linalg.norm(quaternion)
    axis, small = rng.normal(size=3), rng.normal(scale=0.05, size=(4, 3))
    if orientation is not Orientation.FIXED:  # no turn is wanted where it is free
        small[[1, 3]] = 0.0
    return Target(
        rng.uniform(-3.0, 3.0, 3),
        quaternion,
        *small,
        orientation=orientation,
        free_axis_in_ee=axis / np.linalg.norm(axis)
        if orientation is Orientation.ABOUT_AXIS
        else None,
    )


def drawn_splines(name: str, still: bool, orientation: Orientation) -> tuple[JointSplines, Array]:
    robot = chain_robot(name)
    rng = np.random.default_rng(100 + robot.joints)
    start, target = drawn_start(robot, rng, still), drawn_target(robot, orientation, rng)
    # What splines read of a problem: a planner refuses goals that ask too much of a short arm.
    asked = {"target": target, "posture": None, "path": None}
    read = SimpleNamespace(robot=robot, start=start, duration=DURATION, **asked)
    family = joint_splines(cast(PlanningProblem, read), SETTINGS)
    hold = np.repeat(family.fixed[-1], family.variables // robot.joints)
    return family, hold + rng.normal(scale=0.4, size=family.variables)


CASES = [
    *(
        (name, still, Orientation.FIXED)
        for name in FREE + PLANAR + SLIDING
        for still in (True, False)
    ),
    *((name, False, o) for name in ("free3", "free7", "planar3") for o in Orientation),
]


@pytest.mark.parametrize(
    ("name", "still", "orientation"),
    CASES,
    ids=[f"{n}-{'still' if s else 'drifting'}-{o}" for n, s, o in CASES],
)
def test_motions_and_their_derivatives_are_those_of_numpy_and_pinocchio(
    name: str, still: bool, orientation: Orientation
) -> None:
    family, x = drawn_splines(name, still, orientation)
    motion, expected = family.motion(x, POINTS), reference_motion(family, x, POINTS)
    for what in ("q", "v", "q_half_way", "goal_error"):
        agree(getattr(motion, what), getattr(expected, what), what)
    sensitivity = sensitivity_of(family, motion)
    by_x = reference_sensitivity(family, expected)
    for what in ("q", "v", "q_half_way", "goal_error", "acceleration"):
        agree(getattr(sensitivity, what), getattr(by_x, what), f"{what} by x")


@pytest.mark.parametrize("name", ["free2", "free7", "free14", "planar1", "planar3"])
def test_what_comes_of_a_path_is_what_the_check_makes_of_its_samples(name: str) -> None:
    """Both integrate by Runge-Kutta, the one rotations and the other poses."""
    family, x = drawn_splines(name, False, Orientation.FREE)
    motion = family.motion(x, 41)
    acceleration = sensitivity_of(family, motion).acceleration
    problem = cast(
        PlanningProblem, SimpleNamespace(robot=family.robot, points=41, duration=DURATION)
    )
    found = followed_path(problem, motion.q, motion.v, acceleration)
    samples = motion.q[:, 7:], motion.v[:, 6:], acceleration[:, 6:]
    joints = JointMotion(np.linspace(0.0, DURATION, 41), *samples)
    expected = followed(family.robot, motion.q[0], motion.v[0], joints, multiple=2)
    assert found.pieces == expected.pieces
    np.testing.assert_allclose(found.time, expected.time, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(found.q), np.abs(expected.q), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(found.v, expected.v, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"angles": np.zeros((4, 3))}, "angles has 4 rows, not an odd number of three or more"),
        ({"angles": np.zeros(5)}, "angles has the shape (5, ), not (5, 3, )"),
        ({"rates": np.zeros((5, 2))}, "rates has the shape (5, 2, ), not (5, 3, )"),
        ({"accelerations": np.full((5, 3), np.nan)}, "accelerations is not finite"),
        ({"duration": np.inf}, "duration is not finite"),
    ],
)
def test_a_motion_of_wrong_sizes_or_of_nan_is_refused_by_name(
    change: dict[str, Any], said: str
) -> None:
    family, _ = drawn_splines("free3", True, Orientation.FIXED)
    joints = {name: np.zeros((5, 3)) for name in ("angles", "rates", "accelerations")}
    fixed = (chain_of(family.robot), family.start)
    assert compiled.DrivenMotion(*fixed, **joints, duration=1.0).q.shape == (3, 10)
    with pytest.raises(ValueError, match=re.escape(said)):
        compiled.DrivenMotion(*fixed, **({"duration": 1.0} | joints | change))


def test_targets_starts_and_rows_of_wrong_sizes_or_of_nan_are_refused_by_name() -> None:
    family, x = drawn_splines("free3", True, Orientation.FIXED)
    with pytest.raises(ValueError, match="orientation is bent, not fixed, about_axis or free"):
        compiled.Target(
            *np.zeros((1, 3)), np.eye(3), *np.zeros((2, 6)), "bent", *np.eye(3)[[0]], np.eye(3)[1:]
        )
    with pytest.raises(ValueError, match="center is not finite"):
        compiled.Start(np.zeros(3), np.eye(3), np.full(3, np.nan), np.zeros(6), "free_flyer")
    motion = family.motion(x, 3).compiled
    rows = np.zeros((5, 8))
    assert motion.goal_error_by_x(rows, rows, rows[0], family._goal).shape == (18, 24)
    with pytest.raises(
        ValueError, match=re.escape("rate_rows has the shape (5, 7, ), not (5, 8, )")
    ):
        motion.goal_error_by_x(rows, rows[:, 1:], rows[0], family._goal)
    with pytest.raises(ValueError, match="angle_rows is not finite"):
        motion.goal_error_by_x(rows + np.nan, rows, rows[0], family._goal)
