"""Publication of plans: at once, or later by plan id, through the service `~/publish_plan`.

A plan that waits is published only if its start is ahead, it is at most `publication.max_age` old,
and the system will be at its first point.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Sequence

from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanInputs, PlanStatus
from ff_planner_msgs.srv import PublishPlan
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Retry, Status
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.task.controller_rules import require_in_time
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.answers import status_message
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.outputs.prediction import Deviation, deviations, too_far
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.requests.continuing import motion_on
from ff_planner_ros.ros.requests.reading import Knowledge, measured_state, require_requester
from ff_planner_ros.ros.topics import PUBLISH_PLAN

# Plans that wait to be published; one of 10,000 points takes 5 MB. A newer one takes the place of
# the oldest.
MOST_WAITING = 10


class Publication:
    """Publishes plans, and keeps those that wait for their release."""

    def __init__(
        self,
        node: Node,
        output: PlanOutput,
        exchanges: Exchanges,
        knowledge: Callable[[], Knowledge],
    ) -> None:
        """Open the service; until `open`, it answers with NOT_ACTIVE.

        Args:
            knowledge: Returns what the planner knows now.
        """
        self._node, self._output, self._knowledge = node, output, knowledge
        self._exchanges = exchanges
        self._logger = node.get_logger()
        self._lock = threading.RLock()
        self._waiting: dict[str, MadePlan] = {}  # the oldest first
        self._refusal: tuple[Status, str] | None = None
        self.close(Status.NOT_ACTIVE, "the planner is not active yet")
        self._service = node.create_service(
            PublishPlan,
            PUBLISH_PLAN.name,
            self._serve,
            qos_profile=REQUEST_QOS,
            callback_group=MutuallyExclusiveCallbackGroup(),
        )

    def open(self) -> None:
        """Publish from now on."""
        with self._lock:
            self._refusal = None

    def close(self, status: Status, message: str) -> None:
        """Publish no more, and forget the plans that wait."""
        with self._lock:
            self._refusal = status, message
            self.forget()

    def forget(self) -> None:
        """Forget the plans that wait: their times are no longer the clock's."""
        with self._lock:
            for plan_id in list(self._waiting):
                self._drop(plan_id)
            if self._output.preview.let_wait(None):
                self._output.preview.draw()

    def destroy(self) -> None:
        """Destroy the service."""
        self._node.destroy_service(self._service)

    def keep(self, made: MadePlan) -> None:
        """Keep a plan until it is published, or `MOST_WAITING` newer ones take its place.

        Raises:
            FfPlannerError: The node is not active any more.
        """
        with self._lock:
            self._require_open()
            self._waiting[made.plan_id] = made
            while len(self._waiting) > MOST_WAITING:
                self._drop(next(iter(self._waiting)))
        self.look()

    def look(self) -> None:
        """Display the newest plan that waits and may still be published, if any."""
        with self._lock:
            shown: MadePlan | None = None
            if self._waiting:
                now_ns = self._node.get_clock().now().nanoseconds
                most = self._knowledge().parameters.publication.max_age
                fit = (one for one in self._waiting.values() if one.may_go_out(now_ns, most))
                shown = next((one for one in reversed(list(fit))), None)
            if self._output.preview.let_wait(shown):
                self._draw()

    def publish(
        self,
        made: MadePlan,
        written: PlanMessage,
        requester: str,
    ) -> None:
        """Publish a plan for controllers, executives and visualisation; `written` is its message.

        Raises:
            FfPlannerError: The node is not active any more.
        """
        with self._lock:
            self._require_open()
            self._output.publish(made, written, requester)
            self._output.preview.release(made)
        self._draw()

    def _serve(
        self, request: PublishPlan.Request, response: PublishPlan.Response
    ) -> PublishPlan.Response:
        requester, inputs = request.requester or PUBLISH_PLAN.name, PlanInputs()
        told = request.plan_id, Interface.PUBLISH_PLAN, requester
        self._exchanges.tell(Event.RECEIVED, *told)
        event = Event.ANSWERED
        try:
            if request.reject:
                self._reject(request)
                event, message = Event.REJECTED, f"is dropped, {requester} rejected it"
            else:
                self._release(request, requester, inputs)
                event, message = Event.PUBLISHED, f"is published, {requester} asked for it"
            self.look()
            message = f"{request.plan_id} {message}"
            self._logger.info(in_log(message))
            response.status = PlanStatus(code=int(Status.SOLVED), message=message)
        except FfPlannerError as error:
            self._logger.warning(f"{PUBLISH_PLAN.name}: {error.status.name}: {in_log(str(error))}")
            response.status = status_message(error)
        except Exception as error:
            self._logger.error(
                in_log(f"{PUBLISH_PLAN.name}: INTERNAL_ERROR\n{traceback.format_exc()}")
            )
            unforeseen = f"{type(error).__name__}: {error}"
            response.status = status_message(FfPlannerError(Status.INTERNAL_ERROR, unforeseen))
        answer = PlanAnswer(status=response.status, plan_id=request.plan_id, inputs=inputs)
        self._exchanges.tell(event, *told, answer=answer)
        return response

    def _reject(self, request: PublishPlan.Request) -> None:
        """Forget the plan that a request names."""
        with self._lock:
            self._require_open()
            require_requester(request.requester)
            del self._waiting[self._waiting_plan(request.plan_id).plan_id]

    def _release(self, request: PublishPlan.Request, requester: str, inputs: PlanInputs) -> None:
        """Publish the plan that a request names; `inputs` takes what that depends on."""
        with self._lock:
            self._require_open()
            require_requester(request.requester)
            made, knowledge = self._waiting_plan(request.plan_id), self._knowledge()
            inputs.received_stamp = time_message(knowledge.now_ns)
            inputs.previous_plan_id = getattr(knowledge.published, "plan_id", "")
            self._require_in_time(made, knowledge.now_ns)
            require_young(made, knowledge)
            measured = measured_state(request.start_state, knowledge, made.robot)
            inputs.state_stamp = time_message(measured.stamp_ns)
            inputs.state_source = measured.source
            require_same_start(made, start_deviations(made, measured, knowledge), knowledge)
        # Thousands of points take a second, in which others may publish or forget.
        written = made.written()
        with self._lock:
            self._require_open()
            self._waiting_plan(request.plan_id)
            self._require_in_time(made, self._node.get_clock().now().nanoseconds)
            self.publish(made, written, requester)
            del self._waiting[made.plan_id]

    def _drop(self, plan_id: str) -> None:
        """Let a plan wait no longer: it will never be published."""
        del self._waiting[plan_id]
        self._exchanges.tell(Event.DROPPED, plan_id, Interface.PUBLISH_PLAN, "")

    def _draw(self) -> None:
        # Markers of many bodies take tens of milliseconds, and no answer waits for them.
        self._exchanges.afterwards(self._output.preview.draw)

    def _require_open(self) -> None:
        if self._refusal is not None:
            raise FfPlannerError(*self._refusal)

    def _waiting_plan(self, plan_id: str) -> MadePlan:
        """Return the plan of an id; an error does not tell the ids of others."""
        if plan_id in self._waiting:
            return self._waiting[plan_id]
        last = self._output.published
        allowed = (
            "it is published already"
            if last is not None and last.plan_id == plan_id
            else "no plan of this id waits to be published (plans asked for with plan_only "
            f"wait, the newest {MOST_WAITING}, until they are published, rejected, or their "
            "start is over)"
        )
        raise InvalidInput(Status.UNKNOWN_PLAN, "plan_id", repr(plan_id), allowed)

    def _require_in_time(self, made: MadePlan, now_ns: int) -> None:
        """Refuse a plan whose start is over; it waits no longer."""
        try:
            require_in_time(made.start_ns, now_ns)
        except NoPlanFound as error:
            self._drop(made.plan_id)
            error.retry = Retry.CHANGED
            raise


