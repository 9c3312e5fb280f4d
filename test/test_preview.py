"""The preview of a plan: the joint motion as the controller will make it."""

from __future__ import annotations

import time
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from drawn_plans import POINTS, drawn_plan
from rclpy.lifecycle import LifecycleNode

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.values import replaced
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs import plan_output
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
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
    states = [one.joints for one in preview_joint_states(plan, rate=7.0)]
    times = [*(np.arange(70) / 7.0), DURATION]
    for row, name in zip(coefficients(lemur.joints), lemur.joint_names, strict=True):
        curve = np.polynomial.Polynomial(row)
        positions = [state.position[state.name.index(name)] for state in states]
        velocities = [state.velocity[state.name.index(name)] for state in states]
        np.testing.assert_allclose(positions, curve(np.array(times)), atol=1e-9)
        np.testing.assert_allclose(velocities, curve.deriv()(np.array(times)), atol=1e-9)


def test_it_names_the_joints_and_claims_no_effort(lemur: Robot, plan: Plan) -> None:
    for _, state in preview_joint_states(plan, rate=1.0):
        assert tuple(state.name) == lemur.joint_names
        assert len(state.effort) == 0


def test_it_is_played_again_and_again_and_only_the_first_time_is_new(
    lemur: Robot, plan: Plan
) -> None:
    """A node would play it to whoever looks; the recorder needs it once."""
    node = Mock(spec=LifecycleNode)
    now = node.get_clock.return_value.now.return_value
    now.to_msg.return_value, now.nanoseconds = Time(), 0
    played = PlanOutput(node, lemur, replaced(load_parameters(), "tf.preview_prefix", ""))
    states = node.create_lifecycle_publisher.return_value
    for number in range(2):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(plan_output, "plan_markers", Mock())
            played.show(Mock(), plan, Scene())
        rate = load_parameters().rates.preview
        states.publish.reset_mock()
        for _ in preview_joint_states(plan, rate):
            played._play_preview()
            assert not played.is_repeated(time.time_ns()), number
        for _ in range(5):
            played._play_preview()
            assert played.is_repeated(time.time_ns()), number
        first, again = states.publish.call_args_list[0], states.publish.call_args_list[-5]
        assert first.args[0].position == again.args[0].position
