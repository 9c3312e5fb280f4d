"""A stand-in for the real chaser: publishes the start of a scenario, time and again."""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path

import rclpy
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import SCENARIO_FRAME, load_scenario
from ff_planner_ros.ros.background import spin_in_background
from ff_planner_ros.ros.planning_service import LATCHED_QOS, STATE_QOS
from ff_planner_ros.ros.to_messages import obstacles_message, state_message

STATE_RATE = 20.0  # [Hz]


def main() -> int:
    """Publish until SIGINT or SIGTERM; the argument is a scenario file."""
    scenario = load_scenario(Path(sys.argv[1]))
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node("mock_chaser")
    publish_scenario(node, scenario)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stop_publishing = spin_in_background(executor, node.get_logger())
    stop.wait()
    stop_publishing()
    rclpy.shutdown()
    return 0


def publish_scenario(node: Node, scenario: PlanningProblem) -> None:
    """Publish obstacles once, and the start state again and again as if measured just now.

    The chaser does not drift and follows no trajectory: every plan starts from the same state.

    Args:
        node: Publishes from a timer.
        scenario: Start state and obstacles.
    """
    obstacles = node.create_publisher(ObstacleSphereArray, "obstacles", LATCHED_QOS)
    states = node.create_publisher(ChaserState, "chaser_state", STATE_QOS)
    clock, joint_names = node.get_clock(), scenario.robot.joint_names

    def publish_state() -> None:
        now_ns = clock.now().nanoseconds
        states.publish(state_message(scenario.start, joint_names, now_ns, SCENARIO_FRAME))

    now_ns = clock.now().nanoseconds
    obstacles.publish(obstacles_message(scenario.obstacles, now_ns, SCENARIO_FRAME))
    node.create_timer(1.0 / STATE_RATE, publish_state)


if __name__ == "__main__":
    sys.exit(main())
