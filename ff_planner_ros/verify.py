"""Execute a plan in the independent engine, and print how far the motion is from the plan."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.target_body import TargetBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.capture import ALLOWED_AT_CAPTURE, Capture, is_soft
from ff_planner_ros.simulation.engine import ENGINE
from ff_planner_ros.simulation.model_errors import model_errors
from ff_planner_ros.simulation.verification import (
    ALLOWED,
    MOMENTUM_TOLERANCE,
    Deviation,
    verify,
)
from ff_planner_ros.text_table import print_table

_COLUMNS = ("end effector [mm]", "[deg]", "chaser [mm]", "[deg]")


def print_verdict(
    name: str,
    robot: Robot,
    trajectory: Trajectory,
    sensitivity: bool,
    body: TargetBody | None = None,
    capture_time: float | None = None,
) -> bool:
    """Execute a plan open loop, also with a wrong model if asked, and tell whether it passed.

    Args:
        body: That the plan captures; None: none.
        capture_time: From its first point on [s]; None: at its last point.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    found = verify(robot, trajectory, body, capture_time)
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
    verdict = "passed"
    if not found.momentum_drift <= MOMENTUM_TOLERANCE:
        verdict = "failed: the momentum changes, the motion is too fast to be integrated"
    elif found.capture is not None and not is_soft(found.capture):
        verdict = "failed: the end effector does not meet the grasp of the target body"
    elif not found.passed:
        verdict = "failed: the system does not do what the plan says"
    print(f"verdict: {verdict}")
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


def _cells(deviation: Deviation, digits: int) -> list[str]:
    meters = deviation.final_position_error, deviation.max_chaser_position_error
    turns = deviation.final_orientation_error, deviation.max_chaser_orientation_error
    values = [
        value for m, rad in zip(meters, turns, strict=True) for value in (m * 1e3, np.rad2deg(rad))
    ]
    return [f"{value:.{digits}f}" for value in values]
