"""The newest state out of messages: pairing, ages, refusals, a clock that jumps."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from heard_inputs import HeardStates
from nav_msgs.msg import Odometry
from robots import LEMUR_URDF
from sensor_msgs.msg import JointState

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.parameters.node import STATE_SOURCES
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.ros.messages.to_messages import state_message, time_message

FRAME, SENSOR = "inertial", "imu"
SECOND = 1_000_000_000
NOW_NS = 1_700_000_000 * SECOND
MAX_AGE, MAX_LEAD, TOLERANCE = 0.5, 0.05, 0.01
AT_CENTRE = OdometryParameters(SENSOR, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
PARAMETERS: NodeParameters = replace(
    load_parameters(), odometry=AT_CENTRE, state_synchronization=TOLERANCE
)


class Fed:
    """A state input with its callbacks by topic, and the question at a time."""

    def __init__(self, robot: Robot, source: str, clock: Callable[[], int] = time.time_ns) -> None:
        parameters = replace(PARAMETERS, state_source=source)
        self.input = HeardStates(robot, parameters, clock)
        hear = self.input.hear
        self.keep = {topic: partial(hear, topic) for topic in self.input.middleware.waiting}

    def ask(self, now_ns: int = NOW_NS) -> Any:
        return self.input.snapshot(now_ns, MAX_AGE, MAX_LEAD)

    def refusal(self, now_ns: int = NOW_NS) -> InvalidInput:
        with pytest.raises(InvalidInput) as refusal:
            self.ask(now_ns)
        return refusal.value


@pytest.fixture
def states(lemur: Robot) -> Fed:
    return Fed(lemur, "chaser_state")


@pytest.fixture
def testbed(lemur: Robot) -> Fed:
    return Fed(lemur, "odometry")


def _odometry(stamp_ns: int = NOW_NS, x: float = 0.0) -> Odometry:
    message = Odometry(child_frame_id=SENSOR)
    message.header.frame_id, message.header.stamp = FRAME, time_message(stamp_ns)
    message.pose.pose.position.x = x
    return message


def _joints(robot: Robot, stamp_ns: int = NOW_NS, first: float = 0.0) -> JointState:
    message = JointState(name=list(robot.joint_names))
    message.header.stamp = time_message(stamp_ns)
    message.position = [first] + [0.0] * (robot.joints - 1)
    message.velocity = [0.0] * robot.joints
    return message


def _chaser_state(problem: PlanningProblem, stamp_ns: int = NOW_NS) -> Any:
    return state_message(problem.start, problem.robot.joint_names, stamp_ns, FRAME)


def test_the_state_heard_last_is_the_snapshot(states: Fed, lemur_capture: PlanningProblem) -> None:
    states.keep["chaser_state"](_chaser_state(lemur_capture, NOW_NS - SECOND // 5))
    states.keep["chaser_state"](_chaser_state(lemur_capture, NOW_NS - SECOND // 10))
    snapshot = states.ask()
    assert (snapshot.stamp_ns, snapshot.source) == (NOW_NS - SECOND // 10, "chaser_state")
    np.testing.assert_array_equal(
        snapshot.state.joint_positions, lemur_capture.start.joint_positions
    )


@pytest.mark.parametrize("seed", range(20))
def test_the_newest_stamp_counts_in_whatever_order_states_come(
    states: Fed, lemur_capture: PlanningProblem, seed: int
) -> None:
    ages = [0.01 * age for age in range(40)]
    random.Random(seed).shuffle(ages)
    for number, age in enumerate(ages, 1):
        states.keep["chaser_state"](_chaser_state(lemur_capture, NOW_NS - round(age * SECOND)))
        assert states.ask().stamp_ns == NOW_NS - round(min(ages[:number]) * SECOND)


@pytest.mark.parametrize("topic", ["odometry", "joint_states"])
def test_the_newest_half_counts_though_an_older_one_comes_last(
    testbed: Fed, lemur: Robot, topic: str
) -> None:
    for late_ns in (0, SECOND // 500):
        if topic == "odometry" or not late_ns:
            testbed.keep["odometry"](_odometry(NOW_NS - late_ns))
        if topic == "joint_states" or not late_ns:
            testbed.keep["joint_states"](_joints(lemur, NOW_NS - late_ns))
    snapshot = testbed.ask()
    assert (snapshot.stamp_ns, snapshot.joint_states_stamp_ns) == (NOW_NS, NOW_NS)


def test_a_bad_state_that_comes_late_hides_nothing(
    states: Fed, lemur_capture: PlanningProblem
) -> None:
    states.keep["chaser_state"](_chaser_state(lemur_capture))
    late = _chaser_state(lemur_capture, NOW_NS - SECOND // 10)
    late.pose.position.x = float("nan")
    states.keep["chaser_state"](late)
    assert states.ask().stamp_ns == NOW_NS


def test_one_stamp_far_ahead_does_not_count_for_ever(
    states: Fed, lemur_capture: PlanningProblem
) -> None:
    states.keep["chaser_state"](_chaser_state(lemur_capture, NOW_NS + 3600 * SECOND))
    assert states.refusal().status is Status.STATE_IN_FUTURE
    states.keep["chaser_state"](_chaser_state(lemur_capture, NOW_NS - SECOND // 10))
    assert states.ask().stamp_ns == NOW_NS - SECOND // 10
    assert states.ask(NOW_NS + SECOND // 10).stamp_ns == NOW_NS - SECOND // 10


def test_a_stamp_with_more_nanoseconds_than_a_second_is_told_until_the_next_state(
    lemur_capture: PlanningProblem,
) -> None:
    states = Fed(lemur_capture.robot, "chaser_state", lambda: NOW_NS)
    states.keep["chaser_state"](_chaser_state(lemur_capture))
    bad = _chaser_state(lemur_capture)
    bad.header.stamp.nanosec = 1_000_000_000
    states.keep["chaser_state"](bad)
    assert states.refusal().field == "chaser_state.header.stamp.nanosec"
    states.keep["chaser_state"](_chaser_state(lemur_capture))
    assert states.ask().stamp_ns == NOW_NS


def test_each_source_subscribes_to_its_own_topics(states: Fed, testbed: Fed) -> None:
    assert list(states.keep) == ["chaser_state"]
    assert list(testbed.keep) == ["odometry", "joint_states"]


def test_what_was_not_received_is_named(states: Fed, testbed: Fed, lemur: Robot) -> None:
    assert (states.refusal().status, states.refusal().field) == (Status.NO_STATE, "chaser_state")
    assert (testbed.refusal().status, testbed.refusal().field) == (Status.NO_STATE, "odometry")
    testbed.keep["odometry"](_odometry())
    assert testbed.refusal().field == "joint_states"
    testbed.keep["joint_states"](_joints(lemur))
    assert testbed.ask().stamp_ns == NOW_NS


def test_a_bad_state_is_told_and_hides_the_good_one_until_the_next_good_one(
    states: Fed, lemur_capture: PlanningProblem
) -> None:
    states.keep["chaser_state"](_chaser_state(lemur_capture))
    bad = _chaser_state(lemur_capture)
    bad.pose.position.x = float("nan")
    states.keep["chaser_state"](bad)
    for _ in range(2):
        refusal = states.refusal()
        assert (refusal.status, refusal.field) == (
            Status.NOT_FINITE,
            "chaser_state.pose.position",
        )
    states.keep["chaser_state"](_chaser_state(lemur_capture))
    assert states.ask().stamp_ns == NOW_NS


@pytest.mark.parametrize("topic", ["odometry", "joint_states"])
def test_a_bad_half_is_told_and_hides_the_good_pair_until_the_next_good_one(
    testbed: Fed, lemur: Robot, topic: str
) -> None:
    good = {"odometry": _odometry(), "joint_states": _joints(lemur)}
    for name, message in good.items():
        testbed.keep[name](message)
    bad: Any = _odometry() if topic == "odometry" else _joints(lemur)
    if topic == "odometry":
        bad.twist.twist.linear.y = float("inf")
    else:
        bad.velocity[3] = float("inf")
    testbed.keep[topic](bad)
    refusal = testbed.refusal()
    assert refusal.status is Status.NOT_FINITE
    assert refusal.field.startswith(topic)
    testbed.keep[topic](good[topic])
    assert testbed.ask().stamp_ns == NOW_NS


def test_a_bad_message_never_pairs_even_where_its_stamp_is_the_nearest(
    testbed: Fed, lemur: Robot
) -> None:
    bad = _joints(lemur, NOW_NS)
    bad.position[0] = float("nan")
    testbed.keep["odometry"](_odometry(NOW_NS))
    testbed.keep["joint_states"](bad)
    testbed.keep["joint_states"](_joints(lemur, NOW_NS + SECOND // 200, first=0.25))
    assert testbed.ask().state.joint_positions[0] == 0.25


@pytest.mark.law("NODE-05")
@pytest.mark.parametrize("source", ["states", "testbed"])
@pytest.mark.parametrize(
    ("age_ns", "status"),
    [
        (SECOND // 2, None),
        (SECOND // 2 + 900, None),  # rounding
        (SECOND // 2 + 1_500, Status.STATE_TOO_OLD),
        (-SECOND // 20, None),
        (-SECOND // 20 - 900, None),
        (-SECOND // 20 - 1_500, Status.STATE_IN_FUTURE),
        (NOW_NS, Status.STATE_TOO_OLD),  # the stamp was left out
        (NOW_NS - (2**31 - 1) * SECOND, Status.STATE_IN_FUTURE),
    ],
)
def test_a_state_may_be_as_old_and_as_early_as_declared_and_no_more(
    request: pytest.FixtureRequest,
    lemur_capture: PlanningProblem,
    source: str,
    age_ns: int,
    status: Status | None,
) -> None:
    fed: Fed = request.getfixturevalue(source)
    stamp_ns = NOW_NS - age_ns
    messages = {
        "chaser_state": _chaser_state(lemur_capture, stamp_ns),
        "odometry": _odometry(stamp_ns),
        "joint_states": _joints(lemur_capture.robot, stamp_ns),
    }
    for topic, keep in fed.keep.items():
        keep(messages[topic])
    if status is None:
        assert fed.ask().stamp_ns == stamp_ns
        return
    refusal = fed.refusal()
    assert refusal.status is status
    assert refusal.field == f"{next(iter(fed.keep))}.header.stamp"
    limit, name = (
        (MAX_AGE, "state_max_age")
        if status is Status.STATE_TOO_OLD
        else (MAX_LEAD, "state_future_tolerance")
    )
    assert f"at most {limit:g} s" in refusal.allowed
    assert name in refusal.allowed


@pytest.mark.parametrize("silent", ["odometry", "joint_states"])
def test_the_half_that_has_fallen_silent_is_named(testbed: Fed, lemur: Robot, silent: str) -> None:
    for step in range(11):
        stamp_ns = NOW_NS - SECOND + step * SECOND // 10
        if step == 0 or silent != "odometry":
            testbed.keep["odometry"](_odometry(stamp_ns))
        if step == 0 or silent != "joint_states":
            testbed.keep["joint_states"](_joints(lemur, stamp_ns))
    refusal = testbed.refusal()
    assert (refusal.status, refusal.field) == (Status.STATE_TOO_OLD, f"{silent}.header.stamp")
    assert refusal.value == "1.000 s old"


def test_halves_of_different_moments_are_refused_with_their_difference(
    testbed: Fed, lemur: Robot
) -> None:
    testbed.keep["odometry"](_odometry(NOW_NS - SECOND // 4))
    testbed.keep["odometry"](_odometry(NOW_NS - SECOND // 5))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS))
    refusal = testbed.refusal()
    assert refusal.status is Status.STATE_NOT_SYNCHRONIZED
    assert "odometry and joint_states is 0.200 s apart" in str(refusal)
    assert "state_synchronization" in refusal.allowed


def test_halves_may_be_as_far_apart_as_declared_and_no_more(testbed: Fed, lemur: Robot) -> None:
    testbed.keep["odometry"](_odometry(NOW_NS))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS + SECOND // 100 + 1_500))
    assert testbed.refusal().status is Status.STATE_NOT_SYNCHRONIZED
    testbed.keep["joint_states"](_joints(lemur, NOW_NS + SECOND // 100 + 900, first=0.5))
    assert testbed.ask().state.joint_positions[0] == 0.5


def test_a_pair_of_long_ago_is_no_state_though_both_halves_go_on(
    testbed: Fed, lemur: Robot
) -> None:
    testbed.keep["odometry"](_odometry(NOW_NS - SECOND))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS - SECOND))
    testbed.keep["odometry"](_odometry(NOW_NS - SECOND // 10))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS))
    refusal = testbed.refusal()
    assert (refusal.status, refusal.value) == (Status.STATE_NOT_SYNCHRONIZED, "0.100 s apart")


@pytest.mark.parametrize("seed", range(20))
def test_any_interleaving_gives_the_newest_odometry_that_has_a_partner_and_its_nearest_one(
    lemur: Robot, seed: int
) -> None:
    # Against every pair there is, looked through one by one.
    shuffle, fed = random.Random(seed), Fed(lemur, "odometry")
    delays = {"odometry": shuffle.uniform(0.0, 0.1), "joint_states": shuffle.uniform(0.0, 0.1)}
    periods = {"odometry": shuffle.uniform(0.005, 0.1), "joint_states": shuffle.uniform(0.002, 0.1)}
    arrivals = []
    for topic, period in periods.items():
        for step in range(int(1.0 / period)):
            measured_ns = round((step * period + shuffle.uniform(0.0, 0.3 * period)) * SECOND)
            arrivals.append((measured_ns + round(delays[topic] * SECOND), topic, measured_ns))
    heard: dict[str, list[int]] = {"odometry": [], "joint_states": []}
    paired = 0
    for now_ns, topic, measured_ns in sorted(arrivals):
        if topic == "odometry":
            fed.keep[topic](_odometry(measured_ns, x=measured_ns / SECOND))
        else:
            fed.keep[topic](_joints(lemur, measured_ns, first=measured_ns / SECOND))
        heard[topic].append(measured_ns)
        pairs = [
            (-chaser_ns, abs(joints_ns - chaser_ns), joints_ns)
            for chaser_ns in heard["odometry"]
            for joints_ns in heard["joint_states"]
            if abs(joints_ns - chaser_ns) <= TOLERANCE * SECOND
            and now_ns - chaser_ns <= SECOND // 2
        ]
        if pairs:
            chaser_ns, _, joints_ns = min(pairs)
            snapshot = fed.ask(now_ns)
            assert snapshot.stamp_ns == -chaser_ns
            assert snapshot.state.position_chaser_in_inertial[0] == -chaser_ns / SECOND
            assert snapshot.state.joint_positions[0] == joints_ns / SECOND
            paired += 1
        else:
            assert fed.refusal(now_ns).status in (Status.NO_STATE, Status.STATE_NOT_SYNCHRONIZED)
    assert paired > 0


def test_joint_states_of_others_leave_the_arms_alone(testbed: Fed, lemur: Robot) -> None:
    gripper = JointState(name=["finger"], position=[0.1], velocity=[0.0])
    testbed.keep["odometry"](_odometry())
    testbed.keep["joint_states"](gripper)
    refusal = testbed.refusal()
    assert refusal.status is Status.UNKNOWN_JOINT
    assert refusal.value == ["finger"]
    assert "missing: " in refusal.allowed
    testbed.keep["joint_states"](_joints(lemur))
    testbed.keep["joint_states"](gripper)
    assert testbed.ask().stamp_ns == NOW_NS


@pytest.mark.parametrize("source", ["states", "testbed"])
def test_nothing_from_before_a_jump_of_the_clock_is_left(
    request: pytest.FixtureRequest, lemur_capture: PlanningProblem, source: str
) -> None:
    fed: Fed = request.getfixturevalue(source)

    def hear(stamp_ns: int) -> None:
        messages = {
            "chaser_state": _chaser_state(lemur_capture, stamp_ns),
            "odometry": _odometry(stamp_ns),
            "joint_states": _joints(lemur_capture.robot, stamp_ns),
        }
        for topic, keep in fed.keep.items():
            keep(messages[topic])

    hear(NOW_NS)
    fed.input.clear()
    refusal = fed.refusal(NOW_NS)
    assert refusal.status is Status.NO_STATE
    assert "none was received since the clock has jumped back" in str(refusal)
    hear(NOW_NS - 3600 * SECOND)
    assert fed.ask(NOW_NS - 3600 * SECOND).stamp_ns == NOW_NS - 3600 * SECOND


@pytest.mark.parametrize("told", [True, False])
def test_a_pair_from_before_a_jump_is_not_used_where_the_newest_messages_do_not_pair(
    testbed: Fed, lemur: Robot, told: bool
) -> None:
    # Told of the jump, not even a pair that may be as early as its stamp says.
    jump_ns = SECOND // 50 if told else SECOND
    testbed.keep["odometry"](_odometry(NOW_NS))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS))
    if told:
        testbed.input.clear()
    testbed.keep["odometry"](_odometry(NOW_NS - jump_ns))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS - jump_ns - SECOND // 20))
    refusal = testbed.refusal(NOW_NS - jump_ns)
    assert (refusal.status, refusal.value) == (Status.STATE_NOT_SYNCHRONIZED, "0.050 s apart")


def test_of_two_messages_with_one_stamp_the_last_one_counts(testbed: Fed, lemur: Robot) -> None:
    for value in (1.0, 2.0):
        testbed.keep["odometry"](_odometry(x=value))
        testbed.keep["joint_states"](_joints(lemur, first=value))
    state = testbed.ask().state
    assert state.position_chaser_in_inertial[0] == 2.0
    assert state.joint_positions[0] == 2.0


def test_a_step_back_that_nobody_told_of_passes_with_the_next_messages(
    testbed: Fed, lemur: Robot
) -> None:
    # The host's clock was set: ROS has no callback for that.
    before_ns = NOW_NS - 3600 * SECOND
    testbed.keep["odometry"](_odometry(NOW_NS, x=1.0))
    testbed.keep["joint_states"](_joints(lemur, NOW_NS))
    assert testbed.refusal(before_ns).status is Status.STATE_IN_FUTURE
    testbed.keep["odometry"](_odometry(before_ns, x=2.0))
    testbed.keep["joint_states"](_joints(lemur, before_ns))
    assert testbed.ask(before_ns).state.position_chaser_in_inertial[0] == 2.0


def test_the_memory_of_a_topic_ends(testbed: Fed, lemur: Robot) -> None:
    # An odometry message can wait for its partner while a second's worth of others come at 1 kHz.
    testbed.keep["joint_states"](_joints(lemur, NOW_NS))
    for late in range(1, 1000):
        testbed.keep["odometry"](_odometry(NOW_NS + late + 2 * SECOND // 100))
    testbed.keep["odometry"](_odometry(NOW_NS, x=3.0))
    for late in range(1, 1000):
        testbed.keep["odometry"](_odometry(NOW_NS + late + 2 * SECOND // 100))
    assert testbed.ask().state.position_chaser_in_inertial[0] == 3.0
    testbed.keep["odometry"](_odometry(NOW_NS + 2 * SECOND // 100))
    assert testbed.refusal().status is Status.STATE_NOT_SYNCHRONIZED


def test_a_huge_message_is_refused_and_let_go(testbed: Fed, lemur: Robot) -> None:
    testbed.keep["odometry"](_odometry())
    huge = _joints(lemur)
    huge.position = [0.0] * 100_000
    references = sys.getrefcount(huge)
    testbed.keep["joint_states"](huge)
    refusal = testbed.refusal()
    assert refusal.status is Status.WRONG_SIZE
    assert len(str(refusal)) < 1000
    assert sys.getrefcount(huge) == references


def test_a_hundred_thousand_foreign_joints_are_told_in_short(
    states: Fed, lemur_capture: PlanningProblem
) -> None:
    message = _chaser_state(lemur_capture)
    message.joint_names = [f"tentacle_{i}" for i in range(100_000)]
    states.keep["chaser_state"](message)
    refusal = states.refusal()
    assert refusal.status is Status.UNKNOWN_JOINT
    assert "unknown: tentacle_0, tentacle_1, " in refusal.allowed
    assert "and 99980 more" in refusal.allowed
    assert len(str(refusal)) < 2000


def test_asking_again_and_again_does_not_grow_the_refusal(testbed: Fed) -> None:
    def frames() -> int:
        count, trace = 0, testbed.refusal().__traceback__
        while trace is not None:
            count, trace = count + 1, trace.tb_next
        return count

    assert len({frames() for _ in range(5)}) == 1


class Navigation:
    """A publisher whose clock is off, and the node that hears it, live."""

    def __init__(self, problem: PlanningProblem, source: str, ahead: float) -> None:
        self.now_ns, self.ahead, self._problem = NOW_NS, ahead, problem
        self.fed = Fed(problem.robot, source, lambda: self.now_ns)

    def go_on(self, seconds: float, rate: float = 20.0) -> None:
        """Publish at a rate [Hz] for a time."""
        for _ in range(round(seconds * rate)):
            self.now_ns += round(SECOND / rate)
            self.say(self.ahead)

    def say(self, ahead: float, came_ns: int | None = None) -> None:
        stamp_ns = self.now_ns + round(ahead * SECOND)
        messages = {
            "chaser_state": _chaser_state(self._problem, stamp_ns),
            "odometry": _odometry(stamp_ns),
            "joint_states": _joints(self._problem.robot, stamp_ns),
        }
        for topic, keep in self.fed.keep.items():
            keep(messages[topic], came_ns=came_ns)

    def refusal(self) -> InvalidInput:
        return self.fed.refusal(self.now_ns)


@pytest.mark.law("NODE-04")
@pytest.mark.parametrize("source", STATE_SOURCES)
@pytest.mark.parametrize("ahead", [0.06, 3.0, 3600.0])
def test_a_stamp_ahead_of_now_never_becomes_a_measurement_of_now(
    lemur_capture: PlanningProblem, source: str, ahead: float
) -> None:
    """However long one waits: as long as its publisher goes on, and when it has stopped."""
    navigation = Navigation(lemur_capture, source, ahead)
    for _ in range(5):
        navigation.go_on(1.0)
        refusal = navigation.refusal()
        assert refusal.status is Status.STATE_IN_FUTURE
        assert refusal.value == f"{ahead:.3f} s ahead of its arrival"
        assert navigation.fed.input.clock_offset == pytest.approx(ahead)
    for _ in range(20):
        navigation.now_ns += round(ahead / 10 * SECOND)
        assert navigation.refusal().status is Status.STATE_IN_FUTURE


@pytest.mark.parametrize("source", STATE_SOURCES)
def test_what_came_with_a_stamp_ahead_hides_no_measurement_when_its_time_has_come(
    lemur_capture: PlanningProblem, source: str
) -> None:
    """It has the newest stamp by then, and was heard long before the last measurement."""
    navigation = Navigation(lemur_capture, source, 0.0)
    navigation.say(6.0)
    navigation.go_on(5.9)
    measured_ns = navigation.now_ns
    navigation.now_ns += SECOND // 5
    assert navigation.fed.ask(navigation.now_ns).stamp_ns == measured_ns


@pytest.mark.parametrize("source", STATE_SOURCES)
def test_what_was_stamped_ahead_is_refused_until_the_first_message_that_is_not(
    lemur_capture: PlanningProblem, source: str
) -> None:
    """However many of either wait until somebody asks."""
    navigation = Navigation(lemur_capture, source, 3.0)
    for right_ones, ahead_ones in ((0, 1), (1, 1), (5, 5)):
        navigation.ahead = -0.01
        navigation.go_on(right_ones / 20.0)
        navigation.ahead = 3.0
        navigation.go_on(ahead_ones / 20.0)
        assert navigation.refusal().status is Status.STATE_IN_FUTURE
    navigation.say(-0.01)
    snapshot = navigation.fed.ask(navigation.now_ns)
    assert snapshot.stamp_ns == navigation.now_ns - SECOND // 100
    assert snapshot.clock_offset == pytest.approx(-0.01)


@pytest.mark.law("NODE-04")
@pytest.mark.parametrize("source", STATE_SOURCES)
def test_in_simulated_time_what_is_ahead_when_it_is_taken_never_becomes_a_measurement(
    lemur_capture: PlanningProblem, source: str
) -> None:
    """The host's clock, which goes on alone, tells nothing of it."""
    navigation = Navigation(lemur_capture, source, 0.0)
    navigation.fed.input.middleware.simulated = True
    navigation.say(3.0, came_ns=NOW_NS + 3600 * SECOND)
    for _ in range(5):
        assert navigation.refusal().status is Status.STATE_IN_FUTURE
        navigation.now_ns += SECOND
    navigation.say(0.0, came_ns=NOW_NS - 3600 * SECOND)
    assert navigation.fed.ask(navigation.now_ns).stamp_ns == navigation.now_ns
    assert navigation.fed.ask(navigation.now_ns).clock_offset == 0.0
    assert navigation.fed.input.clock_offset is None


