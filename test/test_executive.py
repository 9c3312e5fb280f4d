"""The mission executive, against a planner that answers as told and a testbed that obeys or not."""

from __future__ import annotations

import runpy
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import rclpy
from answers import answer_with
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import (
    ChaserState,
    PlanAnswer,
    PlanProgress,
    PlanRequest,
    PlanStatus,
    PublishedPlan,
)
from ff_planner_msgs.srv import PublishPlan
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from robots import random_state
from ros_processes import DEADLINE, FRAME, private_domain
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.executive import MissionExecutive, end_effector
from ff_planner_ros.demo.testbed import CONTROLLER_TOPIC
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.to_messages import (
    controller_message,
    state_message,
    target_body_message,
)
from ff_planner_ros.ros.process import spin_in_background
from ff_planner_ros.ros.qos import create_publisher
from ff_planner_ros.ros.topics import PUBLISHED_PLAN

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@dataclass
class World:
    """The executive, and what the planner and the controller beside it were told."""

    executive: MissionExecutive
    node: Any
    answered: list[Status] = field(default_factory=list)
    committed: list[JointTrajectory] = field(default_factory=list)
    asked_to_publish: list[PublishPlan.Request] = field(default_factory=list)
    heard: threading.Event = field(default_factory=threading.Event)
    cancelled: threading.Event = field(default_factory=threading.Event)

    def control(self, trajectory: JointTrajectory) -> None:
        self.committed.append(trajectory)
        self.heard.set()

    def plan(self) -> PlanAnswer:
        self.reports: list[PlanProgress] = []
        return self.executive.plan(REQUEST, self.reports.append)


REQUEST = PlanRequest(duration=12.0)
PROGRESS = PlanProgress(found=True, best_objective=0.25)
PUBLISHED = PlanStatus(code=int(Status.SOLVED))


def nothing() -> None:
    """A check that is always content."""


@contextmanager
def _world(
    *answers: Status,
    patience: float = DEADLINE,
    check: Callable[[], None] = nothing,
    silent: threading.Event | None = None,
    controller: bool = True,
    states: Callable[[], ChaserState] = ChaserState,
    publication: tuple[PlanStatus, ...] = (PUBLISHED,),
    published: Callable[[], PublishedPlan] = PublishedPlan,
    ages_of_body: tuple[float, ...] = (),
) -> Iterator[World]:
    """Start an executive, a planner with these answers, the last one for ever, and a controller.

    Args:
        ages_of_body: Of the target body of each answer, when it is given [s]; then there is none.
    """
    coming = chain(answers, repeat(answers[-1])) if answers else iter(())
    of_publication = chain(publication, repeat(publication[-1]))
    ages = chain(ages_of_body, repeat(None))
    # For a while the controllers of tests before, which were killed, seem to listen where one does.
    arguments = [] if controller else ["--ros-args", "-r", "__ns:=/without_controller"]
    with private_domain(), closing(MissionExecutive(check, patience, arguments)) as executive:
        context = executive.client.node.context
        node = rclpy.create_node("everybody_else", context=context)
        world = World(executive, node)
        publisher = node.create_publisher(ChaserState, "chaser_state", 10)
        node.create_timer(0.01, lambda: publisher.publish(states()))
        if controller:
            node.create_subscription(JointTrajectory, CONTROLLER_TOPIC, world.control, 10)

        plans = create_publisher(node, PUBLISHED_PLAN)

        def publish(
            request: PublishPlan.Request, response: PublishPlan.Response
        ) -> PublishPlan.Response:
            world.asked_to_publish.append(request)
            response.status = next(of_publication)
            if response.status is PUBLISHED:
                plans.publish(PublishedPlan(plan_id="run.of another"))
                plans.publish(published())
            return response

        node.create_service(PublishPlan, "ff_planner/publish_plan", publish)

        def answer(handle: Any) -> PlanTrajectory.Result:
            if silent is not None:
                silent.set()
                world.cancelled.wait(DEADLINE)
                handle.abort()
                return PlanTrajectory.Result()
            assert handle.request.request == REQUEST
            handle.publish_feedback(PlanTrajectory.Feedback(progress=PROGRESS))
            world.answered.append(next(coming))
            status = PlanStatus(code=world.answered[-1], message=f"for {world.answered[-1].name}")
            handle.succeed()
            made = PlanAnswer(status=status, plan_id="run.1")
            if (age := next(ages)) is not None:
                measured = node.get_clock().now() - Duration(seconds=age)
                made.inputs.target_body_stamp = measured.to_msg()
            return PlanTrajectory.Result(answer=made)

        def cancel(_: Any) -> CancelResponse:
            world.cancelled.set()
            return CancelResponse.ACCEPT

        server = None
        if answers or silent is not None:
            server = ActionServer(
                node,
                PlanTrajectory,
                "plan_trajectory_action",
                answer,
                cancel_callback=cancel,
                callback_group=ReentrantCallbackGroup(),
            )
        executor = MultiThreadedExecutor(num_threads=3, context=context)
        executor.add_node(node)
        stop = spin_in_background(executor, node.get_logger())
        try:
            yield world
        finally:
            world.cancelled.set()
            stop()
            if server is not None:
                server.destroy()


