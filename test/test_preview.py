"""The preview of a plan: the joint motion as the controller will make it."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from changed_parameters import replaced
from drawn_plans import POINTS, drawn_plan
from rclpy.lifecycle import LifecycleNode
from test_plan_output import Output
from visualization_msgs.msg import Marker, MarkerArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs import made_plan
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.preview import Preview, preview_joint_states
from ff_planner_ros.ros.outputs.transforms import Transforms

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
    parameters = replaced(load_parameters(), "tf.preview_prefix", "")
    played = Preview(node, Transforms(node, lemur, parameters), parameters)
    states = node.create_lifecycle_publisher.return_value
    for number in range(2):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(made_plan, "plan_markers", Mock(return_value=MarkerArray()))
            played.release(MadePlan(f"run.{number}", plan, 0, "none", lemur, Scene(), "inertial"))
            played.draw()
        rate = load_parameters().rates.preview
        states.publish.reset_mock()
        for _ in preview_joint_states(plan, rate):
            played._play()
            assert not played.is_repeated(time.time_ns()), number
        for _ in range(5):
            played._play()
            assert played.is_repeated(time.time_ns()), number
        first, again = states.publish.call_args_list[0], states.publish.call_args_list[-5]
        assert first.args[0].position == again.args[0].position


def test_each_plan_is_played_once_though_nobody_looks(
    lemur: Robot, plan: Plan, screen: Output
) -> None:
    """The bag has every plan's preview."""
    shows, played = screen.output.preview, screen.heard["planned_joint_states"]
    recorder: Any = Mock(get_subscription_count=lambda: 1)
    shows.publishers = recorder, recorder
    shows.look_for_viewers(recorders=1)
    for number in (1, 2, 3):
        before = len(played)
        shows.release(MadePlan(f"run.{number}", plan, 0, "none", lemur, Scene(), "inertial"))
        shows.draw()
        states = preview_joint_states(plan, load_parameters().rates.preview)
        for _ in range(2 * len(states)):
            shows._play()
        found = [list(one.position) for one in played[before:]]
        expected = [list(one.joints.position) for one in states]
        assert found[: len(states)] == expected
        assert len(found) <= len(states) + 1  # where it is seen that nobody looks


@pytest.fixture
def screen(lemur: Robot) -> Output:
    return Output(lemur)


def namespaces(screen: Output) -> dict[str, list[Marker]]:
    """What the newest markers draw."""
    deleting, *markers = screen.heard["markers"][-1].markers
    assert deleting.action == Marker.DELETEALL
    return {name: [one for one in markers if one.ns == name] for name in {m.ns for m in markers}}


def played(screen: Output, plan: Plan) -> bool:
    """Whether the next state of the preview is one of a plan."""
    screen.output.preview._play()
    shown = np.array(screen.heard["planned_joint_states"][-1].position)
    states = preview_joint_states(plan, load_parameters().rates.preview)
    return any(np.array_equal(one.joints.position, shown) for one in states)


def test_a_plan_that_waits_is_played_and_drawn_beside_the_one_that_was_published(
    lemur: Robot, plan: Plan, screen: Output
) -> None:
    other, shows = drawn_plan(lemur, seed=9), screen.output.preview
    published, waits = (
        MadePlan(name, one, 0, "none", lemur, Scene(), "inertial")
        for name, one in (("run.1", plan), ("run.2", other))
    )
    shows.release(published)
    shows.draw()
    alone = namespaces(screen)
    assert played(screen, plan)
    assert shows.let_wait(waits)
    assert not shows.let_wait(waits), "nothing changes"
    shows.draw()
    both = namespaces(screen)
    assert {name: both[name] for name in alone} == alone
    added = both.keys() - alone.keys()
    assert added == {f"waiting/{name}" for name in (*alone, "words")}
    (words,) = both["waiting/words"]
    assert words.text == "run.2 waits to be released"
    assert words.header.frame_id == "inertial"
    (path,), (other_path,) = both["end_effector_path"], both["waiting/end_effector_path"]
    found = [[point.x, point.y, point.z] for point in other_path.points]
    np.testing.assert_array_equal(found, other.trajectory.ee_positions)
    assert other_path.color != path.color
    assert played(screen, other)
    # Rejected, or too late: all is as before.
    assert shows.let_wait(None)
    shows.draw()
    assert namespaces(screen) == alone
    assert played(screen, plan)


def test_a_plan_that_is_released_is_no_longer_drawn_as_one_that_waits(
    lemur: Robot, plan: Plan, screen: Output
) -> None:
    shows, waits = (
        screen.output.preview,
        MadePlan("run.2", plan, 0, "none", lemur, Scene(), "inertial"),
    )
    shows.let_wait(waits)
    shows.draw()
    assert all(name.startswith("waiting/") for name in namespaces(screen))
    assert played(screen, plan)
    shows.release(waits)
    shows.let_wait(None)
    shows.draw()
    assert not any(name.startswith("waiting/") for name in namespaces(screen))
    assert namespaces(screen)["arm"]
    # It is played on, not again for the bag.
    first = preview_joint_states(plan, load_parameters().rates.preview)[1].joints
    assert played(screen, plan)
    assert screen.heard["planned_joint_states"][-1].position == first.position
