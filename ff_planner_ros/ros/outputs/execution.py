"""Execution of published plans: sent to the controller's action if asked for, and their events."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from diagnostic_msgs.msg import DiagnosticStatus
from ff_planner_msgs.msg import PlanEvent
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.parameters.controller import ControllerParameters, HandOver
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.controller import ControllerClient, ControllerWatch, Ended
from ff_planner_ros.ros.qos import create_lifecycle_publisher
from ff_planner_ros.ros.topics import PLAN_EVENTS

# Of a timer that is set anew before it runs [s].
_ANY_PERIOD = 1.0
_SOON_NS = 1_000_000
# A controller says why it ended a goal later than its reference shows it: 0.05 s with its usual
# action_monitor_rate, and more on a busy machine. Its own words and code are waited for [ns].
_SAYS_WHY_NS = 1_000_000_000


class Event(IntEnum):
    """Events of a published plan, as in `ff_planner_msgs/PlanEvent`."""

    PUBLISHED = PlanEvent.PUBLISHED
    STARTED = PlanEvent.STARTED
    AT_GOAL = PlanEvent.AT_GOAL
    ABORTED = PlanEvent.ABORTED
    SUPERSEDED = PlanEvent.SUPERSEDED


@dataclass(frozen=True)
class ControllerHealth:
    """State of the controller; by default plans go out on the topic alone."""

    action: str = ""  # name of its action; empty: plans go out on the topic alone
    is_there: bool = True  # whether the action can be reached
    last: tuple[str, Event, str] | None = None  # of the last plan: id, event, words
    # Joint off its plan most, by what, and the unit
    furthest: tuple[str, float, str] | None = None
    unwatched: str = ""  # why nobody sees that it keeps a plan's times; empty: the node does


@dataclass(eq=False)
class _Plan:
    """A plan from its publication to its end."""

    plan_id: str
    start_ns: int
    goal_ns: int
    trajectory: JointTrajectory
    is_sent: bool = False  # to the action
    is_taken: bool = False  # the controller accepted it, or there is no action to ask
    taken_ns: int = 0  # when the controller accepted it, which may be after its start
    has_started: bool = False
    broken: str = ""  # why the controller does not keep it; empty: it does
    broken_ns: int = 0  # since when


class Execution:
    """Tracks plans by the node's clock and, with the action, by the controller's responses."""

    def __init__(
        self,
        node: LifecycleNode,
        settings: ControllerParameters,
        aborted: Callable[[str], None],
    ) -> None:
        """Create publisher and client.

        Args:
            aborted: Called with the id of a plan that was aborted.
        """
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._lead_ns = round(settings.hand_over_lead * 1e9)
        self._aborted = aborted
        self._lock = threading.RLock()
        self._plans: list[_Plan] = []  # as published
        self.last: tuple[str, Event, str] | None = None  # plan, event and words, for diagnostics
        self._events = create_lifecycle_publisher(node, PLAN_EVENTS)
        self.publishers = (self._events,)
        self.controller: ControllerClient | None = None  # None: plans go out on the topic alone
        # Time is the plan's: where it stands still, no plan begins.
        group = MutuallyExclusiveCallbackGroup()
        self._node, self._timer = node, node.create_timer(_ANY_PERIOD, self.look, group)
        self._timer.cancel()  # until there is a plan
        if settings.hand_over == HandOver.ACTION:
            self.controller = ControllerClient(node, settings, group)
        self.watch: ControllerWatch | None = None  # None: the controller's state is not watched
        if settings.watched_topic:
            self.watch = ControllerWatch(node, settings, self._broken)

    def runs(self, plan_id: str) -> bool:
        """Return whether a published plan runs, or will."""
        return any(one.plan_id == plan_id for one in self._plans)

    def published(
        self, plan_id: str, start_ns: int, goal_ns: int, trajectory: JointTrajectory
    ) -> None:
        """Track a plan that was just published; times of its first point and of its goal [ns]."""
        with self._lock:
            taken = self.controller is None
            plan = _Plan(plan_id, start_ns, goal_ns, trajectory, is_taken=taken)
            self._plans.append(plan)
            if self.watch is not None and self.controller is None:
                self.watch.replaced(self._clock.now().nanoseconds)
            self._tell(plan, Event.PUBLISHED, "published")
            self._arm()

    def look(self) -> None:
        """Publish the events until now, in their order, and send plans that are due."""
        with self._lock:
            now_ns = self._clock.now().nanoseconds
            for plan in list(self._plans):
                if self.controller is not None:
                    self._hand_over(plan, self.controller, now_ns)
                if plan.broken and now_ns >= plan.broken_ns + _SAYS_WHY_NS:
                    self._end(plan, Event.ABORTED, plan.broken)
            while due := [one for one in self._due() if one[0] <= now_ns]:
                _, plan = min(due, key=lambda one: one[0])
                if plan.has_started:
                    self._end(plan, Event.AT_GOAL, "its time at the goal has come")
                else:
                    self._start(plan)
            self._arm()

    def health(self, robot: Robot) -> ControllerHealth:
        """Return the current state of the controller."""
        client, watch = self.controller, self.watch
        return ControllerHealth(
            action="" if client is None else client.action,
            is_there=client is None or client.is_there,
            last=self.last,
            furthest=None if client is None else _furthest(client.off, robot),
            unwatched="" if watch is None else watch.complaint,
        )

    def withdraw(self, why: str) -> None:
        """Abort plans that are not yet sent to the action; the controller keeps its goal."""
        with self._lock:
            for plan in [one for one in self._plans if not one.is_sent and self.controller]:
                self._end(plan, Event.ABORTED, f"not handed over: {why}")
            self._arm()

    def forget(self, why: str) -> None:
        """Abort every plan, and cancel the controller's goal."""
        with self._lock:
            if self.controller is not None:
                self.controller.cancel()
            for plan in list(self._plans):
                self._end(plan, Event.ABORTED, why)
            self._arm()

    def close(self) -> None:
        """Remove timer and client from the node."""
        self._node.destroy_timer(self._timer)
        for one in (self.controller, self.watch):
            if one is not None:
                one.close()

    def _arm(self) -> None:
        """Set the timer to when something is due next."""
        waits = [one for one in self._plans if not one.is_sent and self.controller is not None]
        silent = [one for one in self._plans if one.is_sent and not one.is_taken]
        times = [
            *(time_ns for time_ns, _ in self._due()),
            *(one.start_ns - self._lead_ns for one in waits),
            *(one.goal_ns + _SOON_NS for one in silent),
            *(one.broken_ns + _SAYS_WHY_NS for one in self._plans if one.broken),
        ]
        if not times:
            self._timer.cancel()
            return
        until = min(times) - self._clock.now().nanoseconds
        self._timer.timer_period_ns = max(until, _SOON_NS)
        self._timer.reset()
        if self._node.executor is not None:
            self._node.executor.wake()

    def _due(self) -> list[tuple[int, _Plan]]:
        """Return the time of each plan's next event that the clock alone decides [ns]."""
        starts = [(one.start_ns, one) for one in self._plans if not one.has_started]
        # The controller says itself when it has brought a plan to its end.
        goals = [
            (one.goal_ns, one) for one in self._plans if one.has_started and not self.controller
        ]
        return [one for one in starts if one[1].is_taken] + goals

    def _start(self, plan: _Plan) -> None:
        plan.has_started = True
        for other in [one for one in self._plans if one is not plan]:
            # A plan that was published later and has not begun waits; all others give way.
            if other.has_started or self._plans.index(other) < self._plans.index(plan):
                self._supersede(other, plan)
        if self.watch is not None:
            times = plan.start_ns, plan.taken_ns
            self.watch.follow(plan.plan_id, *times, plan.trajectory)
        self._tell(plan, Event.STARTED, "its start time has come")

    def _supersede(self, plan: _Plan, successor: _Plan) -> None:
        words = f"{successor.plan_id} has taken its place"
        self._end(plan, Event.SUPERSEDED, words, successor.plan_id)

    def _hand_over(self, plan: _Plan, controller: ControllerClient, now_ns: int) -> None:
        if not plan.is_sent and now_ns >= plan.start_ns - self._lead_ns:
            plan.is_sent = True
            if self.watch is not None:
                self.watch.replaced(now_ns)
            controller.send(
                plan.trajectory,
                lambda: self._accepted(plan),
                lambda ended: self._ended(plan, ended),
            )
        elif not plan.is_taken and now_ns > plan.goal_ns:
            self._ended(plan, Ended("the controller did not say whether it takes it"))

    def _accepted(self, plan: _Plan) -> None:
        with self._lock:
            plan.is_taken, plan.taken_ns = True, self._clock.now().nanoseconds
            self._arm()

    def _ended(self, plan: _Plan, ended: Ended) -> None:
        with self._lock:
            if plan not in self._plans:
                return
            if ended.succeeded:
                if not plan.has_started:
                    self._start(plan)
                self._end(plan, Event.AT_GOAL, ended.words)
                return
            later = self._plans[self._plans.index(plan) + 1 :]
            successor = next((one for one in later if one.is_sent), None)
            if successor is not None and ended.is_replaced:
                self._supersede(plan, successor)
            else:
                self._end(plan, Event.ABORTED, ended.words, error_code=ended.error_code)

    def _broken(self, plan_id: str, why: str, may_have_ended: bool) -> None:
        """Abort a plan that the controller does not keep; the controller keeps its goal.

        Args:
            may_have_ended: Whether the controller may have ended its goal, and will say why.
        """
        with self._lock:
            for plan in [one for one in self._plans if one.plan_id == plan_id]:
                plan.broken, plan.broken_ns = f"broken: {why}", self._clock.now().nanoseconds
                self._aborted(plan_id)  # already, so that nothing is planned from it
                if self.controller is None or not may_have_ended:
                    self._end(plan, Event.ABORTED, plan.broken)
            self._arm()

    def _end(
        self, plan: _Plan, event: Event, words: str, successor: str = "", error_code: int = 0
    ) -> None:
        self._plans.remove(plan)
        if self.watch is not None:
            self.watch.leave(plan.plan_id)
        if plan.broken and event is not Event.ABORTED:
            event, words, successor = Event.ABORTED, plan.broken, ""
        self._tell(plan, event, words, successor, error_code)
        if event is Event.ABORTED and not plan.broken:
            self._aborted(plan.plan_id)

    def _tell(
        self, plan: _Plan, event: Event, words: str, successor: str = "", error_code: int = 0
    ) -> None:
        self.last = plan.plan_id, event, words
        said = f"{plan.plan_id}: {event.name}: {in_log(words)}"
        if event is Event.ABORTED:
            self._logger.error(said)
        elif event is not Event.PUBLISHED:  # of that the answer's line tells
            self._logger.info(said)
        self._events.publish(
            PlanEvent(
                header=Header(stamp=time_message(self._clock.now().nanoseconds)),
                plan_id=plan.plan_id,
                event=int(event),
                successor=successor,
                error_code=error_code,
                message=words,
            )
        )


