"""Processes that do independent parts of a computation side by side.

They are forks of the process that computes: they know all that it knows, and what it computes by
threads would wait for the interpreter's lock. Parts and results are the same for any number.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Part = TypeVar("Part")
Result = TypeVar("Result")

# Parts are numbered by one byte.
_MOST_PARTS = 256
# Of Linux's prctl: the signal that a process gets when its parent ends.
_PR_SET_PDEATHSIG = 1


class _Worker(NamedTuple):
    pid: int
    link: Connection  # receives parts, sends numbered results


class Workers(Generic[Part, Result]):
    """Forks that compute, made when there is work for several, until they are closed."""

    def __init__(self, compute: Callable[[Part], Result], most: int) -> None:
        """Share the work among `most` processes, this one included.

        Args:
            compute: Computes a part; what it changes is lost. Parts and results are pickled.
        """
        self._compute, self._most = compute, most
        self._workers: list[_Worker] = []
        # The numbers of the parts that nobody has begun: who reads one computes it.
        self._waiting, self._numbers = os.pipe()
        os.set_blocking(self._waiting, False)

    def close(self) -> None:
        """End the forks, all at once: each takes milliseconds to give its memory back."""
        for worker in self._workers:
            worker.link.close()
            os.kill(worker.pid, signal.SIGKILL)
        for worker in self._workers:
            os.waitpid(worker.pid, 0)
        self._workers.clear()
        os.close(self._waiting)
        os.close(self._numbers)

    def results(self, parts: Sequence[Part]) -> Iterator[Result]:
        """Yield the results of parts in order; one process computes them as they are asked for."""
        if not 1 < len(parts) <= _MOST_PARTS or not self._is_shared():
            yield from map(self._compute, parts)
            return
        os.write(self._numbers, bytes(range(len(parts))))
        asked = [worker for worker in self._workers if _has_sent(worker.link, parts)]
        found = dict(self._computed(parts))
        for worker in asked:
            with suppress(EOFError, OSError):  # it has died: this process does its part
                found.update(worker.link.recv())
        for number, part in enumerate(parts):
            yield found[number] if number in found else self._compute(part)

    def _is_shared(self) -> bool:
        """Tell whether there are workers; fork them if there are none yet."""
        for _ in range(0 if self._workers else _processes(self._most) - 1):
            self._workers.append(self._forked())
        return bool(self._workers)

    def _forked(self) -> _Worker:
        from multiprocessing.connection import Pipe  # of sockets, which few plans need

        ours, theirs = Pipe()
        parent, pid = os.getpid(), os.fork()
        if pid:
            theirs.close()
            return _Worker(pid, ours)
        try:
            ours.close()
            _end_with(parent)
            gc.freeze()  # a collection would copy all of the memory
            with suppress(EOFError, OSError):  # the search is over
                while True:
                    theirs.send(list(self._computed(theirs.recv())))
        finally:
            os._exit(0)

    def _computed(self, parts: Sequence[Part]) -> Iterator[tuple[int, Result]]:
        """Yield the results of the parts that this process takes, with their numbers."""
        while True:
            try:
                (number,) = os.read(self._waiting, 1)
            except BlockingIOError:  # all are begun
                return
            yield number, self._compute(parts[number])


def _processes(most: int) -> int:
    """Return how many processes may share the work: one if this one cannot be forked safely.

    A fork of a process with several threads may inherit a lock that nobody releases.
    """
    try:
        is_alone = len([*Path("/proc/self/task").iterdir()]) == 1
        return min(most, len(os.sched_getaffinity(0))) if is_alone else 1
    except (OSError, AttributeError):  # not on Linux
        return 1


def _has_sent(link: Connection, parts: object) -> bool:
    try:
        link.send(parts)
    except OSError:  # it has died
        return False
    return True


def _end_with(parent: int) -> None:
    """Have this process killed when its parent ends, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended before
        os._exit(1)
