"""Times of messages."""

from __future__ import annotations

from typing import Any

NANOSECONDS = 1_000_000_000  # in a second
# A time this little beyond a limit is within it [s].
ROUNDING = 1e-6


def nanoseconds(stamp: Any) -> int:
    """Return a message's time or duration as integer nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
