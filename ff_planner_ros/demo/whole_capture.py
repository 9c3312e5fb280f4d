"""The demonstration of a whole capture: planned in one request, flown from approach to rest.

It is flown twice: in real time over ROS, by executive and simulated testbed, and in MuJoCo.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.bag.exchanges import exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.demo.flights import Flight, Stage, Testbed, node_command, running, wait_for_node
from ff_planner_ros.demo.flights import fly as fly_over_ros
from ff_planner_ros.demo.run import demonstrated
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.ros.process import StopRequest
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.whole_flight import fly

SCENARIO = "whole_capture.yaml"
_HEADER = ("phase", "end effector [mm]", "[deg]", "chaser [mm]", "[deg]", "grasp [mm]", "[deg]")


def run_whole_capture(output: Path) -> int:
    """Plan the whole capture over ROS, fly it, replay it, fly it in MuJoCo; print the errors.

    Returns:
        Exit code of `demonstrated`.
    """
    stop = StopRequest()
    return demonstrated(output, lambda directory: _demonstrate(directory, stop))


def _demonstrate(directory: Path, stop: StopRequest) -> None:
    config = share_directory() / "config"
    scenario, parameters = config / "scenarios" / SCENARIO, config / "planner.yaml"
    print(
        f"The whole capture ({SCENARIO}): approach, grasp, stop and stow in one request to the\n"
        "planner node. First executive and simulated testbed fly it over ROS in real time: an\n"
        "impact joins chaser and target at the grasp. Then MuJoCo does: chaser and target are two\n"
        "free bodies, and a weld holds them together. The joints follow the plan.",
        flush=True,
    )
    os.environ.update(private_environment())
    task = load_task(scenario, Defaults(load_parameters(parameters).planner))
    command = node_command(directory, parameters, task.problem.robot)
    shown = Testbed("The whole capture", SCENARIO, parameters.name)
    begun = time.monotonic()
    with running(command, directory / "node.log") as node:
        stage = Stage(shown, scenario, directory, node, stop)
        perform(task)  # on trial: the plan must be there before it begins
        planning = time.monotonic() - begun
        wait_for_node(stage)
        starting = time.monotonic() - begun
        # The phases share the time until the start equally, and the first one needs the longest.
        lead = starting + (1 + len(task.then)) * planning
        report = fly_over_ros(PLANNED, Flight("whole", (), {}), stage, lead)
    (bag,) = (metadata.parent for metadata in directory.glob("*/metadata.yaml"))
    with open_bag(bag) as opened:
        *_, recorded = exchanges(opened)
    replayed, task = replay(recorded), recorded.planned_task()
    phases = report["phases"]
    print_table("Deviations from the prediction, over ROS", _HEADER, _rows(map(_off, phases)))
    in_mujoco = ((one.end_effector, one.chaser, one.grasp) for one in fly(task, perform(task)))
    print_table("Deviations from the prediction, in MuJoCo", _HEADER, _rows(in_mujoco))
    took = report["solve_time"]
    print(f"\nplanned in {took:.2f} s; replay of the bag: {replayed.verdict.value}")
    print(f"bag      {bag}")
    if replayed.verdict is not Verdict.IDENTICAL:
        raise FfPlannerError(Status.CHECK_FAILED, f"the replay is {replayed.verdict.value}")


def _off(phase: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Return the errors at the end of a phase of a report; of the chaser, the worst until then."""
    grasp = phase["capture"]
    return [
        *((one["position"], one["angle"]) for one in (phase["error"], phase["worst_chaser_error"])),
        (grasp["position_error"], grasp["orientation_error"]),
    ]


def _rows(phases: Iterable[Sequence[tuple[float, float]]]) -> list[tuple[str, ...]]:
    """Return the cells of `_HEADER`, a row for each phase."""
    return [
        (
            str(number),
            *(
                cell
                for metres, angle in found
                for cell in (f"{1e3 * metres:.3f}", f"{math.degrees(angle):.4f}")
            ),
        )
        for number, found in enumerate(phases, start=1)
    ]
