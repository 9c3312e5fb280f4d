"""A method, in the process that it runs in.

A method is a name of `ENTRANTS`, a Python file with a function `answer(scenario, seconds)` that
returns an answer as a dictionary, or a command line that reads {scenario} and writes {answer}.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.errors import InvalidInput, Status

ENTRANTS = ("ours", "direct", "fixed_base", "zero_momentum", "rrt_connect")
_SET_DEATH_SIGNAL = 1  # of prctl: a method ends with its judge
# Characters that are kept of a method's error message; of a command, the last ones.
MOST_WORDS = 200

Answers: TypeAlias = Callable[[Path, float], Any]


def require_known(method: str) -> None:
    """Refuse a word that names no method.

    Raises:
        InvalidInput: It is no entrant, no existing Python file and no command that can run.
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


def main(method: str, seconds: str) -> None:
    """Answer the questions on standard input, a line of JSON each, by lines of JSON.

    What a method prints is not part of an answer: it goes to standard error.
    """
    with suppress(OSError, AttributeError):  # another system than Linux
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def tell(**said: Any) -> None:
        print(json.dumps(said), file=answers, flush=True)

    try:
        answer = _answers_of(method)
    except Exception as error:  # whatever a foreign file raises
        tell(wrong=f"{type(error).__name__}: {error}"[:MOST_WORDS])
        return
    tell(ready=True)
    for line in sys.stdin:
        question = json.loads(line)
        try:
            given = answer(Path(question["scenario"]), float(seconds))
            tell(question=question["number"], answer=given)
        except Exception as error:  # whatever a foreign method raises
            words = f"{type(error).__name__}: {error}"[:MOST_WORDS]
            tell(question=question["number"], failed=words)


def _answers_of(method: str) -> Answers:
    """Return a method as a function."""
    if method in ENTRANTS:
        outside = method == "rrt_connect"
        place = "rrt_connect" if outside else "planners"
        known: Any = importlib.import_module(f"ff_planner_benchmark.entrants.{place}").answer
        return known if outside else partial(known, method)
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
    """Return the answer that a command writes; its judge ends what takes too long."""
    with tempfile.TemporaryDirectory() as directory, tempfile.TemporaryFile() as said:
        file = Path(directory) / "answer.json"
        words = shlex.split(method)
        told = {"{scenario}": str(scenario), "{answer}": str(file), "{seconds}": f"{seconds:g}"}
        for name, value in told.items():
            words = [word.replace(name, value) for word in words]
        quiet = subprocess.DEVNULL
        code = subprocess.run(words, stdin=quiet, stdout=quiet, stderr=said).returncode
        if code == 0 and file.exists():
            return read_json(file)
        said.seek(0)
        last = said.read()[-MOST_WORDS:].decode(errors="replace").strip().splitlines()[-1:]
        reason = "it wrote no answer" if code == 0 else ended_with(code)
        return {"status": "no answer", "message": ": ".join([reason, *last])}


def ended_with(code: int) -> str:
    """Return how a process ended, in words."""
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name


if __name__ == "__main__":
    main(*sys.argv[1:])
