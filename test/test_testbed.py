"""The simulated testbed: what it measures, and what it makes of a trajectory message."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Duration
from ff_planner_msgs.msg import (
    ChaserState,
    Exchange,
    Plan,
    PlanAnswer,
    PlanInputs,
    PlanStatus,
    Scene,
    TargetBody,
)
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import DEADLINE, FRAME, private_domain
from scipy.spatial.transform import Rotation
from test_tumbling import body_of, moved
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.testbed import (
    CONTROLLER_TOPIC,
    Imperfections,
    SimulatedTestbed,
    motion_from_message,
    with_sensor_noise,
)
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem, RigidMotion
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.from_messages import (
    scene_from_message,
    state_from_message,
    target_body_from_message,
)
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.process import spin_in_background
from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.topics import CHASER_STATE, EXCHANGES, TARGET_BODY
from ff_planner_ros.simulation.free_floating import carried_back

PERFECT = Imperfections()
ALONG_A_BODY = Path(poses=[PoseStamped()])
LEAD = 1.5  # of a testbed that waits [s]
# What the testbed's sensors measure of a state: everything but these.
NOT_MEASURED = ("joint_accelerations", "wheel_momenta", "ee_at_rest")
MEASURED = [item.name for item in fields(SystemState) if item.name not in NOT_MEASURED]


def trajectory(names: list[str], times: list[float], start_ns: int = 0) -> JointTrajectory:
    """All joints at the number of the point, each joint a hundred further than the last."""
    message = JointTrajectory(joint_names=names)
    message.header.stamp = time_message(start_ns)
    for number, time in enumerate(times):
        row = [number + 100.0 * joint for joint in range(len(names))]
        offset_ns = round(time * NANOSECONDS)
        message.points.append(
            JointTrajectoryPoint(
                positions=row,
                velocities=[0.1 * value for value in row],
                accelerations=[0.01 * value for value in row],
                time_from_start=Duration(
                    sec=offset_ns // NANOSECONDS, nanosec=offset_ns % NANOSECONDS
                ),
            )
        )
    return message


def test_a_trajectory_is_read_whatever_the_order_of_its_joints() -> None:
    motion = motion_from_message(trajectory(["b", "a"], [0.0, 0.25, 1.5]), ("a", "b"))
    assert motion.time.tolist() == [0.0, 0.25, 1.5]
    assert motion.positions.tolist() == [[100.0, 0.0], [101.0, 1.0], [102.0, 2.0]]
    np.testing.assert_allclose(motion.velocities, 0.1 * motion.positions)
    np.testing.assert_allclose(motion.accelerations, 0.01 * motion.positions)


def without(field: str) -> Callable[[JointTrajectory], None]:
    def take_away(message: JointTrajectory) -> None:
        setattr(message.points[1], field, [])

    return take_away


def not_a_number(message: JointTrajectory) -> None:
    message.points[0].positions = [0.0, float("nan")]


@pytest.mark.parametrize(
    ("spoil", "field", "status"),
    [
        (lambda m: m.joint_names.__setitem__(0, "c"), "joint_names", Status.UNKNOWN_JOINT),
        (lambda m: m.points.__delitem__(slice(1, None)), "points", Status.CONTROLLER_CONSTRAINT),
        (lambda m: m.points.reverse(), "points", Status.CONTROLLER_CONSTRAINT),
        (without("positions"), "points[].positions", Status.CONTROLLER_CONSTRAINT),
        (without("velocities"), "points[].velocities", Status.CONTROLLER_CONSTRAINT),
        (without("accelerations"), "points[].accelerations", Status.CONTROLLER_CONSTRAINT),
        (not_a_number, "points[].positions", Status.CONTROLLER_CONSTRAINT),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_refused_by_name(
    spoil: Callable[[JointTrajectory], None], field: str, status: Status
) -> None:
    message = trajectory(["a", "b"], [0.0, 1.0, 2.0])
    spoil(message)
    with pytest.raises(InvalidInput) as refusal:
        motion_from_message(message, ("a", "b"))
    assert (refusal.value.field, refusal.value.status) == (field, status)


def test_a_perfect_sensor_measures_the_truth(lemur_capture: PlanningProblem) -> None:
    state = lemur_capture.start
    found = with_sensor_noise(state, PERFECT, np.random.default_rng(1))
    for name in MEASURED:
        np.testing.assert_allclose(getattr(found, name), getattr(state, name), atol=1e-15)


def test_noise_has_the_standard_deviation_that_was_asked_for(
    lemur_capture: PlanningProblem,
) -> None:
    state, random = lemur_capture.start, np.random.default_rng(2)
    noisy = Imperfections(
        position_noise=0.01, angle_noise=0.02, velocity_noise=0.03, rate_noise=0.04
    )
    found = [with_sensor_noise(state, noisy, random) for _ in range(3000)]
    expected = {
        "position_chaser_in_inertial": 0.01,
        "linear_velocity_chaser_in_inertial": 0.03,
        "angular_velocity_chaser_in_inertial": 0.04,
        "joint_positions": 0.02,
        "joint_velocities": 0.04,
    }
    for name, sigma in expected.items():
        off = np.array([getattr(one, name) for one in found]) - getattr(state, name)
        np.testing.assert_allclose(off.std(axis=0), sigma, rtol=0.05)
        np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.1 * sigma)
    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    turns = Rotation.from_quat([one.quaternion_chaser_to_inertial_xyzw for one in found])
    vectors = (turns * attitude.inv()).as_rotvec()
    np.testing.assert_allclose(vectors.std(axis=0), 0.02, rtol=0.05)


class Watcher:
    """A node beside the testbed's that keeps what it publishes."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("watcher")
        self._changed = threading.Condition()
        self.states: list[ChaserState] = []
        self.obstacles: list[Scene] = []
        self.bodies: list[TargetBody] = []
        self.node.create_subscription(
            TargetBody, "target_body", self._keeper(self.bodies), qos_profile(TARGET_BODY)
        )
        late = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(
            ChaserState, "chaser_state", self._keeper(self.states), qos_profile(CHASER_STATE)
        )
        self.node.create_subscription(Scene, "obstacles", self._keeper(self.obstacles), late)
        self.controller = self.node.create_publisher(JointTrajectory, CONTROLLER_TOPIC, 10)
        # What the planner tells of its requests.
        self._exchanges = self.node.create_publisher(
            Exchange, EXCHANGES.name, qos_profile(EXCHANGES)
        )

    def _keeper(self, kept: list[Any]) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            with self._changed:
                kept.append(message)
                self._changed.notify_all()

        return keep

    def wait_until_heard(self) -> None:
        """Wait until the testbed would hear whatever is told."""
        topics = (EXCHANGES.name, CONTROLLER_TOPIC)
        self.wait_until(
            lambda: self.states and all(self.node.count_subscribers(topic) for topic in topics)
        )

    def tell_goal(self) -> None:
        """Tell that the planner was asked."""
        self._exchanges.publish(Exchange(interface="action", event="received"))

    def tell_result(self, status: Status, *plans: JointTrajectory, **inputs: Any) -> None:
        """Tell what the planner answered, and what that was made from; all but the last capture."""
        answer = PlanAnswer(
            status=PlanStatus(code=int(status)),
            plans=[
                *(Plan(joint_trajectory=one, target_path=ALONG_A_BODY) for one in plans[:-1]),
                *(Plan(joint_trajectory=one) for one in plans[-1:]),
            ],
            inputs=PlanInputs(**inputs),
        )
        self._exchanges.publish(Exchange(interface="action", event="answered", answer=[answer]))

    def tell_publication(self, event: str) -> None:
        """Tell of a request to publish a plan, or to reject it."""
        answer = [] if event == "received" else [PlanAnswer()]
        self._exchanges.publish(Exchange(interface="publish_plan", event=event, answer=answer))

    def state_number(self, number: int) -> ChaserState:
        """Return a state by its number, as soon as it has come."""
        self.wait_until(lambda: len(self.states) > number)
        return self.states[number]

    def wait_until(self, condition: Callable[[], object]) -> None:
        with self._changed:
            assert self._changed.wait_for(condition, DEADLINE)

    def wait_for_state_at(self, stamp_ns: int) -> None:
        self.wait_until(lambda: self.states and stamp(self.states[-1]) >= stamp_ns)


