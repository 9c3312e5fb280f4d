"""The errors of this package: each names what is at fault, its value and what is allowed."""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any, NamedTuple

from ff_planner_ros.common.shown import shortened, shown


class Status(IntEnum):
    """Status of the answer to a planning request; the codes of `ff_planner_msgs/PlanStatus`."""

    SOLVED = 0

    NO_STATE = 100
    STATE_TOO_OLD = 101
    STATE_IN_FUTURE = 102
    NO_OBSTACLES = 103
    START_IN_COLLISION = 104
    START_OUTSIDE_LIMITS = 105
    START_SINGULAR = 106
    STATE_NOT_SYNCHRONIZED = 107
    NO_TARGET_BODY = 108
    TARGET_TOO_OLD = 109
    TARGET_IN_FUTURE = 110
    SEVERAL_PUBLISHERS = 111

    NOT_FINITE = 200
    WRONG_SIZE = 201
    BAD_QUATERNION = 202
    WRONG_FRAME = 203
    UNKNOWN_JOINT = 204
    OUT_OF_RANGE = 205
    UNSUPPORTED = 206
    BAD_ROBOT = 207
    START_IN_PAST = 208
    UNKNOWN_PLAN = 209
    NO_ACTIVE_PLAN = 210
    PLAN_ENDING = 211

    GOAL_OUT_OF_REACH = 300
    COLLISION = 301
    LIMIT_VIOLATED = 302
    SINGULAR = 303
    CHECK_FAILED = 304
    TIMED_OUT = 305
    TORQUE_TOO_HIGH = 306
    TOO_LATE = 307
    CONTROLLER_CONSTRAINT = 308
    STATE_MOVED = 309

    INTERNAL_ERROR = 400
    SOLVER_DIED = 401

    BUSY = 500
    CANCELLED = 501
    PREEMPTED = 502
    NOT_ACTIVE = 503
    SHUT_DOWN = 504
    CLOCK_JUMPED = 505

    @property
    def is_no_plan(self) -> bool:
        """Whether the request was valid but has no plan, or none that still applies: codes 3xx."""
        return Status.GOAL_OUT_OF_REACH <= self < Status.INTERNAL_ERROR


class Retry(IntEnum):
    """Whether repeating a request can help; the constants of `ff_planner_msgs/PlanStatus.retry`."""

    NOT_NEEDED = 0  # there is a plan
    LATER = 1  # the same request may be answered otherwise a little later
    CHANGED = 2  # only another request, scene, state or parameter can be answered otherwise
    DO_NOT_RETRY = 3  # this node answers no more


class Remedy(NamedTuple):
    """Machine-readable details of a status, used where the error itself carries none."""

    retry: Retry
    field: str = ""  # of the request, or a topic or parameter; empty: the error always names it
    value: str = ""  # of the field
    allowed: str = ""  # for the field, or what may help


