"""Where the paper's equations end, by an integrator of their own: golden numbers.

Tests read the numbers from `oracle.json` every day, and `test_oracle.py` integrates anew in CI. Run
as a script, this writes the file.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.robot.state import SystemState

FILE = Path(__file__).with_suffix(".json")


def golden(name: str) -> SystemState:
    """Return the state that an integration ended in when the file was written."""
    numbers = json.loads(FILE.read_text("utf-8"))[name]
    return SystemState(**{field: np.array(values) for field, values in numbers.items()})


def integrations() -> dict[str, Callable[[], SystemState]]:
    """Return every integration by its name."""
    import test_forward  # these read the golden numbers
    import test_rollout

    return test_forward.INTEGRATIONS | test_rollout.INTEGRATIONS


def _numbers(state: SystemState) -> dict[str, Any]:
    return {name: values.tolist() for name, values in asdict(state).items() if values is not None}


if __name__ == "__main__":
    ends = {name: _numbers(integrate()) for name, integrate in integrations().items()}
    FILE.write_text(f"{json.dumps(ends, indent=1)}\n", "utf-8")
