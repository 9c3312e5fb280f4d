"""Publishes what is asked of the planner, and what became of it, for bags and other listeners."""

from __future__ import annotations

import json
import threading
import time
import traceback
from collections.abc import Callable
from queue import SimpleQueue

from ff_planner_msgs.msg import Exchange, PlanAnswer, PlanRequest
from rclpy.node import Node
from std_msgs.msg import Header, String

from ff_planner_ros.bag.provenance import versions
from ff_planner_ros.common.shown import in_log
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.ros.qos import create_publisher
from ff_planner_ros.ros.topics import EXCHANGES, ROBOT_MODEL

# By then an answer is sent, which needs the interpreter as much as its exchange does [s].
_AFTER_ANSWER = 0.01


class Exchanges:
    """A thread that publishes exchanges in order, and does what else no answer waits for."""

    def __init__(self, node: Node, urdf: str, inertial_frame: str) -> None:
        """Publish the robot's model, and exchanges from now on, whether the node is active or not.

        Args:
            urdf: `Robot.drawn_urdf`, which tasks name by its digest.
        """
        self._node, self._urdf, self._frame = node, urdf, inertial_frame
        self._versions = json.dumps(versions())
        self._model = create_publisher(node, ROBOT_MODEL)
        self._model.publish(String(data=urdf))
        self._publisher = create_publisher(node, EXCHANGES)
        self._waiting = SimpleQueue[Callable[[], object] | None]()
        self._thread = threading.Thread(target=self._run, name="exchanges", daemon=True)
        self._thread.start()

    def tell(
        self,
        event: Event,
        plan_id: str,
        interface: Interface,
        requester: str,
        *,
        request: PlanRequest | None = None,
        task: PlanningTask | None = None,
        answer: PlanAnswer | None = None,
    ) -> None:
        """Publish an exchange behind those before it; its messages must not change any more.

        Args:
            task: All that the answer depends on, efforts included; None: it is not complete.
        """
        stamp = self._node.get_clock().now().to_msg()
        told = Exchange(
            header=Header(stamp=stamp, frame_id=self._frame),
            plan_id=plan_id,
            interface=interface,
            requester=requester,
            event=event,
            request=[] if request is None else [request],
            versions=self._versions,
            answer=[] if answer is None else [answer],
        )
        self._waiting.put(lambda: self._publish(told, task))

    def afterwards(self, action: Callable[[], object]) -> None:
        """Do what no answer waits for, after what was told before."""
        self._waiting.put(action)

    def close(self) -> None:
        """Publish what waits, then remove the publishers."""
        self._waiting.put(None)
        self._thread.join()
        for one in (self._publisher, self._model):
            self._node.destroy_publisher(one)

    def _run(self) -> None:
        while (action := self._waiting.get()) is not None:
            if self._waiting.empty():
                time.sleep(_AFTER_ANSWER)
            try:
                action()
            except Exception:
                self._node.get_logger().error(in_log(traceback.format_exc()))

    def _publish(self, told: Exchange, task: PlanningTask | None) -> None:
        try:
            told.task = "" if task is None else task_json(task, self._urdf)
        except Exception:  # of a plug-in's requirement, say; the exchange counts all the same
            why = in_log(traceback.format_exc())
            self._node.get_logger().error(f"{told.plan_id}: no task for a replay\n{why}")
        self._publisher.publish(told)
