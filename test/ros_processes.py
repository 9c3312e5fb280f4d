"""Real planner processes, and a client that waits for conditions and never sleeps."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from ff_planner_msgs.msg import (
    ChaserState,
    Exchange,
    PlanAnswer,
    PlanProgress,
    PlanRequest,
    PlanStatus,
    PublishedPlan,
)
from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.srv import PlanTrajectory, PublishPlan
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMsg
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.highlevel import AnyReader
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.client import PlannerClient
from ff_planner_ros.ros.messages.to_messages import (
    request_message,
    scene_message,
    state_message,
)
from ff_planner_ros.ros.process import ask
from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.topics import SERVICE

FRAME = "inertial"
DEADLINE = 300.0  # [s] a condition that is not met by then on a busy machine never will be
PROBE_INTERVAL = 5.0  # [s] after which an answer is taken to be lost


ENDS_IN_MOTION = (
    *("-p", "end_behaviour:=none"),
    *("-p", "controller.allow_nonzero_velocity_at_trajectory_end:=true"),
)


class PlannerProcess:
    """A planner node in a process of its own; its bag and its log lie in a directory."""

    def __init__(self, directory: Path, *ros_arguments: str) -> None:
        self._log = directory / "node.log"
        self._bags = directory / "bags"
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "ff_planner_ros.ros.node", "--ros-args"),
                    *("-p", f"bag.directory:={self._bags}"),
                    # The paper's capture, of which the joints still move at the goal.
                    *("-p", "robot.geometry:=lines", *ENDS_IN_MOTION, *ros_arguments),
                ],
                cwd=directory,
                stderr=log,
            )

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def bag(self) -> Path:
        (directory,) = self._bags.iterdir()
        return directory

    @property
    def solvers(self) -> list[int]:
        """Numbers of the processes that make plans."""
        numbers = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                command = (entry / "cmdline").read_bytes()
            except OSError:  # ended meanwhile
                continue
            if parent == self.process.pid and b"ros.requests.solver_process" in command:
                numbers.append(int(entry.name))
        return numbers

    def send_to_solvers(self, number: signal.Signals) -> None:
        """Send a signal to every process that makes plans."""
        for process in self.solvers:
            with suppress(ProcessLookupError):
                os.kill(process, number)

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Ask the node to end and return its exit code."""
        self.process.send_signal(number)
        return self.process.wait(DEADLINE)


def wait_for(condition: Callable[[], Any], what: str) -> None:
    give_up = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < give_up, f"{what} did not happen"
        time.sleep(0.05)


