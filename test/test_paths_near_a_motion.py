"""The path of a family that runs as a motion does: of its own motions it is the path itself."""

from __future__ import annotations

import numpy as np
import pytest
from robots import random_path, random_state
from test_core import chain_robot
from test_core_driven_motion import drawn_splines

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.problem.problem import Orientation
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum


@pytest.mark.parametrize("name", ["free1", "free7", "planar3"])
def test_of_a_spline_s_motion_it_has_the_control_points(name: str) -> None:
    family, x = drawn_splines(name, False, Orientation.FREE)
    assert np.abs(x).max() > 0.3
    assert family.near(family.motion(x, 41).q) == pytest.approx(x, abs=1e-8)


def drawn(seed: int) -> tuple[EndEffectorPaths, Array]:
    """The paths of an arm from a state in motion to an end in motion, and coefficients of one."""
    robot, rng = chain_robot("free7"), np.random.default_rng(seed)
    state = random_state(robot, rng)
    q, v = configuration(robot, state)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    polynomial = random_path(robot, state, rng, 5.0, reach=0.1)
    return EndEffectorPaths(robot, q, momentum, polynomial), rng.normal(scale=0.05, size=18)


@pytest.mark.parametrize("seed", range(4))
def test_of_an_end_effector_s_path_it_has_the_coefficients(seed: int) -> None:
    """Position and Euler angles alike, however the end effector is turned."""
    paths, x = drawn(seed)
    s = np.linspace(0.0, 1.0, 21)
    positions, rotations = paths.polynomial.pose(x.reshape(6, 3), s)
    assert paths.polynomial.near(positions, rotations) == pytest.approx(x, abs=1e-6)


def test_of_a_motion_it_has_the_coefficients_of_the_end_effector_s_path() -> None:
    """Of the first two that are drawn and meet no singularity."""
    all_drawn = (drawn(seed) for seed in range(20))
    regular = ((p, x, p.motion(x, 101)) for p, x in all_drawn)
    found = [(p, x, m) for p, x, m in regular if m.singular_at is None][:2]
    assert len(found) == 2
    for paths, x, motion in found:
        assert paths.near(motion.q) == pytest.approx(x, abs=1e-4)
