"""From a request to what is to be planned: times, sources, and what the arm does meanwhile."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from ff_planner_msgs.msg import Phase, PlanInputs, PlanRequest, TargetBody
from heard_inputs import HeardScenes
from robots import LEMUR_URDF
from ros_processes import FRAME, Scene

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput, Retry, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.robot import LimitParameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.limits import OF_ONE_NUMBER
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.robot.urdf.urdf import TURN_OF_CONTINUOUS
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.answers import status_message
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.reading import (
    Knowledge,
    ReadRequest,
    read_request,
)

NOW = 1_000 * NANOSECONDS
ANGLES = ("chaser_attitude", "chaser_rotation")  # that a request may limit
PARAMETERS = {
    "inertial_frame": FRAME,
    "points": 50,
    "time_budget": 30.0,
    "attitude_time_budget": 3.0,
    "planning_lead_time": 2.0,
    "start_horizon": 600.0,
    "end_behaviour": "none",
    "post_goal_duration": 1.5,
    "state_max_age": 0.5,
    "state_future_tolerance": 0.05,
}


def limiting(**angles: float) -> LimitParameters:
    """Return limits as the parameters have them, with some of the chaser's angles."""
    told = dict.fromkeys(OF_ONE_NUMBER, 0.0) | angles
    return LimitParameters("from_urdf", (0.0,), "from_urdf", **told)


def asked(
    problem: PlanningProblem,
    request: PlanRequest,
    measured_ns: int = NOW,
    published: PublishedPlan | None = None,
    inputs: PlanInputs | None = None,
    **parameters: Any,
) -> ReadRequest:
    used = replace(load_parameters(), **PARAMETERS | parameters)
    states = Mock()
    states.snapshot.return_value = Snapshot(problem.start, measured_ns, "chaser_state")
    scenes = HeardScenes()
    scenes.hear(Scene(problem).obstacles())
    knowledge = Knowledge(problem.robot, used, states, scenes, published, NOW)
    return read_request(request, knowledge, inputs)


def test_without_a_start_time_the_plan_starts_after_the_allowance(
    lemur_capture: PlanningProblem,
) -> None:
    request = Scene(lemur_capture).request()
    found = asked(lemur_capture, request, NOW - 300_000_000)
    assert found.start_ns == NOW + 2 * NANOSECONDS
    assert found.task.ahead == pytest.approx(2.3)
    assert found.inputs == PlanInputs(
        received_stamp=time_message(NOW),
        state_stamp=time_message(NOW - 300_000_000),
        state_source="chaser_state",
    )


def test_a_refusal_tells_its_sources_as_far_as_it_came(lemur_capture: PlanningProblem) -> None:
    request = Scene(lemur_capture).complete_request()
    request.scene[0].header.frame_id = "elsewhere"
    found = PlanInputs()
    with pytest.raises(InvalidInput, match=r"scene\.header\.frame_id"):
        asked(lemur_capture, request, inputs=found)
    now = time_message(NOW)
    assert found == PlanInputs(received_stamp=now, state_stamp=now, state_source="start_state")


@pytest.mark.parametrize(
    ("lead", "status", "words"),
    [
        (-0.5, Status.START_IN_PAST, ("start_time", "0.500 s ago")),
        (601.0, Status.OUT_OF_RANGE, ("start_time", "601.000 s ahead", "600")),
    ],
)
def test_a_start_time_that_is_over_or_far_ahead_is_refused(
    lemur_capture: PlanningProblem, lead: float, status: Status, words: tuple[str, ...]
) -> None:
    request = Scene(lemur_capture).request()
    request.start_time = time_message(NOW + round(lead * 1e9))
    with pytest.raises(InvalidInput) as refusal:
        asked(lemur_capture, request)
    assert refusal.value.status is status
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize("field", ["start_time", "start_state", "scene"])
@pytest.mark.parametrize("nanosec", [1_000_000_000, 2**32 - 1])
def test_a_time_with_more_nanoseconds_than_a_second_is_refused(
    lemur_capture: PlanningProblem, field: str, nanosec: int
) -> None:
    request = Scene(lemur_capture).complete_request()
    part = getattr(request, field)
    time = part if field == "start_time" else part[0].header.stamp
    time.sec, time.nanosec = NOW // NANOSECONDS - 1, nanosec
    with pytest.raises(InvalidInput, match=rf"{field}.*nanosec is {nanosec}: it must be less"):
        asked(lemur_capture, request)


