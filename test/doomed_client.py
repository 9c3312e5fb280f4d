"""A process that asks the planner for a long plan and waits for it, until somebody kills it."""

from __future__ import annotations

import sys

from ff_planner_msgs.msg import PlanRequest
from quick_capture import resting_capture
from ros_processes import Client, Scene, connected_client

from ff_planner_ros.errors import Status

POINTS = 1200
LEAD = 120  # [s] before the plan begins


def main(door: str) -> None:
    with connected_client() as client:
        client.wait_for_planner()
        request = Scene(resting_capture()).complete_request()
        # Of least attitude, on so many points: seconds on any machine.
        request.objective.joint_path_length, request.objective.chaser_attitude = 0.0, 1.0
        request.search.points = POINTS
        request.start_time = client.node.get_clock().now().to_msg()
        request.start_time.sec += LEAD
        # BUSY with whoever wants to know whether this one is planned for.
        while _planned(client, door, request) == Status.BUSY:
            pass


def _planned(client: Client, door: str, request: PlanRequest) -> Status:
    answer = client.plan(request) if door == "service" else client.send_goal(request).result()[1]
    return Status(answer.status.code)


if __name__ == "__main__":
    main(sys.argv[1])