class Client:
    """The world around the planner: publishes, asks, and keeps what it hears."""

    def __init__(self, namespace: str, planner: str) -> None:
        self._changed = threading.Condition()
        self.received: dict[str, list[Any]] = {}
        self._publish = f"{planner}/publish_plan"
        # The default context, in which the nodes of tests are.
        context = rclpy.utilities.get_default_context()
        self.planner = PlannerClient(
            "test_client", planner=planner, namespace=namespace, context=context
        )
        self.node, self.executor = self.planner.node, self.planner.executor
        self.now_ns = self.planner.now_ns
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self.node.create_publisher(ChaserState, "chaser_state", 100)
        self._obstacles = self.node.create_publisher(
            SceneMessage, "obstacles", QoSProfile(depth=1, durability=latched.durability)
        )
        for message_type, topic, qos in (
            (JointTrajectory, "joint_trajectory", latched),
            (PublishedPlan, "published_plan", latched),
            (PathMsg, "predicted_chaser_path", latched),
            (PoseStamped, "predicted_chaser_pose", QoSProfile(depth=100)),
            (Exchange, "exchanges", latched),
            (MarkerArray, "markers", latched),
        ):
            self.hear(message_type, topic, qos)
        # Tests ask many times at once: the middleware drops the oldest of more than ten answers.
        self._service = self.node.create_client(
            PlanTrajectory, "plan_trajectory", qos_profile=qos_profile(SERVICE)
        )
        # After the other services: see `wait_for_planner`.
        self._probe = self.node.create_client(GetParameters, f"{planner}/get_parameters")

    def close(self) -> None:
        self.planner.close()
        rclpy.utilities.get_default_context(shutting_down=True)  # the next one is new

    def hear(self, message_type: Any, topic: str, qos: QoSProfile | int = 100) -> list[Any]:
        """Subscribe to a topic, and return the list of what comes, which grows."""
        self.received[topic] = []
        self.node.create_subscription(message_type, topic, self._keeper(topic), qos)
        return self.received[topic]

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Call a service and wait for its response."""
        return self.planner.call(service_type, name, request, DEADLINE)

    def wait_until(self, condition: Callable[[], object], what: str) -> None:
        """Wait until something that is heard makes a condition true."""
        with self._changed:
            if not self._changed.wait_for(condition, DEADLINE):
                raise TimeoutError(f"{what} did not happen within {DEADLINE} s")

    def wait_for_planner(self) -> None:
        """Wait until the planner is there, and knows where its answers go.

        A service is available as soon as it hears the client. On a busy machine it may discover
        seconds later where the client listens, and an answer until then is lost
        (https://github.com/ros2/ros2/issues/1253). What a process offers and wants is told in
        order: once the last client has got an answer, the others will get theirs.
        """
        assert self._service.wait_for_service(DEADLINE), "no planner appeared"
        give_up = time.monotonic() + DEADLINE
        while time.monotonic() < give_up:
            with suppress(TimeoutError):
                probe = partial(self._probe.call_async, GetParameters.Request())
                ask(self.executor, probe).result(PROBE_INTERVAL)
                return
        raise TimeoutError("the planner did not answer")

    def wait_for_an_answer(self) -> None:
        """Wait until the planner answers: on a busy machine seconds after it appeared."""
        self.plan(PlanRequest())  # refused

    def publish_state(self, message: ChaserState) -> None:
        self._states.publish(message)

    def publish_obstacles(self, message: SceneMessage) -> None:
        self._obstacles.publish(message)

    def publish_states_at(self, rate: float, messages: list[ChaserState]) -> None:
        """Publish messages one by one at a rate [Hz], and wait until all are out."""
        waiting = iter(messages)
        published = threading.Event()

        def publish_next() -> None:
            message = next(waiting, None)
            if message is None:
                published.set()
            else:
                self._states.publish(message)

        timer = self.node.create_timer(1.0 / rate, publish_next)
        assert published.wait(DEADLINE)
        self.node.destroy_timer(timer)

    def send(self, request: PlanRequest) -> Callable[[], PlanAnswer]:
        """Send a request and return a function that waits for the answer."""
        answered = threading.Event()
        future = self._service.call_async(PlanTrajectory.Request(request=request))
        future.add_done_callback(lambda _: answered.set())

        def answer() -> PlanAnswer:
            assert answered.wait(DEADLINE), "the planner did not answer"
            return _told(future.result().answer)

        return answer

    def send_goal(self, request: PlanRequest) -> Goal:
        """Send a goal, and wait until the planner has it."""
        goal = self.send_goal_at_once(request)
        assert goal.is_accepted
        return goal

    def send_goal_at_once(self, request: PlanRequest) -> Goal:
        """Send a goal without waiting for anything."""
        self.planner.wait_for_planner(DEADLINE)
        return Goal(self.planner, request)

    def plan(self, request: PlanRequest) -> PlanAnswer:
        return self.send(request)()

    def publish_plan(self, answer: PlanAnswer, **fields: Any) -> PlanStatus:
        """Ask for a plan that waits to be published, as its answer says unless a field is given."""
        request = PublishPlan.Request(**{"plan_id": answer.plan_id} | fields)
        return self.call(PublishPlan, self._publish, request).status

    def plan_until(
        self, request: PlanRequest, accepted: Callable[[PlanAnswer], bool]
    ) -> PlanAnswer:
        """Ask until the answer is accepted: what was published before may still be on its way."""
        give_up = time.monotonic() + DEADLINE
        while not accepted(answer := self.plan(request)):
            assert time.monotonic() < give_up, f"the last answer was {answer.status}"
        return answer

    def publish_and_wait(self, state: ChaserState) -> None:
        """Publish a first state until the planner has it, and obstacles, too."""
        still = (Status.NO_STATE, Status.NO_OBSTACLES)
        probe = PlanRequest()  # refused for its goal, which is looked at last

        def arrived(answer: PlanAnswer) -> bool:
            self._states.publish(state)
            return answer.status.code not in still

        self.plan_until(probe, arrived)

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            with self._changed:
                self.received[topic].append(message)
                self._changed.notify_all()

        return keep


def _told(answer: PlanAnswer) -> PlanAnswer:
    """An answer, which tells programs of its refusal if it is one, whatever it refuses."""
    status = answer.status
    said = [bool(one) for one in (status.field, status.value, status.allowed, status.retry)]
    assert all(said) if status.code else not any(said), status
    return answer


class Goal:
    """A goal of the planner's action."""

    def __init__(self, client: PlannerClient, request: PlanRequest) -> None:
        self.feedback: list[PlanProgress] = []
        self.progress = threading.Event()
        self._planning = client.ask(request, self._keep)

    @property
    def is_accepted(self) -> bool:
        """Whether the planner has accepted it, as it does with every goal."""
        return bool(self._planning.sent.result(DEADLINE).accepted)

    def cancel(self) -> bool:
        """Ask to cancel; whether the planner accepts."""
        return self._planning.cancel(DEADLINE)

    def result(self) -> tuple[int, PlanAnswer]:
        """Wait for the goal's final state (`action_msgs/GoalStatus`) and its answer."""
        give_up = time.monotonic() + DEADLINE

        def check() -> None:
            assert time.monotonic() < give_up, "the planner did not answer"

        answer = _told(self._planning.answer(check))
        return self._planning.goal_status, answer

    def _keep(self, progress: PlanProgress) -> None:
        self.feedback.append(progress)
        self.progress.set()


class Scene:
    """Messages of the paper's capture."""

    def __init__(self, problem: PlanningProblem) -> None:
        self.problem = problem

    def state(self, stamp_ns: int) -> ChaserState:
        names = self.problem.robot.joint_names
        return state_message(self.problem.start, names, stamp_ns, FRAME)

    def obstacles(self) -> SceneMessage:
        return scene_message(self.problem.obstacles, 0, FRAME)

    def request(self) -> PlanRequest:
        """Return a request that can be solved, starting from the topics."""
        return request_message(self.problem, FRAME)

    def complete_request(self) -> PlanRequest:
        """Return a request that can be solved and brings its own start state and scene."""
        request = self.request()
        request.start_state = [self.state(0)]
        request.scene = [self.obstacles()]
        return request


def read_bag(directory: Path) -> dict[str, list[Any]]:
    """Read every message of every topic, with the definitions that the bag itself carries."""
    with AnyReader([directory]) as reader:
        messages: dict[str, list[Any]] = {c.topic: [] for c in reader.connections}
        for connection, _, data in reader.messages():
            messages[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return messages


def answers_in(messages: Mapping[str, list[Any]]) -> list[Any]:
    """Return the answers to requests for plans among the messages of a bag, in their order."""
    return [
        exchange.answer[0]
        for exchange in messages["/exchanges"]
        if exchange.answer and exchange.request
    ]


@contextmanager
def private_domain(environment: dict[str, str] | None = None) -> Iterator[None]:
    """Keep the processes inside apart from whatever else runs on the host.

    Args:
        environment: Of a private domain that is entered again; None: a new one.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (environment or private_environment()).items():
            patch.setenv(name, value)
        # One heap for all threads: how much memory a process holds is then a matter of what it
        # keeps, not of which thread asked for it.
        patch.setenv("MALLOC_ARENA_MAX", "1")
        yield


@contextmanager
def running_planner(directory: Path, *ros_arguments: str) -> Iterator[PlannerProcess]:
    planner = PlannerProcess(directory, *ros_arguments)
    try:
        yield planner
    finally:
        planner.send_to_solvers(signal.SIGKILL)  # one may be frozen, and would stay for ever
        planner.process.kill()
        planner.process.wait()


@contextmanager
def connected_client(namespace: str = "", planner: str = "ff_planner") -> Iterator[Client]:
    client = Client(namespace, planner)
    try:
        yield client
    finally:
        client.close()
