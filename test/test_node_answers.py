"""A request that can be solved, through the real service: what comes back and is published."""

from __future__ import annotations

import time
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from robots import LEMUR_URDF
from ros_processes import (
    FRAME,
    Scene,
    answers_in,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.search.planner import plan

SPOKEN_ON = {
    "/chaser_state",
    "/obstacles",
    "/joint_trajectory",
    "/predicted_chaser_path",
    "/predicted_chaser_pose",
    "/tracking_error",
    "/markers",
    "/robot_description",
    "/planned_joint_states",
    "/diagnostics",
    "/rosout",
    "/exchanges",
}
# From a request to its plan [ns]; the chaser drifts meanwhile, and a busy machine takes its time.
ALLOWANCE = 10_000_000_000
# State and plan are of this much ahead of the beginning, in times that one plan takes here and now,
# and at least so many seconds.
LEAD_IN_PLANS, LEAST_LEAD = 10.0, 8.0


@dataclass(frozen=True)
class Run:
    """What was heard from one planner process, from its start to its end."""

    stamp_ns: int
    from_topics: Any
    again: Any
    overriding: Any
    shuffled: Any
    asked_ns: int
    answered_ns: int
    received: dict[str, list[Any]]
    received_late: dict[str, list[Any]]
    exit_code: int
    bag: dict[str, list[Any]]
    attachments: dict[str, bytes]


@pytest.fixture(scope="module")
def run(lemur_capture: PlanningProblem, tmp_path_factory: pytest.TempPathFactory) -> Run:
    scene, directory = Scene(lemur_capture), tmp_path_factory.mktemp("answers")
    arguments = (
        *("-p", "state_max_age:=3600.0", "-p", "state_future_tolerance:=3600.0"),
        *("-p", f"planning_lead_time:={ALLOWANCE / 1e9}"),
        # Each plan starts from its own state, however soon after another it was asked for.
        *("-p", "tracking.max_joint_position:=0.0"),
    )
    with private_domain(), running_planner(directory, *arguments) as planner:
        with connected_client() as client:
            client.publish_obstacles(scene.obstacles())
            client.wait_for_planner()
            client.wait_for_an_answer()
            begun = time.monotonic()
            plan(lemur_capture, load_parameters().planner)
            lead = max(LEAD_IN_PLANS * (time.monotonic() - begun), LEAST_LEAD)
            stamp_ns = client.now_ns() + round(lead * 1e9)
            state = scene.state(stamp_ns)
            client.publish_and_wait(state)
            from_the_state = scene.request()
            from_the_state.start_time = state.header.stamp
            from_topics = client.plan(from_the_state)
            again = client.plan(from_the_state)
            assert again.status.code == Status.SOLVED, again.status.message  # as late as it gets
            client.wait_until(
                lambda: len(client.received["predicted_chaser_pose"]) >= 3, "a stream of poses"
            )
            client.wait_until(lambda: client.received["markers"], "markers")

            everything_blocked = scene.obstacles()
            everything_blocked.spheres[0].radius = 10.0
            client.publish_obstacles(everything_blocked)
            unreachable = scene.request()  # or else it is solved while the obstacles travel
            unreachable.goal.pose.pose.position.x = 10.0
            client.plan_until(
                unreachable, lambda answer: answer.status.code == Status.START_IN_COLLISION
            )
            asked_ns = client.now_ns()
            overriding = client.plan(scene.complete_request())
            answered_ns = client.now_ns()
            shuffled = client.plan(_with_joints_reversed(scene.complete_request()))
            client.wait_until(
                lambda: len(client.received["joint_trajectory"]) >= 4, "four trajectories"
            )
        with connected_client() as late:
            late.wait_until(
                lambda: (
                    late.received["joint_trajectory"] and late.received["predicted_chaser_path"]
                ),
                "the last plan at a late subscriber",
            )
        exit_code = planner.stop()
        bag = planner.bag
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        attachments = {item.name: item.data for item in make_reader(stream).iter_attachments()}
    return Run(
        stamp_ns=stamp_ns,
        from_topics=from_topics,
        again=again,
        overriding=overriding,
        shuffled=shuffled,
        asked_ns=asked_ns,
        answered_ns=answered_ns,
        received=client.received,
        received_late=late.received,
        exit_code=exit_code,
        bag=read_bag(bag),
        attachments=attachments,
    )


@pytest.mark.law("NODE-03")
def test_a_plan_for_the_states_own_time_starts_at_the_state_and_ends_at_the_target(
    run: Run, lemur_capture: PlanningProblem
) -> None:
    answer, problem = run.from_topics, lemur_capture
    assert answer.status.code == Status.SOLVED
    trajectory = answer.plans[0].joint_trajectory
    assert tuple(trajectory.joint_names) == problem.robot.joint_names
    assert trajectory.header.frame_id == FRAME
    assert _ns(trajectory.header.stamp) == run.stamp_ns
    assert len(trajectory.points) == problem.points
    assert _ns(trajectory.points[-1].time_from_start) == round(problem.duration * 1e9)
    np.testing.assert_allclose(
        trajectory.points[0].positions, problem.start.joint_positions, atol=1e-12
    )
    last = answer.plans[0].end_effector_path.poses[-1]
    assert _ns(last.header.stamp) == run.stamp_ns + round(problem.duration * 1e9)
    np.testing.assert_allclose(_position(last), problem.target.position, atol=1e-3)
    turned = _rotation(last) * Rotation.from_quat(problem.target.quaternion_xyzw).inv()
    assert turned.magnitude() <= 1e-3


def test_the_benchmark_is_solved_as_well_through_the_service(
    run: Run, lemur_capture: PlanningProblem
) -> None:
    (metrics,) = run.from_topics.metrics
    assert metrics.joint_path_length <= 1.115
    assert metrics.min_clearance >= 0.0
    assert metrics.penalty == 0.0
    (planned,) = run.from_topics.plans
    rates = np.array([point.velocities for point in planned.joint_trajectory.points])
    margin = (lemur_capture.robot.velocity_limits - np.abs(rates)).min()
    found = metrics.min_velocity_margin
    assert margin - 1e-3 < found <= margin + 1e-9  # less is left between the points
    assert len(planned.xi) == 18
    assert run.from_topics.solver.solve_time > 0.0


def test_every_row_of_the_answer_belongs_to_one_point(run: Run) -> None:
    (plan,) = run.from_topics.plans
    points = len(plan.joint_trajectory.points)
    assert len(plan.chaser_path.poses) == points
    assert len(plan.chaser_twists) == points
    assert len(plan.end_effector_path.poses) == points
    assert len(plan.end_effector_twists) == points
    for point, pose in zip(plan.joint_trajectory.points, plan.chaser_path.poses, strict=True):
        assert _ns(pose.header.stamp) == run.stamp_ns + _ns(point.time_from_start)
        assert pose.header.frame_id == FRAME


@pytest.mark.law("NODE-02")
def test_what_is_published_equals_the_answer(run: Run) -> None:
    answers = [run.from_topics, run.again, run.overriding, run.shuffled]
    published = [_without_torques(answer.plans[0].joint_trajectory) for answer in answers]
    assert run.received["joint_trajectory"] == published
    assert run.received["predicted_chaser_path"] == [a.plans[0].chaser_path for a in answers]


def test_a_late_subscriber_still_gets_the_last_plan(run: Run) -> None:
    last = _without_torques(run.shuffled.plans[0].joint_trajectory)
    assert run.received_late["joint_trajectory"] == [last]
    assert run.received_late["predicted_chaser_path"] == [run.shuffled.plans[0].chaser_path]


@pytest.mark.law("NODE-19")
def test_the_streamed_poses_lie_on_the_predicted_path(run: Run) -> None:
    (planned,) = run.from_topics.plans
    path, twists = planned.chaser_path.poses, planned.chaser_twists
    times = [_ns(pose.header.stamp) - run.stamp_ns for pose in path]
    spline = CubicHermiteSpline(
        np.array(times) / 1e9,
        [_position(pose) for pose in path],
        [[twist.linear.x, twist.linear.y, twist.linear.z] for twist in twists],
    )
    for pose in run.received["predicted_chaser_pose"][:3]:
        now = _ns(pose.header.stamp) - run.stamp_ns
        assert times[0] <= now <= times[-1]
        np.testing.assert_allclose(_position(pose), spline(now / 1e9), atol=1e-9)
        after = int(np.searchsorted(times, now))
        pair = slice(after - 1, after + 1)
        expected = _interpolated(path[pair], twists[pair], np.array(times[pair]) / 1e9, now / 1e9)
        assert (_rotation(pose).inv() * expected).magnitude() < 1e-9


def _interpolated(path: Any, twists: Any, times: Any, time: float) -> Rotation:
    """The rotation vector from the first pose on, as the cubic that has both ends' spins.

    From the formulas: p(s) = s (1 - s)^2 m0 + s^2 (3 - 2 s) p1 + s^2 (s - 1) m1, where m is the
    rotation vector's rate, which is 1 / Jr times the spin in axes of the body.
    """
    first, second = (_rotation(pose) for pose in path)
    spins = [np.array([twist.angular.x, twist.angular.y, twist.angular.z]) for twist in twists]
    step = times[1] - times[0]
    p1 = (first.inv() * second).as_rotvec()
    angle = np.linalg.norm(p1)
    x, y, z = p1
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    of_square = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    inverse_jacobian = np.eye(3) + cross / 2 + of_square * cross @ cross
    m0 = step * first.inv().apply(spins[0])
    m1 = step * inverse_jacobian @ second.inv().apply(spins[1])
    s = (time - times[0]) / step
    vector = s * (1 - s) ** 2 * m0 + s**2 * (3 - 2 * s) * p1 + s**2 * (s - 1) * m1
    return first * Rotation.from_rotvec(vector)


def test_the_same_request_gives_the_same_plan_under_another_id(run: Run) -> None:
    assert run.again.plans[0].joint_trajectory == run.from_topics.plans[0].joint_trajectory
    assert run.again.plans[0].xi == run.from_topics.plans[0].xi
    assert run.again.plan_id != run.from_topics.plan_id


def test_state_and_obstacles_of_the_request_go_before_the_topics(run: Run) -> None:
    # The published obstacles contain the whole arm: only those of the request can be avoided.
    assert run.overriding.status.code == Status.SOLVED
    assert run.overriding.inputs.state_source == "start_state"
    assert run.from_topics.inputs.state_source == "chaser_state"


def test_a_start_state_without_stamp_is_as_if_measured_now(run: Run) -> None:
    assert run.asked_ns <= _ns(run.overriding.inputs.state_stamp) <= run.answered_ns


def test_a_plan_without_start_time_starts_after_the_allowance(run: Run) -> None:
    start = _ns(run.overriding.plans[0].joint_trajectory.header.stamp)
    assert start - _ns(run.overriding.inputs.state_stamp) == ALLOWANCE


def test_joints_may_come_in_any_order(run: Run) -> None:
    shuffled, from_topics, overriding = (
        answer.plans[0].joint_trajectory
        for answer in (run.shuffled, run.from_topics, run.overriding)
    )
    assert shuffled.joint_names == from_topics.joint_names
    assert shuffled.points == overriding.points


def test_the_node_ends_with_exit_code_zero_on_sigint(run: Run) -> None:
    assert run.exit_code == 0


def test_the_bag_holds_what_was_said_on_every_topic(run: Run) -> None:
    counts = {topic: len(found) for topic, found in run.bag.items()}
    assert all(counts[topic] for topic in SPOKEN_ON), counts


@pytest.mark.law("BAG-01")
def test_the_bag_holds_every_answer_and_what_was_published(run: Run) -> None:
    answers = [run.from_topics, run.again, run.overriding, run.shuffled]
    recorded = [answer for answer in answers_in(run.bag) if answer.status.code == Status.SOLVED]
    assert [answer.plan_id for answer in recorded] == [answer.plan_id for answer in answers]
    for topic in ("joint_trajectory", "predicted_chaser_path"):
        assert len(run.bag[f"/{topic}"]) == len(answers)
    for recorded_answer, published, answer in zip(
        recorded, run.bag["/joint_trajectory"], answers, strict=True
    ):
        expected = [list(point.positions) for point in answer.plans[0].joint_trajectory.points]
        assert [p.positions.tolist() for p in published.points] == expected
        in_answer = recorded_answer.plans[0].joint_trajectory.points
        assert [p.positions.tolist() for p in in_answer] == expected


@pytest.mark.law("BAG-01")
def test_the_bag_explains_itself(run: Run) -> None:
    assert b"<robot" in run.attachments["robot.urdf"]
    assert b"state_max_age: 3600.0" in run.attachments["parameters.yaml"]


def test_the_robot_is_described_with_the_shapes_that_screens_show(run: Run) -> None:
    (described,) = run.bag["/robot_description"]
    assert described.data == LEMUR_URDF.read_text(encoding="utf-8")
    assert "<visual>" in described.data


def _without_torques(trajectory: Any) -> Any:
    """What a controller without an effort interface takes."""
    published = deepcopy(trajectory)
    for point in published.points:
        point.effort = []
    return published


def _with_joints_reversed(request: Any) -> Any:
    (state,) = request.start_state
    state.joint_names = state.joint_names[::-1]
    state.joint_positions = state.joint_positions[::-1]
    state.joint_velocities = state.joint_velocities[::-1]
    return request


def _ns(stamp: Any) -> int:
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def _position(pose: Any) -> list[float]:
    return [pose.pose.position.x, pose.pose.position.y, pose.pose.position.z]


def _rotation(pose: Any) -> Rotation:
    q = pose.pose.orientation
    return Rotation.from_quat([q.x, q.y, q.z, q.w])
