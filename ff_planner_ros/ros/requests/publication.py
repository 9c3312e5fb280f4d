"""Plans go out: at once, or later by their ids, through the service `~/publish_plan`.

A plan that waits is published only while it still fits: its start is ahead, the system will be
where it begins, and no rule that it was checked by is stricter by now.
"""

from __future__ import annotations

import math
import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from ff_planner_msgs.msg import PlanStatus
from ff_planner_msgs.srv import PlanTrajectory, PublishPlan
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.service_introspection import ServiceIntrospectionState
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.controller_rules import require_in_time
from ff_planner_ros.ros.messages.controller_message import controller_message
from ff_planner_ros.ros.messages.interfaces import PUBLISH_PLAN
from ff_planner_ros.ros.messages.to_messages import response_from_plan
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.qos import EVENT_QOS
from ff_planner_ros.ros.requests.reading import Knowledge, asker
from ff_planner_ros.ros.requests.waiting_plan import (
    MadePlan,
    require_same_rules,
    require_same_start,
)

# Plans that wait to be published; one of 10,000 points takes 5 MB. A newer one takes the place of
# the oldest.
MOST_WAITING = 10


class Publication:
    """Publishes plans, and keeps those that wait for it."""

    def __init__(self, node: Node, output: PlanOutput, knowledge: Callable[[], Knowledge]) -> None:
        """Open the service; until `open`, it answers with NOT_ACTIVE.

        Args:
            knowledge: What the planner knows now.
        """
        self._node, self._output, self._knowledge = node, output, knowledge
        self._logger = node.get_logger()
        self._lock = threading.RLock()
        self._waiting: dict[str, MadePlan] = {}  # the oldest first
        self._refusal: tuple[Status, str] | None = None
        self.answered = -math.inf  # when, last of all, by the monotonic clock [s]
        self.close(Status.NOT_ACTIVE, "the planner is not active yet")
        self._service = node.create_service(
            PublishPlan, PUBLISH_PLAN, self._serve, callback_group=MutuallyExclusiveCallbackGroup()
        )
        self._service.configure_introspection(
            node.get_clock(), EVENT_QOS, ServiceIntrospectionState.CONTENTS
        )

    def open(self) -> None:
        """Publish from now on."""
        with self._lock:
            self._refusal = None

    def close(self, status: Status, message: str) -> None:
        """Publish no more, and forget the plans that wait."""
        with self._lock:
            self._refusal = status, message
            self._waiting.clear()

    def forget(self) -> None:
        """Forget the plans that wait: their times are no longer the clock's."""
        with self._lock:
            self._waiting.clear()

    def destroy(self) -> None:
        """Take the service off the node."""
        self._node.destroy_service(self._service)

    def keep(self, made: MadePlan) -> None:
        """Let a plan wait until somebody asks for it, or newer ones take its place."""
        with self._lock:
            self._require_open()
            self._waiting[made.plan_id] = made
            while len(self._waiting) > MOST_WAITING:
                del self._waiting[next(iter(self._waiting))]

    def publish(
        self,
        made: MadePlan,
        response: PlanTrajectory.Response,
        for_controller: JointTrajectory,
        asked_by: str,
    ) -> None:
        """Send a plan to controllers, executives and screens; `response` is the one that holds it.

        Raises:
            FfPlannerError: The node is not active any more.
        """
        with self._lock:
            self._require_open()
            self._output.publish(
                made.plan,
                response,
                for_controller,
                asked_by,
                made.end_behaviour,
                made.target_body,
                made.following,
            )
        executor: Any = self._node.executor
        executor.create_task(
            partial(self._output.show, made.plan, made.obstacles, made.target_body, made.approach)
        )

    def _serve(
        self, request: PublishPlan.Request, response: PublishPlan.Response
    ) -> PublishPlan.Response:
        try:
            message = self._published(request)
            self._logger.info(message)
            response.status = PlanStatus(code=int(Status.SOLVED), message=message)
        except FfPlannerError as error:
            self._logger.warning(f"{PUBLISH_PLAN}: {error.status.name}: {error}")
            response.status = PlanStatus(code=int(error.status), message=str(error))
        except Exception as error:
            self._logger.error(f"{PUBLISH_PLAN}: INTERNAL_ERROR\n{traceback.format_exc()}")
            words = f"{type(error).__name__}: {error}"
            response.status = PlanStatus(code=int(Status.INTERNAL_ERROR), message=words)
        self.answered = time.monotonic()
        return response

    def _published(self, request: PublishPlan.Request) -> str:
        """Publish the plan that is asked for, and say so in words."""
        with self._lock:
            self._require_open()
            asked_by = asker(request.asked_by, PUBLISH_PLAN)
            made, knowledge = self._waiting_plan(request.plan_id), self._knowledge()
            self._require_in_time(made, knowledge.now_ns)
            require_same_rules(made, knowledge.parameters)
            require_same_start(made, request, knowledge)
        # Thousands of points take a second, in which others may publish or forget.
        frame = made.parameters.inertial_frame
        response = response_from_plan(
            made.plan, made.plan_id, made.start_ns, frame, 0.0, made.target_body
        )
        takes_torques = knowledge.parameters.controller.effort_interface
        for_controller = controller_message(response.joint_trajectory, takes_torques)
        with self._lock:
            self._require_open()
            self._waiting_plan(request.plan_id)
            self._require_in_time(made, self._node.get_clock().now().nanoseconds)
            self.publish(made, response, for_controller, asked_by)
            del self._waiting[made.plan_id]
        return f"{made.plan_id} is published, {asked_by} asked for it"

    def _require_open(self) -> None:
        if self._refusal is not None:
            raise FfPlannerError(*self._refusal)

    def _waiting_plan(self, plan_id: str) -> MadePlan:
        if plan_id in self._waiting:
            return self._waiting[plan_id]
        last = self._output.published
        if last is not None and last.plan_id == plan_id:
            allowed = "it is published already"
        else:
            allowed = (
                f"it must be one that waits to be published: {', '.join(self._waiting)}"
                if self._waiting
                else "no plan waits to be published"
            )
            allowed += (
                f" (plans asked for with plan_only wait, the newest {MOST_WAITING}, until they are "
                "published or their start is over)"
            )
        raise InvalidInput(Status.UNKNOWN_PLAN, "plan_id", repr(plan_id), allowed)

    def _require_in_time(self, made: MadePlan, now_ns: int) -> None:
        """Refuse a plan whose start is over; it waits no longer."""
        try:
            require_in_time(made.start_ns, now_ns)
        except NoPlanFound:
            del self._waiting[made.plan_id]
            raise