def test_what_comes_before_simulated_time_begins_waits_for_it(
    lemur_capture: PlanningProblem,
) -> None:
    navigation = Navigation(lemur_capture, "chaser_state", 0.0)
    navigation.fed.input.middleware.simulated = True
    navigation.say(0.0)
    begun_ns, navigation.now_ns = navigation.now_ns, 0
    assert navigation.refusal().status is Status.NO_STATE
    navigation.now_ns = begun_ns
    assert navigation.fed.ask(begun_ns).stamp_ns == begun_ns


@pytest.mark.parametrize("source", STATE_SOURCES)
def test_a_clock_that_is_behind_is_told_as_such_and_a_publisher_that_is_gone_is_not(
    lemur_capture: PlanningProblem, source: str
) -> None:
    navigation = Navigation(lemur_capture, source, -2.0)
    navigation.go_on(1.0)
    refusal = navigation.refusal()
    assert (refusal.status, refusal.value) == (Status.STATE_TOO_OLD, "2.000 s old")
    assert "clock is 2.000 s behind this node's" in refusal.allowed
    navigation.now_ns += 60 * SECOND
    assert "behind" not in navigation.refusal().allowed
    navigation.ahead = 0.0
    navigation.go_on(1.0)
    navigation.now_ns += 60 * SECOND
    assert "behind" not in navigation.refusal().allowed


