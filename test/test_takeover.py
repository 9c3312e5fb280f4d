"""A request that takes over from the plan that runs: which one, and whether it still holds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from ff_planner_msgs.msg import PlanInputs, PlanRequest
from heard_inputs import HeardScenes
from robots import LEMUR_URDF
from ros_processes import FRAME, Scene
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Retry, Status
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.answers import status_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.continuing import ContinuedPlan, continued_plan
from ff_planner_ros.ros.requests.reading import (
    Knowledge,
    ReadRequest,
    read_request,
)

NOW = 1_000 * NANOSECONDS
BEGUN = NOW - 4 * NANOSECONDS  # a plan of 10 s that has run for four
PARAMETERS: NodeParameters = replace(load_parameters(), inertial_frame=FRAME)
LEMUR = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.LINES)
REMAINDER, ALLOWED = PARAMETERS.replanning.min_remainder, PARAMETERS.tracking
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])


def state_on(motion: Trajectory, time: float) -> SystemState:
    """Where a plan has the system at a time: between two points, on straight lines."""

    def at(rows: Any) -> Any:
        return np.array([np.interp(time, motion.time, column) for column in rows.T])

    attitude = at(motion.chaser_quaternions_xyzw)
    return SystemState(
        at(motion.chaser_positions),
        attitude / np.linalg.norm(attitude),
        at(motion.chaser_linear_velocities),
        at(motion.chaser_angular_velocities),
        at(motion.joint_positions),
        at(motion.joint_velocities),
    )


@pytest.fixture
def running(lemur_plan: Plan) -> PublishedPlan:
    return PublishedPlan("run.1", lemur_plan.trajectory, BEGUN)


def snapshot(running: PublishedPlan, at_ns: int = NOW, **moved: Any) -> Snapshot:
    state = state_on(running.trajectory, (at_ns - running.start_ns) / NANOSECONDS)
    return Snapshot(replace(state, **moved), at_ns, "chaser_state")


def taken_over(
    published: PublishedPlan | None, measured: Snapshot, start_ns: int, **changes: Any
) -> ContinuedPlan:
    """Take over from a plan of the paper's arm, with some fields of the robot changed."""
    robot = replace(LEMUR, **changes)
    return continued_plan(published, measured, start_ns, robot, REMAINDER, ALLOWED)


def refusal(published: PublishedPlan | None, measured: Snapshot, start_ns: int) -> InvalidInput:
    with pytest.raises(InvalidInput) as refused:
        taken_over(published, measured, start_ns)
    assert refused.value.field == "replan_active"
    return refused.value


