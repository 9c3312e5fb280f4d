"""Processor time and termination of all descendants of a process, whatever became of them."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")  # [s]
_SET_CHILD_SUBREAPER = 36  # of prctl: who loses its parent below this process becomes its child
_PAUSE = 0.01  # [s] between two looks at whether the killed have ended
_PATIENCE = 10.0  # [s] until they have: the system ends them at once, but for what waits in it


class _Process(NamedTuple):
    """An entry of the system's table of processes."""

    pid: int
    parent: int
    begun: int  # [ticks]; with the pid it identifies the process
    own: float  # processor time [s]
    of_ended: float  # processor time of the children that it has waited for [s]


class Family:
    """A process and all its descendants, also in other sessions and orphaned."""

    def __init__(self, of_all: bool = False) -> None:
        """Begin to count; the process must be started by this one afterwards.

        Args:
            of_all: Whether present children of this process belong to the family, too.
        """
        with suppress(OSError, AttributeError):  # another system than Linux
            ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        here = os.getpid()
        self._others = {one.pid for one in _processes() if one.parent == here and not of_all}
        self._before = _of_reaped()
        self._seen: dict[tuple[int, int], float] = {}  # processor time of each [s]
        # Whether one of them ignores SIGCHLD, so that the time of its ended children is lost
        self.loses_time = False

    def seconds(self) -> float:
        """Return the processor time of the whole family so far [s].

        Ended processes count with the time that their parents got from the system, or else with the
        time seen last.
        """
        living = list(self._living())
        for one in living:
            self._seen[one.pid, one.begun] = one.own
            self.loses_time = self.loses_time or _ignores_children(one.pid)
        waited = _of_reaped() - self._before
        waited += sum(one.own + one.of_ended for one in living)
        return max(waited, sum(self._seen.values()))

    def end(self) -> None:
        """Kill the whole family, and wait until it has ended."""
        until = time.monotonic() + _PATIENCE
        while (living := list(self._living())) and time.monotonic() < until:
            for one in living:
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(one.pid, signal.SIGKILL)
            for one in living:
                if one.parent == os.getpid():
                    with suppress(ChildProcessError):
                        os.waitpid(one.pid, os.WNOHANG)
            time.sleep(_PAUSE)

    def _living(self) -> Iterator[_Process]:
        """Yield the processes of the family, zombies included."""
        by_parent: dict[int, list[_Process]] = {}
        for one in _processes():
            by_parent.setdefault(one.parent, []).append(one)
        new = [one for one in by_parent.get(os.getpid(), []) if one.pid not in self._others]
        while new:
            one = new.pop()
            yield one
            new += by_parent.get(one.pid, [])


def _of_reaped() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _ignores_children(pid: int) -> bool:
    """Tell whether a process ignores SIGCHLD, so that the system waits for its children itself."""
    with suppress(OSError):  # ended meanwhile
        for line in Path(f"/proc/{pid}/status").read_text("utf-8", "replace").splitlines():
            name, _, mask = line.partition(":")
            if name == "SigIgn":
                return bool(int(mask, 16) >> (signal.SIGCHLD - 1) & 1)
    return False


def _processes() -> Iterator[_Process]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError, ValueError, IndexError):  # ended meanwhile
                # Behind the name, which may hold anything.
                words = (entry / "stat").read_bytes().rpartition(b")")[2].split()
                own = (int(words[11]) + int(words[12])) * _TICK
                of_ended = (int(words[13]) + int(words[14])) * _TICK
                yield _Process(int(entry.name), int(words[1]), int(words[19]), own, of_ended)