def test_a_stored_message_is_read_when_it_is_asked_for_and_a_huge_one_is_not_stored(
    states: Fed, lemur_capture: PlanningProblem
) -> None:
    message = _chaser_state(lemur_capture)
    states.keep["chaser_state"](message)
    assert states.ask().stamp_ns == NOW_NS
    states.keep["chaser_state"](b"\0\1\0\0" + bytes(20))
    assert states.refusal(0).value == "damaged"
    message.joint_names = [f"tentacle_{i}" for i in range(10_000)]
    states.keep["chaser_state"](message)
    assert states.refusal().status is Status.UNKNOWN_JOINT


def test_joint_states_whose_names_begin_as_the_arms_are_of_others(
    testbed: Fed, lemur: Robot
) -> None:
    longer = [f"{name}_of_another_arm" for name in lemur.joint_names]
    testbed.keep["odometry"](_odometry())
    testbed.keep["joint_states"](_joints(lemur))
    others = JointState(name=longer, position=[0.1] * 7, velocity=[0.0] * 7)
    others.header.stamp = time_message(NOW_NS)
    testbed.keep["joint_states"](others)
    assert testbed.ask().stamp_ns == NOW_NS


def _said_by_two(problem: PlanningProblem, source: str) -> Fed:
    """A state input that hears two publishers of each topic, in turn."""
    fed = Fed(problem.robot, source, lambda: NOW_NS)
    fed.input.middleware.names = ["/nav_a", "/nav_b"]
    messages = {
        "chaser_state": _chaser_state(problem),
        "odometry": _odometry(),
        "joint_states": _joints(problem.robot),
    }
    for by in ("/nav_a", "/nav_b"):
        for topic, keep in fed.keep.items():
            keep(messages[topic], by=by)
    return fed


