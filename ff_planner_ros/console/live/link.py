"""The console's connection to a node: its parameters, robot, inputs, events and services."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import PlanEvent, PublishedPlan
from rclpy.parameter import Parameter
from std_msgs.msg import String

from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters
from ff_planner_ros.parameters.values import parameters_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.client import PlannerClient
from ff_planner_ros.ros.inputs.locked_joints import measured_robot
from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan as RunningPlan
from ff_planner_ros.ros.requests.reading import Knowledge
from ff_planner_ros.ros.topics import (
    DIAGNOSTICS,
    PLAN_EVENTS,
    PUBLISHED_PLAN,
    ROBOT_DESCRIPTION,
)

_SIMULATED = "use_sim_time"
# The node is lost if it has missed so many of its diagnostics, and some time more [s].
_MISSED, _MORE = 2.0, 1.0
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
        namespace = self.name.rpartition("/")[0] or None
        self.client = PlannerClient(
            f"ff_planner_console_{os.getpid()}", ros_arguments, self.name, namespace
        )
        self.node, self.now_ns = self.client.node, self.client.now_ns
        self.client.hear(ROBOT_DESCRIPTION, self._described)
        self.client.hear(DIAGNOSTICS, self._diagnosed)
        try:
            self.parameters, self.robot = self._learn(patience)
        except BaseException:
            self.client.close()
            raise
        now = self.parameters
        self._middleware = Middleware(self.node, now.allow_several_publishers)
        self._states = StateInput(self.robot, now, self._middleware)
        self._scenes = SceneInput(now.inertial_frame, self._middleware)
        self._robots = measured_robot(now.robot, self.robot, self._with_locked)
        self.client.hear(PLAN_EVENTS, self.happened.put)
        self.client.hear(PUBLISHED_PLAN, self.happened.put)

    def close(self) -> None:
        """Leave ROS."""
        self._middleware.close()
        self.client.close()

    @property
    def knowledge(self) -> Knowledge:
        """What the node knows now, as far as the console hears the same topics."""
        heard = self._states, self._scenes, self.published, self.now_ns()
        return Knowledge(self.robot, self.parameters, *heard, robots=self._robots)

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
        status = self.client.publish(plan_id, REQUESTER, reject)
        return Status(status.code), status.message

    def _learn(self, patience: float) -> tuple[NodeParameters, Robot]:
        """Read parameters and robot."""
        deadline = time.monotonic() + patience
        parameters = self._parameters(patience)
        while not self._urdf:
            if time.monotonic() > deadline:
                allowed = f"its robot was not heard within {patience:g} s: is it active?"
                raise InvalidInput(Status.NOT_ACTIVE, "--node", self.name, allowed)
            time.sleep(_POLL)
        urdf = resolve_uri(parameters.robot.urdf, relative_to=Path.cwd())
        # Meshes are read where the URDF is on this machine, too.
        directory = urdf.parent if urdf.is_file() else None
        robot = parameters.robot.load(self._urdf, directory)
        self._with_locked = partial(parameters.robot.load, self._urdf, directory)
        self._heard = time.monotonic()
        return parameters, robot

    def _parameters(self, patience: float) -> NodeParameters:
        names = [*DECLARATIONS, _SIMULATED]
        values = self.client.parameters(self.name, names, patience)
        simulated = Parameter(_SIMULATED, value=bool(values.pop(_SIMULATED)))
        self.node.set_parameters([simulated])
        return parameters_of(values)

    def _described(self, message: String) -> None:
        self._urdf = message.data
        self._changed.set()  # the node has been activated, perhaps with other parameters

    def _diagnosed(self, message: DiagnosticArray) -> None:
        parts = [one for one in message.status if one.name.startswith(f"{self.name}: ")]
        if not parts:
            return
        self._heard = time.monotonic()
        self._warnings = {
            one.name.removeprefix(f"{self.name}: "): one.message
            for one in parts
            if one.level != b"\0"
        }