def test_a_start_time_before_the_state_is_refused_and_the_allowance_waits_for_it(
    lemur_capture: PlanningProblem,
) -> None:
    ahead = NOW + 40_000_000
    request = Scene(lemur_capture).request()
    assert asked(lemur_capture, request, ahead, planning_lead_time=0.0).task.ahead == 0.0
    request.start_time = time_message(NOW + 10_000_000)
    with pytest.raises(InvalidInput, match=r"start_time is 0\.030 s before the start state"):
        asked(lemur_capture, request, ahead)


def test_the_requests_end_behaviour_goes_before_the_parameters(
    lemur_capture: PlanningProblem,
) -> None:
    request = Scene(lemur_capture).request()
    by_parameter = asked(lemur_capture, request, end_behaviour="hold_end_effector").task
    assert (by_parameter.end_behaviour, by_parameter.tail) == (EndBehaviour.HOLD_END_EFFECTOR, 1.5)
    request.end_behaviour = "stop_joints"
    by_request = asked(lemur_capture, request).task
    assert (by_request.end_behaviour, by_request.tail) == (EndBehaviour.STOP_JOINTS, 1.5)


@pytest.mark.parametrize(
    ("since", "off", "follows"),
    [
        *((4.0, 0.0, True), (4.0, 0.019, True), (4.0, 0.021, False)),
        *((4.0, -0.019, True), (4.0, -0.021, False), (11, 0, False)),
        *((10.001, 0.0, False), (9.999, 0.0, True)),
        # One that begins between the measurement and the start, if it begins where they will be
        *((-0.001, 0.0, True), (-0.1, 0.0, True), (-0.1, 0.03, False), (-2.1, 0.0, False)),
    ],
)
def test_the_joints_follow_the_last_plan_if_that_is_where_they_are(
    lemur_capture: PlanningProblem, lemur_plan: Plan, since: float, off: float, follows: bool
) -> None:
    """A plan of 10 s that began `since` seconds before the state was measured."""
    motion = lemur_plan.trajectory
    planned = [np.interp(since, motion.time, column) for column in motion.joint_positions.T]
    start = replace(lemur_capture.start, joint_positions=np.array(planned) + off * np.eye(7)[2])
    if since < 0.0:
        start = replace(start, joint_velocities=np.zeros(7))
    problem = replace(lemur_capture, start=start)
    published = PublishedPlan("run.1", motion, NOW - round(since * NANOSECONDS))
    found = asked(problem, Scene(problem).request(), published=published)
    running = found.task.running
    assert (running is not None) == follows
    assert found.inputs.previous_plan_id == ("run.1" if follows else "")
    if running is not None:
        # From the point before the state on: the task depends on no earlier one
        assert -0.21 < running.time[0] <= max(-since, 0.0) + 1e-9


def later(plan: Plan, first: PublishedPlan, seconds: float) -> PublishedPlan:
    """A plan that begins so many seconds after another one, where that one is by then."""
    motion = plan.trajectory
    (there,), _, _ = joint_motion(first.trajectory).at(np.array([seconds]))
    off = there - motion.joint_positions[0]
    moved = replace(motion, joint_positions=motion.joint_positions + off)
    start_ns = first.start_ns + round(seconds * NANOSECONDS)
    return PublishedPlan("run.2", moved, start_ns, before=first)


