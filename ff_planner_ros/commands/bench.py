"""The command that measures the planner itself."""

from __future__ import annotations

from argparse import SUPPRESS, Action, ArgumentParser, Namespace
from typing import Any

from ff_planner_ros.commands import BAD_INPUT
from ff_planner_ros.commands.options import Add, add_output, require_file
from ff_planner_ros.errors import InvalidInput, Status

_MOST = 10_000  # scenarios of a class


def add_bench(add: Add) -> None:
    """Add `bench`."""
    bench = add(
        "bench",
        run_benchmark,
        "measure speed and success rate",
    )
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench.add_argument(
        "--scenarios", type=int, metavar="N", help="of each class (default: 200; quick: 4)"
    )
    add_output(bench, "--json", "FILE", "write all figures", require_file)
    bench.add_argument("--dataset", "--score", action=_Moved, nargs="*", help=SUPPRESS)


class _Moved(Action):
    """A former option, now a command of another program; it says so for one more version."""

    def __call__(self, parser: ArgumentParser, *given: Any) -> None:
        where = "ff-planner-benchmark: see docs/how_to/dataset.md"
        parser.exit(BAD_INPUT, f"ff-planner: {given[2]} is now a command of {where}\n")


def run_benchmark(options: Namespace) -> int:
    """Measure speed and success rate."""
    from ff_planner_ros.bag.provenance import provenance
    from ff_planner_ros.bench.report import run_on_one_core

    if options.scenarios is not None and not 1 <= options.scenarios <= _MOST:
        allowed = f"it must be from 1 to {_MOST}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--scenarios", options.scenarios, allowed)
    commit = provenance().get("git", "")
    return run_on_one_core(options.quick, options.scenarios, options.json, commit)
