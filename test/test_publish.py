"""A bag played into ROS: another process hears the recorded bytes, in order, with their QoS."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_processes import DEADLINE, Scene, connected_client, private_domain, running_planner
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.runs import publish

STATES, SCENE, LOG = "/robot/chaser_state", "/robot/obstacles", "/said"
RELIABLE = QualityOfService(depth=50, reliability="reliable", durability="volatile")
LATCHED = QualityOfService(depth=1, reliability="reliable", durability="transient_local")
BEST_EFFORT = QualityOfService(depth=5, reliability="best_effort", durability="volatile")
EVERYTHING = ("--publish", "--rate", "1000", "--topics", "all")
GOLDEN = Path(__file__).parent / "golden_bags" / "node"
START, SECOND = 1_700_000_000_000_000_000, 1_000_000_000


@pytest.fixture(scope="module")
def recorded(
    lemur_capture: PlanningProblem, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, list[bytes]]]:
    """Forty states in two seconds, obstacles in the middle of them, and what the planner said."""
    scene, bag = Scene(lemur_capture), tmp_path_factory.mktemp("publish") / "bag"
    states = [encode(scene.state(START + i * SECOND // 20)) for i in range(40)]
    obstacles = encode(scene.obstacles())
    # What a foreign serialiser leaves at the end must come out as it is; DDS counts in words.
    states[7] = states[7] + bytes([7] * (4 + -len(states[7]) % 4))
    with BagWriter(bag, flush_interval=0.0) as writer:
        writer.add_topic(STATES, "ff_planner_msgs/msg/ChaserState", [RELIABLE])
        writer.add_topic(SCENE, "ff_planner_msgs/msg/ObstacleSphereArray", [LATCHED])
        writer.add_topic(LOG, "std_msgs/msg/String", [BEST_EFFORT])
        for i, cdr in enumerate(states):
            writer.write(STATES, cdr, START + i * SECOND // 20, START)
            if i == 20:
                writer.write(SCENE, obstacles, START + SECOND, START)
                writer.write(LOG, encode(String(data="ready")), START + SECOND, START)
    return bag, {STATES: states, SCENE: [obstacles], LOG: [encode(String(data="ready"))]}


class Listener:
    """Subscribes to raw bytes."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.heard: list[tuple[str, bytes]] = []
        self.clock: list[int] = []
        self._node = rclpy.create_node("listener")
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        for kind, topic, qos in (
            (ChaserState, STATES, QoSProfile(depth=100)),
            (ObstacleSphereArray, SCENE, latched),
            (String, LOG, best_effort),
        ):
            self._node.create_subscription(kind, topic, self._keeper(topic), qos, raw=True)
        self._node.create_subscription(Clock, "/clock", self._keep_time, 10)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def listen_until(self, process: subprocess.Popen[str], count: int) -> None:
        while process.poll() is None and len(self.heard) < count:
            self._executor.spin_once(timeout_sec=0.1)

    def listen_to_the_end(self) -> None:
        """Take what has arrived already."""
        before = -1
        while len(self.heard) > before:
            before = len(self.heard)
            self._executor.spin_once(timeout_sec=0.5)

    def qos(self, topic: str) -> tuple[str, str]:
        (endpoint,) = self._node.get_publishers_info_by_topic(topic)
        profile = endpoint.qos_profile
        return profile.reliability.name.lower(), profile.durability.name.lower()

    def close(self) -> None:
        rclpy.shutdown()

    def _keep_time(self, message: Clock) -> None:
        self.clock.append(nanoseconds(message.clock))

    def _keeper(self, topic: str) -> Any:
        return lambda message: self.heard.append((topic, bytes(message)))


