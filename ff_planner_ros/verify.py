"""Put a plan to the test in the independent engine, and say how it went."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.engine import ENGINE
from ff_planner_ros.simulation.model_errors import model_errors
from ff_planner_ros.simulation.verification import (
    MOMENTUM_TOLERANCE,
    ORIENTATION_TOLERANCE,
    POSITION_TOLERANCE,
    Deviation,
    Verification,
    verify,
)
from ff_planner_ros.text_table import print_table

_COLUMNS = ("end effector [mm]", "[deg]", "chaser [mm]", "[deg]")
_ALLOWED = Deviation(
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE, POSITION_TOLERANCE, ORIENTATION_TOLERANCE
)


def print_verdict(name: str, robot: Robot, trajectory: Trajectory, sensitivity: bool) -> bool:
    """Execute a plan open loop, print how far it is from coming true, and the verdict.

    Args:
        sensitivity: Whether to execute it with errors in the model, too.

    Returns:
        Whether it passed.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    found = verify(robot, trajectory)
    print_table(
        f"{name}, open loop in {ENGINE}: end effector at the end, chaser at worst",
        ("", *_COLUMNS, "momentum"),
        [
            ("off the plan", *_cells(found.deviation, 4), f"{found.momentum_drift:.1e}"),
            ("allowed", *_cells(_ALLOWED, 4), f"{MOMENTUM_TOLERANCE:.1e}"),
        ],
    )
    print(f"verdict: {_verdict(found)}")
    if sensitivity:
        print_table(
            f"{name}, open loop with something wrong: how far off the plan",
            ("what is wrong", *_COLUMNS),
            [(row.cause, *_cells(row.deviation, 2)) for row in model_errors(robot, trajectory)],
        )
    return found.passed


def _verdict(found: Verification) -> str:
    if found.passed:
        return "passed"
    if not found.momentum_drift <= MOMENTUM_TOLERANCE:
        return "failed: the momentum changes, the motion is too fast to be integrated"
    return "failed: the system does not do what the plan says"


def _cells(deviation: Deviation, digits: int) -> list[str]:
    values = (
        deviation.final_position_error * 1e3,
        np.rad2deg(deviation.final_orientation_error),
        deviation.max_chaser_position_error * 1e3,
        np.rad2deg(deviation.max_chaser_orientation_error),
    )
    return [f"{value:.{digits}f}" for value in values]
