"""Callbacks in a thread of their own."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from rclpy.executors import Executor, ExternalShutdownException
from rclpy.impl.rcutils_logger import RcutilsLogger


def spin_in_background(executor: Executor, logger: RcutilsLogger) -> Callable[[], None]:
    """Run an executor in a new thread.

    A callback that raises is logged and the others go on: rclpy would end the thread, and the
    node would be there but deaf.

    Args:
        executor: With all its nodes added.
        logger: Where errors go.

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
