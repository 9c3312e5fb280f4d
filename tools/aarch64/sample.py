"""Numbers of one machine, for another one to compare: everything that the core offers, and plans.

`sample.py write FILE` makes them, `sample.py compare FILE FILE` tells where they differ.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

SOURCE_TREE = Path(__file__).resolve().parents[2]
SCENARIOS = (
    "lemur_capture",
    "lemur_capture_bodies",
    "planar_capture",
    "lemur_tumbling",
    "rail_capture",
    "stow",
)
# What is promised of the same task on another kind of processor, for shortest plans.
JOINTS_APART = 1e-6  # rad, m


def numbers_of(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each array and number that a value holds, by a name."""
    if isinstance(value, np.ndarray | int | float):
        yield name, np.asarray(value, dtype=float)
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from numbers_of(inner, f"{name}.{key}")
    elif isinstance(value, list | tuple):
        for key, inner in enumerate(value):
            yield from numbers_of(inner, f"{name}[{key}]")
    elif type(value).__module__.endswith("compiled"):
        for key in dir(value):
            if not key.startswith("_") and not callable(getattr(value, key)):
                yield from numbers_of(getattr(value, key), f"{name}.{key}")


def write(file: str) -> None:
    """Compute the numbers of this machine."""
    import test_core_border

    from ff_planner_ros.parameters import load_parameters
    from ff_planner_ros.planning.scenario.scenario import load_task
    from ff_planner_ros.planning.task.task import perform

    found: dict[str, np.ndarray] = {}
    for name, (call, given) in test_core_border.sound().items():
        found |= numbers_of(given, f"given {name}")
        found |= numbers_of(call(**given), f"core {name}")
    for scenario in SCENARIOS:
        path = SOURCE_TREE / "config" / "scenarios" / f"{scenario}.yaml"
        task = load_task(path, load_parameters().of_scenarios())
        plan = perform(task)
        found[f"digest {scenario}"] = np.frombuffer(task.digest.encode(), dtype=np.uint8)
        found[f"plan {scenario}"] = plan.trajectory.joint_positions
        found[f"counts {scenario}"] = np.array([plan.solver.iterations, plan.solver.starts])
        print(f"{platform.machine()}: {scenario}", flush=True)
    np.savez(file, allow_pickle=False, **found)


def compare(ours: str, theirs: str) -> bool:
    """Tell where two machines differ; return whether they keep what is promised."""
    first, second = dict(np.load(ours)), dict(np.load(theirs))
    print(f"{'of':<28}{'values':>8}{'equal bits':>12}{'largest difference':>20}")
    kept = first.keys() == second.keys()
    for kind in ("given", "core", "digest", "counts"):
        names = [name for name in first if name.startswith(f"{kind} ")]
        if names:
            kept &= tell(kind, [(first[name], second[name]) for name in names], kind == "given")
    for name in (name for name in first if name.startswith("plan ")):
        kept &= tell(name, [(first[name], second[name])], False, JOINTS_APART)
    return bool(kept)


def tell(
    kind: str, pairs: list[tuple[np.ndarray, np.ndarray]], equal: bool, most: float = np.inf
) -> bool:
    """Print a row, of differences relative to an array's largest; return whether it is allowed."""
    if any(one.shape != other.shape for one, other in pairs):
        print(f"{kind:<28} of another shape")
        return False
    same = sum(one.tobytes() == other.tobytes() for one, other in pairs)
    largest = max(
        float(np.abs(np.nan_to_num(one) - np.nan_to_num(other)).max(initial=0.0))
        / (max(1.0, float(np.abs(np.nan_to_num(one)).max(initial=0.0))))
        for one, other in pairs
    )
    told = "" if kind == "digest" else f"{largest:.1e}"
    print(f"{kind:<28}{len(pairs):>8}{same:>12}{told:>20}")
    return largest <= (0.0 if equal else most)


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(sys.argv[2])
    else:
        sys.exit(not compare(*sys.argv[2:]))
