"""The console's connection to a node: its parameters, robot, inputs, events and services."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import PlanEvent, PublishedPlan
from ff_planner_msgs.srv import PublishPlan
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters
from ff_planner_ros.parameters.values import parameters_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.background import ask, spin_in_background
from ff_planner_ros.ros.inputs.input_topics import heard_with
from ff_planner_ros.ros.inputs.listener import Listener
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.joining import joining_ros
from ff_planner_ros.ros.messages.interfaces import PUBLISH_PLAN
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan as RunningPlan
from ff_planner_ros.ros.qos import LATCHED_QOS, PLAN_EVENTS_QOS, STREAM_QOS, qos_profile
from ff_planner_ros.ros.requests.reading import Knowledge

_SIMULATED = "use_sim_time"
# The node is lost if it has missed so many of its diagnostics, and some time more [s].
_MISSED, _MORE = 2.0, 1.0
_RESTART = 1.5  # a node that was started again was silent for longer [s]
_ANSWER = 5.0  # longest wait for a service of a node that is there [s]
_POLL = 0.05  # [s]
REQUESTER = "ff-planner console"


class Link:
    """Subscribes to the topics of one planner node, and calls its services."""

    def __init__(self, name: str, patience: float, ros_arguments: Sequence[str]) -> None:
        """Join ROS, and read the node's parameters and robot.

        Args:
            name: Name of the node, with its namespace unless that is the root.
            patience: How long to wait for the node [s].

        Raises:
            InvalidInput: There is no such node, or it is not active.
            FfPlannerError: The node does not answer.
        """
        self.name = name if name.startswith("/") else f"/{name}"
        self.happened: SimpleQueue[PlanEvent | PublishedPlan] = SimpleQueue()
        self.published: RunningPlan | None = None  # the last plan, which the arm may be following
        self._heard = 0.0  # when, last of all, by the monotonic clock [s]
        self._warnings: dict[str, str] = {}
        self._changed = threading.Event()  # the node's parameters, perhaps
        self._urdf = ""
        self.other_robot = ""  # message if the node now plans for another robot
        with joining_ros():
            self._context = Context()
            rclpy.init(
                args=["ff-planner", *ros_arguments],
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self.node: Node = rclpy.create_node(
                f"ff_planner_console_{os.getpid()}",
                namespace=self.name.rpartition("/")[0] or None,
                context=self._context,
            )
        create = self.node.create_client
        self._values = create(GetParameters, f"{self.name}/get_parameters")
        self._publish = create(PublishPlan, PUBLISH_PLAN.replace("~", self.name))
        hear = self.node.create_subscription
        hear(String, "robot_description", self._described, LATCHED_QOS)
        hear(DiagnosticArray, "/diagnostics", self._diagnosed, STREAM_QOS)
        of_parameters = qos_profile_parameter_events
        hear(ParameterEvent, "/parameter_events", self._parameters_changed, of_parameters)
        self.executor = SingleThreadedExecutor(context=self._context)
        self.executor.add_node(self.node)
        self._stop = spin_in_background(self.executor, self.node.get_logger())
        try:
            self.parameters, self.robot = self._learn(time.monotonic() + patience, patience)
        except BaseException:
            self._leave()
            raise
        self._listener = Listener(self.node)
        heard = self.now_ns, Publishers(self.node, self.parameters.qos)
        self._states = StateInput(
            self.robot,
            self.parameters.inertial_frame,
            self.parameters.state_source,
            self.parameters.odometry,
            *heard,
        )
        self._scenes = SceneInput(self.parameters.inertial_frame, *heard)
        self._subscribe()

    def close(self) -> None:
        """Leave ROS."""
        self._listener.close()
        self._leave()

    def now_ns(self) -> int:
        """Return the time by the node's clock [ns]."""
        return int(self.node.get_clock().now().nanoseconds)

    @property
    def knowledge(self) -> Knowledge:
        """What the node knows now, as far as the console hears the same topics."""
        return Knowledge(
            self.robot, self.parameters, self._states, self._scenes, self.published, self.now_ns()
        )

    @property
    def lost(self) -> str:
        """Message if the node is not heard any more, else empty."""
        silent = time.monotonic() - self._heard
        if silent <= _MISSED / self.parameters.rates.diagnostics + _MORE:
            return ""
        return f"LOST: nothing was heard from {self.name} for {silent:.0f} s; waiting for it"

    @property
    def warnings(self) -> dict[str, str]:
        """Warnings and errors in the node's diagnostics, by part."""
        return dict(self._warnings)

    def look(self) -> None:
        """Read the parameters again if they may have changed.

        Raises:
            FfPlannerError: The node does not answer; the next call asks again.
        """
        if not self._changed.is_set() or self.lost:
            return
        self._changed.clear()
        robot = self.parameters.robot
        try:
            self.parameters = self._parameters(_ANSWER)
        except FfPlannerError:
            self._changed.set()
            raise
        if self.parameters.robot != robot:
            words = "the node plans for another robot by now: end this console and begin anew"
            self.other_robot = words

    def release(self, plan_id: str, reject: bool = False) -> tuple[Status, str]:
        """Ask the node to publish or drop a waiting plan; return its status and message.

        Raises:
            FfPlannerError: The node does not answer.
        """
        if lost := self.lost:
            raise FfPlannerError(Status.NOT_ACTIVE, lost)
        request = PublishPlan.Request(plan_id=plan_id, requester=REQUESTER, reject=reject)
        status = self._called(self._publish, request, _ANSWER).status
        return Status(status.code), status.message

    def _learn(self, deadline: float, patience: float) -> tuple[NodeParameters, Robot]:
        """Read parameters and robot."""
        while not (self._values.service_is_ready() and self._urdf):
            if time.monotonic() > deadline:
                domain = os.environ.get("ROS_DOMAIN_ID", "0")
                missing = "its robot" if self._values.service_is_ready() else "its parameters"
                allowed = (
                    f"{missing} was not heard within {patience:g} s: does the node run, active, in "
                    f"ROS domain {domain}?"
                )
                raise InvalidInput(Status.NOT_ACTIVE, "--node", self.name, allowed)
            time.sleep(_POLL)
        parameters = self._parameters(patience)
        urdf = resolve_uri(parameters.robot.urdf, relative_to=Path.cwd())
        # Meshes are read where the URDF is on this machine, too.
        directory = urdf.parent if urdf.is_file() else None
        robot = parameters.robot.load(self._urdf, directory)
        self._heard = time.monotonic()
        return parameters, robot

    def _parameters(self, patience: float) -> NodeParameters:
        names = [*DECLARATIONS, _SIMULATED]
        answer = self._called(self._values, GetParameters.Request(names=names), patience)
        values = dict(zip(names, map(_plain, answer.values), strict=True))
        simulated = Parameter(_SIMULATED, value=bool(values.pop(_SIMULATED)))
        self.node.set_parameters([simulated])
        return parameters_of(values)

    def _called(self, client: Any, request: Any, patience: float) -> Any:
        try:
            return ask(self.executor, lambda: client.call_async(request)).result(patience)
        except TimeoutError:
            words = f"{self.name} did not answer within {patience:g} s"
            raise FfPlannerError(Status.NOT_ACTIVE, words) from None

    def _subscribe(self) -> None:
        qos = self.parameters.qos
        keep = self._states.callbacks() | self._scenes.callbacks()
        for topic in heard_with(self.parameters.state_source):
            self._listener.add(
                topic.message_type,
                topic.name,
                keep[topic.name],
                qos_profile(getattr(qos, topic.name)),
            )
        self._listener.start()
        hear = self.node.create_subscription
        hear(PlanEvent, "plan_events", self.happened.put, PLAN_EVENTS_QOS)
        of_plans = qos_profile(qos.joint_trajectory)
        hear(PublishedPlan, "published_plan", self.happened.put, of_plans)

    def _leave(self) -> None:
        self._stop()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _described(self, message: String) -> None:
        self._urdf = message.data

    def _diagnosed(self, message: DiagnosticArray) -> None:
        parts = [one for one in message.status if one.name.startswith(f"{self.name}: ")]
        if not parts:
            return
        if self._heard and time.monotonic() - self._heard > _RESTART:
            self._changed.set()  # it may have been started again, with others
        self._heard = time.monotonic()
        self._warnings = {
            one.name.removeprefix(f"{self.name}: "): one.message
            for one in parts
            if one.level != b"\0"
        }

    def _parameters_changed(self, event: ParameterEvent) -> None:
        if event.node == self.name:
            self._changed.set()


def _plain(value: Any) -> Any:
    """Return a parameter's value as a parameters file has it."""
    plain = parameter_value_to_python(value)
    return plain if isinstance(plain, str | bool | int | float | None) else list(plain)