@pytest.mark.law("NODE-06")
@pytest.mark.parametrize("source", STATE_SOURCES)
def test_two_publishers_of_a_state_are_refused_by_name_till_one_stops_or_they_are_allowed(
    lemur_capture: PlanningProblem, source: str
) -> None:
    fed = _said_by_two(lemur_capture, source)
    refusal = fed.refusal()
    assert (refusal.status, refusal.field) == (Status.SEVERAL_PUBLISHERS, next(iter(fed.keep)))
    assert refusal.value == "published by /nav_a and /nav_b"
    assert "allow_several_publishers" in refusal.allowed
    fed.input.middleware.allows_several = True
    assert fed.ask().stamp_ns == NOW_NS
    fed.input.middleware.allows_several = False
    fed.input.middleware.names = ["/nav_b"]
    assert fed.ask().stamp_ns == NOW_NS


class Controllers:
    """Controllers that publish the joint states of parts of an arm, beside one odometry."""

    def __init__(self, robot: Robot) -> None:
        self.now_ns, self._robot = NOW_NS, robot
        self.fed = Fed(robot, "odometry", lambda: self.now_ns)
        self.fed.input.middleware.names = ["/lower", "/upper"]
        self.fed.keep["odometry"](_odometry())

    @property
    def lower(self) -> list[str]:
        return list(self._robot.joint_names[:3])

    @property
    def upper(self) -> list[str]:
        return list(self._robot.joint_names[3:])

    def say(self, names: list[str], at: float, by: str, value: float = 0.0) -> None:
        """Publish joint states, measured `at` seconds after odometry."""
        message = JointState(name=names)
        message.header.stamp = time_message(NOW_NS + round(at * SECOND))
        message.position, message.velocity = [value] * len(names), [-value] * len(names)
        self.fed.keep["joint_states"](message, by=by)