_NOT_NEEDED, _LATER, _CHANGED, _DO_NOT_RETRY = Retry
REMEDIES: Mapping[Status, Remedy] = {
    Status.SOLVED: Remedy(_NOT_NEEDED),
    Status.NO_STATE: Remedy(_LATER),
    Status.STATE_TOO_OLD: Remedy(_LATER),
    Status.STATE_IN_FUTURE: Remedy(_LATER),
    Status.NO_OBSTACLES: Remedy(_LATER),
    Status.START_IN_COLLISION: Remedy(
        _CHANGED, "start_state", "in collision", "outside of all obstacles, not in itself"
    ),
    Status.START_OUTSIDE_LIMITS: Remedy(
        _CHANGED, "start_state", "outside of limits", "within the limits of all joints"
    ),
    Status.START_SINGULAR: Remedy(
        _CHANGED, "start_state", "singular", "a Jacobian of full rank, or another parametrisation"
    ),
    Status.STATE_NOT_SYNCHRONIZED: Remedy(_LATER),
    Status.NO_TARGET_BODY: Remedy(_LATER),
    Status.TARGET_TOO_OLD: Remedy(_LATER),
    Status.TARGET_IN_FUTURE: Remedy(_LATER),
    Status.SEVERAL_PUBLISHERS: Remedy(_CHANGED),
    Status.NOT_FINITE: Remedy(_CHANGED),
    Status.WRONG_SIZE: Remedy(_CHANGED),
    Status.BAD_QUATERNION: Remedy(_CHANGED),
    Status.WRONG_FRAME: Remedy(_CHANGED),
    Status.UNKNOWN_JOINT: Remedy(_CHANGED),
    Status.OUT_OF_RANGE: Remedy(_CHANGED),
    Status.UNSUPPORTED: Remedy(_CHANGED),
    Status.BAD_ROBOT: Remedy(_CHANGED),
    Status.START_IN_PAST: Remedy(_CHANGED),
    Status.UNKNOWN_PLAN: Remedy(_CHANGED),
    Status.NO_ACTIVE_PLAN: Remedy(_CHANGED),
    Status.PLAN_ENDING: Remedy(_CHANGED),
    Status.GOAL_OUT_OF_REACH: Remedy(
        _CHANGED, "goal", "out of reach", "within the arm's reach of where the chaser can be"
    ),
    Status.COLLISION: Remedy(_CHANGED, "scene", "in the way", "room for the robot on its way"),
    Status.LIMIT_VIOLATED: Remedy(_CHANGED, "limits", "violated", "a motion within them"),
    Status.SINGULAR: Remedy(
        _CHANGED, "goal", "only through a singularity", "another parametrisation"
    ),
    Status.CHECK_FAILED: Remedy(_CHANGED, "goal", "no plan passes the check", "another goal"),
    Status.TIMED_OUT: Remedy(_CHANGED, "search.time_budget", "used up", "a longer one"),
    Status.TORQUE_TOO_HIGH: Remedy(_CHANGED, "duration", "too short", "a longer one"),
    Status.TOO_LATE: Remedy(_LATER, "start_time", "over", "later than the answer"),
    Status.CONTROLLER_CONSTRAINT: Remedy(
        _CHANGED, "controller", "refuses the plan", "what a joint_trajectory_controller takes"
    ),
    Status.STATE_MOVED: Remedy(_CHANGED, "plan_id", "begins elsewhere", "a new plan"),
    Status.INTERNAL_ERROR: Remedy(_LATER, "planner", "failed", "please report it"),
    Status.SOLVER_DIED: Remedy(_LATER, "solver", "died", "a new one runs"),
    Status.BUSY: Remedy(_LATER, "when_busy", "reject", "one request at a time, or preempt"),
    Status.CANCELLED: Remedy(_LATER, "on_cancel", "discard", "best keeps the best plan so far"),
    Status.PREEMPTED: Remedy(_LATER, "when_busy", "preempt", "reject keeps the first request"),
    Status.NOT_ACTIVE: Remedy(_LATER, "lifecycle state", "not active", "active"),
    Status.SHUT_DOWN: Remedy(_DO_NOT_RETRY, "lifecycle state", "finalized", "active"),
    Status.CLOCK_JUMPED: Remedy(_LATER, "/clock", "jumped back", "time that goes on"),
}


# Of a message [characters]: with a command's name and the remark that something is cut off, a line
# is not longer than a thousand.
LONGEST_MESSAGE = 950
_LONGEST_FIELD = 250  # with a name of 200, the longest of links and joints


