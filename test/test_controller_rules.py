"""What `joint_trajectory_controller` refuses is refused before it is sent, its rule named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.task.controller_rules import (
    Command,
    Controller,
    require_acceptable,
    require_in_time,
)

NOW = 1_700_000_000_000_000_000
STRICT = Controller(("shoulder", "elbow", "wrist"), False, False)
MILD = Controller(STRICT.joints, True, True)
NONE = [[], [], []]
SOUND = Command(
    joint_names=["wrist", "shoulder", "elbow"],
    time_from_start_ns=[0, 1, 2_000_000_000],
    positions=[[0.0, 0.1, 0.2], [0.3, 0.4, 0.5], [0.6, 0.7, 0.8]],
    velocities=[[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.0, 1.1e-7, -1.1e-7]],
    accelerations=[[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]],
    effort=NONE,
)


def changed(rows: Any, point: int, row: list[float]) -> list[list[float]]:
    return [row if index == point else old for index, old in enumerate(rows)]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({}, id="as it is"),
        pytest.param({"accelerations": NONE}, id="without accelerations"),
        pytest.param({"velocities": NONE, "accelerations": NONE}, id="positions only"),
        pytest.param({"time_from_start_ns": [5, 6, 7]}, id="first point later"),
        pytest.param(
            {
                name: getattr(SOUND, name)[:1]
                for name in ("time_from_start_ns", "positions", "accelerations", "effort")
            }
            | {"velocities": [[]]},
            id="one point",
        ),
    ],
)
def test_a_sound_trajectory_is_taken(change: dict[str, Any]) -> None:
    require_acceptable(STRICT, replace(SOUND, **change))


def test_a_controller_that_gives_up_joints_that_have_not_stopped_names_the_first() -> None:
    moves = replace(SOUND, velocities=changed(SOUND.velocities, 2, [0.0, 0.01, -0.02]))
    require_acceptable(replace(MILD, stopped_velocity_tolerance=0.02), moves)
    with pytest.raises(
        NoPlanFound, match=r"joint elbow still moves at -0\.02 .* 0\.015 rad/s"
    ) as no:
        require_acceptable(replace(MILD, stopped_velocity_tolerance=0.015), moves)
    assert no.value.status is Status.CONTROLLER_CONSTRAINT


@pytest.mark.law("PLAN-32")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joint_names": ["wrist", "shoulder", "hand"]}, "joint_names holds hand"),
        ({"joint_names": ["wrist", "shoulder", "wrist"]}, "joint_names holds wrist more than once"),
        ({"joint_names": ["wrist", "shoulder"]}, "joint_names misses elbow"),
        ({"joint_names": []}, "joint_names misses shoulder"),
        ({"time_from_start_ns": []}, "points is empty"),
        ({"time_from_start_ns": [-1, 1, 2]}, r"points\[0\].time_from_start is -1 ns"),
        ({"time_from_start_ns": [1, 1, 2]}, r"points\[1\].time_from_start is 1 ns: .* the 1 ns"),
        ({"time_from_start_ns": [0, 2, 2]}, r"points\[2\].time_from_start is 2 ns: .* the 2 ns"),
        ({"time_from_start_ns": [0, 2, 1]}, r"points\[2\].time_from_start is 1 ns"),
        ({"positions": SOUND.positions[:2]}, "positions are given for 2 points: there are 3"),
        ({"effort": []}, "effort are given for 0 points: there are 3"),
        (
            {"positions": changed(SOUND.positions, 1, [])},
            r"points\[1\].positions has 0 entries: it must have 3$",
        ),
        (
            {"velocities": changed(SOUND.velocities, 2, [0.0, 0.0])},
            r"points\[2\].velocities has 2 entries: it must have 3 or none",
        ),
        (
            {"accelerations": changed(SOUND.accelerations, 0, [0.0] * 4)},
            r"points\[0\].accelerations has 4 entries",
        ),
        (
            {"positions": changed(SOUND.positions, 1, [0.0, np.nan, 0.0])},
            r"points\[1\].positions of shoulder is nan: it must be finite",
        ),
        (
            {"velocities": changed(SOUND.velocities, 0, [0.0, 0.0, np.inf])},
            r"points\[0\].velocities of elbow is inf",
        ),
        (
            {"velocities": changed(SOUND.velocities, 2, [0.0, 0.0, -1.2e-7])},
            r"joint elbow still moves at -1.2e-07 rad/s at the last point: .* stop_joints",
        ),
        (
            {"effort": changed(NONE, 1, [1.0, 1.0, 1.0])},
            r"points\[1\].effort is given: only a controller whose command_interfaces hold effort",
        ),
    ],
)
def test_each_rule_is_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(NoPlanFound, match=words) as refused:
        require_acceptable(STRICT, replace(SOUND, **change))
    assert refused.value.status is Status.CONTROLLER_CONSTRAINT
    assert str(refused.value).startswith("a joint_trajectory_controller would not take the plan: ")


def test_a_trajectory_that_was_to_begin_before_now_comes_too_late() -> None:
    """The controller takes it until it has ended, and would jump to its middle."""
    with pytest.raises(NoPlanFound, match=r"begin 0\.500 s ago") as refused:
        require_in_time(NOW - 500_000_000, NOW)
    assert refused.value.status is Status.TOO_LATE
    with pytest.raises(NoPlanFound):
        require_in_time(NOW - 1, NOW)


def test_a_controller_that_is_set_up_for_it_takes_effort_and_joints_that_still_move() -> None:
    moving = changed(SOUND.velocities, 2, [0.5, 0.5, 0.5])
    pushed = [[1.0, 2.0, 3.0]] * 3
    require_acceptable(MILD, replace(SOUND, velocities=moving, effort=pushed))
    with pytest.raises(NoPlanFound, match=r"points\[1\].effort of wrist is nan"):
        require_acceptable(MILD, replace(SOUND, effort=changed(pushed, 1, [np.nan] * 3)))
