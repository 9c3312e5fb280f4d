"""Publishes what is asked of the planner, and what became of it, for bags and other listeners."""

from __future__ import annotations

import json
import threading
import traceback
from queue import SimpleQueue

from ff_planner_msgs.msg import Exchange, PlanAnswer, PlanRequest
from rclpy.node import Node
from std_msgs.msg import Header, String

from ff_planner_ros.bag.provenance import versions
from ff_planner_ros.common.shown import in_log
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.ros.messages.interfaces import EXCHANGES, ROBOT_MODEL
from ff_planner_ros.ros.qos import EXCHANGES_QOS, LATCHED_QOS


class Exchanges:
    """Publishes exchanges in their order, from a thread of its own: no plan waits for that."""

    def __init__(self, node: Node, urdf: str, inertial_frame: str) -> None:
        """Publish the robot's model, and exchanges from now on, whether the node is active or not.

        Args:
            urdf: `Robot.drawn_urdf`, which tasks name by its digest.
        """
        self._node, self._urdf, self._frame = node, urdf, inertial_frame
        self._versions = json.dumps(versions())
        self._model = node.create_publisher(String, ROBOT_MODEL, LATCHED_QOS)
        self._model.publish(String(data=urdf))
        self._publisher = node.create_publisher(Exchange, EXCHANGES, EXCHANGES_QOS)
        self._waiting = SimpleQueue[tuple[Exchange, PlanningTask | None] | None]()
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
        self._waiting.put((told, task))

    def close(self) -> None:
        """Publish what waits, then remove the publishers."""
        self._waiting.put(None)
        self._thread.join()
        for publisher in (self._publisher, self._model):
            self._node.destroy_publisher(publisher)

    def _run(self) -> None:
        while (waiting := self._waiting.get()) is not None:
            told, task = waiting
            try:
                told.task = "" if task is None else task_json(task, self._urdf)
            except Exception:  # of a plug-in's requirement, say; the exchange counts all the same
                why = in_log(traceback.format_exc())
                self._node.get_logger().error(f"{told.plan_id}: no task for a replay\n{why}")
            self._publisher.publish(told)
