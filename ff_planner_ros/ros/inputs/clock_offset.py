"""Offset of a publisher's clock from the node's: stamps of messages minus times of arrival.

Transport delays only lower this difference, so its largest value over the last seconds is nearest
to the offset.
"""

from __future__ import annotations

from collections import deque

from ff_planner_ros.common.times import NANOSECONDS

# Length of the window [s]. Shorter, and a few late messages in a row look like an offset; longer,
# and a publisher is refused long after its clock was corrected.
WINDOW = 3.0
# Differences are kept for parts of the window, each the largest of so many.
_PARTS = 30
_WINDOW_NS = round(WINDOW * NANOSECONDS)
_PART_NS = _WINDOW_NS // _PARTS


class ClockOffset:
    """Clock offset estimated from the messages of one topic; not thread-safe."""

    def __init__(self) -> None:
        """Begin without messages."""
        self._parts: deque[tuple[int, int]] = deque(maxlen=_PARTS)  # begin, largest lead [ns]

    def note(self, lead_ns: int, arrived_ns: int) -> None:
        """Add a message: its stamp minus its time of arrival, and its time of arrival [ns]."""
        if self._parts:
            begun_ns, largest_ns = self._parts[-1]
            if 0 <= arrived_ns - begun_ns < _PART_NS:
                self._parts[-1] = begun_ns, max(largest_ns, lead_ns)
                return
        self._parts.append((arrived_ns, lead_ns))

    def at(self, now_ns: int) -> float | None:
        """Return how far the publisher's clock is ahead [s]; None: no message in the window."""
        lately = [
            lead_ns
            for begun_ns, lead_ns in self._parts
            # What seems to come after now came before the clock was set back.
            if 0 <= now_ns - begun_ns <= _WINDOW_NS
        ]
        return max(lately) / NANOSECONDS if lately else None

    def forget(self) -> None:
        """Discard all messages."""
        self._parts.clear()