@contextmanager
def playing(bag: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "ff_planner_ros.cli", "replay", str(bag), "--publish"]
    process = subprocess.Popen(
        [*command, *options], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_the_planners_inputs_are_heard_byte_by_byte_and_the_latched_ones_first(
    recorded: tuple[Path, dict[str, list[bytes]]],
) -> None:
    bag, wanted = recorded
    with (
        private_domain(),
        closing(Listener()) as listener,
        playing(bag, "--rate", "20", "--clock") as process,
    ):
        listener.listen_until(process, 41)
        listener.listen_to_the_end()
        printed, errors = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0, errors
    assert printed == "published 41 messages of 2 topics\n"
    heard = {topic: [cdr for of, cdr in listener.heard if of == topic] for topic in wanted}
    assert heard == {STATES: wanted[STATES], SCENE: wanted[SCENE], LOG: []}
    assert listener.clock == sorted(set(listener.clock))
    assert START <= listener.clock[0] < listener.clock[-1] <= START + 2 * SECOND
    assert SCENE in [topic for topic, _ in listener.heard[:20]]  # it was recorded after the 21st


def test_a_signal_ends_it_cleanly_in_the_middle(
    recorded: tuple[Path, dict[str, list[bytes]]],
) -> None:
    bag, wanted = recorded
    with (
        private_domain(),
        closing(Listener()) as listener,
        playing(bag, "--rate", "0.001", "--topics", "all") as process,
    ):
        listener.listen_until(process, 2)
        offered = [listener.qos(topic) for topic in wanted]
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, errors) == (0, "")
    assert re.fullmatch("published [2-9] messages of 3 topics\n", printed)  # of 42 in all
    assert offered == [
        (qos.reliability, qos.durability) for qos in (RELIABLE, LATCHED, BEST_EFFORT)
    ]
    # On a busy machine the first state may go out before the listener is found.
    assert {topic for topic, _ in listener.heard} == {SCENE, STATES}
    assert all(bytes_heard in wanted[topic] for topic, bytes_heard in listener.heard)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--publish", "--topics", "nothing"), "has no topic /nothing; it has /robot/chaser_state"),
        (("--publish", "--rate", "0"), "--rate is 0.0: it must be greater than 0"),
        (("--publish", "--set", "points=20"), "--set is points=20: a bag is published as it is"),
        (("--clock",), "--clock is True: it goes with --publish"),
    ],
)
def test_what_cannot_be_played_is_refused_by_name(
    recorded: tuple[Path, dict[str, list[bytes]]],
    options: tuple[str, ...],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with private_domain():
        assert main(["replay", str(recorded[0]), *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.ci
def test_a_live_planner_on_simulated_time_plans_from_what_is_played(
    recorded: tuple[Path, dict[str, list[bytes]]],
    lemur_capture: PlanningProblem,
    tmp_path: Path,
) -> None:
    arguments = ("-r", "__ns:=/robot", "-p", "use_sim_time:=true")
    with (
        private_domain(),
        running_planner(tmp_path, *arguments),
        connected_client("/robot") as client,
    ):
        client.wait_for_planner()
        with playing(recorded[0], "--clock", "--rate", "0.2"):
            answer = client.plan_until(
                Scene(lemur_capture).request(),
                lambda response: response.status.code == Status.SOLVED,
            )
    assert answer.inputs.state_source == "chaser_state"
    assert START <= nanoseconds(answer.inputs.state_stamp) < START + 2 * SECOND
    assert START <= nanoseconds(answer.inputs.received_stamp) < START + 2 * SECOND


def test_a_bag_of_types_that_are_not_installed_names_them_and_plays_the_others(
    recorded: tuple[Path, dict[str, list[bytes]]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "std_msgs.msg", None)  # as if it were not there
    monkeypatch.setattr(publish, "_DISCOVERY", 0.0)
    with private_domain():
        assert main(["replay", str(recorded[0]), *EVERYTHING]) == 0
        printed = capsys.readouterr()
        assert main(["replay", str(recorded[0]), "--publish", "--topics", LOG]) == 2
    assert "/said is left out: its type std_msgs/msg/String is not installed here" in printed.err
    assert printed.out == "published 41 messages of 2 topics\n"
    assert "no topic of it has a type that is installed" in capsys.readouterr().err


def test_every_type_that_the_node_records_is_found_by_its_name() -> None:
    with open_bag(GOLDEN) as bag:
        names = {topic.type_name for topic in bag.topics.values()}
    assert len(names) > 10
    for name in names:
        assert type_name(publish._message_type(name)) == name


@pytest.mark.parametrize("name", ["nobody_msgs/msg/Thing", "std_msgs/msg/Thing", "Thing", "", "//"])
def test_a_type_that_is_not_there_is_no_error(name: str) -> None:
    assert publish._message_type(name) is None
