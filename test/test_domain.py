"""A ROS domain of one's own."""

from __future__ import annotations

import os
import subprocess
import sys

import rclpy
from ros_processes import DEADLINE

from ff_planner_ros.demo.domain import private_environment

PARTICIPANT = """
import rclpy
rclpy.init()
node = rclpy.create_node("neighbour")
print("ready", flush=True)
input()
"""


def test_the_domain_stays_on_this_host_and_is_none_that_a_neighbour_uses() -> None:
    environment = private_environment()
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert private_environment()["ROS_DOMAIN_ID"] == environment["ROS_DOMAIN_ID"]
    neighbour = subprocess.Popen(
        [sys.executable, "-c", PARTICIPANT],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with neighbour:
        assert neighbour.stdout is not None
        assert neighbour.stdout.readline() == b"ready\n"
        assert private_environment()["ROS_DOMAIN_ID"] != environment["ROS_DOMAIN_ID"]
        neighbour.communicate(b"\n", DEADLINE)


CLAIM = """
import os
from ff_planner_ros.demo.domain import private_environment
os.getpid = lambda: {pid}
print(private_environment()["ROS_DOMAIN_ID"], flush=True)
input()
"""


def test_two_processes_that_search_at_the_same_time_never_find_the_same_domain() -> None:
    """Though both begin at the same one, and neither of them talks yet."""
    own = private_environment()["ROS_DOMAIN_ID"]
    other = subprocess.Popen(
        [sys.executable, "-c", CLAIM.format(pid=os.getpid())],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with other:
        assert other.stdout is not None
        found = other.stdout.readline().decode().strip()
        other.communicate(b"\n", DEADLINE)
    assert found.isdecimal()
    assert found != own


def test_a_process_that_claimed_a_domain_ends_without_a_warning() -> None:
    claim = "from ff_planner_ros.demo.domain import private_environment; private_environment()"
    command = [sys.executable, "-W", "always::ResourceWarning", "-c", claim]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ended.stderr == ""


def test_the_domain_is_one_that_ros_accepts() -> None:
    environment = private_environment()
    assert 1 <= int(environment["ROS_DOMAIN_ID"]) <= 101
    assert set(os.environ) <= set(environment)
    rclpy.init(args=[], domain_id=int(environment["ROS_DOMAIN_ID"]))
    rclpy.shutdown()