def require_young(made: MadePlan, knowledge: Knowledge) -> None:
    """Refuse a plan whose age exceeds `publication.max_age`.

    Raises:
        NoPlanFound: It does (CHECK_FAILED).
    """
    age = made.age(knowledge.now_ns)
    most = knowledge.parameters.publication.max_age
    if age > most:
        raise NoPlanFound(
            Status.CHECK_FAILED,
            f"{made.plan_id} was made {age:.3g} s ago, longer than publication.max_age, {most:g} "
            "s; ask for a new plan",
        )


def require_same_start(made: MadePlan, found: Sequence[Deviation], knowledge: Knowledge) -> None:
    """Refuse a plan if the system will be too far from its first point.

    Args:
        found: From `start_deviations`.

    Raises:
        NoPlanFound: A deviation is larger than allowed (STATE_MOVED).
    """
    off = too_far(found, knowledge.parameters.tracking, at_rates=True)
    if off:
        raise NoPlanFound(
            Status.STATE_MOVED,
            f"the system will not be where {made.plan_id} begins: it will miss {off}; "
            "ask for a new plan",
        )


def start_deviations(made: MadePlan, measured: Snapshot, knowledge: Knowledge) -> list[Deviation]:
    """Return how far the system, predicted to a plan's start time, is from its first point."""
    followed = knowledge.followed(measured, made.start_ns)
    continuous = knowledge.robot.continuous
    running = motion_on(followed, measured, continuous) if followed else None
    # A state may be stamped ahead of now by state_future_tolerance, and so be later than the start
    # of a plan that begins at once.
    ahead = max(made.start_ns - measured.stamp_ns, 0) / NANOSECONDS
    there = carried_forward(made.robot, measured.state, ahead, running)
    return deviations(there, made.plan.trajectory, 0.0, knowledge.robot)