def stamp(message: ChaserState | Scene | TargetBody) -> int:
    return nanoseconds(message.header.stamp)


@contextmanager
def running_testbed(
    scenario: PlanningProblem, epoch: float | None, imperfections: Imperfections = PERFECT
) -> Iterator[tuple[Watcher, int]]:
    """Run a testbed at 50 Hz whose epoch is so many seconds from now; yield it with its epoch.

    Without an epoch it waits for its first plan, `LEAD` before the start state.
    """
    with private_domain():
        rclpy.init(args=[])
        try:
            node = rclpy.create_node("testbed")
            epoch_ns = node.get_clock().now().nanoseconds + round((epoch or 0.0) * NANOSECONDS)
            given = None if epoch is None else epoch_ns
            body = scenario.target_body
            SimulatedTestbed(node, scenario, body, given, 50.0, imperfections, LEAD)
            watcher = Watcher()
            executor = SingleThreadedExecutor()
            for each in (node, watcher.node):
                executor.add_node(each)
            stop = spin_in_background(executor, node.get_logger())
            try:
                yield watcher, epoch_ns
            finally:
                stop()
        finally:
            rclpy.shutdown()


def test_the_scene_is_there_for_whoever_comes_late(lemur_capture: PlanningProblem) -> None:
    with running_testbed(lemur_capture, epoch=0.0) as (watcher, _):
        watcher.wait_until(lambda: watcher.obstacles)
        spheres = scene_from_message(watcher.obstacles[0], "obstacles", FRAME)
    assert watcher.obstacles[0].source == "testbed"
    for found, sphere in zip(spheres, lemur_capture.obstacles, strict=True):
        assert (found.id, found.radius) == (sphere.id, sphere.radius)
        assert np.array_equal(found.center, sphere.center)


