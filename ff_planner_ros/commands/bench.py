"""The command that measures the planner itself."""

from __future__ import annotations

import argparse

from ff_planner_ros.bag.provenance import provenance
from ff_planner_ros.bench.report import run_on_one_core
from ff_planner_ros.errors import InvalidInput, Status

_MOST = 10_000  # scenarios of a class


def run_benchmark(options: argparse.Namespace) -> int:
    """Measure speed and success rate."""
    if options.scenarios is not None and not 1 <= options.scenarios <= _MOST:
        allowed = f"it must be from 1 to {_MOST}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--scenarios", options.scenarios, allowed)
    commit = provenance().get("git", "")
    return run_on_one_core(options.quick, options.scenarios, options.json, commit)
