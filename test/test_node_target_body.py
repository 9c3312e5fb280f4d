"""A target body on its topic: the node captures it, tells how, and its bag holds it all."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import Approach, PlanAnswer, PlanRequest, TargetBody
from geometry_msgs.msg import PoseStamped, Vector3
from nav_msgs.msg import Path as PathMsg
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_requests import motions_in, replays_of
from ros_processes import (
    FRAME,
    Client,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from scipy.spatial.transform import Rotation
from test_tumbling import body_of, moved

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import TargetBody as FreeBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.to_messages import target_body_message
from ff_planner_ros.runs.replay import Verdict
from ff_planner_ros.simulation.verification import verify

pytestmark = pytest.mark.ci

# The state is measured when the node is asked; so long before [s] the body was seen, and so long
# after that the plan starts [s].
SEEN_BEFORE, ALLOWANCE = 1.5, 5.0


@dataclass
class Run:
    problem: PlanningProblem
    captured: PlanAnswer
    stale: PlanAnswer
    free: PlanAnswer  # with a range of durations
    hurried: PlanAnswer  # likewise, with too little time
    stamps: set[int]  # of the bodies that were published [ns]
    bag: Path
    received: dict[str, list[Any]] = field(default_factory=dict)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    directory, problem = tmp_path_factory.mktemp("target"), tumbling.problem("tumbling", 0)
    urdf = directory / "robot.urdf"
    urdf.write_text(problem.robot.drawn_urdf)
    arguments = [word for value in _arguments(urdf, problem.robot) for word in ("-p", value)]
    with private_domain(), running_planner(directory, *arguments) as planner:
        with connected_client() as client:
            targets = _listens(client)
            client.wait_for_planner()
            request = Scene(problem).complete_request()
            stamps = set[int]()

            def answered(age: float, status: Status) -> PlanAnswer:
                def arrived(answer: PlanAnswer) -> bool:
                    stamp_ns = client.now_ns() - round(age * NANOSECONDS)
                    stamps.add(stamp_ns)
                    targets.publish(target_body_message(body_of(problem), stamp_ns, FRAME))
                    return bool(answer.status.code == status)

                return client.plan_until(request, arrived)

            stale = answered(3600.0, Status.TARGET_TOO_OLD)
            ask_for_corridor(request, problem)
            captured = answered(SEEN_BEFORE, Status.SOLVED)
            request.goal.approach, request.limits.accelerations = [], []
            relative = client.received["predicted_relative_pose"]
            client.wait_until(lambda: len(relative) > 3, "a relative pose")
            client.wait_until(lambda: client.received["predicted_target_path"], "a path")
            request.plan_only = True
            shortest, longest = window(problem)
            request.duration, request.duration_max = shortest, longest
            request.search.time_budget = 0.01
            hurried = answered(SEEN_BEFORE, Status.TIMED_OUT)
            request.search.time_budget = 0.0
            free = answered(SEEN_BEFORE, Status.SOLVED)
        planner.stop(signal.SIGTERM)
        yield Run(problem, captured, stale, free, hurried, stamps, planner.bag, client.received)


def ask_for_corridor(request: PlanRequest, problem: PlanningProblem) -> None:
    """Ask for a wide one, from where the end effector is; and for limits that are no matter."""
    body, start = body_of(problem), problem.start
    target = body.after(SEEN_BEFORE + ALLOWANCE).target(problem.duration)
    (points,) = arm_points(problem.robot, configuration(problem.robot, start)[0][None])
    way = Rotation.from_quat(target.quaternion_xyzw).inv().apply(target.position - points[-1])
    direction = Vector3(**dict(zip("xyz", way.tolist(), strict=True)))
    request.goal.approach = [Approach(direction=direction, distance=0.05, half_angle=1.2)]
    request.limits.accelerations = [50.0]


def window(problem: PlanningProblem) -> tuple[float, float]:
    """The range of durations that the planner chooses from [s]."""
    return 0.9 * problem.duration, 1.4 * problem.duration


def _arguments(urdf: Path, robot: Robot) -> Iterator[str]:
    yield f"robot.urdf:={urdf}"
    yield f"robot.base_link:={robot.base_link}"
    yield f"robot.tip_link:={robot.tip_link}"
    yield from (f"planning_lead_time:={ALLOWANCE}", "target_max_age:=300.0", "time_budget:=300.0")
    yield "planner.starts:=4"


def _listens(client: Client) -> Any:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for kind, topic, qos in (
        (PathMsg, "predicted_target_path", latched),
        (PoseStamped, "predicted_relative_pose", QoSProfile(depth=100)),
    ):
        client.received[topic] = []
        client.node.create_subscription(kind, topic, client._keeper(topic), qos)
    return client.node.create_publisher(TargetBody, "target_body", 10)


@pytest.mark.law("NODE-05")
def test_a_body_that_was_seen_an_hour_ago_is_refused(run: Run) -> None:
    assert run.stale.status.code == Status.TARGET_TOO_OLD
    assert "target_body.header.stamp" in run.stale.status.message


def test_the_end_effector_meets_the_grasp_that_was_seen_before_the_plan(run: Run) -> None:
    body = body_of(run.problem)
    shortest, longest = window(run.problem)
    (captured,), (free,) = run.captured.plans, run.free.plans
    assert captured.duration == run.problem.duration
    assert shortest <= free.duration <= longest
    assert free.duration != captured.duration
    for answer in (run.captured, run.free):
        require_met(run, answer, body)
    assert run.hurried.status.code == Status.TIMED_OUT


def require_met(run: Run, answer: PlanAnswer, body: FreeBody) -> None:
    """The arm meets the grasp when the duration is over that the answer tells."""
    (plan,) = answer.plans
    start_ns = nanoseconds(plan.joint_trajectory.header.stamp)
    lasts = nanoseconds(plan.end_effector_path.poses[-1].header.stamp) - start_ns
    assert lasts / NANOSECONDS == pytest.approx(plan.duration, abs=1e-8)
    seen_ns = nanoseconds(answer.inputs.target_body_stamp)
    assert seen_ns in run.stamps
    end_ns = nanoseconds(plan.end_effector_path.poses[-1].header.stamp)
    since = (end_ns - seen_ns) / NANOSECONDS

    (center,), (attitude,), (rate,) = moved(body, np.array([since]))
    lever = attitude.apply(body.grasp_position.copy())
    pose = plan.end_effector_path.poses[-1].pose
    place, turn = pose.position, pose.orientation
    assert [place.x, place.y, place.z] == pytest.approx(center + lever, abs=1e-5)
    grasp = attitude * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    found = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
    assert (found * grasp.inv()).magnitude() < 1e-5
    linear = plan.end_effector_twists[-1].linear
    expected = body.linear_velocity + np.cross(rate, lever)
    assert [linear.x, linear.y, linear.z] == pytest.approx(expected, abs=1e-5)


def test_the_path_of_the_body_goes_out_and_the_pose_relative_to_its_grasp(run: Run) -> None:
    assert run.received["predicted_target_path"][-1] == run.captured.plans[0].target_path
    poses = run.received["predicted_relative_pose"]
    assert {pose.header.frame_id for pose in poses} == {"target_grasp"}
    start = run.captured.plans[0].end_effector_path.poses[0].header.stamp
    assert all(nanoseconds(pose.header.stamp) >= nanoseconds(start) for pose in poses)


def test_the_bag_holds_it_all(run: Run) -> None:
    topics = read_bag(run.bag)
    for topic in ("/target_body", "/predicted_target_path", "/predicted_relative_pose"):
        assert topics[topic], topic
    replayed = replays_of(run.bag)
    for answer in (run.captured, run.free):
        assert replayed[answer.plan_id].verdict is Verdict.IDENTICAL
    assert replayed[run.stale.plan_id].verdict is Verdict.NOT_PLANNED
    hurried = replayed[run.hurried.plan_id]
    # The step at which its time was over; none where a single step took all of it.
    is_cut = hurried.exchange.planned_task().effort
    assert hurried.verdict is (Verdict.IDENTICAL if is_cut else Verdict.WITHOUT_CLOCK)


def test_mujoco_sees_the_recorded_capture_come_true(run: Run) -> None:
    (told,) = (one for one in motions_in(run.bag) if one.name == run.captured.plan_id)
    found = verify(told.robot, told.trajectory, told.scene)
    assert found.passed
    assert found.capture is not None
    assert found.corridor is not None
    assert run.captured.metrics[0].min_acceleration_margin > 40.0
    assert run.free.metrics[0].min_acceleration_margin == np.inf
    drawn = [{marker.ns for marker in array.markers} for array in read_bag(run.bag)["/markers"]]
    assert "approach" in drawn[0]
