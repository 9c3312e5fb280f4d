"""The whole capture: planned by the node in one request, flown in MuJoCo from approach to rest."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ff_planner_msgs.msg import PlanRequest

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.demo.flights import Stage, Testbed, node_command, running, wait_for_node
from ff_planner_ros.demo.run import demonstrated
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME, Defaults, load_task
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.background import StopRequest
from ff_planner_ros.ros.client import answer_of_node, request_of_scenario
from ff_planner_ros.ros.messages.phases import efforts_of
from ff_planner_ros.ros.messages.to_messages import state_message, target_body_message
from ff_planner_ros.runs.recorded_run import recorded_run
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.whole_flight import Reached, fly

SCENARIO = "whole_capture.yaml"
# How long a node may take to offer its action [s].
_PATIENCE = 60.0
# The plan begins so many times as long after the request as it took on trial, and not sooner [s]:
# the node may have less of the machine, and shares its time among the phases.
_LEAD_PER_TRIAL, _SHORTEST_LEAD = 6.0, 10.0


def run_whole_capture(output: Path) -> int:
    """Plan the whole capture over ROS, replay it, fly it, and print what was reached.

    Returns:
        Exit code of `demonstrated`.
    """
    return demonstrated(output, _demonstrate)


def _demonstrate(directory: Path) -> None:
    config = share_directory() / "config"
    scenario, parameters = config / "scenarios" / SCENARIO, config / "planner.yaml"
    print(
        f"The whole capture ({SCENARIO}): approach, grasp, stop and stow in one request to the\n"
        "planner node. Then MuJoCo flies it: chaser and target are two free bodies, and a weld at\n"
        "the grasp holds them together. The joints follow the plan.",
        flush=True,
    )
    os.environ.update(private_environment())
    task = load_task(scenario, Defaults(load_parameters(parameters).planner))
    begun = time.monotonic()
    perform(task)  # on trial: the plan must be there before it begins
    lead = max(_SHORTEST_LEAD, math.ceil(_LEAD_PER_TRIAL * (time.monotonic() - begun)))
    command = node_command(directory, parameters, task.problem.robot)
    command += ["-p", f"planning_lead_time:={lead:.1f}"]
    shown = Testbed("The whole capture", SCENARIO, parameters.name)
    with running(command, directory / "node.log") as node:
        wait_for_node(Stage(shown, scenario, directory, node, StopRequest()))
        request = request_of_scenario(scenario, SCENARIO_FRAME, ("obstacles",))
        _begin_as_in(request, task.problem, lead)
        answer = answer_of_node(request, _PATIENCE, [])
    if answer.status.code != Status.SOLVED:
        raise FfPlannerError(Status(answer.status.code), answer.status.message)
    (bag,) = (metadata.parent for metadata in directory.glob("*/metadata.yaml"))
    with open_bag(bag) as opened:
        recorded = recorded_run(opened).requests[-1]
    replayed = replay(recorded)
    task = recorded.read_request().task.ended_at(*efforts_of(answer))
    plan = perform(task)
    print_table(
        "Reached in MuJoCo, from what was predicted",
        ("phase", "lasts [s]", "end effector [mm]", "[deg]", "chaser [mm]", "[deg]", "grasp [mm]"),
        _rows([one.duration or 0.0 for one in plan.phases], fly(task, plan)),
    )
    took = answer.solver.solve_time
    print(f"\nplanned in {took:.2f} s; replay of the bag: {replayed.verdict.value}")
    print(f"bag      {bag}")
    if replayed.verdict is not Verdict.IDENTICAL:
        raise FfPlannerError(Status.CHECK_FAILED, f"the replay is {replayed.verdict.value}")


def _begin_as_in(request: PlanRequest, problem: PlanningProblem, lead: float) -> None:
    """Bring state and body as they are before a lead time, after which they are the problem's."""
    robot, start, body = problem.robot, problem.start, problem.target_body
    before = _back_in_time(carried_forward(robot, _back_in_time(start), lead, None))
    request.start_state = [state_message(before, robot.joint_names, 0, SCENARIO_FRAME)]
    if body is not None:
        request.target_body = [target_body_message(body.after(-lead), 0, SCENARIO_FRAME)]


def _back_in_time(state: SystemState) -> SystemState:
    """Return a state in which everything moves the other way."""
    return replace(
        state,
        linear_velocity_chaser_in_inertial=-state.linear_velocity_chaser_in_inertial,
        angular_velocity_chaser_in_inertial=-state.angular_velocity_chaser_in_inertial,
        joint_velocities=-state.joint_velocities,
    )


def _rows(durations: Sequence[float], reached: Sequence[Reached]) -> list[tuple[str, ...]]:
    rows = list[tuple[str, ...]]()
    for number, (lasts, one) in enumerate(zip(durations, reached, strict=True), start=1):
        cells = list[str]()
        for metres, angle in (one.end_effector, one.chaser):
            cells += f"{1e3 * metres:.3f}", f"{math.degrees(angle):.4f}"
        rows.append((str(number), f"{lasts:.2f}", *cells, f"{1e3 * one.grasp[0]:.3f}"))
    return rows
