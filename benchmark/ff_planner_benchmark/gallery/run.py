"""A run of the gallery, in a process of its own on one core; see `bench.report`."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ff_planner_benchmark.bench.report import machine
from ff_planner_benchmark.gallery.compared import Compared
from ff_planner_benchmark.gallery.least_turn import least_last_turns
from ff_planner_benchmark.gallery.page import page
from ff_planner_benchmark.gallery.plans import TASKS, drawn_goals, planned, reaches
from ff_planner_benchmark.gallery.problems import PROBLEMS
from ff_planner_benchmark.gallery.recomputed import COMPARISONS
from ff_planner_ros.analysis.json_file import json_text, read_json
from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.parameters import load_parameters

# Of the direct optimisation that bounds the plans of P1.
_INTERVALS, _STARTS = 50, 3


def run_on_one_core(
    names: Sequence[str], goals: int, json_file: Path | None, page_file: Path | None
) -> int:
    """Run problems in a process of its own, and return its exit code.

    Args:
        names: Of the problems.
        goals: Number of goals that are drawn for P16.
        json_file: File of all figures; those of other problems in it stay. None: none is written.
        page_file: File of the page. None: it is printed.
    """
    arguments = [",".join(names), str(goals), str(json_file or ""), str(page_file or "")]
    command = [sys.executable, "-u", "-m", "ff_planner_benchmark.gallery.run", *arguments]
    return subprocess.run(command, env=os.environ | PLANNING, check=False).returncode


def main(names: str, goals: int, json_file: str, page_file: str) -> None:
    """Run problems, and write figures and page. See `run_on_one_core` for the arguments."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    there = read_json(Path(json_file)) if json_file and Path(json_file).exists() else {}
    figures: dict[str, Any] = there or {"problems": {}}
    figures["machine"] = machine() | {"date": time.strftime("%Y-%m-%d")}
    for name in names.split(","):
        print(f"{name}: {PROBLEMS[name].title}", file=sys.stderr)
        figures["problems"][name] = figures_of(name, goals)
    problems = figures["problems"]
    figures["problems"] = {name: problems[name] for name in PROBLEMS if name in problems}
    text = page(figures)
    if json_file:
        Path(json_file).write_text(json_text(figures, indent=1) + "\n", encoding="utf-8")
    if page_file:
        Path(page_file).write_text(text, encoding="utf-8")
    else:
        print(text, end="")


def figures_of(name: str, goals: int) -> dict[str, Any]:
    """Return the figures of one problem: their motion on our model, and our plans."""
    settings, found = load_parameters().planner, dict[str, Any]()
    if name in COMPARISONS:
        found["recomputed"] = [_row(one) for one in COMPARISONS[name]()]
    if name == "P1":
        least, by_rates = (
            float(least_last_turns(_INTERVALS, _STARTS, within).max()) for within in (True, False)
        )
        what = (
            f"Least last turn that velocities and torques allow from rest: {least:.2f} deg; the "
            f"velocities alone: {by_rates:.2f} deg. By direct optimisation of accelerations in "
            f"{_INTERVALS} intervals, the same from {_STARTS} random initial guesses "
            f"(gallery/least_turn.py)."
        )
        found["bound"] = what
    plans = [planned(task, settings) for task in TASKS.get(name, ())]
    if name == "P5":
        plans += reaches(settings)
    if plans:
        found["plans"] = plans
    if name == "P16":
        found["goals"] = list(drawn_goals(goals, settings))
    return found


def _row(one: Compared) -> dict[str, Any]:
    return {
        "what": one.what,
        "unit": one.unit,
        "printed": one.printed,
        "ours": one.ours,
        "by": one.by,
        "agrees": one.agrees,
        "rounds": one.rounds,
        "remark": one.remark,
    }


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4])
    except KeyboardInterrupt:
        sys.exit(130)