@pytest.fixture
def arm(lemur: Robot) -> Controllers:
    controllers = Controllers(lemur)
    odometry = controllers.fed.input.middleware
    odometry.several = lambda topic: odometry.names if topic == "joint_states" else []  # type: ignore[method-assign]
    return controllers


@pytest.mark.parametrize("seed", range(20))
def test_halves_of_an_arm_are_merged_by_name_each_from_its_nearest_message(
    arm: Controllers, seed: int
) -> None:
    """At rates and phases of their own, beside a gripper; against a look at every message."""
    shuffle = random.Random(seed)
    heard = list[tuple[float, str]]()
    for half in ("lower", "upper"):
        period, phase = shuffle.uniform(0.002, 0.015), shuffle.uniform(0.0, 0.015)
        heard += [(phase + k * period - 0.2, half) for k in range(int(0.2 / period))]
    heard = [(round(at, 9), half) for at, half in heard if at <= 0.0]
    for at, half in sorted(heard, key=lambda one: one[0] + shuffle.uniform(0.0, 0.02)):
        arm.say(getattr(arm, half), at, f"/{half}", value=at)
        arm.say(["finger"], at, "/gripper")
    expected = [max(at for at, one in heard if one == half) for half in ("lower", "upper")]
    if min(expected) < -TOLERANCE:
        assert arm.fed.refusal().status is Status.STATE_NOT_SYNCHRONIZED
        return
    snapshot = arm.fed.ask()
    wanted = [expected[0]] * 3 + [expected[1]] * 4
    assert snapshot.state.joint_positions.tolist() == wanted
    assert snapshot.state.joint_velocities.tolist() == [-one for one in wanted]
    assert snapshot.joint_states_stamp_ns == NOW_NS + round(min(expected) * SECOND)


