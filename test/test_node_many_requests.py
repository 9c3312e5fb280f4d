"""As many requests as are documented may come at once, and every one is answered."""

from __future__ import annotations

import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanRequest
from ff_planner_msgs.srv import PlanTrajectory, PublishPlan
from quick_capture import resting_capture
from rclpy.qos import QoSProfile
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)
from std_srvs.srv import Trigger

from ff_planner_ros.errors import Status
from ff_planner_ros.ros.topics import SERVICE

# A client's answers wait in a queue of its own.
MOST_REQUESTS = SERVICE.qos.depth
QOS = QoSProfile(depth=MOST_REQUESTS)


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    directory: Path = tmp_path_factory.mktemp("many")
    with private_domain(), running_planner(directory) as planner:
        yield planner


@contextmanager
def frozen(planner: PlannerProcess) -> Iterator[None]:
    """Let what is sent meanwhile arrive at once."""
    planner.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        planner.process.send_signal(signal.SIGCONT)


def all_at_once(
    planner: PlannerProcess, client: Client, kind: type, name: str, request: Any, many: int
) -> list[Any]:
    """Send a request many times at once, and return every answer."""
    caller = client.node.create_client(kind, name, qos_profile=QOS)
    assert caller.wait_for_service(DEADLINE)
    answered, missing = threading.Event(), threading.Semaphore(0)

    def count(_: Any) -> None:
        missing.release()

    futures = []

    def send() -> None:
        for _ in range(many):
            futures.append(caller.call_async(request))
            futures[-1].add_done_callback(count)
        answered.set()

    with frozen(planner):
        client.executor.create_task(send)
        assert answered.wait(DEADLINE)
    for number in range(many):
        assert missing.acquire(timeout=DEADLINE), f"{many - number} of {many} got no answer"
    return [future.result() for future in futures]


@pytest.mark.ci
@pytest.mark.law("NODE-01")
def test_every_one_of_many_requests_at_once_is_answered(
    planner: PlannerProcess,
) -> None:
    many = MOST_REQUESTS
    request = Scene(resting_capture()).complete_request()
    request.search.points = 1000
    with connected_client() as client:
        client.wait_for_planner()
        client.wait_for_an_answer()
        asked = PlanTrajectory.Request(request=request)
        answers = all_at_once(planner, client, PlanTrajectory, "plan_trajectory", asked, many)
        codes = Counter(Status(one.answer.status.code) for one in answers)
        assert codes[Status.SOLVED] + codes[Status.TOO_LATE] >= 1
        assert codes[Status.BUSY] > many // 2
        assert len({one.answer.plan_id for one in answers}) == many
    assert "a callback failed" not in planner.log


@pytest.mark.nightly
@pytest.mark.law("NODE-01")
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (PublishPlan, "ff_planner/publish_plan"),
        (Trigger, "ff_planner/split_bag"),
    ],
)
def test_so_is_every_one_at_the_other_services(
    planner: PlannerProcess, kind: Any, name: str
) -> None:
    many = 100 if name.endswith("split_bag") else MOST_REQUESTS  # each of those makes a file
    with connected_client() as client:
        client.wait_for_planner()
        client.wait_for_an_answer()
        assert len(all_at_once(planner, client, kind, name, kind.Request(), many)) == many


@pytest.mark.law("NODE-01")
@pytest.mark.ci
def test_so_is_every_one_of_many_goals(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    many = times(50, 200)
    with connected_client() as client:
        client.wait_for_planner()
        client.wait_for_an_answer()
        request = PlanRequest(duration=-1.0)
        with frozen(planner):
            asked = [client.planner.ask(request) for _ in range(many)]
        assert all(one.sent.result(DEADLINE).accepted for one in asked)
        codes = Counter(one.answer().status.code for one in asked)
        assert codes[Status.NO_STATE]
        assert codes.keys() <= {Status.NO_STATE, Status.BUSY}
