"""A minimal mission executive: it requests a plan, commits it, and compares it with the motion."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from ff_planner_msgs.msg import (
    ChaserState,
    PlanAnswer,
    PlanProgress,
    PlanRequest,
    PlanStatus,
    PublishedPlan,
    TargetBody,
)
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.testbed import CONTROLLER_TOPIC
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.client import Check, PlannerClient
from ff_planner_ros.ros.messages.from_messages import state_from_message, target_body_from_message
from ff_planner_ros.ros.outputs.prediction import (
    FramePose,
    PoseError,
    deviations,
    difference,
    predicted_pose,
)
from ff_planner_ros.ros.topics import CHASER_STATE, PUBLISHED_PLAN, TARGET_BODY
from ff_planner_ros.simulation.capture import Capture, captured, end_effector_motion

NAME = "mission_executive"  # of the node, and of who asks

# Refusals that pass by themselves while the system starts, or where the machine is busy: worth
# another try at the next state.
_NOT_YET = frozenset(
    {
        *(Status.NO_STATE, Status.STATE_TOO_OLD, Status.STATE_NOT_SYNCHRONIZED),
        *(Status.NO_OBSTACLES, Status.NO_TARGET_BODY, Status.TARGET_TOO_OLD),
    }
)
# Asks for a plan, calls back with the progress, and checks repeatedly whether to go on.
Ask: TypeAlias = Callable[[PlanRequest, Callable[[PlanProgress], None], Check], PlanAnswer]
_CHECK_INTERVAL = 0.2  # [s] between looks at the caller's check while waiting
_ASK_AGAIN = 0.5  # [s] after a refusal: every request is logged and recorded


@dataclass(frozen=True, eq=False)
class FlownPlan:
    """A plan's prediction beside the measured motion."""

    predicted: FramePose  # end effector at the last measurement before the end of the plan
    reached: FramePose  # measured end effector at that time
    error: PoseError  # between the two
    # Largest differences of the chaser from its prediction along the plan
    worst: PoseError
    time: Array  # of the measurements, from the plan's start; shape (states,) [s]
    from_end: Array  # distance of the end effector to `predicted`; shape (states,) [m]
    # Measured errors of the end effector to the grasp of the body; None: nothing was captured
    capture: Capture | None = None