def test_a_half_that_is_missing_is_named_joint_by_joint(arm: Controllers) -> None:
    arm.say(arm.lower, 0.0, "/lower")
    refusal = arm.fed.refusal()
    assert (refusal.status, refusal.field) == (Status.UNKNOWN_JOINT, "joint_states.name")
    assert refusal.value == arm.lower
    assert f"missing: {', '.join(arm.upper)}" in refusal.allowed
    arm.say(arm.upper, 0.0, "/upper")
    assert arm.fed.ask().stamp_ns == NOW_NS


def test_a_half_that_has_fallen_silent_is_named_though_the_other_goes_on(arm: Controllers) -> None:
    arm.say(arm.upper, -1.0, "/upper")
    for step in range(11):
        arm.say(arm.lower, -1.0 + 0.1 * step, "/lower")
    refusal = arm.fed.refusal()
    assert refusal.status is Status.STATE_TOO_OLD
    assert refusal.field in [f"joint_states.header.stamp[{name}]" for name in arm.upper]
    assert refusal.value == "1.000 s old"


def test_halves_further_from_odometry_than_the_tolerance_make_no_state(arm: Controllers) -> None:
    arm.say(arm.lower, 0.005, "/lower")
    arm.say(arm.upper, -0.1, "/upper")
    refusal = arm.fed.refusal()
    assert (refusal.status, refusal.value) == (Status.STATE_NOT_SYNCHRONIZED, "0.100 s apart")
    arm.say(arm.upper, -0.009, "/upper")
    assert arm.fed.ask().joint_states_stamp_ns == NOW_NS - 9 * SECOND // 1000


