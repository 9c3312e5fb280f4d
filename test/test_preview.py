"""The preview of a plan: the joint motion as the controller will make it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import POINTS, drawn_plan

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs.preview import preview_joint_states

DURATION = 10.0


@pytest.fixture(scope="module")
def plan(lemur: Robot) -> Plan:
    """Each joint moves on a polynomial of order five, which quintics meet exactly."""
    drawn = drawn_plan(lemur, seed=6)
    time = np.linspace(0.0, DURATION, POINTS)
    curves = [np.polynomial.Polynomial(row) for row in coefficients(lemur.joints)]
    positions, velocities, accelerations = (
        np.column_stack([curve.deriv(order)(time) if order else curve(time) for curve in curves])
        for order in range(3)
    )
    motion = replace(
        drawn.trajectory,
        time=time,
        joint_positions=positions,
        joint_velocities=velocities,
        joint_accelerations=accelerations,
    )
    return replace(drawn, trajectory=motion)


def coefficients(joints: int) -> Array:
    return np.random.default_rng(8).normal(size=(joints, 6)) / 4.0 ** np.arange(6)


@pytest.mark.parametrize(("rate", "states"), [(30.0, 301), (0.1, 2), (0.15, 3), (7.0, 71)])
def test_it_goes_through_the_whole_plan_at_its_rate(plan: Plan, rate: float, states: int) -> None:
    assert len(preview_joint_states(plan, rate)) == states


def test_every_state_is_on_the_planned_motion(lemur: Robot, plan: Plan) -> None:
    states = preview_joint_states(plan, rate=7.0)
    times = [*(np.arange(70) / 7.0), DURATION]
    for row, name in zip(coefficients(lemur.joints), lemur.joint_names, strict=True):
        curve = np.polynomial.Polynomial(row)
        positions = [state.position[state.name.index(name)] for state in states]
        velocities = [state.velocity[state.name.index(name)] for state in states]
        np.testing.assert_allclose(positions, curve(np.array(times)), atol=1e-9)
        np.testing.assert_allclose(velocities, curve.deriv()(np.array(times)), atol=1e-9)


def test_it_names_the_joints_and_claims_no_effort(lemur: Robot, plan: Plan) -> None:
    for state in preview_joint_states(plan, rate=1.0):
        assert tuple(state.name) == lemur.joint_names
        assert len(state.effort) == 0
