"""When a plan has to be ready, and how long before its handover it has to be asked for."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from ff_planner_msgs.msg import PlanRequest
from rclpy.clock import Clock, ROSClock

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.published_plans import ReplanningParameters
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.ros.requests.reading import ReadRequest

# The allowance follows the last answers: a share of them [%] would have come in time, with so much
# to spare.
_ANSWERS, _SHARE, _SPARE = 20, 95, 1.25
# What was given up would have taken longer, nobody knows how much: so many times as long.
_OF_GIVEN_UP = 2.0
# Of the time until its plan has to be ready, a search leaves so much for writing the plan: a part,
# and at most [s].
_FOR_ANSWER, _MOST_FOR_ANSWER = 0.1, 0.5
# And once it has a plan that takes over, be it what remains of the running one, this part: on a
# busy machine the way of the answer takes as long as the search.
_FOR_ANSWER_WITH_PLAN = 0.5
# What remains of the running plan, unchanged, is what the joints do anyway: it takes over at any
# moment, and counts as an answer until so long after the handover [s].
_LATE_REMAINDER = 1.0


class LeadTimes:
    """How long answers to requests took that take over from a running plan."""

    def __init__(self) -> None:
        """Begin without any."""
        self._took = deque[float](maxlen=_ANSWERS)
        self._lock = threading.Lock()

    def add(self, seconds: float, status: Status) -> None:
        """Take an answer into account, by its time from the request on [s]."""
        if status >= Status.INTERNAL_ERROR:
            return  # what was called off, or failed, tells nothing of others
        with self._lock:
            late = status is Status.TOO_LATE
            self._took.append(_OF_GIVEN_UP * seconds if late else seconds)

    def lead_time(self, parameters: ReplanningParameters) -> float:
        """Return how long after its request a plan takes over that does not say when [s]."""
        with self._lock:
            if not self._took:
                return parameters.lead_time
            needed = _SPARE * float(np.percentile(self._took, _SHARE)) + parameters.handover
        return max(parameters.lead_time, min(needed, parameters.longest_lead_time))


class Stages:
    """What the time of an answer goes into."""

    def __init__(self, name: str, begun: float) -> None:
        """Begin with the first stage, at a time of the monotonic clock [s]."""
        self._begun: list[tuple[str, float]] = [(name, begun)]

    def begin(self, name: str) -> None:
        """End a stage and begin another."""
        self._begun.append((name, time.monotonic()))

    @property
    def words(self) -> str:
        """How long each stage took, the last until now."""
        ends = [*(begun for _, begun in self._begun[1:]), time.monotonic()]
        return ", ".join(
            f"{end - begun:.3f} s {name}"
            for (name, begun), end in zip(self._begun, ends, strict=True)
        )


@dataclass(frozen=True)
class Deadline:
    """The moment at which a plan has to be ready."""

    at_ns: int  # by the node's clock [ns]
    moment: str  # in words: what is then
    advice: str  # what to change first
    takes_over: bool = False  # whether a plan runs meanwhile

    def require(self, now_ns: int, stages: Stages, plan: Plan | None = None) -> None:
        """Refuse a plan that is not ready by then.

        Args:
            plan: None: it is still looked for, and may be what remains of the running one.

        Raises:
            NoPlanFound: It is not (TOO_LATE).
        """
        may_be_late = self.takes_over and (plan is None or plan.family == REMAINDER)
        latest_ns = self.at_ns + may_be_late * round(_LATE_REMAINDER * NANOSECONDS)
        if now_ns > latest_ns:
            late = (now_ns - self.at_ns) / NANOSECONDS
            raise NoPlanFound(
                Status.TOO_LATE,
                f"{self.moment} was missed by {late:.3f} s: {stages.words}; {self.advice}",
            )

    def missed(self, now_ns: int, stages: Stages, why: NoPlanFound) -> NoPlanFound:
        """Return the refusal of a search that was ended so that its plan would have been ready."""
        left = (self.at_ns - now_ns) / NANOSECONDS
        return NoPlanFound(
            Status.TOO_LATE,
            f"{self.moment} would be missed: {left:.3f} s before it there is no plan ({why}; "
            f"{stages.words}); {self.advice}",
        )

    def limited(self, budget: Budget, clock: Clock, taken_up: float) -> Budget:
        """Return a budget that ends with the deadline: the best plan until then is the answer.

        Args:
            clock: The node's.
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
    """Return when the plan of a request has to be ready."""
    replanning, continues = parameters.replanning, read.task.running_goal is not None
    ahead = (read.start_ns - read.provenance.received_stamp_ns) / NANOSECONDS
    after = f"{ahead:.3f} s after the request"
    if nanoseconds(request.start_time):
        after, advice = f"at the start_time asked for, {after}", "ask for a later start_time first"
    else:
        name, given = "planning_lead_time", parameters.planning_lead_time
        if continues:
            name, given = "replanning.lead_time", replanning.lead_time
        after = f"{after} (parameter {name}, {given:g} s)"
        advice = f"raise {name} first, or ask for a later start_time"
    if not continues:
        return Deadline(read.start_ns, f"the start of the plan, {after},", advice)
    moment = (
        f"the handover from {read.provenance.previous_plan_id}, {after}, less "
        f"{replanning.handover:g} s for the controller (replanning.handover),"
    )
    ready_ns = read.start_ns - round(replanning.handover * NANOSECONDS)
    return Deadline(ready_ns, moment, advice, takes_over=True)
