"""What the demonstration of replanning in motion shows, apart from its flights."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_processes import DEADLINE
from test_examples import EXAMPLES

from ff_planner_ros.demo import following
from ff_planner_ros.demo.flights import TESTBEDS
from ff_planner_ros.demo.following import (
    HEADER,
    OPEN_LOOP,
    RATE_BIAS,
    REPLANNED,
    following_figure,
    miss_by_torques_alone,
    rows,
)
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation import execution as execution_module

REPORTS = {
    OPEN_LOOP: {
        "asked": 0,
        "plans": 0,
        "error": {"position": 0.0082, "angle": 0.005},
        "way": [[0.0, 1.1], [5.0, 0.4], [10.0, 0.0082]],
    },
    REPLANNED: {
        "asked": 45,
        "plans": 44,
        "delay": 0.2,
        "solve_time_p50": 0.0187,
        "solve_time_p99": 0.0402,
        "iterations_p50": 3.0,
        "error": {"position": 0.0004, "angle": 0.0001},
        "way": [[0.0, 1.1], [5.0, 0.39], [10.0, 0.0004]],
    },
}


def test_a_row_for_each_flight_tells_how_often_and_how_fast_it_was_planned_again() -> None:
    found = list(rows(REPORTS, torques_alone=0.043))
    assert found == [
        ("torques alone", "-", "-", "-", "-", "-", "-", "43.0"),
        ("open loop", "0", "0", "-", "-", "-", "-", "8.2"),
        ("at 5 Hz", "45", "44", "200", "19", "40", "3", "0.4"),
    ]
    assert {len(row) for row in found} == {len(HEADER)}
    assert [row[0] for row in rows(REPORTS, torques_alone=None)] == ["open loop", "at 5 Hz"]


def test_the_figure_has_the_way_of_each_flight() -> None:
    (axes,) = following_figure(REPORTS).axes
    drawn = {str(line.get_label()): np.asarray(line.get_ydata())[-1] for line in axes.lines}
    assert drawn == {"open loop": pytest.approx(8.2), "at 5 Hz": pytest.approx(0.4)}
    assert axes.get_yscale() == "log"


@pytest.mark.parametrize("scene", TESTBEDS)
def test_a_flight_is_asked_for_by_options_that_its_example_has(scene: str) -> None:
    for flight in TESTBEDS[scene].flights.values():
        source = (EXAMPLES / f"{flight.example}.py").read_text("utf-8")
        for option in [word for word in flight.options if word.startswith("--")]:
            assert f'"{option}"' in source


@pytest.mark.ci
def test_a_follower_that_cannot_begin_says_why_and_writes_it(tmp_path: Path) -> None:
    scenario = tmp_path / "none.yaml"
    file = tmp_path / "report.json"
    command = [sys.executable, str(EXAMPLES / "follower.py"), str(scenario), "--json", str(file)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("follower: ")
    assert "none.yaml" in ended.stderr
    report = json.loads(file.read_text("utf-8"))
    assert report["status"] != Status.SOLVED
    assert "none.yaml" in report["message"]


def test_torques_alone_drive_a_heavier_arm_on_a_chaser_that_turns_otherwise(
    lemur: Robot, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The measured turn is the true one and the error; the chaser weighs what it should."""
    starts: list[SystemState] = []
    execute = execution_module.execute

    def kept(engine: Any, start: SystemState, torques: Any) -> Any:
        starts.append(start)
        return execute(engine, start, torques)

    monkeypatch.setattr(execution_module, "execute", kept)
    motion = lemur_plan.trajectory
    missed = miss_by_torques_alone(lemur, motion)
    assert missed is not None
    assert missed > 0.04
    turning = starts[0].angular_velocity_chaser_in_inertial - motion.chaser_angular_velocities[0]
    np.testing.assert_allclose(turning, -RATE_BIAS, atol=1e-12)
    monkeypatch.setattr(following, "RATE_BIAS", 0.0)
    by_the_arm = miss_by_torques_alone(lemur, motion)
    monkeypatch.setattr(following, "ARM_HEAVIER", 0.0)
    as_modelled = miss_by_torques_alone(lemur, motion)
    assert by_the_arm is not None
    assert as_modelled is not None
    assert as_modelled < 1e-3 < 0.01 < by_the_arm
