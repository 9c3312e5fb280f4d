"""A testbed in software: a chaser with its arm that drifts, tumbles and follows trajectories.

    .venv/bin/python examples/simulated_testbed.py config/scenarios/lemur_capture.yaml

publishes `chaser_state` and the scenario's `obstacles`, and follows the trajectories on
`arm_controller/joint_trajectory` in real time; `--help` lists noise and delays. It waits for its
first plan, in the state from which a plan requested now begins near the scenario's start, and
begins to drift when the planner receives a request. Replace it by your hardware: those three topics
are all there is. A scenario that captures a body has `target_body`, too; if phases follow, the end
effector grasps the body.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.demo.testbed import Imperfections, SimulatedTestbed
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import default_values, load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.whole import captured_bodies
from ff_planner_ros.ros.process import StopRequest, joining_ros, spin_in_background

MEANING = {
    "position_noise": "of the measured position, standard deviation [m]",
    "angle_noise": "of the measured attitude and joint angles [rad]",
    "velocity_noise": "of the measured velocity [m/s]",
    "rate_noise": "of the measured angular velocity and joint rates [rad/s]",
    "state_delay": "from measuring to publishing [s]",
    "command_delay": "by which the joints are behind a trajectory [s]",
    "rate_bias": "of the measured angular velocity of the chaser about each axis [rad/s]",
    "arm_heavier": "masses and inertias of the arm beyond the model's, as a part of these",
    "seed": "of the noise",
}


def main() -> int:
    """Run until SIGINT or SIGTERM."""
    options = _options()
    stop = StopRequest()
    try:
        task = load_task(options.scenario, Defaults(load_parameters().planner))
        with joining_ros():
            rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node("simulated_testbed")
    except FfPlannerError as error:
        print(f"simulated_testbed: {error}", file=sys.stderr)
        return 2
    epoch_ns = None if options.epoch is None else options.epoch * NANOSECONDS
    # Every noise and delay is an option of the same name.
    imperfections = Imperfections(
        **{i.name: getattr(options, i.name) for i in fields(Imperfections)}
    )
    lead = default_values()["planning_lead_time"]
    body = next(filter(None, captured_bodies(task)), None)
    SimulatedTestbed(node, task.problem, body, epoch_ns, options.rate, imperfections, lead)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    leave = spin_in_background(executor, node.get_logger())
    stop.wait()
    leave()
    rclpy.shutdown()
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", type=Path, metavar="SCENARIO")
    parser.add_argument("--rate", type=float, default=50.0, help="of chaser_state [Hz]")
    parser.add_argument(
        "--epoch",
        type=int,
        metavar="SECONDS",
        help="ROS time at which the chaser passes through the scenario's start (default: it waits "
        "for its first plan, which begins there)",
    )
    for item in fields(Imperfections):
        name = f"--{item.name.replace('_', '-')}"
        parser.add_argument(
            name, type=type(item.default), default=item.default, help=MEANING[item.name]
        )
    # What follows --ros-args is for ROS, anything else that is not known a slip of the pen.
    return parser.parse_args(remove_ros_args(sys.argv)[1:])


if __name__ == "__main__":
    sys.exit(main())