@pytest.mark.parametrize(
    "refusal",
    [
        *(
            Status.NO_STATE,
            Status.NO_OBSTACLES,
            Status.STATE_TOO_OLD,
            Status.STATE_NOT_SYNCHRONIZED,
        ),
        *(Status.NO_TARGET_BODY, Status.TARGET_TOO_OLD),
    ],
)
def test_it_asks_again_while_the_system_starts(refusal: Status) -> None:
    with _world(refusal, refusal, Status.SOLVED) as world:
        assert world.plan().status.code == Status.SOLVED
        assert world.answered == [refusal, refusal, Status.SOLVED]
        assert world.reports == [PROGRESS] * 3


@pytest.mark.parametrize("alone", [False, True])
def test_the_examples_two_ways_to_ask_give_the_same_answer(alone: bool) -> None:
    example = runpy.run_path(str(EXAMPLES / "mission_executive.py"))
    with _world(Status.NO_STATE, Status.SOLVED) as world:
        by_client = partial(example["ask_with_client"], world.executive.client)
        ask = example["ask_with_rclpy"] if alone else by_client
        reports: list[PlanProgress] = []
        answer = world.executive.plan(REQUEST, reports.append, ask)
        assert (answer.plan_id, answer.status.code) == ("run.1", Status.SOLVED)
        assert reports == [PROGRESS] * 2


@pytest.mark.parametrize("alone", [False, True])
def test_either_way_whoever_stops_waiting_cancels(alone: bool) -> None:
    example, asked = runpy.run_path(str(EXAMPLES / "mission_executive.py")), threading.Event()

    def check() -> None:
        if asked.is_set():
            raise KeyboardInterrupt

    with _world(silent=asked) as world:
        by_client = partial(example["ask_with_client"], world.executive.client)
        ask = example["ask_with_rclpy"] if alone else by_client
        with pytest.raises(KeyboardInterrupt):
            ask(REQUEST, lambda _: None, check)
        assert world.cancelled.wait(DEADLINE)


def test_it_asks_again_where_the_body_is_that_of_an_earlier_run() -> None:
    with _world(Status.SOLVED, ages_of_body=(3600.0, 3600.0, 0.0)) as world:
        made = world.plan()
        assert world.answered == [Status.SOLVED] * 3
        age = world.node.get_clock().now().nanoseconds - nanoseconds(made.inputs.target_body_stamp)
        assert age < 3600 * NANOSECONDS


@pytest.mark.parametrize("refusal", [Status.COLLISION, Status.WRONG_FRAME, Status.INTERNAL_ERROR])
def test_a_refusal_that_will_not_pass_is_raised_at_once(refusal: Status) -> None:
    with _world(refusal) as world:
        with pytest.raises(FfPlannerError, match=f"for {refusal.name}") as raised:
            world.plan()
        assert raised.value.status is refusal
        assert world.answered == [refusal]


def test_its_patience_ends_when_the_planner_never_hears_of_the_chaser() -> None:
    with (
        _world(Status.NO_STATE, patience=1.0) as world,
        pytest.raises(FfPlannerError, match="for NO_STATE"),
    ):
        world.plan()


def test_its_patience_ends_when_there_is_no_planner() -> None:
    with (
        _world(patience=0.0) as world,
        pytest.raises(FfPlannerError, match="action is plan_trajectory_action: no node offers it"),
    ):
        world.plan()


def test_when_it_stops_waiting_the_planner_hears_that_nobody_wants_the_plan() -> None:
    asked = threading.Event()

    def check() -> None:
        if asked.is_set():
            raise KeyboardInterrupt

    with _world(silent=asked, check=check) as world:
        with pytest.raises(KeyboardInterrupt):
            world.plan()
        assert world.cancelled.wait(DEADLINE)


