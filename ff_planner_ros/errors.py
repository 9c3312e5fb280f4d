"""The errors of this package: each names what is at fault, its value and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum

from ff_planner_ros.shown import shortened, shown


class Status(IntEnum):
    """Why a request was answered the way it was; the codes of `ff_planner_msgs/PlanStatus`."""

    SOLVED = 0

    NO_STATE = 100
    STATE_TOO_OLD = 101
    STATE_IN_FUTURE = 102
    NO_OBSTACLES = 103
    START_IN_COLLISION = 104
    START_OUTSIDE_LIMITS = 105
    START_SINGULAR = 106
    STATE_UNPAIRED = 107
    NO_TARGET_BODY = 108
    TARGET_STALE = 109
    TARGET_IN_FUTURE = 110

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
    NO_PLAN_RUNS = 210
    PLAN_ENDS = 211

    GOAL_OUT_OF_REACH = 300
    COLLISION = 301
    LIMIT_VIOLATED = 302
    SINGULAR = 303
    CHECK_FAILED = 304
    OUT_OF_TIME = 305
    TORQUE_TOO_HIGH = 306
    TOO_LATE = 307
    CONTROLLER_RULE = 308
    STATE_MOVED = 309

    INTERNAL_ERROR = 400
    SOLVER_DIED = 401

    BUSY = 500
    CANCELLED = 501
    PREEMPTED = 502
    NOT_ACTIVE = 503
    SHUT_DOWN = 504
    CLOCK_JUMPED = 505


# Of what is wrong with an input [characters], so that a line with a command's name and a remark
# that something is cut off is not longer than a thousand.
LONGEST_MESSAGE = 950
_LONGEST_FIELD = 150


class FfPlannerError(Exception):
    """Root of all errors that this package raises on purpose."""

    def __init__(self, status: Status, message: str) -> None:
        """Store the cause beside the message."""
        super().__init__(message)
        self.status = status  # as the service and the command line report it


class InvalidInput(FfPlannerError):
    """A value that cannot be planned with."""

    def __init__(self, status: Status, field: str, value: object, allowed: str) -> None:
        """Name the field, its value and what is allowed."""
        message = f"{shortened(field, _LONGEST_FIELD)} is {shown(value)}: {allowed}"
        super().__init__(status, shortened(message, LONGEST_MESSAGE))
        self.field = field  # as in a scenario file: `chaser.quaternion_xyzw`
        self.value = value
        self.allowed = allowed

    def __reduce__(self) -> tuple[type, tuple[Status, str, object, str]]:
        """Pickle by constructor arguments, so that the error crosses processes."""
        return type(self), (self.status, self.field, self.value, self.allowed)


@dataclass(frozen=True)
class Failure:
    """A requirement that a plan does not meet."""

    status: Status
    finding: str  # what is where, and by how much too far
    advice: tuple[str, ...]  # what may help


class NoPlanFound(FfPlannerError):
    """The input is sound, and no plan that keeps the constraints was found."""

    def __init__(
        self,
        status: Status,
        constraint: str,
        attempt: object | None = None,
        failures: Sequence[Failure] = (),
    ) -> None:
        """Name the violated constraint and keep the best attempt for investigation."""
        super().__init__(status, constraint)
        self.constraint = constraint  # what is violated, where, by how much, and what to try
        self.attempt = attempt  # the best, a `Plan` that is not to be executed; None: none
        self.failures = tuple(failures)  # of the best attempt; empty where they are not known

    def __reduce__(self) -> tuple[type, tuple[Status, str, object | None, tuple[Failure, ...]]]:
        """Pickle by constructor arguments, so that the error crosses processes."""
        return type(self), (self.status, self.constraint, self.attempt, self.failures)


class OutOfTime(FfPlannerError):
    """The time for a search is over; `plan` turns it into a NoPlanFound."""

    def __init__(self, message: str) -> None:
        """Only one status fits."""
        super().__init__(Status.OUT_OF_TIME, message)


class Interrupted(FfPlannerError):
    """A plan that is no longer wanted."""

    def __init__(self) -> None:
        """Only one status and one message fit."""
        super().__init__(Status.CANCELLED, "the plan was given up")


class BagError(FfPlannerError):
    """A bag that cannot be written or read."""

    def __init__(self, message: str) -> None:
        """A bag error is never the planner's answer to a request: its status is internal."""
        super().__init__(Status.INTERNAL_ERROR, shortened(message, LONGEST_MESSAGE))


@contextmanager
def fields_named(named_as: Mapping[str, str]) -> Iterator[None]:
    """Make errors name other fields: a message's, say, instead of the planning objects' ones."""
    try:
        yield
    except InvalidInput as error:
        field = named_as.get(error.field, error.field)
        raise InvalidInput(error.status, field, error.value, error.allowed) from None
