"""The same problem gives the same plan, bit by bit, in every process and under every load."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# Both kinds of search, and joint rates at their limits; printed is every bit of the answers.
PLAN = """
from dataclasses import fields, replace
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.problem.problem import Limits, Objective
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.common.share import share_directory

config = share_directory() / "config"
settings = replace(load_parameters().planner, starts=3)
capture = load_scenario(config / "scenarios" / "lemur_capture.yaml")
for objective in (Objective(1.0, 0.0), Objective(0.2, 0.8)):
    limits = Limits(joint_velocities=True)
    asked = replace(capture, objective=objective, duration=5.0, limits=limits)
    answer = plan(asked, settings)
    for item in fields(answer.trajectory):
        print(item.name, getattr(answer.trajectory, item.name).tobytes().hex())
    print(answer.xi.tobytes().hex(), answer.metrics, answer.solver)
"""


def started(hash_seed: str, threads: str) -> subprocess.Popen[str]:
    """A fresh process that plans."""
    environment = {
        **os.environ,
        "PYTHONHASHSEED": hash_seed,
        "OMP_NUM_THREADS": threads,
        "OPENBLAS_NUM_THREADS": threads,
    }
    return subprocess.Popen(
        [sys.executable, "-c", PLAN],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


@pytest.mark.law("PLAN-23")
@pytest.mark.ci
def test_fresh_processes_with_other_hashes_and_threads_plan_the_same_to_the_last_bit() -> None:
    processes = [started("1", threads="1"), started("2", threads="2")]
    (first, errors), (second, _) = [process.communicate() for process in processes]
    assert processes[0].returncode == 0, errors
    assert len(first.splitlines()) == 2 * 14
    assert first == second
