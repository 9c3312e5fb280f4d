"""Commands of `ff-planner`, each in a process of its own, with what it said and what it took."""

from __future__ import annotations

import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

# What a command may take [s of a processor, MB], and when it is killed.
SECONDS, MEGABYTES, KILLED_AFTER = 5.0, 500, 30
ADDRESSES = 8 << 30  # [bytes] so that a mistake does not take the machine along
MODULES = (
    *(
        "commands.tasks",
        "commands.verify",
        "commands.compare",
        "bag.info",
        "bag.recover",
    ),
    *("bag.export", "runs.replay", "runs.what_if", "report.run_page", "report.from_bag"),
    *("runs.export_scenarios", "runs.ccsds"),
)


@dataclass(frozen=True)
class Done:
    """What became of a command."""

    code: int  # negative: killed by this signal
    out: str
    err: str
    seconds: float  # of a processor
    megabytes: float


Run = Callable[[Sequence[object]], Done]


@contextmanager
def measured_commands() -> Iterator[Run]:
    """Yield what runs a command; the imports, which take longest, are done once for all."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, __file__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        ask, answers = server.stdin, server.stdout

        def run(arguments: Sequence[object]) -> Done:
            print(json.dumps([str(argument) for argument in arguments]), file=ask, flush=True)
            return Done(**json.loads(answers.readline()))

        yield run
        ask.close()


def serve() -> None:
    for name in MODULES:
        importlib.import_module(f"ff_planner_ros.{name}")
    for line in sys.stdin:
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            child = os.fork()
            if child == 0:
                be_the_command(json.loads(line), out.fileno(), err.fileno())
            _, status, used = os.wait4(child, 0)
            texts = []
            for file in (out, err):
                file.seek(0)
                texts.append(file.read(1_000_000).decode(errors="replace"))
        code = os.waitstatus_to_exitcode(status)
        done = Done(code, *texts, used.ru_utime + used.ru_stime, used.ru_maxrss / 1000)
        print(json.dumps(vars(done)), flush=True)


def be_the_command(arguments: list[str], out: int, err: int) -> None:
    code = 70  # of a traceback
    try:
        os.dup2(out, 1)
        os.dup2(err, 2)
        resource.setrlimit(resource.RLIMIT_CPU, (KILLED_AFTER, KILLED_AFTER))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        from ff_planner_ros.cli import main

        try:
            code = main(arguments)
        except SystemExit as stop:
            code = int(stop.code or 0)
    except BaseException as error:
        print(f"Traceback: {error!r}", file=sys.stderr)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    serve()
