"""State of the node's clock for `/diagnostics`: time that stops or jumps back voids plans."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import ROSClock
from rclpy.node import Node

# Simulated clocks tick ten times a second or more [s].
_STANDS = 2.0
# How long `/diagnostics` reports a jump back, and the shortest time between its log lines [s].
_TOLD, LOG_PERIOD = 10.0, 1.0


@dataclass(frozen=True)
class ClockHealth:
    """State of the node's clock; the defaults are those of the system's clock."""

    still_for: float | None = None  # since /clock ticked last [s]; None: the system's clock
    jumps: int = 0  # number of jumps back in the last seconds
    furthest: float = 0.0  # the largest of them [s]
    publishers: Sequence[str] = ()  # of /clock, after jumps


class ClockWatch:
    """Watches the clock of a node by the host's monotonic clock."""

    def __init__(self, node: Node) -> None:
        """Begin with nothing seen."""
        self._node = node
        self._ticked = -1, 0.0  # simulated time, and when it was seen first: (ns, s)
        self._jumps = deque[tuple[float, float]](maxlen=10_000)  # when, and by how much back [s]

    def jumped_back(self, seconds: float) -> None:
        """Note a jump back by some seconds [s]."""
        self._jumps.append((time.monotonic(), seconds))

    def health(self, now_ns: int) -> ClockHealth:
        """Return the state of the clock, which now reads now_ns [ns]."""
        clock, now = self._node.get_clock(), time.monotonic()
        if not (isinstance(clock, ROSClock) and clock.ros_time_is_active):
            return ClockHealth()
        if now_ns != self._ticked[0]:
            self._ticked = now_ns, now
        lately = [seconds for when, seconds in list(self._jumps) if now - when <= _TOLD]
        heard = self._node.get_publishers_info_by_topic("/clock") if lately else []
        return ClockHealth(
            still_for=now - self._ticked[1],
            jumps=len(lately),
            furthest=max(lately, default=0.0),
            publishers=sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in heard),
        )


def clock_part(health: ClockHealth) -> tuple[bytes, str, Mapping[str, str]]:
    """Return level, message and values of the diagnostic status of the clock."""
    if health.still_for is None:
        return DiagnosticStatus.OK, "the system's", {}
    values = {"still for [s]": f"{health.still_for:.1f}", "jumps back": str(health.jumps)}
    if health.still_for > _STANDS:
        message = (
            f"simulated, and /clock has not ticked for {health.still_for:.1f} s: plans, previews "
            "and the age of what was received stand still; does the simulation run?"
        )
        return DiagnosticStatus.WARN, message, values
    if health.jumps:
        often = "once" if health.jumps == 1 else f"{health.jumps} times"
        message = (
            f"simulated, and /clock has jumped back {often} in the last {_TOLD:g} s, by "
            f"{health.furthest:.3f} s at most: states and plans of before are void each time"
        )
        if len(health.publishers) > 1:
            message += f"; it is published by {' and '.join(health.publishers)}: stop all but one"
        return DiagnosticStatus.WARN, message, values
    return DiagnosticStatus.OK, "simulated: /clock ticks", values
