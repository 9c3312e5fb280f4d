"""Execute a plan in independent engines, and print how far the motion is from the plan."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.analysis.nearest import Nearest, nearest
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.commands import NO_PLAN, SCENARIOS, SOLVED
from ff_planner_ros.commands.monte_carlo import Draw, print_monte_carlo, uncertainty_of
from ff_planner_ros.commands.options import refuse_given
from ff_planner_ros.commands.printed import print_notes, write_json
from ff_planner_ros.commands.tasks import task_of
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.runs.planned_motions import PlannedMotion, motions_of, recorded_motions
from ff_planner_ros.simulation.capture import ALLOWED_AT_CAPTURE, Capture, Corridor, is_soft
from ff_planner_ros.simulation.deviation import ALLOWED, Deviation
from ff_planner_ros.simulation.engine import ENGINE
from ff_planner_ros.simulation.model_errors import model_errors
from ff_planner_ros.simulation.monte_carlo import require_runs
from ff_planner_ros.simulation.other_engines import Engine, Flown, other_engines
from ff_planner_ros.simulation.verification import (
    MOMENTUM_TOLERANCE,
    TORQUE_TOLERANCE,
    Verification,
    verify,
)

_COLUMNS = ("end effector [mm]", "[deg]", "chaser [mm]", "[deg]")


def print_verdicts(options: Namespace) -> int:
    """Execute the plans of a source, print and write the verdicts, and return the exit code."""
    total, asked = _runs_asked_for(options)
    engines, notes = other_engines(options.engine)
    print_notes(notes)
    verdicts, answers = list[bool](), list[dict[str, Any]]()
    for one in _motions(options.source, options):
        motion = one.name, one.robot, one.trajectory
        verdicts.append(print_verdict(*motion, options.sensitivity, one.scene, engines))
        answers.append({"name": one.name, "passed": verdicts[-1]})
        if total is not None:
            draw = Draw(total, options.seed, options.execution, asked or one.uncertainty)
            found = print_monte_carlo(*motion, one.scene, one.limits, draw)
            answers[-1]["monte_carlo"] = found
    write_json(options.json, {"plans": answers})
    return SOLVED if all(verdicts) else NO_PLAN


def _runs_asked_for(options: Namespace) -> tuple[int | None, Uncertainty | None]:
    """Return the number of Monte Carlo runs (None: none) and `--uncertainty` (None: not given)."""
    if options.monte_carlo is None:
        unused = {"seed": 0, "execution": "tracked", "uncertainty": None}
        refuse_given(options, unused, "it counts beside --monte-carlo alone")
        return None, None
    require_runs(options.monte_carlo, options.seed)
    told = options.uncertainty
    return options.monte_carlo, None if told is None else uncertainty_of(told)


def _motions(source: Path, options: Namespace) -> Iterator[PlannedMotion]:
    """Yield each plan of a JSON file or bag, or of a scenario that is planned first."""
    if source.suffix in SCENARIOS:
        task, watch = task_of(source, options)
        planned = perform(task, watch, method_of(options.method, task))
        yield from motions_of(source.name, task, planned)
    elif source.suffix in (".json", ".mcap") or source.is_dir():
        yield from recorded_motions(source, print_notes)
    else:
        allowed = "it must be a scenario (.yaml), an answer (.json) or a bag (directory or .mcap)"
        raise InvalidInput(Status.UNSUPPORTED, "what to verify", source, allowed)


def print_verdict(
    name: str,
    robot: Robot,
    trajectory: Trajectory,
    sensitivity: bool,
    scene: Scene | None = None,
    engines: Sequence[Engine] = (),
) -> bool:
    """Execute a plan open loop, print the deviations, and tell whether it passed.

    Args:
        sensitivity: Whether to execute it with model errors, too.
        scene: In the plan's inertial frame; None: it is not known.
        engines: They execute it after MuJoCo, if it came true there.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    among = scene or Scene()
    found = verify(robot, trajectory, among)
    flown = list[Flown]()
    for engine in engines if found.came_true else ():
        try:
            flown.append(engine(robot, trajectory, among, found.parts))
        except FfPlannerError as error:
            print_notes([str(error)])
    print_table(
        f"{name}, open loop in {ENGINE}: end effector at the end, chaser at worst",
        ("", *_COLUMNS, "momentum"),
        [
            ("off the plan", *_cells(found.deviation, 4), f"{found.momentum_drift:.1e}"),
            ("allowed", *_cells(ALLOWED, 4), f"{MOMENTUM_TOLERANCE:.1e}"),
        ],
    )
    if found.parts > 1:
        print(
            f"executed in {found.parts} parts, each from a state of the plan: without feedback "
            f"this motion is unstable; deviations are the sum over the parts, times {found.parts}"
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
    if found.holding_torque_error is not None:
        print(
            f"wheels: the torque that holds the chaser is {found.holding_torque_error:.1e} N m off "
            f"what the plan says, allowed is {TORQUE_TOLERANCE:.0e} N m"
        )
    if found.corridor is not None:
        print(f"approach: {_told(found.corridor)}")
    if found.path is not None:
        turn = found.path.orientation_error
        turned = "" if turn is None else f" and {np.rad2deg(turn):.5f} deg"
        away = f"{found.path.position_error * 1e3:.4f} mm{turned}"
        print(f"path: the end effector strays from it by at most {away}")
    _print_contacts(found, "bodies" if robot.bodies else "lines", unknown=scene is None)
    if flown:
        told = with_bodies(robot), trajectory, among.obstacles, among.allowed_collisions
        _print_flown(name, flown, nearest(*told))
    print(f"verdict: {_verdict(found, flown)}")
    if sensitivity:
        print_table(
            f"{name}, open loop with something wrong: how far off the plan",
            ("what is wrong", *_COLUMNS),
            [(row.cause, *_cells(row.deviation, 2)) for row in model_errors(robot, trajectory)],
        )
    return found.passed and all(one.passed for one in flown)


def _relative(found: Capture) -> list[str]:
    numbers = (
        1e3 * found.position_error,
        np.rad2deg(found.orientation_error),
        1e3 * found.linear_speed,
        np.rad2deg(found.angular_speed),
    )
    return [f"{number:.4f}" for number in numbers]


def _told(found: Corridor) -> str:
    """Return the margin of the end effector to its corridor, in words."""
    where = f"{abs(found.margin) * 1e3:.2f} mm {'inside' if found.margin >= 0.0 else 'beside'}"
    return (
        f"in the corridor's reach for good from {found.inside_from:.3f} s on; least margin "
        f"{where} at {found.time:.3f} s, as the target sees it"
    )


def _print_contacts(found: Verification, of: str, unknown: bool) -> None:
    told = ", but the obstacles are not known" if unknown else ""
    if not found.contacts:
        print(f"contacts: none of {found.pairs} pairs of {of} and obstacles{told}")
        return
    print_table(
        f"contacts, of {found.pairs} pairs of {of} and obstacles{told}; none of them pushes",
        ("pair", "from [s]", "deepest at [s]", "depth [mm]"),
        [
            (one.pair, f"{one.first_time:.3f}", f"{one.time:.3f}", f"{one.depth * 1e3:.2f}")
            for one in found.contacts
        ],
    )


def _print_flown(name: str, flown: Sequence[Flown], planned: Nearest | None) -> None:
    """Print what other engines say of a plan, and which pair is nearest as planned."""
    rows = [(one.engine, *_cells(one.deviation, 4), *_apart(one)) for one in flown]
    print_table(
        f"{name}, in other engines: off the plan, and nearest at its points",
        ("", *_COLUMNS, "nearest", "at [s]", "apart [mm]", "contact"),
        [*rows, ("as planned", *[""] * len(_COLUMNS), *_apart(planned))],
    )


def _apart(nearest: Flown | Nearest | None) -> tuple[str, str, str, str]:
    if nearest is None or not nearest.pair:
        return "no pair", "", "", ""
    touches = "no" if nearest.distance > 0.0 else "yes"
    return nearest.pair, f"{nearest.time:.3f}", f"{nearest.distance * 1e3:.2f}", touches


def _verdict(found: Verification, flown: Sequence[Flown]) -> str:
    if not found.momentum_drift <= MOMENTUM_TOLERANCE:
        return "failed: the momentum changes, the motion is too fast to be integrated"
    if found.capture is not None and not is_soft(found.capture):
        return "failed: the end effector does not meet the grasp of the target body"
    if not found.came_true:
        return "failed: the system does not do what the plan says"
    if not found.kept_corridor:
        return "failed: the end effector leaves the corridor of its approach"
    if not found.kept_path:
        return "failed: the end effector strays from its path by more than the tolerances"
    if found.contacts:
        first = found.contacts[0]
        return f"failed: {first.pair} touch at {first.first_time:.3f} s, and must not"
    for one in flown:
        if not one.passed:
            return f"failed: in {one.engine} the plan does not come true, or bodies touch"
    return "passed"


def _cells(deviation: Deviation, digits: int) -> list[str]:
    meters = deviation.final_position_error, deviation.max_chaser_position_error
    turns = deviation.final_orientation_error, deviation.max_chaser_orientation_error
    values = [
        value for m, rad in zip(meters, turns, strict=True) for value in (m * 1e3, np.rad2deg(rad))
    ]
    return [f"{value:.{digits}f}" for value in values]
