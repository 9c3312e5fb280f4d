"""The node `ff_planner`: parameters, robot, recorder and service, from start to a clean end."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path

import rclpy
import yaml
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from ff_planner_msgs.srv import PlanTrajectory
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMsg
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.bag.writer import BagWriter, unique_directory
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.ros.background import spin_in_background
from ff_planner_ros.ros.parameters import NodeParameters, declare_parameters
from ff_planner_ros.ros.planning_service import (
    LATCHED_QOS,
    SERVICE_EVENT_QOS,
    STATE_QOS,
    STREAM_QOS,
    PlanningService,
)
from ff_planner_ros.ros.recorder import RecordedTopic, Recorder
from ff_planner_ros.ros.worker import Worker
from ff_planner_ros.share import resolve_uri


def main(arguments: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Args:
        arguments: Of the command line, ROS arguments included; None: those of the process.

    Returns:
        Exit code: 0 stopped by a signal, 2 refused to start.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        _initialise(arguments)
        _run(stop)
    except FfPlannerError as error:
        print(f"planner_node: {error}", file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
    return 0


def _initialise(arguments: list[str] | None) -> None:
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rclpy raises has no narrower public name
        raise InvalidInput(
            Status.OUT_OF_RANGE, "ROS arguments", "refused", str(error).splitlines()[0]
        ) from None


def _run(stop: threading.Event) -> None:
    with closing(Worker()) as worker:
        node = Node("ff_planner")
        parameters = declare_parameters(node)
        urdf = resolve_uri(parameters.robot.urdf, relative_to=Path.cwd())
        robot = load_robot(urdf, parameters.robot.base_link, parameters.robot.tip_link)
        bag_directory = unique_directory(Path(parameters.bag.directory).resolve(), "ff_planner")
        with _recording(node, parameters, urdf, bag_directory):
            PlanningService(node, parameters, robot, worker, run_name=bag_directory.name)
            with _spinning(node):
                node.get_logger().info(f"ready; recording to {bag_directory}")
                stop.wait()
                # The solver first: the request in progress is answered, the answer recorded.
                worker.close()


@contextmanager
def _recording(
    node: Node, parameters: NodeParameters, urdf: Path, bag_directory: Path
) -> Iterator[None]:
    """Record everything that the node hears and says, with what is needed to understand it."""
    service_event = f"{node.resolve_service_name('plan_trajectory')}/_service_event"
    topics = [
        RecordedTopic(node.resolve_topic_name(name), message_type, qos)
        for name, message_type, qos in (
            ("chaser_state", ChaserState, STATE_QOS),
            ("obstacles", ObstacleSphereArray, LATCHED_QOS),
            ("joint_trajectory", JointTrajectory, LATCHED_QOS),
            ("predicted_chaser_path", PathMsg, LATCHED_QOS),
            ("predicted_chaser_pose", PoseStamped, STREAM_QOS),
        )
    ]
    topics.append(RecordedTopic(service_event, PlanTrajectory.Event, SERVICE_EVENT_QOS))
    flush_interval = parameters.bag.flush_interval
    used = {"/**": {"ros__parameters": asdict(parameters)}}
    name = f"{node.get_name()}_recorder"
    with BagWriter(bag_directory, flush_interval) as bag:
        bag.attach("robot.urdf", "application/xml", urdf.read_bytes())
        bag.attach("parameters.yaml", "application/yaml", yaml.safe_dump(used).encode())
        with closing(Recorder(bag, topics, flush_interval, name, node.get_namespace())):
            yield


@contextmanager
def _spinning(node: Node) -> Iterator[None]:
    executor = MultiThreadedExecutor(num_threads=2)  # one plans, one listens
    executor.add_node(node)
    stop = spin_in_background(executor, node.get_logger())
    yield
    stop()


if __name__ == "__main__":
    sys.exit(main())
