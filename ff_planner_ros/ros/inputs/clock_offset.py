"""How far a publisher's clock is from the node's: stamps of messages less their times of arrival.

A message comes later than it is stamped, by its way. So the largest difference over the last
seconds is nearest to the offset between the clocks.
"""

from __future__ import annotations

from collections import deque

from ff_planner_ros.common.times import NANOSECONDS

# A clock that is set right counts after so long [s]. Shorter, and a few late messages in a row are
# told as an offset; longer, and a publisher whose clock was mended is refused for nothing.
WINDOW = 3.0
# Differences are kept for parts of the window, each the largest of so many.
_PARTS = 30
_WINDOW_NS = round(WINDOW * NANOSECONDS)
_PART_NS = _WINDOW_NS // _PARTS


class ClockOffset:
    """The offset that one topic's messages show; its user sees to it that one thread is in it."""

    def __init__(self) -> None:
        """Begin with nothing heard."""
        self._parts: deque[tuple[int, int]] = deque(maxlen=_PARTS)  # begin, largest lead [ns]

    def note(self, lead_ns: int, arrived_ns: int) -> None:
        """Take the next message: its stamp less its time of arrival, and when it came [ns]."""
        if self._parts:
            begun_ns, largest_ns = self._parts[-1]
            if 0 <= arrived_ns - begun_ns < _PART_NS:
                self._parts[-1] = begun_ns, max(largest_ns, lead_ns)
                return
        self._parts.append((arrived_ns, lead_ns))

    def at(self, now_ns: int) -> float | None:
        """Return by how much the publisher's clock is ahead [s]; None: nothing came lately."""
        lately = [
            lead_ns
            for begun_ns, lead_ns in self._parts
            # What seems to come after now came before the clock was set back.
            if 0 <= now_ns - begun_ns <= _WINDOW_NS
        ]
        return max(lately) / NANOSECONDS if lately else None

    def forget(self) -> None:
        """Begin again."""
        self._parts.clear()
