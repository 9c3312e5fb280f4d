"""Execute a plan many times by systems that differ from the model, and print how often it holds."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Limits
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.monte_carlo import TORQUES, Distribution, MonteCarlo, monte_carlo
from ff_planner_ros.simulation.torque_runs import torque_monte_carlo

# Scale and name of a unit in tables.
_SHOWN = {
    "m": (1e3, "mm"),
    "rad": (float(np.rad2deg(1.0)), "deg"),
    "N m": (1.0, "N m"),
}
# Fields of a distribution, and their names in tables.
_COLUMNS_OF_RUNS = {
    "rms": "rms",
    "std": "deviation",
    "least": "least",
    "percentile_1": "1 %",
    "median": "median",
    "percentile_99": "99 %",
    "largest": "largest",
}


@dataclass(frozen=True)
class Draw:
    """The options of the runs of a plan."""

    total: int  # number of runs
    seed: int
    execution: str  # of `EXECUTIONS`
    uncertainty: Uncertainty


def uncertainty_of(text: str) -> Uncertainty:
    """Return the uncertainty in a text such as `mass=0.01,angular_velocity=0.0002`.

    Names that are left out are zero.

    Raises:
        InvalidInput: A name is unknown or repeated, or a value is not a finite number.
    """
    names = [item.name for item in fields(Uncertainty)]
    told = dict.fromkeys(names, 0.0)
    seen = set[str]()
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name not in names or name in seen:
            allowed = f"it must be one or several of {', '.join(names)}, each once: mass=0.01,..."
            raise InvalidInput(Status.OUT_OF_RANGE, "--uncertainty", part, allowed)
        seen.add(name)
        try:
            told[name] = finite_number(f"--uncertainty {name}", float(value))
        except ValueError:
            allowed = "it must be a number"
            field = f"--uncertainty {name}"
            raise InvalidInput(Status.OUT_OF_RANGE, field, value, allowed) from None
    return Uncertainty(**told)


def print_monte_carlo(
    name: str,
    robot: Robot,
    trajectory: Trajectory,
    scene: Scene | None,
    limits: Limits,
    draw: Draw,
) -> dict[str, Any]:
    """Execute a plan in many runs, print the statistics and return them for JSON.

    Args:
        scene: In the plan's inertial frame; None: it is not known.

    Raises:
        InvalidInput: The plan cannot be executed, or the number of runs is out of range.
    """
    seen, asked = scene or Scene(), (draw.uncertainty, draw.total, draw.seed)
    if draw.execution == TORQUES:
        found = torque_monte_carlo(robot, trajectory, seen, *asked)
    else:
        found = monte_carlo(robot, trajectory, seen, *asked, limits)
    drawn = [f"{key} {value:.3g}" for key, value in asdict(found.uncertainty).items() if value]
    how = {TORQUES: "torques alone"}.get(found.execution, "joints controlled")
    rows = []
    for one in found.numbers:
        scale, unit = _SHOWN[one.unit]
        rows.append((f"{one.name} [{unit}]", *_scaled(one.runs, scale)))
        if one.linear is not None:
            rows.append(("  linear prediction", *_scaled(one.linear, scale)))
    print_table(
        f"{name}, {found.total} runs, {how}, seed {found.seed}; deviations: "
        f"{', '.join(drawn) or 'none'}",
        ("", *_COLUMNS_OF_RUNS.values()),
        rows,
    )
    print_table(
        "violations",
        ("kind", "runs", "share", "95 % interval", "linear prediction"),
        [
            (
                one.kind,
                str(one.count),
                percent(one.share, 2),
                " to ".join(percent(end, 2) for end in one.interval),
                "" if one.linear is None else str(one.linear),
            )
            for one in found.violations
        ],
    )
    return _as_dictionary(found)


def _scaled(values: Distribution, scale: float) -> list[str]:
    return [f"{scale * getattr(values, name):.4f}" for name in _COLUMNS_OF_RUNS]


def _as_dictionary(found: MonteCarlo) -> dict[str, Any]:
    """Return the results for JSON, in SI units and radians; infinite statistics are null."""
    told = found.foretold_end_error
    return {
        "execution": found.execution,
        "runs": found.total,
        "seed": found.seed,
        "uncertainty": asdict(found.uncertainty),
        "numbers": {
            one.name: {
                "unit": one.unit,
                "runs": _finite(one.runs._asdict()),
                "linear": None if one.linear is None else _finite(one.linear._asdict()),
            }
            for one in found.numbers
        },
        "foretold_rms_end_error": None
        if told is None
        else {"position": told[0], "orientation": told[1]},
        "violations": {
            one.kind: {
                "runs": one.count,
                "share": one.share,
                "interval_95": list(one.interval),
                "linear": one.linear,
            }
            for one in found.violations
        },
    }


def _finite(numbers: dict[str, float]) -> dict[str, float | None]:
    return {name: value if np.isfinite(value) else None for name, value in numbers.items()}
