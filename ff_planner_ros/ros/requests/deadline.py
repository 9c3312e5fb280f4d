"""Deadlines of plans: when they begin, or take over from a running one."""

from __future__ import annotations

import time
from dataclasses import dataclass

from ff_planner_msgs.msg import PlanRequest
from rclpy.clock import Clock, ROSClock

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import NoPlanFound, Retry, Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.ros.requests.reading import ReadRequest

# Time that a search leaves for writing the plan: part of the time until the deadline, and at most
# [s].
_FOR_ANSWER, _MOST_FOR_ANSWER = 0.1, 0.5
# The same part once there is a plan that takes over, even the rest of the running one: on a busy
# machine the way of the answer takes as long as the search.
_FOR_ANSWER_WITH_PLAN = 0.5
# The rest of the running plan, unchanged, is what the joints do anyway: it can take over at any
# time, and counts as an answer until so long after the handover [s].
LATE_REMAINDER = 1.0


class Stages:
    """Durations of the stages of an answer."""

    def __init__(self, name: str, begun: float) -> None:
        """Begin the first stage, at a time of the monotonic clock [s]."""
        self._begun: list[tuple[str, float]] = [(name, begun)]

    def begin(self, name: str) -> None:
        """End a stage and begin another."""
        self._begun.append((name, time.monotonic()))

    @property
    def words(self) -> str:
        """Durations of the stages, the last one until now."""
        ends = [*(begun for _, begun in self._begun[1:]), time.monotonic()]
        return ", ".join(
            f"{end - begun:.3f} s {name}"
            for (name, begun), end in zip(self._begun, ends, strict=True)
        )


@dataclass(frozen=True)
class Deadline:
    """The moment at which a plan has to be ready."""

    at_ns: int  # by the node's clock [ns]
    moment: str  # what is then, as the subject of a sentence
    advice: str  # what to change first
    takes_over: bool = False  # whether a plan runs meanwhile
    is_asked_for: bool = False  # whether the request has it; the next answer is later still

    def require(self, now_ns: int, stages: Stages, plan: Plan | None = None) -> None:
        """Refuse a plan that is not ready by the deadline.

        Args:
            now_ns: Current time by the node's clock [ns].
            plan: None: still searched for, and may become the rest of the running plan.

        Raises:
            NoPlanFound: The deadline is over (TOO_LATE); the rest of a running plan may be a little
                later.
        """
        may_be_late = self.takes_over and (plan is None or plan.family == REMAINDER)
        latest_ns = self.at_ns + may_be_late * round(LATE_REMAINDER * NANOSECONDS)
        if now_ns > latest_ns:
            late = (now_ns - self.at_ns) / NANOSECONDS
            raise self._too_late(f"was missed by {late:.3f} s: {stages.words}")

    def missed(self, now_ns: int, stages: Stages, why: NoPlanFound) -> NoPlanFound:
        """Return the refusal of a search that ended without a plan because of the deadline."""
        left = (self.at_ns - now_ns) / NANOSECONDS
        return self._too_late(
            f"would be missed: {left:.3f} s before it there is no plan ({why}; {stages.words})"
        )

    def _too_late(self, how: str) -> NoPlanFound:
        error = NoPlanFound(Status.TOO_LATE, f"{self.moment} {how}; {self.advice}")
        error.retry = Retry.CHANGED if self.is_asked_for else None
        return error

    def limited(self, budget: Budget, clock: Clock, taken_up: float) -> Budget:
        """Return a budget that ends before the deadline: the best plan until then is the answer.

        With simulated time the budget stays as it is.

        Args:
            clock: The node's clock.
            taken_up: When the budget began to run, by the monotonic clock [s].
        """
        if isinstance(clock, ROSClock) and clock.ros_time_is_active:
            return budget  # how long that is by the wall clock is for the simulation to say
        left = (self.at_ns - clock.now().nanoseconds) / NANOSECONDS
        gone, seconds = (
            time.monotonic() - taken_up,
            left - min(_FOR_ANSWER * left, _MOST_FOR_ANSWER),
        )
        limited = budget._replace(seconds=min(budget.seconds, gone + seconds))
        if not self.takes_over:
            return limited
        with_plan = gone + (1.0 - _FOR_ANSWER_WITH_PLAN) * left
        return limited._replace(with_plan=min(budget.with_plan, with_plan))


def deadline_of(request: PlanRequest, read: ReadRequest, parameters: NodeParameters) -> Deadline:
    """Return the deadline for the plan of a request."""
    replanning, continues = parameters.replanning, read.task.running_goal is not None
    ahead = (read.start_ns - nanoseconds(read.inputs.received_stamp)) / NANOSECONDS
    after = f"{ahead:.3f} s after the request"
    is_asked_for = bool(nanoseconds(request.start_time))
    if is_asked_for:
        after, advice = f"at the start_time asked for, {after}", "ask for a later start_time first"
    else:
        name, given = "planning_lead_time", parameters.planning_lead_time
        if continues:
            name, given = "replanning.lead_time", replanning.lead_time
        after = f"{after} (parameter {name}, {given:g} s)"
        advice = f"raise {name} first, or ask for a later start_time"
    if not continues:
        moment = f"the start of the plan, {after},"
        return Deadline(read.start_ns, moment, advice, is_asked_for=is_asked_for)
    moment = (
        f"the handover from {read.inputs.previous_plan_id}, {after}, less "
        f"{replanning.handover:g} s for the controller (replanning.handover),"
    )
    ready_ns = read.start_ns - round(replanning.handover * NANOSECONDS)
    return Deadline(ready_ns, moment, advice, takes_over=True, is_asked_for=is_asked_for)
