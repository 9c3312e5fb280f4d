"""The process of the node `ff_planner`: signals, threads and a clean end."""

from __future__ import annotations

import gc
import sys
from contextlib import closing

import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.background import StopRequest, spin_in_background
from ff_planner_ros.ros.joining import joining_ros, security_gap
from ff_planner_ros.ros.parameter_files import not_taken
from ff_planner_ros.ros.planner_node import PlannerNode
from ff_planner_ros.ros.requests.worker import Worker

# One plans, one waits for it to make room, one cancels, one streams, one tells how the node is, one
# draws a plan, one publishes a plan that waited, one waits for the bag's disk.
_THREADS = 8


def main(arguments: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, with ROS arguments; None: those of the process.

    Returns:
        Exit code: 0 stopped by a signal, 2 refused to start.
    """
    stop = StopRequest()
    try:
        with joining_ros():
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        return _run(stop, sys.argv if arguments is None else arguments)
    except FfPlannerError as error:
        print(f"planner_node: {error}", file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()


def _run(stop: StopRequest, arguments: list[str]) -> int:
    with closing(Worker()) as worker:
        with joining_ros():
            node = PlannerNode(worker)
        if gap := security_gap():
            node.get_logger().warning(gap)
        for words in not_taken(arguments, node.get_fully_qualified_name()):
            node.get_logger().warning(in_log(words))
        executor = MultiThreadedExecutor(num_threads=_THREADS)
        executor.add_node(node)
        try:
            if node.parameters.current.autostart and not _started(node):
                return 2
            # A full collection looks at all that is loaded, which stays to the end: half a second
            # on a busy machine, in which no request is read.
            gc.collect()
            gc.freeze()
            stop_spinning = spin_in_background(executor, node.get_logger())
            stop.wait()
            # The request in progress is answered, and the answer recorded.
            node.stop_planning(Status.SHUT_DOWN, "the planner was shut down")
            stop_spinning()
        finally:
            node.close()
    return 0


def _started(node: PlannerNode) -> bool:
    """Configure and activate; whether that worked, the node says if not."""
    node.trigger_configure()
    if node.refusal is None:
        node.trigger_activate()
    return node.refusal is None


if __name__ == "__main__":
    sys.exit(main())