def test_target_body_and_obstacles_come_through_their_places_at_its_epoch() -> None:
    drawn = tumbling.problem("tumbling", 0)
    rock = Obstacle.sphere("rock", np.array([9.0, 0.0, 0.0]), 0.1, np.array([0.5, 0.0, 0.0]))
    with running_testbed(replace(drawn, obstacles=(rock, *drawn.obstacles)), epoch=0.7) as (
        watcher,
        epoch_ns,
    ):
        watcher.wait_until(lambda: watcher.bodies and stamp(watcher.bodies[-1]) > epoch_ns)
        watcher.wait_until(lambda: watcher.obstacles)
    first, last = watcher.bodies[0], watcher.bodies[-1]
    seen = target_body_from_message(last, FRAME)
    since = (stamp(last) - epoch_ns) / NANOSECONDS
    (center,), (attitude,), (rate,) = moved(body_of(drawn), np.array([since]))
    np.testing.assert_allclose(seen.position, center, atol=1e-9)
    turn = Rotation.from_quat(seen.quaternion_xyzw.copy()) * attitude.inv()
    assert turn.magnitude() < 1e-9
    np.testing.assert_allclose(seen.angular_velocity, rate, atol=1e-10)
    # Before the epoch, too: what is seen first becomes the body as it is there.
    ahead = (epoch_ns - stamp(first)) / NANOSECONDS
    (center,), _, _ = moved(target_body_from_message(first, FRAME), np.array([abs(ahead)]))
    if ahead > 0.0:
        np.testing.assert_allclose(center, body_of(drawn).position, atol=1e-9)
    # Obstacles of its own; what is fixed to the body is told with it.
    (sphere,) = scene_from_message(watcher.obstacles[0], "obstacles", FRAME)
    lead = (epoch_ns - stamp(watcher.obstacles[0])) / NANOSECONDS
    np.testing.assert_allclose(sphere.center, [9.0 - 0.5 * lead, 0.0, 0.0], atol=1e-9)


