"""Exchanges of a node: what is asked and answered, in order, with all that a replay needs."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest
import rclpy
from ff_planner_msgs.msg import Exchange, PlanAnswer, PlanRequest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_processes import DEADLINE, FRAME, private_domain
from std_msgs.msg import String

from ff_planner_ros.bag.provenance import versions
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.task_json import task_from_json, urdf_digest
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.outputs import exchanges as module
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.process import spin_in_background
from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.topics import EXCHANGES, ROBOT_MODEL

SETTINGS = load_parameters().planner


@contextmanager
def a_node() -> Iterator[tuple[Node, Any]]:
    """A node, and a function that waits for so many messages of a topic from its begin on."""
    with private_domain():
        rclpy.init(args=[])
        node, came = rclpy.create_node("planner"), threading.Condition()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        stop = spin_in_background(executor, node.get_logger())

        def heard(message_type: type, topic: str, count: int) -> list[Any]:
            found = list[Any]()

            def keep(message: Any) -> None:
                with came:
                    found.append(message)
                    came.notify()

            qos = qos_profile(ROBOT_MODEL if message_type is String else EXCHANGES)
            node.create_subscription(message_type, topic, keep, qos)
            with came:
                assert came.wait_for(lambda: len(found) >= count, DEADLINE)
            return found

        try:
            yield node, heard
        finally:
            stop()
            rclpy.shutdown()


def test_who_comes_late_hears_the_last_exchanges_in_their_order_and_the_robots_model(
    lemur_capture: PlanningProblem,
) -> None:
    urdf, task = lemur_capture.robot.drawn_urdf, PlanningTask(lemur_capture, SETTINGS)
    asked = "run.1", Interface.ACTION, "tester"
    request, answer = PlanRequest(duration=2.0), PlanAnswer(plan_id="run.1")
    with a_node() as (node, heard), closing(Exchanges(node, urdf, FRAME)) as exchanges:
        exchanges.tell(Event.RECEIVED, *asked, request=request)
        exchanges.tell(Event.ANSWERED, *asked, request=request, task=task, answer=answer)
        exchanges.tell(Event.DROPPED, "run.0", Interface.PUBLISH_PLAN, "")
        first, second, third = heard(Exchange, "exchanges", 3)
        (model,) = heard(String, "robot_model", 1)
    assert (first.plan_id, first.interface, first.requester, first.event) == (*asked, "received")
    assert (second.event, third.event, third.plan_id) == ("answered", "dropped", "run.0")
    assert first.header.frame_id == FRAME
    assert [list(one.request) for one in (first, second, third)] == [[request], [request], []]
    assert [list(one.answer) for one in (first, second, third)] == [[], [answer], []]
    assert json.loads(first.versions) == versions()
    assert (first.task, third.task, model.data) == ("", "", urdf)
    read = task_from_json(second.task, {urdf_digest(model.data): model.data})
    assert read.digest == task.digest


def test_a_task_is_written_beside_the_planner_and_what_waits_goes_out_before_the_end(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, writes = threading.Event(), list[str]()

    def written(*_: object) -> str:
        assert told.wait(DEADLINE)  # which comes only if nobody waits for this
        writes.append(threading.current_thread().name)
        return "a task"

    monkeypatch.setattr(module, "task_json", written)
    with a_node() as (node, _):
        exchanges, sent = Exchanges(node, "", FRAME), list[str]()
        monkeypatch.setattr(exchanges._publisher, "publish", lambda one: sent.append(one.task))
        for number in range(3):
            asked = f"run.{number}", Interface.SERVICE, "tester"
            exchanges.tell(Event.ANSWERED, *asked, task=PlanningTask(lemur_capture, SETTINGS))
        told.set()
        exchanges.close()
    assert sent == ["a task"] * 3
    assert writes == ["exchanges"] * 3


def test_an_exchange_whose_task_cannot_be_written_goes_out_all_the_same(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> str:
        raise ValueError("not in a scenario")

    monkeypatch.setattr(module, "task_json", refuse)
    asked = "run.1", Interface.SERVICE, "tester"
    with a_node() as (node, heard), closing(Exchanges(node, "", FRAME)) as exchanges:
        exchanges.tell(Event.ANSWERED, *asked, task=PlanningTask(lemur_capture, SETTINGS))
        exchanges.tell(Event.RECEIVED, *asked)
        first, second = heard(Exchange, "exchanges", 2)
    assert (first.task, second.event) == ("", "received")
