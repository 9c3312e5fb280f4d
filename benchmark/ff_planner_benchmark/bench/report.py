"""The benchmark: every experiment, printed as tables and written to a file.

All run in one process on one core. It is a process of its own, because numerical libraries read the
number of threads from the environment when they load.
"""

from __future__ import annotations

import gc
import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ff_planner_benchmark.bench import (
    captures,
    executed,
    in_motion,
    least_attitude,
    methods,
    plans,
    prices,
    published,
    times,
)
from ff_planner_benchmark.bench.experiment import Experiment
from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.common.process_environment import ONE_THREAD, PLANNING
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.parameters import load_parameters

BENCH = (
    *(methods.METHODS, *times.SCALING, plans.SCENARIO_PLANS, in_motion.STARTS),
    *(in_motion.REPLANNING, plans.FAMILIES, plans.GEOMETRIES, prices.CROWDS, prices.PRICES),
    *(plans.SHAPES_PLANS, plans.JOINT_GOAL_PLANS, captures.CAPTURED_PLANS, captures.CAPTURES),
    *(captures.FREE_MOMENTS, plans.ALL_FEATURES_PLANS, least_attitude.STEADINESS),
    *(*least_attitude.EQUAL_TIME, times.SEVERAL_CORES, executed.EXECUTIONS),
    published.COMPARISONS,
)
EXPERIMENTS = (*BENCH, executed.ENGINES)


def run_on_one_core(
    names: Iterable[str], quick: bool, scenarios: int, json_file: Path | None, commit: str
) -> int:
    """Run experiments in a process of its own, and return its exit code.

    Args:
        names: Of the experiments.
        quick: Whether to use smaller sizes and to stop the other methods early.
        scenarios: Number of problems of each class, for experiments that have so many.
        json_file: File for all figures; None: they are only printed.
        commit: Commit of the sources; empty: it is not known.
    """
    arguments = [",".join(names), str(int(quick)), str(scenarios), str(json_file or ""), commit]
    command = [sys.executable, "-u", "-m", "ff_planner_benchmark.bench.report", *arguments]
    return subprocess.run(command, env=os.environ | PLANNING, check=False).returncode


def main(names: str, quick: bool, scenarios: int, json_file: str, commit: str) -> None:
    """Print the tables, and write all figures to a JSON file if its name is not empty.

    Pins the process to one core. See `run_on_one_core` for the arguments.
    """
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    gc.collect()
    gc.freeze()  # as in the node
    made = {"date": time.strftime("%Y-%m-%d"), "commit": commit or "unknown"}
    figures: dict[str, Any] = {"machine": machine() | made, "tables": []}
    for name, value in figures["machine"].items():
        print(f"{name:8}  {value}")
    asked = names.split(",")
    for one in EXPERIMENTS:
        if one.name in asked:
            run(one, one.count(scenarios, quick=quick), figures)
    if json_file:
        Path(json_file).write_text(figures_json(figures), encoding="utf-8")


def run(one: Experiment, count: int, figures: dict[str, Any]) -> None:
    """Run an experiment, print its table and remarks, and add its rows and table to figures."""
    rows = list(one.rows(count, load_parameters().planner))
    table = one.table(rows)
    print_table(*table)
    for remark in filter(None, map(one.remark, rows)):
        print(remark)
    figures["tables"].append({"of": one.name, **table._asdict()})
    figures.setdefault(one.name, []).extend(rows)


def machine() -> dict[str, str]:
    """Return the machine, thread settings and versions that the figures depend on."""
    cpu = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            cpu = line.partition(":")[2].strip()
            break
    versions = [f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "pin", "scipy")]
    threads = [f"{name}={os.environ.get(name, 'not set')}" for name in ONE_THREAD]
    return {
        "machine": f"{cpu}, {len(os.sched_getaffinity(0))} core of {os.cpu_count()} used",
        "threads": ", ".join(threads),
        "versions": ", ".join([f"Python {platform.python_version()}", *versions]),
    }


def figures_json(figures: dict[str, Any]) -> str:
    """Return JSON with a line for each table and for each result."""
    blocks = []
    for name, block in figures.items():
        lines = json_text(block, indent=1)
        if isinstance(block, list):
            lines = "[\n" + ",\n".join(map(json_text, block)) + "\n]"
        blocks.append(f"{json_text(name)}: {lines}")
    return "{\n" + ",\n".join(blocks) + "\n}\n"


if __name__ == "__main__":
    try:
        main(sys.argv[1], bool(int(sys.argv[2])), int(sys.argv[3]), sys.argv[4], sys.argv[5])
    except KeyboardInterrupt:
        sys.exit(130)