def test_a_half_that_is_no_number_is_refused_though_the_other_is_newer(arm: Controllers) -> None:
    arm.say(arm.upper, -0.005, "/upper")
    arm.say(arm.upper, -0.001, "/upper", value=float("nan"))
    arm.say(arm.lower, 0.0, "/lower")
    assert arm.fed.refusal().status is Status.NOT_FINITE
    arm.say(arm.upper, 0.0, "/upper", value=0.5)
    assert arm.fed.ask().state.joint_positions.tolist() == [0.0] * 3 + [0.5] * 4


@pytest.mark.law("NODE-06")
def test_two_publishers_of_one_joint_are_refused_with_it_and_each_of_its_own_are_not(
    arm: Controllers,
) -> None:
    for step in range(10):
        arm.say(arm.lower, -0.001 * step, "/lower")
        arm.say(arm.upper, -0.001 * step, "/upper")
        assert arm.fed.ask().stamp_ns == NOW_NS
    arm.say(arm.upper[:1] + arm.lower[:1], 0.0, "/third")
    refusal = arm.fed.refusal()
    assert (refusal.status, refusal.field) == (Status.SEVERAL_PUBLISHERS, "joint_states")
    assert refusal.value == "published by /lower and /upper"
    assert f"one publisher of {arm.lower[0]}, {arm.upper[0]}" in refusal.allowed
    # One that was started anew counts from one, too: it is not refused for long.
    arm.now_ns += 4 * SECOND
    assert arm.fed.input.snapshot(arm.now_ns, 5.0, MAX_LEAD).stamp_ns == NOW_NS


