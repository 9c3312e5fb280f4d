"""The momentum that wheels take of a base that does not turn, against Pinocchio."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from robots import ROBOTS

from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.robot.dynamics import torques_on_base
from ff_planner_ros.robot.model import Base, robot_from_urdf_text
from ff_planner_ros.robot.momentum import angular_momenta, momentum_maps

POINTS = 3


@pytest.mark.parametrize("name", ROBOTS)
def test_momenta_and_torques_are_those_of_pinocchio(name: str) -> None:
    urdf, *links = ROBOTS[name]
    robot = robot_from_urdf_text(urdf, *links, Base.ATTITUDE_HELD)
    model, rng = robot.model, np.random.default_rng(1)
    q, v = np.zeros((POINTS, model.nq)), np.zeros((POINTS, model.nv))
    q[:, 6] = 1.0
    q[:, 7:], v[:, 6:], accelerations = rng.normal(size=(3, POINTS, robot.joints))
    momenta, torques = compiled.held_momenta(chain_of(robot), q, v, accelerations)
    # The centre of mass rests.
    maps = momentum_maps(robot, model.createData(), q)
    v[:, :3] = -np.einsum("pij,pj->pi", maps[:, :3], v) / pin.computeTotalMass(model)
    about, _ = angular_momenta(robot, q, v, accelerations)
    agree = partial(np.testing.assert_allclose, rtol=1e-9)
    agree(momenta, about @ robot.rotation_chaser_to_base.T, atol=1e-9 * np.abs(momenta).max())
    expected = torques_on_base(robot, q, v, accelerations)
    agree(torques, expected, atol=1e-9 * np.abs(expected).max())
