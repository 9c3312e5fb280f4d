"""What a process on ROS needs: to join it, to spin in a thread, to ask, to end by signals."""

from __future__ import annotations

import os
import signal
import socket
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any

from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.task import Future as RosFuture

from ff_planner_ros.errors import InvalidInput, Status

# Of the environment; rcl takes exactly these values for a demand.
_ENABLE, _STRATEGY, _KEYSTORE = (
    f"ROS_SECURITY_{name}" for name in ("ENABLE", "STRATEGY", "KEYSTORE")
)
_DEMANDED, _ENFORCED = "true", "Enforce"
# So often the executor looks anew at what there is; a transition destroys a few entities at once.
_LOOKS = 100


@contextmanager
def joining_ros() -> Iterator[None]:
    """Turn rclpy's errors into `InvalidInput` while ROS is initialised or a first node created.

    Raises:
        InvalidInput: rclpy refuses the arguments, or security is enabled but not available.
    """
    try:
        with warnings.catch_warnings():
            # Of what rclpy cannot undo after it has failed.
            warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except RuntimeError as error:  # what rclpy raises has no narrower public name
        reason = str(error).splitlines()[0]
        if os.environ.get(_ENABLE) != _DEMANDED:
            raise InvalidInput(Status.OUT_OF_RANGE, "ROS arguments", "refused", reason) from None
        keystore = os.environ.get(_KEYSTORE) or "not set"
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            _ENABLE,
            _DEMANDED,
            f"security cannot be had: {reason}. It needs {_KEYSTORE} ({keystore}), an enclave in "
            "it, and a DDS with security, which the ROS wheels from PyPI do not have: see "
            "docs/how_to/security.md, or set it to false",
        ) from None


def security_gap() -> str:
    """Return a warning if ROS security is enabled but not enforced, else an empty string."""
    if os.environ.get(_ENABLE) == _DEMANDED and os.environ.get(_STRATEGY) != _ENFORCED:
        return (
            f"{_ENABLE} is true, but {_STRATEGY} is not {_ENFORCED}: without keys this node runs "
            "without security"
        )
    return ""


class StopRequest:
    """A flag that SIGINT and SIGTERM set; to be constructed in the main thread.

    The handlers raise nothing: an exception at an arbitrary line could be lost, or leave a child
    process without its owner.
    """

    def __init__(self) -> None:
        """Replace the handlers of both signals."""
        self._has_come = False
        # Python handles signals in the main thread, but wakes it up from a lock only if the system
        # has delivered the signal to it. A byte is written in whatever thread it comes.
        self._bytes, written = socket.socketpair()
        written.setblocking(False)
        signal.set_wakeup_fd(written.detach())
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, *_: object) -> None:
        self._has_come = True

    def is_set(self) -> bool:
        """Return whether one of the signals has arrived."""
        return self._has_come

    def check(self) -> None:
        """Do nothing until one of the signals has arrived.

        Raises:
            KeyboardInterrupt: One has.
        """
        if self._has_come:
            raise KeyboardInterrupt

    def wait(self) -> None:
        """Block the main thread until one of the signals arrives."""
        while not self._has_come:
            self._bytes.recv(1)


class CallbackExecutor(MultiThreadedExecutor):
    """rclpy's executor of several threads, for a node that destroys entities in its callbacks.

    rclpy 7.1 lists the entities, and then adds them to what it waits for: an action server or an
    event of a subscription that a callback destroys in between makes it raise.
    """

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """Return the next callback as rclpy does, of the entities that are left."""
        for _ in range(_LOOKS):
            with suppress(rclpy_implementation.RCLError, rclpy_implementation.InvalidHandle):
                return super().wait_for_ready_callbacks(*args, **kwargs)
        return super().wait_for_ready_callbacks(*args, **kwargs)


def spin_in_background(executor: Executor, logger: RcutilsLogger) -> Callable[[], None]:
    """Run an executor in a new thread.

    A callback that raises is logged and the others go on: rclpy would end the thread, and the
    node would be there but deaf.

    Returns:
        A function that shuts the executor down and waits until every callback that has begun is
        done, the answers of services sent included.
    """
    stopped = threading.Event()

    def spin() -> None:
        while executor.context.ok() and not stopped.is_set():
            try:
                executor.spin_once()
            except ExternalShutdownException:
                return
            except Exception:
                logger.error(f"a callback failed, the node goes on\n{traceback.format_exc()}")

    def stop() -> None:
        stopped.set()
        executor.create_task(lambda: None)  # wakes the thread
        thread.join()
        # In rclpy 7.1 `Executor.shutdown` says that it waits for the callbacks, and does not.
        pool = getattr(executor, "_executor", None)
        if isinstance(pool, ThreadPoolExecutor):
            pool.shutdown()
        executor.shutdown()

    thread = threading.Thread(target=spin, name="callbacks", daemon=True)
    thread.start()
    return stop


def ask(executor: SingleThreadedExecutor, call: Callable[[], RosFuture]) -> Future[Any]:
    """Call an action server in the thread that receives its responses.

    From any other thread rclpy 7.1 may lose a response: one that comes before the request has been
    noted is ignored as unexpected (https://github.com/ros2/rclpy/issues/1123).

    Args:
        executor: Executor of the action client's node, spinning in the background.
        call: Sends the request, for instance `handle.cancel_goal_async`.

    Returns:
        The response, to be waited for in any thread but the executor's.
    """
    answer: Future[Any] = Future()

    def pass_on(received: RosFuture) -> None:
        error = received.exception()
        if error is None:
            answer.set_result(received.result())
        else:
            answer.set_exception(error)

    def send() -> None:
        try:
            call().add_done_callback(pass_on)
        except Exception as error:
            answer.set_exception(error)

    executor.create_task(send)
    return answer
