"""A process that asks the planner for a long plan and waits for it, until somebody kills it."""

from __future__ import annotations

import sys

from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from quick_capture import resting_capture
from ros_processes import Client, Scene, connected_client

from ff_planner_ros.errors import Status

POINTS = 1200
LEAD = 120  # [s] before the plan begins


def main(door: str) -> None:
    with connected_client() as client:
        client.wait_for_planner()
        request = Scene(resting_capture()).complete_request()
        request.search.points = POINTS
        request.start_time = client.node.get_clock().now().to_msg()
        request.start_time.sec += LEAD
        code = Status.BUSY
        while code == Status.BUSY:  # with whoever wants to know whether this one is planned for
            answer = client.plan(request) if door == "service" else _result(client, request)
            code = answer.status.code


def _result(client: Client, request: PlanRequest) -> PlanAnswer:
    return client.send_goal(request).result()[1]


if __name__ == "__main__":
    main(sys.argv[1])