@pytest.mark.parametrize("begins", [5.0, 6.0, 4.0 + 30 / 49 * 10.0 - 4.0, 7.9])
@pytest.mark.parametrize("continuous", [False, True])
def test_the_joints_follow_one_plan_and_then_the_next_one_until_the_new_one_starts(
    lemur_capture: PlanningProblem, lemur_plan: Plan, begins: float, continuous: bool
) -> None:
    """One runs since 4 s, the next one is published for later, also at a point of the first."""
    first = PublishedPlan("run.1", lemur_plan.trajectory, NOW - 4 * NANOSECONDS)
    second = later(lemur_plan, first, begins)
    (now,), (rates,), _ = joint_motion(first.trajectory).at(np.array([4.0]))
    robot, turn = lemur_capture.robot, 2.0 * np.pi * np.eye(7)[2]
    if continuous:
        wide = np.where(turn, TURN_OF_CONTINUOUS, robot.upper_position_limits)
        robot = replace(
            robot,
            upper_position_limits=wide,
            lower_position_limits=-wide,
            continuous=tuple(turn > 0.0),
        )
        now = now + turn
    start = replace(lemur_capture.start, joint_positions=now, joint_velocities=rates)
    problem = replace(lemur_capture, robot=robot, start=start)
    request = Scene(problem).request()
    request.start_time = time_message(NOW + 4 * NANOSECONDS)
    found = asked(problem, request, published=second)
    assert found.inputs.previous_plan_id == "run.2"
    running = found.task.running
    assert running is not None
    for since in np.linspace(4.0, 8.0, 41):
        of, at = (first, since) if since < begins else (second, since - begins)
        positions, *others = joint_motion(of.trajectory).at(np.array([at]))
        # A continuous joint goes on from the turn that it is measured in.
        expected = positions + (turn if continuous else 0.0), *others
        if abs(since - begins) < 0.21:  # where the last piece of the first one is cut
            continue
        told = running.at(np.array([since - 4.0]))
        for one, other in zip(told, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-6)
    # For a start before the next one begins, that does not count.
    request.start_time = time_message(NOW + NANOSECONDS // 2)
    found = asked(problem, request, published=second)
    assert found.inputs.previous_plan_id == "run.1"


def test_every_joint_must_be_where_the_last_plan_wants_it(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    motion = lemur_plan.trajectory
    published = PublishedPlan("run.1", motion, NOW - round(motion.time[20] * NANOSECONDS))
    for joint in range(7):
        for off in (0.03, -0.03):
            joints = motion.joint_positions[20] + off * np.eye(7)[joint]
            problem = replace(
                lemur_capture, start=replace(lemur_capture.start, joint_positions=joints)
            )
            found = asked(problem, Scene(problem).request(), published=published)
            assert found.task.running is None, (joint, off)


def test_a_plan_that_begins_with_the_new_one_moves_nothing_before(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """It was published, and is to be replaced: until then the joints rest, or go on as they do."""
    motion = lemur_plan.trajectory
    joints = motion.joint_positions[0]
    problem = replace(lemur_capture, start=replace(lemur_capture.start, joint_positions=joints))
    begins = PublishedPlan("run.1", motion, NOW + 2 * NANOSECONDS)
    assert asked(problem, Scene(problem).request(), published=begins).task.running is None
    request = Scene(problem).request()
    request.start_time = time_message(NOW + NANOSECONDS)
    begun = PublishedPlan("run.1", motion, NOW)
    assert asked(problem, request, published=begun).task.running is not None
    request.start_time = time_message(NOW)
    assert asked(problem, request, published=begun).task.running is None


@pytest.mark.parametrize(
    ("age", "status"),
    [(0.49, None), (0.51, Status.STATE_TOO_OLD), (-0.04, None), (-0.06, Status.STATE_IN_FUTURE)],
)
def test_a_state_that_a_request_brings_is_as_old_and_as_early_as_one_heard_may_be(
    lemur_capture: PlanningProblem, age: float, status: Status | None
) -> None:
    request = Scene(lemur_capture).complete_request()
    request.start_state[0].header.stamp = time_message(NOW - round(age * NANOSECONDS))
    if status is None:
        found = asked(lemur_capture, request)
        assert nanoseconds(found.inputs.state_stamp) == NOW - round(age * NANOSECONDS)
        assert found.inputs.state_source == "start_state"
        return
    with pytest.raises(InvalidInput, match=r"start_state\.header\.stamp") as refusal:
        asked(lemur_capture, request)
    assert refusal.value.status is status
    is_over = status is Status.STATE_TOO_OLD  # its age only grows
    assert status_message(refusal.value).retry == (Retry.CHANGED if is_over else Retry.LATER)


def test_a_state_that_is_brought_without_a_stamp_is_of_now(lemur_capture: PlanningProblem) -> None:
    request = Scene(lemur_capture).complete_request()
    request.start_state[0].header.stamp = time_message(0)
    found = asked(lemur_capture, request)
    assert nanoseconds(found.inputs.state_stamp) == NOW
    assert found.task.ahead == pytest.approx(2.0)


def test_what_the_arm_does_after_the_goal_lasts_as_long_as_the_parameter_says_or_not_at_all(
    lemur_capture: PlanningProblem,
) -> None:
    request = Scene(lemur_capture).request()
    assert asked(lemur_capture, request, end_behaviour="none").task.tail == 0.0
    assert asked(lemur_capture, request, end_behaviour="stop_joints").task.tail == 1.5
    request.end_behaviour = "come_home"
    with pytest.raises(InvalidInput, match="end_behaviour is 'come_home'"):
        asked(lemur_capture, request)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("over", [False, True])
def test_no_joint_is_given_more_acceleration_than_the_parameter_says(
    lemur_capture: PlanningProblem, joint: int, over: bool
) -> None:
    most = 1.0 + np.arange(7.0)[::-1]
    limits = replace(limiting(), acceleration=tuple(most.tolist()))
    wanted = 0.5 * most
    wanted[joint] = (1.01 if over else 0.99) * most[joint]
    request = Scene(lemur_capture).request()
    request.limits.accelerations = wanted.tolist()
    if not over:
        found = asked(lemur_capture, request, limits=limits)
        assert found.task.problem.limits.joint_accelerations == tuple(wanted.tolist())
        return
    name = lemur_capture.robot.joint_names[joint]
    with pytest.raises(
        InvalidInput, match=rf"^limits\.accelerations.*joint {name} .*{most[joint]:g}"
    ):
        asked(lemur_capture, request, limits=limits)


@pytest.mark.parametrize(
    ("asked_for", "parameter", "kept"),
    [([], 0.0, np.inf), ([], 0.3, 0.3), ([0.2], 0.3, 0.2), ([0.3], 0.3, 0.3), ([0.2], 0.0, 0.2)],
)
def test_a_request_may_ask_for_a_smaller_limit_of_an_angle_than_the_parameters(
    lemur_capture: PlanningProblem, asked_for: list[float], parameter: float, kept: float
) -> None:
    for name in ANGLES:
        request = Scene(lemur_capture).request()
        setattr(request.limits, name, asked_for)
        limits = limiting(**{name: parameter})
        found = asked(lemur_capture, request, limits=limits).task.problem.limits
        assert found == Limits(True, **{name: kept})


@pytest.mark.parametrize(
    ("value", "parameter"),
    [
        *((-0.1, 0.0), (np.nan, 0.0), (np.nan, 0.3), (0.301, 0.3), (np.inf, 0.3)),
        *((0.0, 0.0), (0.0, 0.3)),  # zero is zero: it stands for no parameter
    ],
)
def test_a_limit_of_an_angle_that_is_none_or_more_than_the_parameters_is_refused_by_name(
    lemur_capture: PlanningProblem, value: float, parameter: float
) -> None:
    for name in ANGLES:
        request = Scene(lemur_capture).request()
        setattr(request.limits, name, [value])
        limits = limiting(**{name: parameter})
        with pytest.raises(InvalidInput, match=rf"^limits\.{name} is {value}") as refused:
            asked(lemur_capture, request, limits=limits)
        if not np.isfinite(value):
            assert refused.value.status is Status.NOT_FINITE
            continue
        assert ("at most 0.3 rad" in refused.value.allowed) == (parameter == 0.3)
        assert f"the parameter limits.{name} holds" in refused.value.allowed


@pytest.mark.parametrize("given", [[0.0], [-0.1], [np.nan], [0.1] * 6 + [0.0]])
def test_an_acceleration_of_zero_is_none_and_does_not_stand_for_the_parameter(
    lemur_capture: PlanningProblem, given: list[float]
) -> None:
    request = Scene(lemur_capture).request()
    request.limits.accelerations = given
    with pytest.raises(InvalidInput, match=rf"^limits\.accelerations\[{len(given) - 1}\] is "):
        asked(lemur_capture, request)


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        *((5, Status.OUT_OF_RANGE), (255, Status.OUT_OF_RANGE)),
    ],
)
def test_a_kind_of_goal_that_is_none_is_refused(
    lemur_capture: PlanningProblem, kind: int, status: Status
) -> None:
    request = Scene(lemur_capture).request()
    request.goal.kind = kind
    with pytest.raises(
        InvalidInput, match=rf"^goal\.kind is {kind}: it must be one of POSE \(0\), CAP"
    ) as refused:
        asked(lemur_capture, request)
    assert refused.value.status is status


@pytest.mark.parametrize(
    ("word", "status"),
    [
        *(("", None), ("discard", None), ("best", None)),
        *(("DISCARD", Status.OUT_OF_RANGE), ("x\n", Status.OUT_OF_RANGE)),
    ],
)
def test_what_a_cancelled_action_leaves_is_nothing_or_the_best_until_then(
    lemur_capture: PlanningProblem, word: str, status: Status | None
) -> None:
    request = Scene(lemur_capture).request()
    request.on_cancel = word
    if status is None:
        asked(lemur_capture, request)
        return
    with pytest.raises(
        InvalidInput, match=r"^on_cancel is .*: it must be discard or best"
    ) as refused:
        asked(lemur_capture, request)
    assert (refused.value.status, refused.value.field) == (status, "on_cancel")


def test_wheels_that_a_robot_does_not_have_have_no_momenta(lemur_capture: PlanningProblem) -> None:
    request = Scene(lemur_capture).complete_request()
    request.start_state[0].wheel_momenta = [0.0]
    with pytest.raises(InvalidInput) as refused:
        asked(lemur_capture, request)
    assert refused.value.status is Status.WRONG_SIZE
    assert refused.value.field == "start_state.wheel_momenta"


@pytest.mark.parametrize("name", ["two\nlines", "\x1b[31m", "n" * 201])
def test_a_name_of_who_asks_that_would_spoil_the_log_is_refused(
    lemur_capture: PlanningProblem, name: str
) -> None:
    request = Scene(lemur_capture).request()
    request.requester = name
    with pytest.raises(InvalidInput, match=r"requester is .*at most 200 printable characters"):
        asked(lemur_capture, request)


def test_a_plan_that_would_end_after_the_clock_of_messages_is_refused(
    lemur_capture: PlanningProblem,
) -> None:
    request = Scene(lemur_capture).request()
    request.duration = 2.0**31
    with pytest.raises(InvalidInput, match=r"duration is .* must end before 2038"):
        asked(lemur_capture, request)


def test_so_is_one_that_ends_later_with_all_that_follows(lemur_capture: PlanningProblem) -> None:
    request = Scene(lemur_capture).request()
    phase = Phase(duration=1e9)
    phase.goal.kind, phase.objective.joint_path_length = GoalKind.AT_REST, 1.0
    request.then = [phase]
    assert asked(lemur_capture, request).task.then
    request.then = 3 * [phase]
    with pytest.raises(InvalidInput, match=r"duration is .* must end before 2038"):
        asked(lemur_capture, request)


@pytest.mark.parametrize("field", ["duration", "duration_max"])
def test_the_motion_of_a_target_body_is_foretold_for_no_longer_than_clocks_count(
    lemur_capture: PlanningProblem, field: str
) -> None:
    """Or else a request holds up the node for ever, and all who ask after it."""
    request = Scene(lemur_capture).request()
    setattr(request, field, 1e30)
    body = TargetBody()
    body.header.frame_id, body.inertia.ixx = FRAME, 1.0
    body.inertia.iyy = body.inertia.izz = 1.0
    body.twist.angular.z = 1e-28
    request.goal.kind, request.target_body = GoalKind.CAPTURE, [body]
    with pytest.raises(InvalidInput, match="must end before 2038") as refused:
        asked(lemur_capture, request)
    assert refused.value.field == field


def test_a_state_in_the_request_that_has_a_locked_joint_elsewhere_is_refused(
    lemur_capture: PlanningProblem,
) -> None:
    at = float(lemur_capture.start.joint_positions[0])
    robot = load_robot(
        LEMUR_URDF, "chaser", "end_effector", held_at={"joint_1": at}, geometry=Geometry.LINES
    )
    request = Scene(lemur_capture).complete_request()
    request.start_state[0].joint_velocities[0] = 0.0
    names = [f"joint_{number}" for number in range(2, 8)]
    positions, velocities = (
        getattr(lemur_capture.start, name)[1:] for name in ("joint_positions", "joint_velocities")
    )
    start = replace(
        lemur_capture.start,
        joint_positions=positions,
        joint_velocities=velocities,
        joint_accelerations=None,
    )
    problem = replace(lemur_capture, robot=robot, start=start)
    assert list(asked(problem, request).task.problem.robot.joint_names) == names
    request.start_state[0].joint_positions[0] += 0.1
    with pytest.raises(InvalidInput, match=r"start_state\.joint_positions\[joint_1\]") as refused:
        asked(problem, request)
    assert refused.value.status is Status.START_OUTSIDE_LIMITS
    asked(problem, request, locked_joint_tolerance=0.11)
