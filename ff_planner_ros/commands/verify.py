"""Execute a plan in the independent engine, and print how far the motion is from the plan.

Or execute it many times by systems that differ from the model, and print how often it holds.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Limits
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.capture import ALLOWED_AT_CAPTURE, Capture, is_soft
from ff_planner_ros.simulation.corridor import Corridor
from ff_planner_ros.simulation.engine import ENGINE
from ff_planner_ros.simulation.model_errors import model_errors
from ff_planner_ros.simulation.monte_carlo import TORQUES, Distribution, MonteCarlo, monte_carlo
from ff_planner_ros.simulation.torque_runs import torque_monte_carlo
from ff_planner_ros.simulation.verification import (
    ALLOWED,
    MOMENTUM_TOLERANCE,
    Deviation,
    Verification,
    verify,
)

_COLUMNS = ("end effector [mm]", "[deg]", "chaser [mm]", "[deg]")


@dataclass(frozen=True)
class Draw:
    """How often, and by which systems, a plan is executed."""

    total: int
    seed: int
    execution: str  # of `EXECUTIONS`
    uncertainty: Uncertainty


def uncertainty_of(text: str) -> Uncertainty:
    """Return what a text such as `mass=0.01,angular_velocity=0.0002` says; the rest is zero.

    Raises:
        InvalidInput: A name that is not known or told twice, or no number.
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
    """Execute a plan by many systems, print what became of it and return it for JSON.

    Args:
        scene: None: it is not known.

    Raises:
        InvalidInput: The plan cannot be executed, or the runs are none.
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
                f"{one.share:.2%}",
                "{:.2%} to {:.2%}".format(*one.interval),
                "" if one.linear is None else str(one.linear),
            )
            for one in found.violations
        ],
    )
    return _as_dictionary(found)


# Scale and name of a unit in tables.
_SHOWN = {
    "m": (1e3, "mm"),
    "rad": (float(np.rad2deg(1.0)), "deg"),
    "N m": (1.0, "N m"),
}


# Of a distribution, and what a table calls it.
_COLUMNS_OF_RUNS = {
    "rms": "rms",
    "std": "deviation",
    "least": "least",
    "percentile_1": "1 %",
    "median": "median",
    "percentile_99": "99 %",
    "largest": "largest",
}


def _scaled(values: Distribution, scale: float) -> list[str]:
    return [f"{scale * getattr(values, name):.4f}" for name in _COLUMNS_OF_RUNS]


def _as_dictionary(found: MonteCarlo) -> dict[str, Any]:
    """Return the runs as JSON has them: SI units, radians; what has no number is null."""
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


def print_verdict(
    name: str,
    robot: Robot,
    trajectory: Trajectory,
    sensitivity: bool,
    scene: Scene | None = None,
) -> bool:
    """Execute a plan open loop, also with a wrong model if asked, and tell whether it passed.

    Args:
        scene: None: it is not known.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    found = verify(robot, trajectory, scene or Scene())
    print_table(
        f"{name}, open loop in {ENGINE}: end effector at the end, chaser at worst",
        ("", *_COLUMNS, "momentum"),
        [
            ("off the plan", *_cells(found.deviation, 4), f"{found.momentum_drift:.1e}"),
            ("allowed", *_cells(ALLOWED, 4), f"{MOMENTUM_TOLERANCE:.1e}"),
        ],
    )
    if found.capture is not None:
        print_table(
            f"{name}, the target a second free body: end effector and grasp at capture",
            ("", "apart [mm]", "[deg]", "moving apart [mm/s]", "[deg/s]"),
            [
                ("relative", *_relative(found.capture)),
                ("allowed", *_relative(ALLOWED_AT_CAPTURE)),
            ],
        )
    if found.corridor is not None:
        print(f"approach: {_told(found.corridor)}")
    if robot.bodies:
        _print_contacts(found, unknown=scene is None)
    else:
        print("contacts: not looked for, the robot is planned with lines")
    print(f"verdict: {_verdict(found)}")
    if sensitivity:
        print_table(
            f"{name}, open loop with something wrong: how far off the plan",
            ("what is wrong", *_COLUMNS),
            [(row.cause, *_cells(row.deviation, 2)) for row in model_errors(robot, trajectory)],
        )
    return found.passed


def _relative(found: Capture) -> list[str]:
    numbers = (
        1e3 * found.position_error,
        np.rad2deg(found.orientation_error),
        1e3 * found.linear_speed,
        np.rad2deg(found.angular_speed),
    )
    return [f"{number:.4f}" for number in numbers]


def _told(found: Corridor) -> str:
    """Return words for how the end effector came along its corridor, as the true grasp sees it."""
    where = f"{abs(found.margin) * 1e3:.2f} mm {'inside' if found.margin >= 0.0 else 'beside'}"
    return (
        f"in the corridor's reach for good from {found.inside_from:.3f} s on; least margin "
        f"{where} at {found.time:.3f} s, as the target sees it"
    )


def _print_contacts(found: Verification, unknown: bool) -> None:
    told = ", but the obstacles are not known" if unknown else ""
    if not found.contacts:
        print(f"contacts: none of {found.pairs} pairs of bodies and obstacles{told}")
        return
    print_table(
        f"contacts, of {found.pairs} pairs of bodies and obstacles{told}; none of them pushes",
        ("pair", "from [s]", "deepest at [s]", "depth [mm]"),
        [
            (one.pair, f"{one.first_time:.3f}", f"{one.time:.3f}", f"{one.depth * 1e3:.2f}")
            for one in found.contacts
        ],
    )


def _verdict(found: Verification) -> str:
    if not found.momentum_drift <= MOMENTUM_TOLERANCE:
        return "failed: the momentum changes, the motion is too fast to be integrated"
    if found.capture is not None and not is_soft(found.capture):
        return "failed: the end effector does not meet the grasp of the target body"
    if not found.came_true:
        return "failed: the system does not do what the plan says"
    if not found.kept_corridor:
        return "failed: the end effector leaves the corridor of its approach"
    if found.contacts:
        first = found.contacts[0]
        return f"failed: {first.pair} touch at {first.first_time:.3f} s, and must not"
    return "passed"


def _cells(deviation: Deviation, digits: int) -> list[str]:
    meters = deviation.final_position_error, deviation.max_chaser_position_error
    turns = deviation.final_orientation_error, deviation.max_chaser_orientation_error
    values = [
        value for m, rad in zip(meters, turns, strict=True) for value in (m * 1e3, np.rad2deg(rad))
    ]
    return [f"{value:.{digits}f}" for value in values]
