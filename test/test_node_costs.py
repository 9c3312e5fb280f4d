"""What the node costs while nobody asks: processor time of its process, not of the clock."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from quick_capture import resting_capture
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.foreign import TFMessage

# Documented are 1 % idle and 3 % with states at 100 Hz; a slow or busy machine may need three times
# as much.
IDLE, WITH_STATES = 0.03, 0.09
pytestmark = pytest.mark.ci
SECONDS = 5  # diagnostics come once a second of the steady clock
RATE = 100.0  # [Hz]


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    directory: Path = tmp_path_factory.mktemp("costs")
    with private_domain(), running_planner(directory) as planner:
        yield planner


def processor_time(planner: PlannerProcess) -> float:
    """Return what the process has used [s]."""
    fields = Path(f"/proc/{planner.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_seconds(client: Client, heard: list[Any], seconds: int) -> None:
    """Wait until the node has published diagnostics so many times more."""
    before = len(heard)
    client.wait_until(lambda: len(heard) >= before + seconds, "diagnostics")


def ignore(client: Client, topic: str) -> None:
    """Hear a topic no more."""
    for one in list(client.node.subscriptions):
        if one.topic_name == topic:
            client.node.destroy_subscription(one)


@pytest.mark.nightly
@pytest.mark.law("NODE-18")
def test_the_node_costs_little_idle_and_with_states_at_a_hundred_hertz(
    planner: PlannerProcess,
) -> None:
    scene = Scene(resting_capture())
    with connected_client() as client:
        heard = client.hear(DiagnosticArray, "/diagnostics")
        client.wait_for_planner()
        client.wait_for_an_answer()
        wait_seconds(client, heard, 2)
        before = processor_time(planner)
        wait_seconds(client, heard, SECONDS)
        assert processor_time(planner) - before <= IDLE * SECONDS

        def publish() -> None:
            client.publish_state(scene.state(client.now_ns()))

        timer = client.node.create_timer(1.0 / RATE, publish)
        wait_seconds(client, heard, 1)
        before = processor_time(planner)
        wait_seconds(client, heard, SECONDS)
        assert processor_time(planner) - before <= WITH_STATES * SECONDS
        client.node.destroy_timer(timer)


@pytest.mark.usefixtures("planner")
def test_the_preview_stops_when_nobody_sees_it_and_goes_on_for_who_comes_later() -> None:
    scene = Scene(resting_capture())
    with connected_client() as client:
        heard, frames = client.hear(DiagnosticArray, "/diagnostics"), client.hear(TFMessage, "/tf")
        ignore(client, "/markers")
        client.wait_for_planner()

        def previewed() -> int:
            return sum(
                one.child_frame_id.startswith("preview/")
                for message in list(frames)
                for one in message.transforms
            )

        def new_in_two_seconds() -> int:
            before = previewed()
            wait_seconds(client, heard, 2)
            return previewed() - before

        answer = client.plan(scene.complete_request())
        assert answer.status.code == Status.SOLVED, answer.status
        client.wait_until(previewed, "the preview")
        # It is played once, which takes longer than the plan where the machine is busy.
        waits = range(int(DEADLINE) // 2)
        assert any(new_in_two_seconds() == 0 for _ in waits), "the preview goes on"
        before = previewed()
        client.hear(MarkerArray, "markers")  # as RViz does, which draws the frames
        client.wait_until(lambda: previewed() > before + 50, "the frames of the preview")
        ignore(client, "/markers")
        states = client.hear(JointState, "planned_joint_states")
        client.wait_until(lambda: len(states) > 20, "the preview")


COUNTED = """
import gc
import sys

from ff_planner_ros.ros import node


def wait(_):
    print(gc.get_freeze_count(), len(gc.get_objects()))


node.StopRequest.wait = wait
sys.exit(node.main(sys.argv[1:]))
"""


def test_a_full_garbage_collection_looks_at_next_to_nothing(tmp_path: Path) -> None:
    """What is loaded stays: to look at it took up to half a second, in which no request is read."""
    with private_domain():
        command = [sys.executable, "-c", COUNTED, "--ros-args", "-p", f"bag.directory:={tmp_path}"]
        done = subprocess.run(
            command, capture_output=True, cwd=tmp_path, text=True, timeout=120, check=True
        )
    kept, looked_at = (int(word) for word in done.stdout.split()[-2:])
    assert kept > 50_000
    assert looked_at < 5_000