def test_it_stops_watching_at_once_when_its_check_fails(
    solved: Callable[[int], PlanAnswer], lemur_capture: PlanningProblem
) -> None:
    def check() -> None:
        raise KeyboardInterrupt

    with _world(check=check) as world, pytest.raises(KeyboardInterrupt):
        world.executive.watch(solved(now_ns(world)), 10.0, lemur_capture.robot)


@pytest.fixture(scope="module")
def solved(lemur_plan: Plan) -> Callable[[int], PlanAnswer]:
    """A plan as an answer, with its start."""

    def answer(start_ns: int) -> PlanAnswer:
        return answer_with(lemur_plan, "run.1", start_ns)

    return answer


def now_ns(world: World) -> int:
    return int(world.node.get_clock().now().nanoseconds)


def test_it_commits_what_the_planner_publishes_under_the_plans_id(
    solved: Callable[[int], PlanAnswer],
) -> None:
    answer = solved(3600 * NANOSECONDS)
    # What the planner publishes is what the controller can take: here, without torques.
    trajectory = controller_message(answer.plans[0].joint_trajectory, effort_interface=False)
    plan = PublishedPlan(plan_id=answer.plan_id, joint_trajectory=trajectory)
    with _world(published=lambda: plan) as world:
        world.executive.commit(answer)
        assert world.heard.wait(DEADLINE)
    (asked,) = world.asked_to_publish
    assert asked.plan_id == "run.1"
    assert asked.requester == "mission_executive"
    assert world.committed == [trajectory]


def test_it_commits_again_where_the_state_came_late(solved: Callable[[int], PlanAnswer]) -> None:
    answer = solved(3600 * NANOSECONDS)
    plan = PublishedPlan(plan_id="run.1", joint_trajectory=answer.plans[0].joint_trajectory)
    late = PlanStatus(code=int(Status.STATE_TOO_OLD), message="1.3 s old")
    with _world(publication=(late, PUBLISHED), published=lambda: plan) as world:
        world.executive.commit(answer)
        assert world.heard.wait(DEADLINE)
    assert len(world.asked_to_publish) == 2


@pytest.mark.parametrize("status", [Status.TOO_LATE, Status.STATE_MOVED, Status.UNKNOWN_PLAN])
def test_a_plan_that_the_planner_does_not_publish_is_not_committed(
    solved: Callable[[int], PlanAnswer], status: Status
) -> None:
    refusal = PlanStatus(code=int(status), message="run.1 does not fit any more")
    with _world(publication=(refusal,)) as world:
        with pytest.raises(FfPlannerError, match=r"run\.1 does not fit any more") as raised:
            world.executive.commit(solved(now_ns(world) + 3600 * NANOSECONDS))
        assert raised.value.status is status
        assert world.committed == []


def test_nothing_is_committed_to_a_controller_that_is_not_there(
    solved: Callable[[int], PlanAnswer],
) -> None:
    with (
        _world(controller=False, patience=0.0) as world,
        pytest.raises(FfPlannerError, match=f"listens to {CONTROLLER_TOPIC} did not come"),
    ):
        world.executive.commit(solved(now_ns(world) + 3600 * NANOSECONDS))
    assert world.asked_to_publish == []


def test_it_tells_how_far_reality_was_from_the_plan(
    solved: Callable[[int], PlanAnswer], lemur_plan: Plan, lemur_capture: PlanningProblem
) -> None:
    """The chaser measured is that of the plan's last point, shifted and turned by known amounts."""
    motion, robot = lemur_plan.trajectory, lemur_capture.robot
    shift, turn = np.array([0.003, 0.0, -0.004]), Rotation.from_rotvec([0.0, 0.02, 0.0])
    end = SystemState(
        motion.chaser_positions[-1] + shift,
        (turn * Rotation.from_quat(motion.chaser_quaternions_xyzw[-1])).as_quat(),
        motion.chaser_linear_velocities[-1],
        motion.chaser_angular_velocities[-1],
        motion.joint_positions[-1],
        motion.joint_velocities[-1],
    )
    ends: list[int] = []

    def states() -> ChaserState:
        # Measured just before the plan ends, and at the start's state when it is over.
        now = rclpy.clock.Clock().now().nanoseconds
        if not ends or now < ends[0] - NANOSECONDS // 2:
            return state_message(lemur_capture.start, robot.joint_names, 0, FRAME)
        if now < ends[0]:
            return state_message(end, robot.joint_names, ends[0] - 10, FRAME)
        return state_message(lemur_capture.start, robot.joint_names, ends[0] + 10, FRAME)

    with _world(states=states) as world:
        # Nine seconds of the plan are over when it is watched.
        answer = solved(now_ns(world) - 9 * NANOSECONDS)
        ends.append(nanoseconds(answer.plans[0].joint_trajectory.header.stamp) + 10 * NANOSECONDS)
        outcome = world.executive.watch(answer, 10.0, robot)
    arm = motion.ee_positions[-1] - motion.chaser_positions[-1]
    np.testing.assert_allclose(outcome.predicted.position, motion.ee_positions[-1], atol=1e-8)
    expected = motion.chaser_positions[-1] + shift + turn.apply(arm)
    np.testing.assert_allclose(outcome.reached.position, expected, atol=1e-8)
    off = shift + turn.apply(arm) - arm
    assert outcome.error.position == pytest.approx(float(np.linalg.norm(off)), abs=1e-8)
    assert outcome.error.angle == pytest.approx(0.02, abs=1e-8)
    assert outcome.worst.position == pytest.approx(0.005, abs=1e-8)
    assert outcome.worst.angle == pytest.approx(0.02, abs=1e-8)


