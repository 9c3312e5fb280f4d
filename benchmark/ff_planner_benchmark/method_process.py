"""A method in a process of its own, with one thread and so much processor time.

A method is a name of `ENTRANTS`, a Python file with a function `answer(scenario, seconds)` that
returns an answer as a dictionary, or a command line that reads {scenario} and writes {answer}.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import multiprocessing
import os
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeAlias

from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.errors import InvalidInput, Status

ENTRANTS = ("ours", "direct", "fixed_base", "zero_momentum", "rrt_connect")
# A process is ended by the system after so many times its processor time. The clock ends only what
# waits, after so many times that and so much more: the machine may have other work [s].
TOO_LONG, _PATIENCE, _MORE_PATIENCE = 2.0, 20.0, 10.0
# A method has so much time to load [s].
_TO_LOAD = 120.0
# So much is kept of what a method says when it fails: of a command the end.
_WORDS = 200

Answers: TypeAlias = Callable[[Path, float], Any]


def require_known(method: str) -> None:
    """Refuse what is no method.

    Raises:
        InvalidInput: It is not one of ours, no file that is there, and no command that can run.
    """
    if method == "rrt_connect" and importlib.util.find_spec("ompl") is None:
        allowed = "it needs OMPL: pip install './benchmark[ompl]'"
        raise InvalidInput(Status.UNSUPPORTED, "--method", method, allowed)
    if method in ENTRANTS or (method.endswith(".py") and Path(method).is_file()):
        return
    allowed = (
        f"it must be {', '.join(ENTRANTS)}, a Python file that is there, or a command line with "
        "{scenario} and {answer}"
    )
    if "{scenario}" in method and "{answer}" in method:
        try:
            words = shlex.split(method)
        except ValueError as error:
            allowed = str(error)
        else:
            if shutil.which(words[0]):
                return
            allowed = f"there is no program {words[0]}, or it may not be executed"
    raise InvalidInput(Status.UNSUPPORTED, "--method", method, allowed)


def started(method: str, seconds: float) -> tuple[Any, Connection]:
    """Start a method's process, and wait until it has loaded the method.

    Raises:
        InvalidInput: It cannot.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(method, seconds, there))
    process.start()
    there.close()
    wrong: str | None = "the process ended"
    with suppress(EOFError, OSError):
        wrong = here.recv() if here.poll(_TO_LOAD) else f"it did not load within {_TO_LOAD:g} s"
    if wrong is not None:
        ended(process, here)
        raise InvalidInput(Status.UNSUPPORTED, "--method", method, wrong)
    return process, here


def asked(pipe: Connection, scenario: Path, seconds: float) -> tuple[float, Any]:
    """Return processor time, and an object with the answer; text: it failed; None: nothing came."""
    with suppress(EOFError, OSError):
        pipe.send(scenario)
        if pipe.poll(_PATIENCE * seconds + _MORE_PATIENCE):
            taken, given = pipe.recv()
            return taken, given
    return TOO_LONG * seconds, None


def ended(process: Any, pipe: Connection) -> str:
    """End a method's process, and return what had become of it."""
    if pipe.poll():  # it sends nothing unasked: the pipe has ended
        process.join(1.0)
    code = process.exitcode
    process.kill()
    process.join()
    return "no answer in time" if code is None else f"the process ended: {_named(code)}"


def _named(code: int) -> str:
    if code == -signal.SIGXCPU:
        return f"{TOO_LONG:g} times its processor time were over"
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name


def _serve(method: str, seconds: float, pipe: Connection) -> None:
    """Answer scenarios until the pipe closes; what a method prints is not part of our table."""
    os.dup2(2, 1)
    try:
        answer = _answers_of(method)
    except Exception as error:  # whatever a foreign file raises
        pipe.send(f"{type(error).__name__}: {error}")
        return
    pipe.send(None)
    while True:
        try:
            scenario = pipe.recv()
        except EOFError:
            return
        given: Any
        begun = _processor_time()
        try:
            if method != "ours":
                _limit_processor_time(TOO_LONG * seconds)
            given = {"answer": json.loads(json.dumps(answer(scenario, seconds)))}
        except Exception as error:  # whatever a foreign method raises
            given = f"{type(error).__name__}: {error}"[:_WORDS]
        pipe.send((_processor_time() - begun, given))


def _limit_processor_time(seconds: float) -> None:
    """Let the system end this process, or one that it starts, after so much more."""
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), most))


def _processor_time() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _answers_of(method: str) -> Answers:
    """Return a method as a function."""
    if method in ENTRANTS:
        known: Answers = importlib.import_module(f"ff_planner_benchmark.entrants.{method}").answer
        return known
    if "{scenario}" in method:
        return partial(_by_command, method)
    found = importlib.util.spec_from_file_location("foreign_method", method)
    if found is None or found.loader is None:
        raise InvalidInput(Status.UNSUPPORTED, "--method", method, "it must be a Python file")
    module = importlib.util.module_from_spec(found)
    # It may import what lies beside it, and be found by what it imports, such as dataclasses.
    sys.path.insert(0, str(Path(method).resolve().parent))
    sys.modules[found.name] = module
    found.loader.exec_module(module)
    given: Answers | None = getattr(module, "answer", None)
    if not callable(given):
        raise TypeError("it must have a function answer(scenario, seconds)")
    return given


def _by_command(method: str, scenario: Path, seconds: float) -> Any:
    """Return what a command writes; it and all that it starts are ended if it takes too long."""
    with tempfile.TemporaryDirectory() as directory, tempfile.TemporaryFile() as said:
        file = Path(directory) / "answer.json"
        words = shlex.split(method)
        told = {"{scenario}": str(scenario), "{answer}": str(file), "{seconds}": f"{seconds:g}"}
        for name, value in told.items():
            words = [word.replace(name, value) for word in words]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(
            words, stdin=quiet, stdout=quiet, stderr=said, start_new_session=True
        )
        try:
            code = process.wait(_PATIENCE * seconds)
        except subprocess.TimeoutExpired:
            return {"status": "no answer", "message": "it did not end in time"}
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if code == 0 and file.exists():
            return read_json(file)
        said.seek(0)
        last = said.read()[-_WORDS:].decode(errors="replace").strip().splitlines()[-1:]
        reason = "it wrote no answer" if code == 0 else _named(code)
        return {"status": "no answer", "message": ": ".join([reason, *last])}
