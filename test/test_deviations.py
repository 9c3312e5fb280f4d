"""How far a measured motion is from its plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.analysis.drawing.tracking import deviations
from ff_planner_ros.planning.motion.plan import Plan


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_deviates_whether_it_lags_or_leads(lemur_plan: Plan, sign: float) -> None:
    planned = lemur_plan.trajectory
    off = sign * np.linspace(0.01, 0.07, planned.joint_positions.shape[1])
    measured = replace(
        planned,
        joint_positions=planned.joint_positions + off,
        joint_velocities=planned.joint_velocities + 2.0 * off,
    )
    found = deviations(planned, measured)
    np.testing.assert_allclose(found.joint_position, 0.07, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.joint_velocity, 0.14, rtol=0.0, atol=1e-9)
    assert np.abs([found.chaser_position, found.ee_position]).max() < 1e-9


def test_joints_that_slide_deviate_by_their_weight(lemur_plan: Plan) -> None:
    planned = lemur_plan.trajectory
    weights = np.append(3.0, np.ones(planned.joint_positions.shape[1] - 1))
    off = 0.01 * np.eye(len(weights))[0]
    measured = replace(planned, joint_positions=planned.joint_positions - off)
    found = deviations(planned, measured, weights)
    np.testing.assert_allclose(found.joint_position, 0.03, rtol=0.0, atol=1e-9)


def test_a_continuous_joint_that_is_measured_a_turn_off_is_where_it_is_planned(
    lemur_plan: Plan,
) -> None:
    """Who publishes joint states may count its turns otherwise, from one to the next."""
    planned, joint = lemur_plan.trajectory, 2
    times, joints = planned.joint_positions.shape
    turns = 2.0 * np.pi * np.outer(np.arange(times) % 3 - 1, np.eye(joints)[joint])
    measured = replace(planned, joint_positions=planned.joint_positions + turns + 0.01)
    continuous = [number == joint for number in range(joints)]
    found = deviations(planned, measured, continuous=continuous)
    np.testing.assert_allclose(found.joint_position, 0.01, rtol=0.0, atol=1e-9)
    assert deviations(planned, measured).joint_position.max() > 6.0