def _with_first_locked(kind: str, at: float) -> Robot:
    """The paper's arm without its first joint, which is locked, and a mount that the URDF fixes."""
    first = '<joint name="joint_1" type="'
    text = LEMUR_URDF.read_text().replace(f'{first}revolute"', f'{first}{kind}"')
    mount = '<link name="lamp"/><joint name="mount" type="fixed"><parent link="chaser"/>'
    text = text.replace("</robot>", f'{mount}<child link="lamp"/></joint></robot>')
    return robot_from_urdf_text(text, "chaser", "end_effector", held_at={"joint_1": at})


WITHIN = 0.02  # of a locked joint
MOVED = [
    # Type and place of the joint, what is measured of it, and what is wrong; none: nothing.
    ("revolute", 0.3, (0.3, 0.0), ""),
    ("revolute", 0.3, (0.319, -0.019), ""),
    ("revolute", 0.3, (1.2, 0.0), "position"),
    ("revolute", 0.3, (0.279, 0.0), "position"),
    ("revolute", 0.3, (0.3, 0.021), "velocity"),
    ("revolute", 0.3, (0.3, -0.021), "velocity"),
    ("revolute", 0.3, (0.3 + 2.0 * np.pi, 0.0), "position"),
    ("continuous", 0.3, (0.3 - 4.0 * np.pi, 0.0), ""),
    ("continuous", 0.3, (1.2 + 2.0 * np.pi, 0.0), "position"),
    ("prismatic", 0.3, (0.33, 0.0), "position"),
    ("revolute", 0.3, (float("nan"), float("nan")), ""),
    ("revolute", 0.3, (float("inf"), 0.0), "position"),
]


@pytest.mark.parametrize("beside", ["with the arm", "alone"])
@pytest.mark.parametrize(("kind", "at", "measured", "wrong"), MOVED)
def test_a_joint_that_is_measured_elsewhere_than_locked_or_moving_is_refused_with_what_to_set(
    kind: str, at: float, measured: tuple[float, float], wrong: str, beside: str
) -> None:
    """Whoever publishes it: masses, collisions and the chaser's centre of mass depend on it."""
    robot = _with_first_locked(kind, at)
    fed = Fed(robot, "odometry")
    arm, other = _joints(robot), JointState(name=["finger", "joint_1"])
    told = arm if beside == "with the arm" else other
    told.name = [*arm.name, "joint_1"] if told is arm else other.name
    for name, value in zip(("position", "velocity"), measured, strict=True):
        setattr(told, name, [*(getattr(arm, name) if told is arm else [7.0]), value])
    fed.keep["odometry"](_odometry())
    for message in {id(one): one for one in (told, arm)}.values():
        fed.keep["joint_states"](message)
    limits = NOW_NS, MAX_AGE, MAX_LEAD, WITHIN
    if not wrong:
        fed.input.snapshot(*limits)
        return
    with pytest.raises(InvalidInput) as refused:
        fed.input.snapshot(*limits)
    assert refused.value.status is Status.START_OUTSIDE_LIMITS
    assert refused.value.field == f"joint_states.{wrong}[joint_1]"
    assert f"locked at {at:g} {'m' if kind == 'prismatic' else 'rad'}" in str(
        refused.value
    ) or "locked at rest" in str(refused.value)
    advice = f'set robot.locked_joints to "joint_1: {measured[0]:.6g}"'
    assert (advice if wrong == "position" else "stop it") in str(refused.value)
    told.position, told.velocity = ([*one[:-1], 0.0] for one in (told.position, told.velocity))
    told.position[-1] = at
    fed.keep["joint_states"](told)  # it is back, and the message before counts no more
    fed.input.snapshot(*limits)


def test_a_chaser_state_may_name_a_locked_joint_which_must_be_where_it_is_locked(
    lemur_capture: PlanningProblem,
) -> None:
    robot = _with_first_locked("revolute", 0.3)
    fed = Fed(robot, "chaser_state")
    for at, message in ((0.3, "a"), (1.2, "b")):
        state = _chaser_state(lemur_capture, NOW_NS + (message == "b"))
        state.joint_positions[0], state.joint_velocities[0] = at, 0.0
        fed.keep["chaser_state"](state)
        if at == 0.3:
            kept = fed.input.snapshot(NOW_NS, MAX_AGE, MAX_LEAD, WITHIN).state
            assert kept.joint_positions.tolist() == state.joint_positions.tolist()[1:]
    with pytest.raises(InvalidInput, match=r"chaser_state\.joint_positions\[joint_1\] is 1\.2 rad"):
        fed.input.snapshot(NOW_NS, MAX_AGE, MAX_LEAD, WITHIN)


def test_a_joint_that_the_urdf_fixes_is_not_measured_elsewhere_either() -> None:
    fed = Fed(robot := _with_first_locked("revolute", 0.3), "odometry")
    fed.keep["odometry"](_odometry())
    arm = _joints(robot)
    fed.keep["joint_states"](arm)
    fed.keep["joint_states"](JointState(name=["mount"], position=[0.4]))
    with pytest.raises(InvalidInput, match=r"\[mount\] is 0\.4 rad.* fixed in the URDF"):
        fed.input.snapshot(NOW_NS, MAX_AGE, MAX_LEAD, WITHIN)
