"""Counts the requests that wait at once: the middleware drops more of them without a word.

rclpy passes on when a request arrived, but no number that is unique among clients. So the count at
an answer is that of the requests answered since its request arrived, its own included.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

from rclpy.service import Service


class RequestQueue:
    """Counts the requests at a service that wait or are being answered at once."""

    def __init__(self) -> None:
        """Begin without requests."""
        self.most = 0  # most requests at once until now
        self._answered = deque[int]()  # times of the answers since the last arrival [ns]
        self._lock = threading.Lock()

    def watch(self, service: Service) -> None:
        """Count the requests at a service from now on."""
        send = service.send_response

        def counted(response: Any, header: Any) -> None:
            send(response, header)
            self.answered(header.received_timestamp, time.time_ns())

        service.send_response = counted  # type: ignore[method-assign]

    def answered(self, arrived_ns: int, now_ns: int) -> None:
        """Count an answer at now_ns, by the system's clock [ns]; arrived_ns <= 0 is unknown."""
        if arrived_ns <= 0:
            return
        with self._lock:
            while self._answered and self._answered[0] <= arrived_ns:
                self._answered.popleft()
            self._answered.append(now_ns)
            self.most = max(self.most, len(self._answered))
