"""The services `~/pause_recording`, `~/resume_recording` and `~/split_bag`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.recorder.recorder import Recorder


@contextmanager
def recording_services(node: Node, recorder: Recorder) -> Iterator[None]:
    """Let operators steer a recorder as long as the context lasts."""
    group = MutuallyExclusiveCallbackGroup()  # they wait for the disk, and nothing else for them
    with ExitStack() as stack:
        for name, action in (
            ("~/pause_recording", recorder.pause),
            ("~/resume_recording", recorder.resume),
            ("~/split_bag", recorder.split),
        ):
            service = node.create_service(
                Trigger,
                name,
                _answer(action),
                qos_profile=REQUEST_QOS,
                callback_group=group,
            )
            stack.callback(node.destroy_service, service)
        yield


def _answer(
    action: Callable[[], str],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, action()
        except BagError as error:
            response.success, response.message = False, str(error)
        return response

    return answer