@pytest.mark.parametrize("goal", [10.0, 7.0])
def test_it_joins_where_the_plan_is_by_then_and_its_goal_is_that_much_nearer(
    running: PublishedPlan, goal: float
) -> None:
    """A plan's goal is where its tail begins, not where that ends."""
    plan = replace(running, duration=goal if goal < 10.0 else None)
    found = taken_over(plan, snapshot(plan), NOW + NANOSECONDS // 4)
    assert found.splice_time == pytest.approx(4.25, abs=1e-9)
    assert found.remaining == pytest.approx(goal - 4.25, abs=1e-9)
    assert found.motion.time[[0, -1]] == pytest.approx([-4.0, 6.0], abs=1e-8)


@SIGNS
@pytest.mark.parametrize("joint", range(7))
def test_no_joint_may_be_further_ahead_or_behind_than_is_allowed(
    running: PublishedPlan, joint: int, sign: float
) -> None:
    sound, most = snapshot(running).state.joint_positions, ALLOWED.max_joint_position
    for part in (0.8, 1.2):
        off = sound + sign * part * most * np.eye(7)[joint]
        measured = snapshot(running, joint_positions=off)
        if part < 1.0:
            taken_over(running, measured, NOW)
            continue
        refused = refusal(running, measured, NOW)
        assert refused.status is Status.STATE_MOVED
        assert f"tracking.max_joint_position, {most:g} rad" in str(refused)
        assert "tracking.max_position" not in str(refused)


@SIGNS
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("what", ["max_position", "max_angle"])
def test_the_chaser_may_be_off_to_no_side_by_more_than_is_allowed(
    running: PublishedPlan, what: str, axis: int, sign: float
) -> None:
    sound, most = snapshot(running).state, getattr(ALLOWED, what)
    attitude = Rotation.from_quat(sound.quaternion_chaser_to_inertial_xyzw)
    for part in (0.8, 1.2):
        off = sign * part * most * np.eye(3)[axis]
        moved: dict[str, Any] = {
            "position_chaser_in_inertial": sound.position_chaser_in_inertial + off
        }
        if what == "max_angle":
            turned = Rotation.from_rotvec(off) * attitude
            moved = {"quaternion_chaser_to_inertial_xyzw": turned.as_quat()}
        measured = snapshot(running, **moved)
        if part < 1.0:
            taken_over(running, measured, NOW)
            continue
        refused = refusal(running, measured, NOW)
        assert refused.status is Status.STATE_MOVED
        assert f"tracking.{what}, {most:g}" in str(refused)


def test_one_joint_that_is_off_is_enough_though_all_others_are_not(running: PublishedPlan) -> None:
    measured = snapshot(running)
    off = measured.state.joint_positions - 2.0 * ALLOWED.max_joint_position * np.eye(7)[6]
    assert "joint_7's position by" in str(
        refusal(running, snapshot(running, joint_positions=off), NOW)
    )


def test_without_a_plan_that_runs_there_is_nothing_to_take_over_from(
    running: PublishedPlan,
) -> None:
    measured = snapshot(running)
    begins_later = replace(running, start_ns=NOW + NANOSECONDS)
    follows = replace(begins_later, before=running)
    over = replace(running, start_ns=NOW - 11 * NANOSECONDS)
    for published, retry in (
        *((None, Retry.CHANGED), (over, Retry.CHANGED)),
        *((begins_later, Retry.LATER), (follows, Retry.LATER)),  # then it runs
    ):
        refused = refusal(published, measured, NOW)
        assert refused.status is Status.NO_ACTIVE_PLAN
        assert status_message(refused).retry == retry
    assert "begins -11.000 s after the state was measured" in str(refusal(over, measured, NOW))


@pytest.mark.parametrize("left", [0.9, 1.1])
def test_what_is_nearly_at_its_goal_is_not_planned_again(
    running: PublishedPlan, left: float
) -> None:
    """Whether a tail comes after the goal or not."""
    remainder = left * REMAINDER
    for goal in (None, 8.0):
        plan = replace(running, duration=goal)
        start_ns = BEGUN + round((plan.seconds_to_goal - remainder) * NANOSECONDS)
        if left > 1.0:
            found = taken_over(plan, snapshot(plan), start_ns)
            assert found.remaining == pytest.approx(remainder, abs=1e-8)
        else:
            refused = refusal(plan, snapshot(plan), start_ns)
            assert refused.status is Status.PLAN_ENDING
            assert f"run.1 is at its goal {remainder:.3f} s after" in str(refused)


def later_plan(running: PublishedPlan, after: float) -> PublishedPlan:
    """A plan that takes over from one a while [s] from now, one tenth of a radian beside it."""
    rows = running.trajectory.time >= 4.0
    motion = Trajectory(
        **{name: rows_of[rows] for name, rows_of in vars(running.trajectory).items()}
    )
    start_ns = NOW + round(after * NANOSECONDS)
    motion = replace(
        motion,
        time=motion.time - motion.time[0],
        joint_positions=motion.joint_positions + 0.1,
        chaser_positions=motion.chaser_positions + 1.0,
    )
    return PublishedPlan("run.2", motion, start_ns, before=running)


def test_until_the_next_plan_begins_the_one_before_it_says_where_the_system_is(
    running: PublishedPlan,
) -> None:
    last, measured = later_plan(running, 0.5), snapshot(running)
    found = taken_over(last, measured, NOW + NANOSECONDS)
    assert found.splice_time == pytest.approx(0.5, abs=1e-9)
    times = np.array([0.0, 0.2, 0.5, 1.3])
    positions, _, _ = found.motion.at(times)
    first, _, _ = running.motion(NOW).at(times)
    then, _, _ = last.motion(NOW).at(times)
    assert (np.diff(found.motion.time) > 0.0).all()
    np.testing.assert_allclose(positions[:1], first[:1], atol=1e-12)
    np.testing.assert_allclose(positions[2:], then[2:], atol=1e-12)
    # The chaser is held against it, too, though the last plan does not say where that is by now.
    place = measured.state.position_chaser_in_inertial + 2.0 * ALLOWED.max_position
    moved = snapshot(running, position_chaser_in_inertial=place)
    assert "the chaser's position by" in str(refusal(last, moved, NOW + NANOSECONDS))
    # Only the plan before is looked at: the system is where the last one has it 4 s later.
    elsewhere = snapshot(last, last.start_ns)
    refused = refusal(last, replace(elsewhere, stamp_ns=NOW), NOW + NANOSECONDS)
    assert refused.status is Status.STATE_MOVED
    assert "where run.1 says" in str(refused)


@pytest.mark.parametrize("knot", range(25, 45))
def test_a_handover_exactly_at_a_point_of_the_running_plan_has_that_point_once(
    running: PublishedPlan, knot: int
) -> None:
    """Seen from any moment before: there is no interval of no length, whose rates were nonsense."""
    told = np.rint(running.trajectory.time * NANOSECONDS).astype(int)
    start_ns = BEGUN + int(told[knot])
    rng = np.random.default_rng(knot)
    for measured_ns in start_ns - rng.integers(NANOSECONDS // 4, NANOSECONDS, 20):
        last = later_plan(running, (start_ns - NOW) / NANOSECONDS)
        assert last.start_ns == start_ns
        measured = snapshot(running, int(measured_ns))
        found = taken_over(last, measured, start_ns + NANOSECONDS).motion
        assert np.diff(found.time).min() > 1e-3
        at = (start_ns - int(measured_ns)) / NANOSECONDS
        for time in np.array([[at], [at + 1e-4]]):
            there, wanted = found.at(time), last.motion(int(measured_ns)).at(time)
            np.testing.assert_allclose(there[0], wanted[0], atol=1e-9)
            np.testing.assert_allclose(there[1], wanted[1], atol=1e-7)


def test_a_plan_that_has_not_begun_by_the_handover_is_not_joined(
    running: PublishedPlan,
) -> None:
    last = later_plan(running, 0.5)
    refused = refusal(last, snapshot(running), NOW + NANOSECONDS // 4)
    assert refused.status is Status.NO_ACTIVE_PLAN
    assert "run.2, the last one, begins 0.500 s after the state was measured" in str(refused)


def asked(
    problem: PlanningProblem,
    running: PublishedPlan,
    request: PlanRequest,
    late_ns: int,
    inputs: PlanInputs | None = None,
) -> ReadRequest:
    states = Mock()
    states.snapshot.return_value = snapshot(running, NOW - late_ns)
    scenes = HeardScenes()
    scenes.hear(Scene(problem).obstacles())
    known = Knowledge(problem.robot, PARAMETERS, states, scenes, running, NOW)
    return read_request(request, known, inputs)


@pytest.mark.parametrize(
    ("duration", "longest", "planned"), [(0.0, 0.0, None), (3.0, 0.0, 3.0), (3.0, 9.0, 9.0)]
)
def test_a_request_tells_from_when_on_it_takes_over_and_how_much_remains(
    lemur_capture: PlanningProblem,
    running: PublishedPlan,
    duration: float,
    longest: float,
    planned: float | None,
) -> None:
    late_ns = NANOSECONDS // 10
    request = Scene(lemur_capture).request()
    request.replan_active, request.duration, request.duration_max = True, duration, longest
    read = asked(lemur_capture, running, request, late_ns)
    allowance = PARAMETERS.replanning.lead_time
    assert read.start_ns == NOW + round(allowance * NANOSECONDS)
    remaining = 6.0 - allowance
    assert read.task.problem.duration == pytest.approx(
        remaining if planned is None else planned, abs=1e-9
    )
    assert (read.task.problem.duration_range is None) == (longest == 0.0)
    assert read.task.ahead == pytest.approx(0.1 + allowance, abs=1e-9)
    assert read.task.running is not None
    assert read.task.running.time[0] == pytest.approx(-3.9, abs=1e-8)
    assert read.task.running_goal == pytest.approx(6.1, abs=1e-9)
    assert read.inputs.previous_plan_id == "run.1"
    assert read.inputs.handover_delay == pytest.approx(allowance, abs=1e-9)
    assert read.inputs.splice_time == pytest.approx(4.0 + allowance, abs=1e-9)


def test_a_refusal_to_take_over_says_from_which_plan(
    lemur_capture: PlanningProblem, running: PublishedPlan
) -> None:
    request = Scene(lemur_capture).request()
    request.replan_active, inputs = True, PlanInputs()
    with pytest.raises(InvalidInput, match=r"run\.1 is at its goal") as refused:
        asked(lemur_capture, replace(running, duration=4.0), request, 0, inputs)
    assert refused.value.status is Status.PLAN_ENDING
    assert inputs.previous_plan_id == "run.1"


def test_a_joint_that_slides_may_be_off_by_its_weight(running: PublishedPlan) -> None:
    most = ALLOWED.max_joint_position
    sound = snapshot(running).state.joint_positions
    off = snapshot(running, joint_positions=sound + 0.5 * most * np.eye(7)[0])
    start_ns = NOW + NANOSECONDS
    taken_over(running, off, start_ns)
    with pytest.raises(InvalidInput, match="joint_1's position by"):
        taken_over(running, off, start_ns, joint_weights=np.append(3.0, np.ones(6)))


@SIGNS
def test_a_plan_goes_on_from_the_turn_that_a_continuous_joint_is_measured_in(
    running: PublishedPlan, sign: float
) -> None:
    """Its encoder may wrap where the plan goes on; a joint with limits is off the plan then."""
    turn = sign * 2.0 * np.pi * np.eye(7)[0]
    measured = snapshot(running).state.joint_positions + turn
    off, start_ns = snapshot(running, joint_positions=measured), NOW + NANOSECONDS
    with pytest.raises(InvalidInput, match=r"joint_1's position by 6\.28 rad"):
        taken_over(running, off, start_ns)
    found = taken_over(running, off, start_ns, continuous=(True, *6 * [False]))
    (planned,), _, _ = found.motion.at(np.zeros(1))
    np.testing.assert_allclose(planned, measured, rtol=0.0, atol=ALLOWED.max_joint_position)
    plain = taken_over(running, snapshot(running), start_ns)
    np.testing.assert_allclose(
        found.motion.positions - turn, plain.motion.positions, rtol=0.0, atol=1e-12
    )