class MissionExecutive:
    """A client of the planner node that hands plans to the arm's controller."""

    def __init__(
        self, check: Callable[[], None], patience: float, ros_arguments: Sequence[str] = ()
    ) -> None:
        """Join ROS.

        Args:
            check: Called repeatedly while waiting; raises to end the wait.
            patience: Longest wait for a reaction of the planner or the testbed [s].
            ros_arguments: Arguments of ROS, for instance `--ros-args -r __ns:=/chaser_1`.
        """
        self._check, self._patience = check, patience
        self._states: list[ChaserState] = []
        self._new_state = threading.Event()
        self._published: dict[str, PublishedPlan] = {}
        self._new_plan = threading.Event()
        self._bodies: list[TargetBody] = []
        self.client = PlannerClient(NAME, ros_arguments)
        self._since_ns = self.client.now_ns()
        self.client.hear(CHASER_STATE, self._keep)
        self.client.hear(TARGET_BODY, self._bodies.append)
        self.client.hear(PUBLISHED_PLAN, self._keep_plan)
        self._controller = self.client.node.create_publisher(JointTrajectory, CONTROLLER_TOPIC, 1)

    def close(self) -> None:
        """Leave ROS."""
        self.client.close()

    def plan(
        self, request: PlanRequest, report: Callable[[PlanProgress], None], ask: Ask | None = None
    ) -> PlanAnswer:
        """Request a plan, as soon as the planner is there and has received a state.

        A target body that was measured before this executive came may be that of an earlier run,
        which the planner carries forward for a while: the plan is requested again.

        Args:
            report: Called with the progress of the search.
            ask: Asks the planner; None: the executive's client does.

        Returns:
            An answer whose status is SOLVED.

        Raises:
            FfPlannerError: The planner's refusal, or no answer in time.
        """
        deadline = time.monotonic() + self._patience
        self.client.wait_for_planner(self._patience, self._check)
        while True:
            answer = self._answer(request, report, deadline, ask)
            if not self._is_solved(answer.status, deadline):
                continue
            body_ns = nanoseconds(answer.inputs.target_body_stamp)
            if not body_ns or body_ns >= self._since_ns:
                return answer
            self._go_on_until(deadline, "a plan of a target body that is measured now")
            time.sleep(_ASK_AGAIN)

    def commit(self, answer: PlanAnswer) -> None:
        """Have the planner publish a plan, and hand the plan to the arm's controller.

        Raises:
            FfPlannerError: The planner refuses, for instance as the start has passed, or no
                controller listens.
        """
        deadline = time.monotonic() + self._patience
        while self._controller.get_subscription_count() == 0:
            self._go_on_until(deadline, f"a controller that listens to {CONTROLLER_TOPIC}")
            time.sleep(_CHECK_INTERVAL)
        while not self._is_solved(self._publication(answer.plan_id), deadline):
            pass
        self._states.clear()
        self._bodies.clear()
        self._hand_over(answer.plan_id, deadline)

    def replan(self, request: PlanRequest) -> PlanAnswer:
        """Request a plan once, and hand a plan that the planner publishes to the controller.

        Returns:
            The answer, of any status.

        Raises:
            FfPlannerError: No answer in time.
        """
        deadline = time.monotonic() + self._patience
        answer = self._answer(request, lambda _: None, deadline)
        if answer.status.code == Status.SOLVED:
            self._hand_over(answer.plan_id, deadline)
        return answer

    def _hand_over(self, plan_id: str, deadline: float) -> None:
        """Wait until a plan is published, and hand it to the arm's controller."""
        while plan_id not in self._published:
            self._wait(self._new_plan, deadline, f"{plan_id} on published_plan")
            self._new_plan.clear()
        self._controller.publish(self._published[plan_id].joint_trajectory)

    def watch(self, answer: PlanAnswer, duration: float, robot: Robot) -> FlownPlan:
        """Wait for the end of a phase of a committed plan, and compare it with the measured states.

        Args:
            duration: From the start of the plan to the end of the phase [s].

        Raises:
            FfPlannerError: No states arrive.
            InvalidInput: A state cannot be used.
        """
        planned = answer.plans[0]
        start_ns = nanoseconds(planned.joint_trajectory.header.stamp)
        end_ns = start_ns + round(duration * NANOSECONDS)
        seconds = (end_ns - self.client.now_ns()) / NANOSECONDS
        deadline = time.monotonic() + seconds + self._patience
        while not self._states or nanoseconds(self._states[-1].header.stamp) < end_ns:
            # Also while states keep arriving.
            self._go_on_until(deadline, "the end of the plan")
            self._new_state.wait(_CHECK_INTERVAL)
            self._new_state.clear()
        frame = planned.chaser_path.header.frame_id
        measured = [
            (nanoseconds(m.header.stamp), state_from_message(m, "chaser_state", robot, frame))
            for m in self._states
            if start_ns <= nanoseconds(m.header.stamp) <= end_ns
        ]
        if not measured:
            raise FfPlannerError(
                Status.NO_STATE, f"no chaser state was measured while {answer.plan_id} ran"
            )
        flown = _flown_plan(plan_from_answer(answer), start_ns, measured, robot)
        last_ns, _ = measured[-1]
        seen = [one for one in self._bodies if nanoseconds(one.header.stamp) <= last_ns]
        if not (seen and any(one.target_path.poses for one in answer.plans)):
            return flown
        body_ns = nanoseconds(seen[-1].header.stamp)
        # A body that is held does not move freely; it is measured at the time of a state.
        at_ns, state = next((one for one in measured if one[0] == body_ns), measured[-1])
        since = (at_ns - body_ns) / NANOSECONDS
        body = target_body_from_message(seen[-1], frame).after(since)
        return replace(flown, capture=captured(robot, state, body))

    def _keep(self, message: ChaserState) -> None:
        self._states.append(message)
        self._new_state.set()

    def _keep_plan(self, message: PublishedPlan) -> None:
        self._published = {message.plan_id: message}
        self._new_plan.set()

    def _answer(
        self,
        request: PlanRequest,
        report: Callable[[PlanProgress], None],
        deadline: float,
        ask: Ask | None = None,
    ) -> PlanAnswer:
        def check() -> None:
            self._go_on_until(deadline, "an answer of the planner")

        return (ask or self.client.plan)(request, report, check)

    def _publication(self, plan_id: str) -> PlanStatus:
        return self.client.publish(plan_id, NAME, patience=self._patience, check=self._check)

    def _is_solved(self, told: PlanStatus, deadline: float) -> bool:
        """Return whether a status is SOLVED; after a transient refusal, wait for a state first."""
        status = Status(told.code)
        if status is Status.SOLVED:
            return True
        if status not in _NOT_YET or time.monotonic() > deadline:
            raise FfPlannerError(status, told.message)
        self._new_state.clear()
        time.sleep(_ASK_AGAIN)
        self._wait(self._new_state, deadline, "a chaser state")
        return False

    def _wait(self, event: threading.Event, deadline: float, what: str) -> None:
        while not event.wait(_CHECK_INTERVAL):
            self._go_on_until(deadline, what)

    def _go_on_until(self, deadline: float, what: str) -> None:
        self._check()
        if time.monotonic() > deadline:
            raise FfPlannerError(
                Status.INTERNAL_ERROR, f"{what} did not come within {self._patience:g} s"
            )


def _flown_plan(
    plan: Plan, start_ns: int, measured: list[tuple[int, SystemState]], robot: Robot
) -> FlownPlan:
    motion = plan.trajectory
    of_states = [
        deviations(state, motion, (at_ns - start_ns) / NANOSECONDS, robot)
        for at_ns, state in measured
    ]
    positions, angles = zip(
        *((found[0].amount, found[1].amount) for found in of_states if found), strict=True
    )
    last_ns, last = measured[-1]
    time_in_plan = min((last_ns - start_ns) / NANOSECONDS, float(plan.trajectory.time[-1]))
    predicted = predicted_pose(plan.trajectory, "ee", time_in_plan)
    if predicted is None:
        raise FfPlannerError(Status.INTERNAL_ERROR, f"no prediction at {time_in_plan} s")
    reached = end_effector(robot, last)
    worst = PoseError(max(positions), max(angles))
    places = np.array([end_effector(robot, state).position for _, state in measured])
    return FlownPlan(
        predicted=predicted,
        reached=reached,
        error=difference(predicted, reached),
        worst=worst,
        time=np.array([at_ns - start_ns for at_ns, _ in measured]) / NANOSECONDS,
        from_end=np.linalg.norm(places - predicted.position, axis=1),
    )


def end_effector(robot: Robot, state: SystemState) -> FramePose:
    """Return the inertial pose of the end effector in a state."""
    pose, _ = end_effector_motion(robot, state)
    return FramePose(pose.translation, Rotation.from_matrix(pose.rotation))
