"""The commands that run on ROS: demo, node."""

from __future__ import annotations

import argparse
import sys


def show_demo(options: argparse.Namespace) -> int:
    """Plan the paper's capture over ROS."""
    from ff_planner_ros.demo.run import run_demo

    return run_demo(options.output)


def run_node(options: argparse.Namespace) -> int:
    """Run the planner node."""
    from ff_planner_ros.ros.node import main as node_main

    return node_main([sys.argv[0], *options.rest])
