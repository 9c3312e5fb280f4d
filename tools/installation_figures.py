"""How long a user waits: for the command in a fresh process, and for the service of a node.

Both as they are installed: the node with its default parameters, which keep shapes clear, a start
10 s ahead, and all that it publishes and records. Run as a script, it writes the times into
docs/benchmark.json, beside those of a warm search; `make figures` and `make installation-figures`
run it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ros_processes import Scene, connected_client, private_domain, running_planner

from ff_planner_benchmark.bench.report import figures_json
from ff_planner_ros.bag.provenance import provenance
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.scenario.scenario import load_scenario

NAME = "installation"
FILE = Path(__file__).resolve().parents[1] / "docs" / "benchmark.json"
CAPTURE = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
COMMANDS = {
    "`ff-planner plan` of the paper's capture, a fresh process": (),
    "the same with `--objective attitude`": ("--objective", "attitude"),
}
SERVICE = "the service `plan_trajectory` of a node, with shapes"
RUNS, CALLS = 20, 100
# What `ros_processes` changes is given back its default.
DEFAULTS = (
    *("-p", "robot.geometry:=auto", "-p", "end_behaviour:=stop_joints"),
    *("-p", "controller.allow_nonzero_velocity_at_trajectory_end:=false"),
)
HEADER = (
    *("asked", "times", "p50 [s]", "p95 [s]", "processor, p50 [s]"),
    *("beside the search, p50 [s]", "p95 of that [s]"),
)


class Waited(NamedTuple):
    """A command or a call, and how long it took [s]."""

    asked: str
    seconds: float  # by the wall clock
    processor: float | None = None  # of a command
    search: float | None = None  # of a call, by the wall clock


def commands() -> Iterator[Waited]:
    """Run each command in turn, in a process of its own each time."""
    program = Path(sys.executable).with_name("ff-planner")
    with tempfile.TemporaryDirectory() as bytecode:  # as an installation has it
        environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode, "PYTHONDONTWRITEBYTECODE": ""}
        for run in range(RUNS + 1):
            for name, options in COMMANDS.items():
                command = [str(program), "plan", str(CAPTURE), *options]
                before, begun = _used(), time.perf_counter()
                subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
                seconds = time.perf_counter() - begun
                if run:  # the first one writes the bytecode
                    yield Waited(name, seconds, processor=_used() - before)


def _used() -> float:
    """Return the processor time of all processes that were waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def calls() -> Iterator[Waited]:
    """Ask a node for the capture, again and again, from its first request on."""
    with (
        tempfile.TemporaryDirectory() as directory,
        private_domain(),
        running_planner(Path(directory), *DEFAULTS),
        connected_client() as client,
    ):
        client.wait_for_planner()
        request = Scene(load_scenario(CAPTURE)).complete_request()
        for _ in range(CALLS):
            begun = time.perf_counter()
            answer = client.plan(request)
            seconds = time.perf_counter() - begun
            if answer.status.code != Status.SOLVED:
                raise RuntimeError(answer.status.message)
            yield Waited(SERVICE, seconds, search=answer.solver.solve_time)


def table(waited: list[Waited]) -> Table:
    """Return medians and 95 % quantiles of each thing that was asked."""
    rows = []
    for name in (*COMMANDS, SERVICE):
        group = [each for each in waited if each.asked == name]
        of_processor = [each.processor for each in group if each.processor is not None]
        rest = [each.seconds - each.search for each in group if each.search is not None]
        times = _quantiles([each.seconds for each in group])
        cells = (*times, *_quantiles(of_processor)[:1], *_quantiles(rest))
        rows.append((name, f"{len(group)}", *cells))
    commit, day = provenance().get("git", "unknown"), time.strftime("%Y-%m-%d")
    return Table(f"A default installation, by the wall clock ({day}, {commit})", HEADER, rows)


def _quantiles(seconds: list[float]) -> list[str]:
    return [f"{np.quantile(seconds, part):.3f}" if seconds else "-" for part in (0.5, 0.95)]


if __name__ == "__main__":
    measured = [*commands(), *calls()]
    figures = json.loads(FILE.read_text("utf-8"))
    figures["tables"] = [one for one in figures["tables"] if one["of"] != NAME]
    figures["tables"].append({"of": NAME, **table(measured)._asdict()})
    figures[NAME] = [each._asdict() for each in measured]
    FILE.write_text(figures_json(figures), "utf-8")