def test_a_body_that_is_held_is_compared_with_the_state_of_its_time(
    solved: Callable[[int], PlanAnswer], lemur_plan: Plan, lemur_capture: PlanningProblem
) -> None:
    """The arm brakes: the last state has gone on, but not as far as a free body would have."""
    motion, robot, ends = lemur_plan.trajectory, lemur_capture.robot, [0]

    def measured(point: int, before_ns: int) -> ChaserState:
        state = SystemState(
            motion.chaser_positions[point],
            motion.chaser_quaternions_xyzw[point],
            motion.chaser_linear_velocities[point],
            motion.chaser_angular_velocities[point],
            motion.joint_positions[point],
            motion.joint_velocities[point],
        )
        return state_message(state, robot.joint_names, max(ends[0] - before_ns, 0), FRAME)

    body = TargetBody(
        position=motion.ee_positions[-9],
        quaternion_xyzw=motion.ee_quaternions_xyzw[-9],
        linear_velocity=np.array([0.3, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        inertia=np.eye(3),
        grasp_position=np.zeros(3),
        grasp_quaternion_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    )
    with _world(states=lambda: measured(-1, before_ns=-10)) as world:
        answer = solved(now_ns(world) - 10 * NANOSECONDS)
        answer.plans[0].target_path.poses.append(PoseStamped())
        ends[0] = nanoseconds(answer.plans[0].joint_trajectory.header.stamp) + 10 * NANOSECONDS
        world.executive._states += [measured(-9, NANOSECONDS), measured(-5, 10)]
        held = target_body_message(body, ends[0] - NANOSECONDS, FRAME)
        world.executive._bodies.append(held)
        outcome = world.executive.watch(answer, 10.0, robot)
    assert outcome.capture is not None
    assert outcome.capture.position_error < 1e-8
    assert outcome.capture.orientation_error < 1e-6


def test_states_that_cease_before_the_end_are_an_error(
    solved: Callable[[int], PlanAnswer], lemur_capture: PlanningProblem
) -> None:
    with _world(patience=0.5) as world:
        answer = solved(now_ns(world) - 10 * NANOSECONDS)
        with pytest.raises(FfPlannerError, match="the end of the plan did not come within"):
            world.executive.watch(answer, 10.0, lemur_capture.robot)


def test_the_end_effector_is_where_forward_kinematics_has_it(robot: Robot) -> None:
    state = random_state(robot, np.random.default_rng(4))
    base = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix()
    base = base @ robot.rotation_chaser_to_base.T
    place = pin.SE3(base, state.position_chaser_in_inertial - base @ robot.position_chaser_in_base)
    for joint, (axis, angle) in enumerate(
        zip(robot.joint_axes, state.joint_positions, strict=True), start=2
    ):
        turn = pin.SE3(Rotation.from_rotvec(axis * angle).as_matrix(), np.zeros(3))
        place = place * robot.model.jointPlacements[joint] * turn
    place = place * robot.model.frames[robot.tip_frame_id].placement
    found = end_effector(robot, state)
    np.testing.assert_allclose(found.position, place.translation, atol=1e-12)
    np.testing.assert_allclose(found.rotation.as_matrix(), place.rotation, atol=1e-12)


def test_the_demonstration_needs_no_mujoco() -> None:
    """`make demo` does not install it."""
    code = (
        "import sys; sys.modules['mujoco'] = None; "
        "import ff_planner_ros.demo.executive, ff_planner_ros.demo.run, ff_planner_ros.demo.testbed"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