def test_it_comes_through_the_start_state_at_its_epoch(lemur_capture: PlanningProblem) -> None:
    with running_testbed(lemur_capture, epoch=0.7) as (watcher, epoch_ns):
        watcher.wait_for_state_at(epoch_ns)
        states = list(watcher.states)
    robot = lemur_capture.robot
    assert any(stamp(message) < epoch_ns for message in states)
    for message in states:
        assert stamp(message) % 20_000_000 == 0
        found = state_from_message(message, "chaser_state", robot, FRAME)
        lead = (epoch_ns - stamp(message)) / NANOSECONDS
        if lead >= 0.0:
            truth = carried_back(robot, lemur_capture.start, lead)
            for name in MEASURED:
                np.testing.assert_allclose(getattr(found, name), getattr(truth, name), atol=1e-7)


def test_it_follows_a_trajectory_from_its_stamp_on(lemur_capture: PlanningProblem) -> None:
    start = lemur_capture.start
    names = list(lemur_capture.robot.joint_names)
    with running_testbed(lemur_capture, epoch=0.0) as (watcher, epoch_ns):
        begin_ns = epoch_ns + 1_000_000_000
        watcher.wait_until(lambda: watcher.controller.get_subscription_count() and watcher.states)
        message = steady(names, start.joint_positions + start.joint_velocities, begin_ns)
        watcher.controller.publish(message)
        watcher.wait_for_state_at(begin_ns + 1_500_000_000)
        states = [state for state in watcher.states if stamp(state) >= begin_ns + 20_000_000]
    for state in states:
        time = min((stamp(state) - begin_ns) / NANOSECONDS, 1.0)
        expected = start.joint_positions + start.joint_velocities + 0.2 * time
        np.testing.assert_allclose(state.joint_positions, expected, atol=1e-9)


def test_a_command_delay_puts_the_joints_behind(lemur_capture: PlanningProblem) -> None:
    start, names = lemur_capture.start, list(lemur_capture.robot.joint_names)
    late = replace(PERFECT, command_delay=0.4)
    with running_testbed(lemur_capture, epoch=0.0, imperfections=late) as (watcher, epoch_ns):
        begin_ns = epoch_ns + 600_000_000
        watcher.wait_until(lambda: watcher.controller.get_subscription_count() and watcher.states)
        watcher.controller.publish(steady(names, start.joint_positions, begin_ns))
        watcher.wait_for_state_at(begin_ns + 900_000_000)
        state = watcher.states[-1]
    behind = (stamp(state) - begin_ns) / NANOSECONDS - 0.4
    np.testing.assert_allclose(
        state.joint_positions, start.joint_positions + 0.2 * behind, atol=1e-9
    )


def test_a_state_delay_holds_back_what_was_measured(lemur_capture: PlanningProblem) -> None:
    late = replace(PERFECT, state_delay=0.3)
    with running_testbed(lemur_capture, epoch=0.0, imperfections=late) as (watcher, _):
        watcher.wait_until(lambda: len(watcher.states) > 5)
        now_ns = watcher.node.get_clock().now().nanoseconds
        assert now_ns - stamp(watcher.states[-1]) >= 300_000_000


def require_equal(found: ChaserState, expected: SystemState, scenario: PlanningProblem) -> None:
    """Whether a state was measured to numerical accuracy."""
    state = state_from_message(found, "chaser_state", scenario.robot, FRAME)
    for name in MEASURED:
        np.testing.assert_allclose(getattr(state, name), getattr(expected, name), atol=1e-9)


def resting_joints(scenario: PlanningProblem) -> PlanningProblem:
    """The same start with joints that rest: they tell nothing of when it was."""
    none = np.zeros(scenario.robot.joints)
    return replace(scenario, start=replace(scenario.start, joint_velocities=none))


