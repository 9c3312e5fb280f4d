"""How many requests wait at once: the middleware tells nobody that it has dropped some.

rclpy hands on when a request arrived, and of its number none that two clients do not share. So what
is known is how many had arrived and were not answered when another one came.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

from rclpy.service import Service


class RequestQueue:
    """Counts the requests at a service that wait or are being answered."""

    def __init__(self) -> None:
        """Begin with none."""
        self.most = 0  # at once, until now
        self._answered = deque[int]()  # when, of those after the last arrival [ns]
        self._lock = threading.Lock()

    def watch(self, service: Service) -> None:
        """Count the requests at a service from now on."""
        send = service.send_response

        def counted(response: Any, header: Any) -> None:
            send(response, header)
            self.answered(header.received_timestamp, time.time_ns())

        service.send_response = counted  # type: ignore[method-assign]

    def answered(self, arrived_ns: int, now_ns: int) -> None:
        """Count a request, by the system's clock [ns]; arrived_ns: zero or less if not known."""
        if arrived_ns <= 0:
            return
        with self._lock:
            while self._answered and self._answered[0] <= arrived_ns:
                self._answered.popleft()
            self._answered.append(now_ns)
            self.most = max(self.most, len(self._answered))
