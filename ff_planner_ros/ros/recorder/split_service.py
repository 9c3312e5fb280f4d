"""The service `~/split_bag`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.recorder.recorder import Recorder


@contextmanager
def split_service(node: Node, recorder: Recorder) -> Iterator[None]:
    """Let operators split a recorder's bag as long as the context lasts."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, recorder.split()
        except BagError as error:
            response.success, response.message = False, str(error)
        return response

    # It waits for the disk, and nothing else for it.
    group = MutuallyExclusiveCallbackGroup()
    service = node.create_service(
        Trigger, "~/split_bag", answer, qos_profile=REQUEST_QOS, callback_group=group
    )
    try:
        yield
    finally:
        node.destroy_service(service)