def test_until_it_is_asked_for_a_plan_it_stays_a_lead_before_its_start(
    lemur_capture: PlanningProblem,
) -> None:
    with running_testbed(lemur_capture, epoch=None) as (watcher, _):
        watcher.wait_until(lambda: len(watcher.states) > 20)
        states = list(watcher.states)
    first = carried_back(lemur_capture.robot, lemur_capture.start, LEAD)
    for state in states:
        require_equal(state, first, lemur_capture)
    assert all(a < b for a, b in pairwise(map(stamp, states)))


@pytest.mark.parametrize("at_rest", [False, True])
def test_from_its_first_plan_on_it_moves_as_that_was_planned(
    lemur_capture: PlanningProblem, at_rest: bool
) -> None:
    scenario = resting_joints(lemur_capture) if at_rest else lemur_capture
    robot, names = scenario.robot, list(scenario.robot.joint_names)
    with running_testbed(scenario, epoch=None) as (watcher, _):
        watcher.wait_until_heard()
        # The planner takes a state that is not the last one up to which the testbed stood still.
        used = watcher.state_number(len(watcher.states))
        watcher.state_number(len(watcher.states) + 3)
        watcher.tell_goal()
        last = watcher.states[-1]
        watcher.wait_until(
            lambda: (
                watcher.states[-1].joint_positions != last.joint_positions
                or watcher.states[-1].pose != last.pose
            )
        )
        begin_ns = stamp(used) + round(LEAD * NANOSECONDS)
        plan = steady(names, scenario.start.joint_positions, begin_ns)
        watcher.tell_result(
            Status.SOLVED, plan, state_stamp=used.header.stamp, state_source="chaser_state"
        )
        watcher.controller.publish(plan)
        watcher.wait_for_state_at(begin_ns + 500_000_000)
        states = list(watcher.states)
    measured = state_from_message(used, "chaser_state", robot, FRAME)
    before = [one for one in states if begin_ns - 200_000_000 <= stamp(one) < begin_ns]
    after = [one for one in states if begin_ns < stamp(one)]
    assert before
    for state in before:
        since = (stamp(state) - stamp(used)) / NANOSECONDS
        require_equal(state, carried_forward(robot, measured, since, None), scenario)
    # It comes through the plan's first point, and goes on from there as from the start state.
    motion = motion_from_message(plan, names)
    for state in after:
        since = (stamp(state) - begin_ns) / NANOSECONDS
        there = carried_forward(robot, scenario.start, since, motion)
        found = state_from_message(state, "chaser_state", robot, FRAME)
        for name in MEASURED:
            np.testing.assert_allclose(getattr(found, name), getattr(there, name), atol=1e-7)


def test_after_a_refusal_it_waits_again_where_it_waited(lemur_capture: PlanningProblem) -> None:
    with running_testbed(lemur_capture, epoch=None) as (watcher, _):
        watcher.wait_until_heard()
        first = watcher.states[0]
        watcher.tell_goal()
        watcher.wait_until(lambda: watcher.states[-1].pose != first.pose)
        watcher.tell_result(Status.START_IN_COLLISION)
        watcher.wait_until(lambda: watcher.states[-1].pose == first.pose)


def test_a_request_to_publish_a_plan_does_not_let_time_run(lemur_capture: PlanningProblem) -> None:
    with running_testbed(lemur_capture, epoch=None) as (watcher, _):
        watcher.wait_until_heard()
        first = watcher.states[0]
        for event in ("received", "published"):
            watcher.tell_publication(event)
        watcher.tell_goal()
        watcher.tell_result(Status.START_IN_COLLISION)
        heard = len(watcher.states)
        watcher.wait_until(lambda: len(watcher.states) > heard + 20)
        assert watcher.states[-1].pose == first.pose


def test_a_plan_that_nobody_flies_lets_it_wait_again(lemur_capture: PlanningProblem) -> None:
    with running_testbed(lemur_capture, epoch=None) as (watcher, _):
        watcher.wait_until_heard()
        first = watcher.states[-1]
        watcher.tell_goal()
        begin_ns = stamp(first) + round(LEAD * NANOSECONDS)
        watcher.tell_result(
            Status.SOLVED,
            trajectory(["any"], [0.0, 1.0], begin_ns),
            state_stamp=first.header.stamp,
            state_source="chaser_state",
        )
        watcher.wait_until(lambda: watcher.states[-1].pose != first.pose)
        watcher.wait_until(lambda: watcher.states[-1].pose == first.pose)
        assert stamp(watcher.states[-1]) >= begin_ns


