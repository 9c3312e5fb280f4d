"""The momentum that wheels take of a base that does not turn, against Pinocchio."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from robots import ROBOTS

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.robot.dynamics import torques_on_base
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import angular_momenta, momentum_maps

POINTS, VARIABLES = 3, 4


def held(name: str) -> Robot:
    urdf, *links = ROBOTS[name]
    return robot_from_urdf_text(urdf, *links, Base.ATTITUDE_HELD)


@pytest.mark.parametrize("name", ROBOTS)
def test_momenta_and_torques_are_those_of_pinocchio_and_derivatives_their_differences(
    name: str,
) -> None:
    robot, rng = held(name), np.random.default_rng(1)
    joints, model = robot.joints, robot.model
    angles, rates, accelerations = rng.normal(size=(3, POINTS, joints))
    along = rng.normal(size=(3, POINTS, joints, VARIABLES))

    def at(step: float, variable: int) -> list[Array]:
        """Return momenta, their derivatives, torques and theirs, a step beside."""
        q, v = np.zeros((POINTS, model.nq)), np.zeros((POINTS, model.nv))
        q[:, 6] = 1.0
        q[:, 7:] = angles + step * along[0, ..., variable]
        v[:, 6:] = rates + step * along[1, ..., variable]
        of_base = np.zeros((POINTS, 6, VARIABLES))
        by_q, by_v = (np.concatenate([of_base, by], axis=1) for by in along[:2])
        moved = accelerations + step * along[2, ..., variable]
        return [*compiled.held_momenta(chain_of(robot), q, v, moved, by_q, by_v, along[2]), q, v]

    momenta, momenta_by_x, torques, torques_by_x, q, v = at(0.0, 0)
    # The centre of mass rests.
    maps = momentum_maps(robot, model.createData(), q)
    v[:, :3] = -np.einsum("pij,pj->pi", maps[:, :3], v) / pin.computeTotalMass(model)
    about, _ = angular_momenta(robot, q, v, accelerations)
    agree = partial(np.testing.assert_allclose, rtol=1e-9)
    agree(momenta, about @ robot.rotation_chaser_to_base.T, atol=1e-9 * np.abs(momenta).max())
    expected = torques_on_base(robot, q, v, accelerations)
    agree(torques, expected, atol=1e-9 * np.abs(expected).max())
    for variable in range(VARIABLES):
        low, high = at(-1e-6, variable), at(1e-6, variable)
        for found, k in ((momenta_by_x, 0), (torques_by_x, 2)):
            slope = (high[k] - low[k]) / 2e-6
            scale = np.abs(slope).max()
            np.testing.assert_allclose(found[..., variable], slope, atol=1e-8 * scale)
