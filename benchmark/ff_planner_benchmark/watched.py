"""A method as its judge runs it: a process that answers in JSON, with its time measured outside.

Nothing but JSON is taken from it: no object of Python, no time, no score.
"""

from __future__ import annotations

import json
import os
import secrets
import selectors
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ff_planner_benchmark import method_process
from ff_planner_benchmark.method_process import ended_with
from ff_planner_benchmark.processes import Family
from ff_planner_ros.analysis.json_file import json_document
from ff_planner_ros.errors import InvalidInput, Status

# Wall time for a method to load, and to end after its standard output has ended [s].
_TO_LOAD, _TO_END = 120.0, 1.0
_FREE_TO_LOAD = 10.0  # processor time of loading that is not counted [s]
# A method is ended after so many times its processor time. Wall time ends only what waits, after so
# many times the processor time and so much more [s].
TOO_LONG = 2.0
_PATIENCE, _MORE_PATIENCE = 20.0, 10.0
_LOOK_AFTER = 0.1  # [s] between two looks at how much time has been taken
# [bytes] of an answer: ten thousand points of fourteen joints are 8 MB.
_LONGEST, _CHUNK = 20_000_000, 1 << 16


class Asked(NamedTuple):
    """A method's answer to a scenario."""

    seconds: float  # processor time of all its processes [s]
    answer: Any  # JSON; None: there is none
    failed: str | None  # why there is no answer; None: there is one


class Method:
    """The process of a method."""

    def __init__(self, method: str, seconds: float) -> None:
        """Start the process, and wait until the method has loaded.

        Args:
            seconds: Processor time for a scenario [s].

        Raises:
            InvalidInput: The method cannot be loaded.
        """
        self._seconds, self._limited = seconds, method != "ours"
        self._family = Family()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", method_process.__name__, method, repr(seconds)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._rest = b""  # what came behind the last line
        line, wrong = self._line(_TO_LOAD, None)
        if line is not None:
            wrong = _member(line, "wrong") if _member(line, "ready") is not True else None
        if line is None or wrong is not None:
            reason = self.end(wrong or "the process ended")
            raise InvalidInput(Status.UNSUPPORTED, "--method", method, reason)
        # To load more than libraries is to plan: the rest counts with the first answer.
        self._taken = min(self._family.seconds(), _FREE_TO_LOAD)

    def ask(self, scenario: Path) -> Asked:
        """Return the method's answer to a scenario; without an answer in time the process is ended.

        The processor time since the last answer counts, too.
        """
        number = secrets.token_hex(8)  # so that nothing said before is an answer
        question = json.dumps({"scenario": str(scenario), "number": number}) + "\n"
        with suppress(OSError):
            os.write(self._pipe("stdin"), question.encode())
        wait = _PATIENCE * self._seconds + _MORE_PATIENCE
        line, failed = self._line(wait, TOO_LONG * self._seconds if self._limited else None)
        now = self._family.seconds()
        taken, self._taken = now - self._taken, now
        if line is None:
            reason = self.end(failed or "")
            return Asked(max(taken, TOO_LONG * self._seconds), None, reason)
        try:
            said = json_document(line.decode("utf-8", "replace"), "its answer", "no answer")
        except InvalidInput as error:
            return Asked(taken, None, f"its answer cannot be read: {error.allowed}")
        if not isinstance(said, dict) or said.get("question") != number:
            return Asked(taken, None, "it answered something that was not asked")
        if self._family.loses_time:
            return Asked(taken, None, "it ignores SIGCHLD: the time of its processes is lost")
        if "answer" not in said:
            return Asked(taken, None, str(said.get("failed"))[: method_process.MOST_WORDS])
        return Asked(taken, said["answer"], None)

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def end(self, reason: str = "") -> str:
        """End the process and its descendants, and return `reason`, or else how it had ended."""
        if not reason:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_TO_END)
        code = self._process.poll()
        self._family.end()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        self._process.wait()
        if reason:
            return reason
        return "no answer in time" if code is None else f"the process ended: {ended_with(code)}"

    def _pipe(self, name: str) -> int:
        pipe = getattr(self._process, name)
        return int(pipe.fileno())

    def _line(self, wait: float, most_seconds: float | None) -> tuple[bytes | None, str | None]:
        """Return a line of the process, or None and why there is none (None: the process ended)."""
        until, begun = time.monotonic() + wait, self._family.seconds()
        found = bytearray(self._rest)
        with selectors.DefaultSelector() as selector:
            selector.register(self._pipe("stdout"), selectors.EVENT_READ)
            while b"\n" not in found[-_CHUNK - 1 :]:
                if len(found) > _LONGEST:
                    return None, f"its answer has more than {_LONGEST / 1e6:g} MB"
                if time.monotonic() > until:
                    return None, "no answer in time"
                if most_seconds is not None and self._family.seconds() - begun > most_seconds:
                    return None, f"{TOO_LONG:g} times its processor time were over"
                if not selector.select(_LOOK_AFTER):
                    if self.has_ended:  # others may hold its end of the pipe
                        return None, None
                    continue
                chunk = os.read(self._pipe("stdout"), _CHUNK)
                if not chunk:
                    return None, None
                found += chunk
        line, _, self._rest = bytes(found).partition(b"\n")
        return line, None


def _member(line: bytes, name: str) -> Any:
    with suppress(ValueError, RecursionError):
        said = json.loads(line)
        return said.get(name) if isinstance(said, dict) else None
    return None
