"""The benchmark: every measurement, printed as tables and written to a file.

All measurements run in one process on one core. It is a process of its own, because numerical
libraries read the number of threads from the environment when they load.
"""

from __future__ import annotations

import gc
import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Set
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ff_planner_benchmark.bench import (
    attitude,
    beliefs,
    captures,
    families,
    geometries,
    methods,
    replanning,
    scaling,
    several_cores,
    starts,
    success,
)
from ff_planner_benchmark.bench.measurement import Measurement
from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.common.process_environment import ONE_THREAD, PLANNING
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario

# Starts in motion of each kind, and scenarios that are planned again while a plan runs.
_STARTS = 20
# Problems of each class that are planned in both path families.
_FAMILIES = 40
# Problems that are planned with lines and with shapes.
_GEOMETRIES = 60
# Bodies of each class that are captured, and the plans executed.
_CAPTURES = 60
# Of which the planner chooses the duration, in each range; a sweep over durations follows.
_FASTEST = 20
# Problems that ask for everything at once, and ordinary ones with a small budget.
_EVERYTHING = 100
# Scenarios of each class whose plans are executed: as many as in a published check by others.
_EXECUTED = 40


def run_on_one_core(quick: bool, scenarios: int | None, json_file: Path | None, commit: str) -> int:
    """Run the benchmark in a process of its own, and return its exit code.

    Args:
        quick: Whether to use smaller sizes and to stop the other methods early.
        scenarios: Number of scenarios of each class; None: 200, or 4 if quick.
        json_file: File for all figures; None: they are only printed.
        commit: Commit of the sources; empty: it is not known.
    """
    count = str(scenarios or (4 if quick else 200))
    arguments = [str(int(quick)), count, str(json_file or ""), commit]
    command = [sys.executable, "-u", "-m", "ff_planner_benchmark.bench.report", *arguments]
    return subprocess.run(command, env=os.environ | PLANNING, check=False).returncode


def main(quick: bool, scenarios: int, json_file: str, commit: str) -> None:
    """Print the tables, and write all figures to a JSON file if its name is not empty.

    Pins the process to one core. See `run_on_one_core` for the arguments.
    """
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    gc.collect()
    gc.freeze()  # as in the node
    made = {"date": time.strftime("%Y-%m-%d"), "commit": commit or "unknown"}
    figures: dict[str, Any] = {"machine": machine() | made, "tables": []}
    for name, value in figures["machine"].items():
        print(f"{name:8}  {value}")
    for name, found in _measurements(quick, scenarios, load_parameters().planner, cores):
        for table in found.tables:
            print_table(*table)
        for remark in found.remarks:
            print(remark)
        figures["tables"] += [{"of": name, **table._asdict()} for table in found.tables]
        figures[name] = [_figures(result) for result in found.results]
    if json_file:
        Path(json_file).write_text(figures_json(figures), encoding="utf-8")


def _measurements(
    quick: bool, scenarios: int, settings: PlannerSettings, cores: Set[int]
) -> Iterator[tuple[str, Measurement]]:
    """Yield name and result of each measurement; if quick, most classes have one problem.

    Args:
        cores: Those of the machine that searches may share.
    """

    def some(most: int) -> int:
        return 1 if quick else min(scenarios, most)

    config = share_directory() / "config"
    problem = load_scenario(config / "scenarios" / "lemur_capture.yaml")
    yield "methods", methods.measurement(problem, settings, quick=quick)
    yield "scaling", scaling.measurement(problem, settings, quick=quick)
    yield "scenarios", success.measurement(scenarios, settings)
    yield "starts", starts.measurement(some(_STARTS), settings)
    yield "replanning", replanning.measurement(problem, some(_STARTS), settings)
    yield "families", families.measurement(some(_FAMILIES), settings)
    yield "geometries", geometries.measurement(some(_GEOMETRIES), settings)
    yield "crowds", geometries.crowd_measurement(settings, quick=quick)
    yield "prices", scaling.price_measurement(settings, quick=quick)
    yield "shapes", success.shapes_measurement(scenarios, settings)
    yield "joint goals", success.joint_goals_measurement(scenarios, settings)
    yield "captured", captures.captured_measurement(some(_CAPTURES), settings)
    yield "captures", captures.measurement(some(_CAPTURES), settings)
    yield "free moments", captures.fastest_measurement(some(_FASTEST), settings, quick=quick)
    yield "all features", success.all_features_measurement(some(_EVERYTHING), settings, quick=quick)
    yield "steadiness", attitude.measurement(1 if quick else len(attitude.BEST_KNOWN), settings)
    count = 1 if quick else len(attitude.BEST_KNOWN)
    yield "equal time", attitude.equal_time_measurement(count, some(_EVERYTHING), settings)
    yield "several cores", several_cores.measurement(count, settings, cores)
    yield "executions", beliefs.measurement(some(_EXECUTED), settings)


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


def _figures(result: Any) -> dict[str, Any]:
    """Return a result as a dictionary for JSON, with the name of its status."""
    row = asdict(result)
    return row | ({"status": row["status"].name} if "status" in row else {})


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
        main(bool(int(sys.argv[1])), int(sys.argv[2]), sys.argv[3], sys.argv[4])
    except KeyboardInterrupt:
        sys.exit(130)
