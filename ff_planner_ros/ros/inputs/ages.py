"""Ages of inputs: what is too old, or stamped ahead, is refused."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.common.times import NANOSECONDS, ROUNDING
from ff_planner_ros.errors import InvalidInput, Retry, Status


@dataclass(frozen=True)
class Ages:
    """How an input is refused for its stamp."""

    old: Status  # if it is too old
    early: Status  # if it is too far ahead
    parameter: str  # of the largest age

    def require(
        self,
        field: str,
        stamp_ns: int,
        now_ns: int,
        max_age: float,
        max_lead: float,
        came_ns: int | None = None,
        is_own: bool = False,
    ) -> None:
        """Refuse a stamp more than max_age ago or more than max_lead ahead of now [s].

        Args:
            field: Field of the stamp, which the error names.
            came_ns: When the message arrived, by the node's clock; None: unknown [ns].
            is_own: Whether a request brings it; its age only grows.

        Raises:
            InvalidInput: The stamp is too old or too far ahead.
        """
        age = (now_ns - stamp_ns) / NANOSECONDS
        if age > max_age + ROUNDING:
            allowed = f"it must be at most {max_age:g} s old (parameter {self.parameter})"
            if not stamp_ns:
                allowed += "; it is zero: is it stamped?"
            if came_ns is not None:
                came, late = (now_ns - came_ns) / NANOSECONDS, (came_ns - stamp_ns) / NANOSECONDS
                if came <= max_age < late:
                    allowed += (
                        f"; it came {came:.3f} s ago with a stamp {late:.3f} s behind: its "
                        f"publisher's clock is {late:.3f} s behind this node's, or messages are "
                        "so long on their way"
                    )
            error = InvalidInput(self.old, field, f"{age:.3f} s old", allowed)
            error.retry = Retry.CHANGED if is_own else None
            raise error
        if -age > max_lead + ROUNDING:
            raise self.ahead(field, -age, max_lead, "now")

    def ahead(self, field: str, lead: float, max_lead: float, of: str) -> InvalidInput:
        """Return the refusal of a stamp that is ahead by more than max_lead [s]."""
        return InvalidInput(
            self.early,
            field,
            f"{lead:.3f} s ahead of {of}",
            f"it must be at most {max_lead:g} s ahead (parameter state_future_tolerance): what is "
            "stamped ahead never counts as a measurement, not even when its time has come; do both "
            "computers have the same time?",
        )

    def behind(self, field: str, seconds: float) -> InvalidInput:
        """Return the refusal of a stamp that is earlier than that of the message before [s]."""
        return InvalidInput(
            self.old,
            field,
            f"{seconds:.3f} s before that of the message before",
            "stamps must not go back: was a clock set back? The next message that is newer counts",
        )


OF_STATES = Ages(Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "state_max_age")
OF_SCENES = Ages(Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "obstacles_max_age")
OF_TARGETS = Ages(Status.TARGET_TOO_OLD, Status.TARGET_IN_FUTURE, "target_max_age")
