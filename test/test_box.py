"""The box that stands for a chaser."""

from __future__ import annotations

import numpy as np
import pytest

from ff_planner_ros.robot.collision.box import uniform_box
from ff_planner_ros.robot.model import Robot


def test_a_solid_box_of_this_size_has_the_chasers_inertia(robot: Robot) -> None:
    a, b, c = uniform_box(robot).edges
    turn = uniform_box(robot).rotation_box_to_chaser
    chaser = robot.model.inertias[1]
    solid = chaser.mass / 12 * np.diag([b**2 + c**2, c**2 + a**2, a**2 + b**2])
    about_base_axes = robot.rotation_chaser_to_base @ turn @ solid @ turn.T
    about_base_axes = about_base_axes @ robot.rotation_chaser_to_base.T
    np.testing.assert_allclose(about_base_axes, chaser.inertia, atol=1e-9)


def test_its_axes_are_a_rotation(robot: Robot) -> None:
    turn = uniform_box(robot).rotation_box_to_chaser
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
