"""Execute a plan in the independent engine, and print how far the motion is from the plan."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.capture import ALLOWED_AT_CAPTURE, Capture, is_soft
from ff_planner_ros.simulation.corridor import Corridor
from ff_planner_ros.simulation.engine import ENGINE
from ff_planner_ros.simulation.model_errors import model_errors
from ff_planner_ros.simulation.verification import (
    ALLOWED,
    MOMENTUM_TOLERANCE,
    Deviation,
    Verification,
    verify,
)
from ff_planner_ros.text_table import print_table

_COLUMNS = ("end effector [mm]", "[deg]", "chaser [mm]", "[deg]")


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
