"""How many requests waited at once, from when each arrived and was answered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from ff_planner_ros.ros.requests.request_queue import RequestQueue


@pytest.mark.parametrize("seed", range(5))
def test_it_is_the_longest_that_a_queue_was_when_a_request_came(seed: int) -> None:
    """One is answered after the other, in the order in which they came: bursts, then calm."""
    rng = np.random.default_rng(seed)
    arrived = np.unique(rng.choice([100, 5000, 90000], 60) + rng.integers(0, 900, 60)).tolist()
    queue, answered, now = RequestQueue(), list[int](), 0
    for at in arrived:
        now = max(now, at) + int(rng.integers(1, 200))
        answered.append(now)
        queue.answered(at, now)
    waiting = [
        sum(came <= at < left for came, left in zip(arrived, answered, strict=True))
        for at in arrived
    ]
    assert queue.most == max(waiting) > 5


def test_each_response_is_sent_and_counted() -> None:
    sent: list[Any] = []
    service, queue = Mock(send_response=lambda *both: sent.append(both)), RequestQueue()
    queue.watch(service)
    for number in range(3):
        service.send_response(number, SimpleNamespace(received_timestamp=1_000))
    assert [number for number, _ in sent] == [0, 1, 2]
    assert queue.most == 3


def test_a_middleware_that_does_not_tell_when_they_came_tells_nothing() -> None:
    queue = RequestQueue()
    for _ in range(3):
        queue.answered(0, 10)
    assert queue.most == 0