class FfPlannerError(Exception):
    """Root of all errors that this package raises on purpose."""

    def __init__(self, status: Status, message: str) -> None:
        """Store the cause beside the message."""
        super().__init__(message)
        self.status = status  # as the service and the command line report it
        self.retry: Retry | None = None  # None: that of the status

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by message and attributes, whatever a subclass is made of."""
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class InvalidInput(FfPlannerError):
    """A value that the planner cannot use."""

    def __init__(self, status: Status, field: str, value: object, allowed: str) -> None:
        """Name the field, its value and what is allowed."""
        told = shortened(" ".join(field.split()), _LONGEST_FIELD)  # a name may hold line breaks
        message = f"{told} is {shown(value)}: {allowed}"
        super().__init__(status, shortened(message, LONGEST_MESSAGE))
        self.field = field  # as in a scenario file: `chaser.quaternion_xyzw`
        self.value = value
        self.allowed = allowed

    @property
    def faults(self) -> tuple[InvalidInput, ...]:
        """Every value that is wrong, each with an error of its own."""
        return (self,)


class InvalidInputs(InvalidInput):
    """Several invalid values in one error; its message names the first."""

    def __init__(self, faults: Sequence[InvalidInput]) -> None:
        """Keep all errors; the first gives status, field, value and message."""
        first = faults[0]
        super().__init__(first.status, first.field, first.value, first.allowed)
        self._faults = tuple(faults)

    @property
    def faults(self) -> tuple[InvalidInput, ...]:
        """Every value that is wrong, each with an error of its own."""
        return self._faults


class Faults:
    """Collects the invalid values of an input, to report all of them in one error."""

    def __init__(self) -> None:
        """Start without any fault."""
        self.found: list[InvalidInput] = []

    def add(self, field: str, value: object, allowed: str) -> None:
        """Add a value that is out of range."""
        self.found.append(InvalidInput(Status.OUT_OF_RANGE, field, value, allowed))

    @contextmanager
    def gathered(self) -> Iterator[None]:
        """Catch and collect an InvalidInput of the `with` block; execution continues after it."""
        try:
            yield
        except InvalidInput as error:
            self.found += error.faults

    def refuse(self) -> None:
        """Raise one error for all collected faults, if there are any.

        Raises:
            InvalidInput: At least one fault was collected; `faults` holds all of them.
        """
        if self.found:
            raise self.found[0] if len(self.found) == 1 else InvalidInputs(self.found)


@dataclass(frozen=True)
class Failure:
    """A requirement that a plan does not meet."""

    status: Status
    finding: str  # what is violated, where, and by how much
    advice: tuple[str, ...]  # what may help


class NoPlanFound(FfPlannerError):
    """The input is valid, but no plan that keeps the constraints was found."""

    def __init__(
        self,
        status: Status,
        constraint: str,
        attempt: object | None = None,
        failures: Sequence[Failure] = (),
        effort: int = 0,
    ) -> None:
        """Name the violated constraint and keep the best attempt for investigation."""
        super().__init__(status, constraint)
        self.constraint = constraint  # what is violated, where, by how much, and what to try
        self.attempt = attempt  # the best, a `Plan` that is not to be executed; None: none
        self.failures = tuple(failures)  # of the best attempt; empty where they are not known
        self.effort = effort  # the step at which the search was stopped; zero: it ran to its end
        # Within a search: how many candidates met each requirement, by name, and the name of the
        # requirement that the message begins with; empty: not known
        self.met: Mapping[str, int] = {}
        self.requirement = ""
        # Of a sequence: the plans of the phases before the one that has none, a `Plan`
        self.found: object | None = None
        self.cause: InvalidInput | None = None  # of a sequence: why that phase cannot be planned


class EndedBy(StrEnum):
    """What ended a search."""

    CONVERGED = "converged"  # the best plan is at an optimum
    EXHAUSTED = "exhausted"  # everything was tried that is to be tried
    DEADLINE = "deadline"
    EFFORT = "effort"  # the last step that the request allows
    CANCEL = "cancel"


class OutOfTime(FfPlannerError):
    """A watch stopped the search before its end; `perform` turns it into a NoPlanFound."""

    def __init__(self, message: str, ended_by: EndedBy = EndedBy.DEADLINE) -> None:
        """Store what stopped the search; the status is TIMED_OUT."""
        super().__init__(Status.TIMED_OUT, message)
        self.ended_by = ended_by
        self.used_for = ""  # what used the time, in words; empty: not known
        self.refusal: NoPlanFound | None = None  # says how far the search came; None: not known


class Interrupted(FfPlannerError):
    """The planning was called off: its plan is no longer wanted."""

    def __init__(self) -> None:
        """Set the one status, CANCELLED, and the one message."""
        super().__init__(Status.CANCELLED, "the plan was given up")


class BagError(FfPlannerError):
    """A bag that cannot be written or read."""

    def __init__(self, message: str) -> None:
        """A bag error is never the planner's answer to a request: its status is internal."""
        super().__init__(Status.INTERNAL_ERROR, shortened(message, LONGEST_MESSAGE))


@contextmanager
def fields_renamed(renamed: Callable[[str], str]) -> Iterator[None]:
    """Rename the fields in every InvalidInput that the `with` block raises."""
    try:
        yield
    except InvalidInput as error:
        faults = [
            InvalidInput(one.status, renamed(one.field), one.value, one.allowed)
            for one in error.faults
        ]
        raise (faults[0] if len(faults) == 1 else InvalidInputs(faults)) from None


def fields_named(named_as: Mapping[str, str]) -> AbstractContextManager[None]:
    """Rename fields and their indexed entries in errors: scenario keys to message fields, say."""

    def renamed(field: str) -> str:
        name, bracket, entry = field.partition("[")
        return named_as.get(field, named_as.get(name, name) + bracket + entry)

    return fields_renamed(renamed)


def fields_placed(place: str) -> AbstractContextManager[None]:
    """Prefix the fields in errors with a place: `phases[1]`, say."""
    return fields_renamed(lambda field: f"{place}.{field}")
