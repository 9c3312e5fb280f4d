"""A running node: plans that are asked for first and published later, and who asked."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState, Goal, PlanAnswer, PlanRequest, PlanStatus
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.srv import Describe
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from managed_node import Manager
from nav_msgs.msg import Path as NavPath
from quick_capture import resting_capture
from rclpy.parameter import Parameter
from robots import LEMUR_URDF
from ros_processes import (
    FRAME,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from std_msgs.msg import Header

from ff_planner_ros.bag.info import bag_document
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.runs.replay import Verdict, replay, replayable

# Plans start, and states are stamped, so far ahead that no machine is too slow [ns].
# Each request's plan begins a minute before that of the last, so that it finds the arm at rest
# however long a slow machine takes from one to the next [ns].
LEADS = itertools.count(3_500_000_000_000, -60_000_000_000)
SCENE = Scene(resting_capture())


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    tolerated = (f"{name}:=3600.0" for name in ("state_future_tolerance", "start_horizon"))
    arguments = [
        word for value in (*tolerated, "end_behaviour:=stop_joints") for word in ("-p", value)
    ]
    directory = tmp_path_factory.mktemp("publish_plan")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


@pytest.fixture(scope="module")
def client(planner: PlannerProcess) -> Iterator[Client]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        yield client


def request(client: Client, **fields: Any) -> PlanRequest:
    found = SCENE.complete_request()
    found.start_time = found.start_state[0].header.stamp = time_message(
        client.now_ns() + next(LEADS)
    )
    for name, value in fields.items():
        setattr(found, name, value)
    return found


def published(client: Client, plan_id: str) -> Any:
    """Wait for a published plan and its trajectory, the last of all."""
    heard = client.received["published_plan"]
    client.wait_until(lambda: heard and heard[-1].plan_id == plan_id, plan_id)
    plan = heard[-1]
    client.wait_until(
        lambda: plan.joint_trajectory in client.received["joint_trajectory"], "its trajectory"
    )
    return plan


@pytest.mark.law("NODE-08")
def test_a_plan_that_is_only_asked_for_goes_out_by_its_id(client: Client) -> None:
    before = [len(client.received[topic]) for topic in ("joint_trajectory", "published_plan")]
    asked = request(client, plan_only=True)
    made = client.plan(asked)
    assert made.status.code == Status.SOLVED, made.status
    fitting = {"requester": "executive", "start_state": asked.start_state}
    status = client.publish_plan(made, **fitting)
    assert status.code == Status.SOLVED, status
    plan = published(client, made.plan_id)
    # It is the first that came on either topic: nothing was published when it was asked for.
    after = [len(client.received[topic]) for topic in ("joint_trajectory", "published_plan")]
    assert [n - b for n, b in zip(after, before, strict=True)] == [1, 1]
    assert plan.requester == "executive"
    assert plan.end_behaviour == "stop_joints"
    (planned,) = made.plans
    assert plan.start_time == planned.joint_trajectory.header.stamp == asked.start_time
    assert plan.header.frame_id == "inertial"
    assert 0 < nanoseconds(plan.header.stamp) <= client.now_ns()
    assert [p.positions for p in plan.joint_trajectory.points] == [
        p.positions for p in planned.joint_trajectory.points
    ]
    again = client.publish_plan(made, **fitting)
    assert again.code == Status.UNKNOWN_PLAN
    assert "published already" in again.message


def test_an_id_of_no_plan_that_waits_is_refused_and_no_other_is_told(client: Client) -> None:
    at_once = client.plan(request(client))
    made, other = (client.plan(request(client, plan_only=True)) for _ in range(2))
    assert {one.status.code for one in (made, other, at_once)} == {Status.SOLVED}
    for plan_id in ("", "run.1", at_once.plan_id):
        state = request(client).start_state
        refused = client.publish_plan(made, start_state=state, plan_id=plan_id)
        assert refused.code == Status.UNKNOWN_PLAN, refused
        assert (refused.field, refused.retry) == ("plan_id", PlanStatus.RETRY_CHANGED)
        said = (refused.message, refused.value, refused.allowed)
        ids = (made.plan_id, other.plan_id)
        assert not [one for one in ids for text in said if one in text], refused
    # None of it hurt the plans that wait.
    for answer in (made, other):
        state = request(client).start_state
        state[0].header.stamp = answer.plans[0].joint_trajectory.header.stamp
        status = client.publish_plan(answer, start_state=state)
        assert status.code == Status.SOLVED, status


def test_a_plan_that_is_published_at_once_says_who_asked(client: Client) -> None:
    for name, said in (("", "plan_trajectory"), ("director", "director")):
        made = client.plan(request(client, requester=name))
        assert made.status.code == Status.SOLVED, made.status
        assert published(client, made.plan_id).requester == said
    _, result = client.send_goal(request(client)).result()
    assert published(client, result.plan_id).requester == "plan_trajectory_action"


@pytest.mark.law("NODE-09")
def test_a_plan_goes_out_only_from_where_it_begins(client: Client) -> None:
    asked = request(client, plan_only=True)
    made = client.plan(asked)
    assert made.status.code == Status.SOLVED, made.status
    # Nobody publishes states here: what is not measured cannot be compared.
    assert client.publish_plan(made).code == Status.NO_STATE
    state = SCENE.state(0)
    state.header.stamp = asked.start_time
    state.pose.position.x += 0.05
    moved = client.publish_plan(made, start_state=[state])
    assert moved.code == Status.STATE_MOVED
    assert "position by 0.05 m, more than tracking.max_position, 0.02 m" in moved.message
    state.pose.position.x -= 0.05
    status = client.publish_plan(made, start_state=[state])
    assert status.code == Status.SOLVED, status


def begin_ns(made: PlanAnswer) -> int:
    """Return when a plan begins [ns]."""
    return nanoseconds(made.plans[0].joint_trajectory.header.stamp)


def state_in(made: PlanAnswer, since: float, turned: float = 0.0) -> list[ChaserState]:
    """Return a request's state so long after a plan's first point [s], which it follows."""
    problem = SCENE.problem
    motion = joint_motion(plan_from_answer(made).trajectory)
    state = carried_forward(problem.robot, problem.start, since, motion)
    wrong = state.angular_velocity_chaser_in_inertial + np.deg2rad(0.01)
    joints = state.joint_positions + turned
    state = replace(state, angular_velocity_chaser_in_inertial=wrong, joint_positions=joints)
    stamp_ns = begin_ns(made) + round(since * NANOSECONDS)
    return [state_message(state, problem.robot.joint_names, stamp_ns, "inertial")]


def continuing(made: PlanAnswer, since: float, **changes: Any) -> dict[str, Any]:
    """Return what a request changes to continue a plan so long after its first point [s]."""
    start_ns = begin_ns(made) + round(since * NANOSECONDS)
    fields = {"replan_active": True, "duration": 0.0, "start_time": time_message(start_ns)}
    return fields | {"start_state": state_in(made, since - 0.2)} | changes


def require_joined(planned: PlanMessage, first: PlanAnswer, since: float) -> None:
    """Require that the joints begin as another plan moves them so long after its begin [s]."""
    joined = joint_motion(plan_from_answer(first).trajectory).at(np.array([since]))
    point = planned.joint_trajectory.points[0]
    for found, wanted in zip(
        (point.positions, point.velocities, point.accelerations), joined, strict=True
    ):
        assert found == pytest.approx(wanted[0], abs=1e-11)


def test_a_plan_takes_over_from_the_one_that_runs(client: Client) -> None:
    first = client.plan(request(client))
    assert first.status.code == Status.SOLVED, first.status
    second = client.plan(request(client, **continuing(first, 3.0)))
    assert second.status.code == Status.SOLVED, second.status
    inputs, (joined,), (planned,) = second.inputs, first.plans, second.plans
    assert inputs.previous_plan_id == first.plan_id
    assert (inputs.splice_time, second.solver.starts) == (3.0, 1)
    delay = (begin_ns(second) - nanoseconds(inputs.received_stamp)) / NANOSECONDS
    assert inputs.handover_delay == pytest.approx(delay)
    assert planned.duration == pytest.approx(joined.duration - 3.0, abs=1e-12)
    require_joined(planned, first, 3.0)
    plan = published(client, second.plan_id)
    assert plan.joint_trajectory.header.stamp == planned.joint_trajectory.header.stamp
    # The state is from before the second plan begins, while the first one still runs.
    third = client.plan(
        request(client, **continuing(second, 0.3, start_state=state_in(first, 2.9)))
    )
    assert third.status.code == Status.SOLVED, third.status
    assert third.inputs.previous_plan_id == second.plan_id

    ends = client.plan(request(client, **continuing(second, 6.9, start_state=state_in(first, 4.0))))
    assert ends.status.code == Status.PLAN_ENDING
    assert "0.100 s after the handover" in ends.status.message
    moved = client.plan(
        request(client, **continuing(first, 3.5, start_state=state_in(first, 3.4, turned=0.1)))
    )
    assert moved.status.code == Status.STATE_MOVED
    assert "more than tracking.max_joint_position, 0.02 rad" in moved.status.message
    early = request(client, replan_active=True)
    early.start_state[0].header.stamp = time_message(client.now_ns())
    nothing = client.plan(early)
    assert nothing.status.code == Status.NO_ACTIVE_PLAN
    assert (nothing.status.field, nothing.status.retry) == ("replan_active", PlanStatus.RETRY_LATER)
    assert third.plan_id in nothing.status.message


def test_a_plan_leaves_the_one_that_runs_for_a_path_to_follow(client: Client) -> None:
    """From where that plan has the end effector, to two centimetres beside where it would go on."""
    first = client.plan(request(client))
    assert first.status.code == Status.SOLVED, first.status
    went = first.plans[0].end_effector_path.poses[15:31]
    left_ns, path = nanoseconds(went[0].header.stamp), NavPath(header=Header(frame_id=FRAME))
    for pose in went:
        after_ns = nanoseconds(pose.header.stamp) - left_ns
        aside = PoseStamped(pose=deepcopy(pose.pose))
        aside.header.stamp = time_message(after_ns)
        part = after_ns / (nanoseconds(went[-1].header.stamp) - left_ns)
        aside.pose.position.y += 0.02 * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        path.poses.append(aside)
    since = (left_ns - begin_ns(first)) / NANOSECONDS
    asked = request(client, **continuing(first, since))
    asked.goal = Goal(kind=Goal.FOLLOW, orientation=Goal.FREE, path=[path])
    asked.limits.path_position_tolerance = [0.005]
    inside = client.plan(asked)
    assert inside.status.code == Status.COLLISION, inside.status
    assert re.search(r"^goal\.path\.poses\[7\]\.pose\.position lies .* c2", inside.status.message)
    asked.scene[0].spheres = []
    second = client.plan(asked)
    assert second.status.code == Status.SOLVED, second.status
    assert second.inputs.previous_plan_id == first.plan_id
    (planned,), (metrics,) = second.plans, second.metrics
    assert nanoseconds(planned.joint_trajectory.header.stamp) == left_ns
    assert planned.duration == pytest.approx(nanoseconds(path.poses[-1].header.stamp) / NANOSECONDS)
    assert 0.0 < metrics.max_path_position_error <= 0.005
    end_ns = nanoseconds(went[-1].header.stamp)
    at_end = [
        one for one in planned.end_effector_path.poses if nanoseconds(one.header.stamp) >= end_ns
    ]
    here, there = (one.pose.position for one in (at_end[0], path.poses[-1]))
    off = np.array([here.x - there.x, here.y - there.y, here.z - there.z])
    assert np.linalg.norm(off) <= 0.005
    require_joined(planned, first, since)


def test_it_describes_what_it_can_be_asked_for(client: Client) -> None:
    """Asked by a stranger who knows the messages alone; compared with the robot itself."""
    told = client.call(Describe, "/ff_planner/describe", Describe.Request())
    robot = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.LINES)
    assert (told.state, told.inertial_frame) == ("active", FRAME)
    assert (told.version, told.messages_version) == (version("ff_planner_ros"),) * 2
    assert told.goal_kinds == ["POSE", "CAPTURE", "JOINTS", "AT_REST", "FOLLOW"]
    assert told.orientations == ["FIXED", "FREE", "ABOUT_AXIS"]
    assert all(getattr(Goal, name) == value for value, name in enumerate(told.goal_kinds))
    assert told.obstacles == ["sphere", "box", "cylinder", "capsule", "cone", "mesh"]
    assert told.objectives == ["joint_path_length", "chaser_attitude", "duration"]
    assert told.end_behaviours == ["none", "hold_end_effector", "stop_joints"]
    arm = told.robot
    assert (arm.name, arm.base, arm.base_link, arm.tip_link) == (
        "lemur",
        "free_flyer",
        "chaser",
        "end_effector",
    )
    assert arm.joint_names == list(robot.joint_names)
    assert arm.lower_position_limits.tolist() == robot.lower_position_limits.tolist()
    assert arm.upper_position_limits.tolist() == robot.upper_position_limits.tolist()
    assert arm.velocity_limits.tolist() == robot.velocity_limits.tolist()
    assert arm.effort_limits.tolist() == robot.effort_limits.tolist()
    assert np.isinf(arm.acceleration_limits).all()
    assert not any([*arm.continuous, *arm.prismatic])
    values = {one.name: Parameter.from_parameter_msg(one).value for one in told.parameters}
    assert values["start_horizon"] == 3600.0
    assert values["end_behaviour"] == "stop_joints"
    assert not [name for name in values if name.startswith(("robot.", "bag.", "qos."))]
    assert arm.geometry == "lines"
    other = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.SHAPES)
    assert arm.model_hash == digest_of(robot) != digest_of(other)


def test_the_bag_has_every_publication_and_who_asked_for_it(
    client: Client, planner: PlannerProcess
) -> None:
    """The last test: it ends the node's session."""
    heard = client.received["published_plan"]
    made = client.plan(request(client, plan_only=True, requester="nobody"))
    manager = Manager(client)
    assert manager.change(Transition.TRANSITION_DEACTIVATE) == [True]
    assert client.publish_plan(made).code == Status.NOT_ACTIVE
    assert manager.change(Transition.TRANSITION_CLEANUP) == [True]
    bag = read_bag(planner.bag)
    recorded = [(one.plan_id, one.requester) for one in bag["/published_plan"]]
    assert recorded == [(one.plan_id, one.requester) for one in heard]
    asked_for = [
        exchange.answer[0].status.code
        for exchange in bag["/exchanges"]
        if exchange.answer and exchange.interface == "publish_plan"
    ]
    by_id = [plan for plan in heard if plan.requester in ("executive", "~/publish_plan")]
    with open_bag(planner.bag) as opened:
        continued = [one for one in replayable(opened) if one.interface == "replanning"]
    assert len(continued) == 7
    for one in continued:
        again = replay(one)
        verdict = Verdict.IDENTICAL if one.task else Verdict.NOT_PLANNED
        assert again.verdict is verdict, (one.plan_id, again.words, again.differences)
        assert not one.task or one.planned_task().digest == one.answer.task_digest
    assert [one.task != "" for one in continued].count(True) >= 2
    assert asked_for.count(Status.SOLVED) == len(by_id)
    assert asked_for[-1] == Status.NOT_ACTIVE
    told = bag_document(planner.bag)["publications"]
    assert [one["status"] for one in told] == [Status(code).name for code in asked_for]
    assert told[-1]["plan_id"] == made.plan_id
