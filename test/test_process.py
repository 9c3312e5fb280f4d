"""Callbacks in a thread of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import partial
from typing import Any
from unittest.mock import Mock, patch

import pytest
import rclpy
from ff_planner_msgs.action import PlanTrajectory
from rclpy.action import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future as RosFuture
from ros_processes import DEADLINE, private_domain
from std_msgs.msg import String

from ff_planner_ros.ros.process import CallbackExecutor, ask, spin_in_background

# The signal comes in the other thread, as the main one blocks it.
WAITING = """
import signal, threading
from ff_planner_ros.ros.process import StopRequest
stop = StopRequest()
threading.Thread(target=threading.Event().wait, daemon=True).start()
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
print(stop.is_set(), flush=True)
stop.wait()
print(stop.is_set())
"""

# By default as many threads as cores, and with one a warning.
EXECUTORS = pytest.mark.parametrize(
    "new_executor", [SingleThreadedExecutor, partial(CallbackExecutor, num_threads=2)]
)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_waiting_whatever_thread_it_comes_in(number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"False\n"
        process.send_signal(number)
        try:
            said, _ = process.communicate(timeout=DEADLINE)
        finally:
            process.kill()
    assert said == b"True\n"
    assert process.returncode == 0


@EXECUTORS
def test_a_callback_that_raises_is_logged_and_the_others_go_on(new_executor: Any) -> None:
    failures, others_go_on = [], threading.Event()

    def fail() -> None:
        failures.append(None)
        raise ValueError("the callback's fault")

    def go_on() -> None:
        if len(failures) >= 3:
            others_go_on.set()

    with private_domain():
        rclpy.init(args=[])
        node, logger, executor = rclpy.create_node("test"), Mock(), new_executor()
        node.create_timer(0.001, fail)
        node.create_timer(0.001, go_on)
        executor.add_node(node)
        stop = spin_in_background(executor, logger)
        assert others_go_on.wait(DEADLINE)
        stop()
        rclpy.shutdown()
    assert "the callback's fault" in logger.error.call_args_list[0].args[0]


@EXECUTORS
def test_stopping_waits_for_the_callback_that_has_begun(new_executor: Any) -> None:
    begun, may_end, stopping, events = (*(threading.Event() for _ in range(3)), [])

    def callback() -> None:
        if not begun.is_set():
            begun.set()
            may_end.wait(DEADLINE)
            events.append("the callback's end")

    with private_domain():
        rclpy.init(args=[])
        node, executor = rclpy.create_node("test"), new_executor()
        node.create_timer(0.001, callback)
        executor.add_node(node)
        stop = spin_in_background(executor, Mock())
        assert begun.wait(DEADLINE)

        def stop_and_tell() -> None:
            stopping.set()
            stop()
            events.append("stopped")

        stopper = threading.Thread(target=stop_and_tell)
        stopper.start()
        assert stopping.wait(DEADLINE)
        may_end.set()
        stopper.join(DEADLINE)
        rclpy.shutdown()
    assert events == ["the callback's end", "stopped"]


def _an_action_server(node: Node) -> Callable[[], None]:
    return _action_server(node).destroy


def _action_server(node: Node) -> ActionServer:
    return ActionServer(node, PlanTrajectory, "an_action", Mock())


def _a_subscription(node: Node) -> Callable[[], object]:
    """Its event of another quality of service is waited for like an action server."""
    return partial(
        node.destroy_subscription,
        node.create_subscription(String, "a_topic", Mock(), 1),
    )


@pytest.mark.parametrize("create", [_an_action_server, _a_subscription])
def test_what_is_destroyed_while_the_executor_lists_it_is_left_out(
    create: Callable[[Node], Callable[[], object]],
) -> None:
    """As when another thread does that: the executor has listed it, and has not locked it yet."""
    destroyed, goes_on = threading.Event(), threading.Event()
    with private_domain():
        rclpy.init(args=[])
        node, logger = rclpy.create_node("test"), Mock()
        _a_subscription(node)
        listed_first = next(iter(node.waitables))
        destroy, count = create(node), listed_first.get_num_entities

        def destroy_the_next() -> Any:
            if not destroyed.is_set():
                destroyed.set()
                destroy()
            return count()

        node.create_timer(0.001, lambda: goes_on.set() if destroyed.is_set() else None)
        executor = CallbackExecutor(num_threads=2)
        executor.add_node(node)
        with patch.object(listed_first, "get_num_entities", destroy_the_next):
            stop = spin_in_background(executor, logger)
            goes_on.wait(DEADLINE)
            stop()
        rclpy.shutdown()
    assert goes_on.is_set()
    logger.error.assert_not_called()


def test_an_executor_that_cannot_wait_says_so() -> None:
    """Nobody destroyed what it cannot wait for: it fails whenever it looks."""
    told, logger = threading.Event(), Mock()
    logger.error.side_effect = lambda _: told.set()
    with private_domain():
        rclpy.init(args=[])
        node = rclpy.create_node("test")
        _action_server(node)._handle.destroy_when_not_in_use()
        executor = CallbackExecutor(num_threads=2)
        executor.add_node(node)
        stop = spin_in_background(executor, logger)
        told.wait(DEADLINE)
        stop()
        rclpy.shutdown()
    assert "action server pointer is invalid" in logger.error.call_args_list[0].args[0]


def test_a_question_is_asked_in_the_thread_that_takes_the_answers() -> None:
    """From another one, its answer might come before rclpy knows of the question."""
    asked_in, received = [], RosFuture()

    def question() -> RosFuture:
        asked_in.append(threading.current_thread())
        received.set_result("the answer")
        return received

    def refuse() -> RosFuture:
        raise TypeError("no goal")

    def fail() -> RosFuture:
        failed = RosFuture()
        failed.set_exception(ValueError("no answer"))
        return failed

    with private_domain():
        rclpy.init(args=[])
        executor = SingleThreadedExecutor()
        executor.add_node(rclpy.create_node("test"))
        stop = spin_in_background(executor, Mock())
        assert ask(executor, question).result(DEADLINE) == "the answer"
        for broken, error in ((refuse, TypeError), (fail, ValueError)):
            with pytest.raises(error):
                ask(executor, broken).result(DEADLINE)
        stop()
        rclpy.shutdown()
    assert [thread.name for thread in asked_in] == ["callbacks"]