def controller_part(health: ControllerHealth) -> tuple[bytes, str, Mapping[str, str]]:
    """Return level, message and values of the diagnostic status of the controller."""
    values = {"hand-over": "action" if health.action else "topic"}
    if health.last is not None:
        plan_id, event, words = health.last
        values |= {"plan id": plan_id, "event": event.name}
    if health.furthest is not None:
        joint, error, unit = health.furthest
        values |= {"joint": joint, f"off by [{unit}]": f"{error:.6f}"}
    level, message = DiagnosticStatus.OK, "plans go out on the topic joint_trajectory"
    if health.action:
        message = f"plans are sent to {health.action}"
    if health.last is not None:
        message += f"; {plan_id}: {event.name}: {words}"
    if not health.is_there:
        level = DiagnosticStatus.WARN
        message = f"nobody answers at {health.action}: does the controller run? {message}"
    if health.unwatched:
        level = DiagnosticStatus.WARN
        message += f"; whether it keeps a plan's times is not seen: {health.unwatched}"
    if health.last is not None and event is Event.ABORTED:
        level = DiagnosticStatus.ERROR
    return level, message, values


def _furthest(off: Mapping[str, float], robot: Robot) -> tuple[str, float, str] | None:
    """Return the joint off its plan most, prismatic ones by their weight, by what, and the unit.

    A joint that no plan moves counts as revolute.
    """
    names, weights = robot.joint_names, robot.joint_weights
    numbers = {name: names.index(name) for name in off if name in names}

    def weighted(name: str) -> float:
        return off[name] * (weights[numbers[name]] if name in numbers else 1.0)

    if not off:
        return None
    joint = max(off, key=weighted)
    return joint, off[joint], robot.unit(numbers[joint]) if joint in numbers else "rad"