def test_a_target_body_waits_with_the_chaser_and_moves_from_where_it_was_seen() -> None:
    drawn = tumbling.problem("tumbling", 0)
    with running_testbed(drawn, epoch=None) as (watcher, _):
        watcher.wait_until_heard()
        watcher.wait_until(lambda: len(watcher.bodies) > 3)
        waiting = list(watcher.bodies)
        watcher.tell_goal()
        watcher.wait_until(lambda: watcher.bodies[-1].pose != waiting[0].pose)
        seen = waiting[1]
        watcher.tell_result(
            Status.SOLVED,
            trajectory(["any"], [0.0, 1.0], stamp(seen) + 3600 * NANOSECONDS),
            target_body_stamp=seen.header.stamp,
        )
        known = len(watcher.bodies)
        watcher.wait_until(lambda: len(watcher.bodies) > known + 3)
        last = target_body_from_message(watcher.bodies[-1], FRAME)
        since = (stamp(watcher.bodies[-1]) - stamp(seen)) / NANOSECONDS
    assert all(one.pose == waiting[0].pose for one in waiting)
    (center,), (attitude,), _ = moved(target_body_from_message(seen, FRAME), np.array([since]))
    np.testing.assert_allclose(last.position, center, atol=1e-9)
    assert (Rotation.from_quat(last.quaternion_xyzw.copy()) * attitude.inv()).magnitude() < 1e-9


def test_bodies_that_move_wait_with_the_chaser_beside_spheres(
    lemur_capture: PlanningProblem,
) -> None:
    panel = Obstacle(
        "panel",
        Solid("box", np.array([1.0, 2.0, 0.1])),
        RigidMotion(np.array([9.0, 0.0, 0.0]), angular_velocity=np.array([0.0, 0.0, 0.1])),
    )
    among = replace(lemur_capture, obstacles=(panel, *lemur_capture.obstacles))
    with running_testbed(among, epoch=None) as (watcher, _):
        watcher.wait_until(lambda: len(watcher.obstacles) > 3)
        *spheres, seen = scene_from_message(watcher.obstacles[-1], "obstacles", FRAME)
    assert not seen.is_sphere
    assert (seen.motion.angular_velocity == panel.motion.angular_velocity).all()
    turned = Rotation.from_quat(seen.motion.quaternion_xyzw.copy()).as_rotvec()
    np.testing.assert_allclose(turned, [0.0, 0.0, -0.1 * LEAD], atol=1e-9)
    assert len(spheres) == len(lemur_capture.obstacles)


def test_moving_obstacles_wait_with_the_chaser(lemur_capture: PlanningProblem) -> None:
    rock = Obstacle.sphere("rock", np.array([9.0, 0.0, 0.0]), 0.1, np.array([0.5, 0.0, 0.0]))
    with running_testbed(replace(lemur_capture, obstacles=(rock,)), epoch=None) as (watcher, _):
        watcher.wait_until(lambda: len(watcher.obstacles) > 3)
        (sphere,) = scene_from_message(watcher.obstacles[-1], "obstacles", FRAME)
    # The node carries it on from the stamp: a lead later it is at its place.
    np.testing.assert_allclose(sphere.center, [9.0 - 0.5 * LEAD, 0.0, 0.0], atol=1e-9)
    assert stamp(watcher.obstacles[-1]) > stamp(watcher.obstacles[0])


def steady(names: list[str], positions: Any, begin_ns: int) -> JointTrajectory:
    """All joints at 0.2 rad/s for a second."""
    message = trajectory(names, [0.0, 1.0], begin_ns)
    for point, offset in zip(message.points, (0.0, 0.2), strict=True):
        point.positions = (positions + offset).tolist()
        point.velocities = [0.2] * len(names)
        point.accelerations = [0.0] * len(names)
    return message
