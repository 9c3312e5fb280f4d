"""The demonstration: a capture, planned and flown in real time by processes over ROS."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.figures import save_figures
from ff_planner_ros.analysis.drawing.scene import save_scene
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.bag.writer import unique_directory
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.demo.flights import (
    TESTBEDS,
    Stage,
    Testbed,
    fly,
    node_command,
    plans_on_trial,
    running,
    wait_for_node,
)
from ff_planner_ros.demo.following import (
    HEADER,
    OPEN_LOOP,
    REPLANNED,
    following_figure,
    miss_by_torques_alone,
    rows,
)
from ff_planner_ros.demo.mission import exit_code
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import load_task
from ff_planner_ros.robot.rotation import euler_from_rotation
from ff_planner_ros.ros.process import StopRequest


def run_demo(
    output: Path = Path("demo_output"), scenario: Path | None = None, testbed: str = "lemur"
) -> int:
    """Run the two flights of a testbed and show the results; each plan is made on trial first.

    Args:
        output: Directory in which a new one is created for the results.
        scenario: Scenario file; None: that of the testbed.
        testbed: Key of `TESTBEDS`.

    Returns:
        Exit code of `demonstrated`.
    """
    stop = StopRequest()
    shown, config = TESTBEDS[testbed], share_directory() / "config"
    found, parameters = scenario or config / "scenarios" / shown.scenario, config / shown.parameters
    return demonstrated(
        output, lambda directory: _demonstrate(shown, directory, found.resolve(), parameters, stop)
    )


def demonstrated(output: Path, demonstrate: Callable[[Path], None]) -> int:
    """Run a demonstration in a new directory below `output`, and print the error if it fails.

    Returns:
        Exit code: 0 flown, 2 something could not run, 3 a plan was not found, 130 interrupted.
    """
    directory = unique_directory(output.resolve(), "demo")
    try:
        directory.mkdir(parents=True)
        demonstrate(directory)
    except KeyboardInterrupt:
        print("ff-planner demo: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"ff-planner demo: {error}", file=sys.stderr)
        return 2
    except FfPlannerError as error:
        print(f"ff-planner demo: {error}\nlogs are in {_shown(directory)}", file=sys.stderr)
        return exit_code(error)
    return 0


def _demonstrate(
    shown: Testbed, directory: Path, scenario: Path, parameters: Path, stop: StopRequest
) -> None:
    task = load_task(scenario, load_parameters(parameters).of_scenarios())
    problem = task.problem
    print(
        f"{shown.title} ({_shown(scenario)}): {problem.robot.joints} joints, "
        f"{len(problem.obstacles)} obstacles, {problem.duration:g} s, {problem.points} points.\n"
        "Three processes talk over ROS 2: planner node, simulated testbed, mission executive. The\n"
        "chaser drifts while the planner plans ahead, and passes through the published start when\n"
        "the plan begins. How long ahead is measured: each plan is made on trial while the node\n"
        "starts. Both flights are in real time.",
        flush=True,
    )
    os.environ.update(private_environment())
    flown: dict[Method, dict[str, Any]] = {}
    with running(
        node_command(directory, parameters, problem.robot), directory / "node.log"
    ) as node:
        begun = time.monotonic()
        stage = Stage(shown, scenario, directory, node, stop)
        planning = plans_on_trial(shown.flights, task)
        wait_for_node(stage)
        starting = time.monotonic() - begun
        plans = ", ".join(f"{method.name} in {took:.2f} s" for method, took in planning.items())
        print(f"\nplanned on trial: {plans}; the node was ready after {starting:.1f} s", flush=True)
        for method, flight in shown.flights.items():
            flown[method] = fly(method, flight, stage, starting + planning[method])
    (bag,) = (metadata.parent for metadata in directory.glob("*/metadata.yaml"))
    by_id = {one.plan_id: one for one in read_plans(bag)}
    recorded = {method: by_id[report["plan_id"]] for method, report in flown.items()}
    found = {method: one.trajectory for method, one in recorded.items()}
    motions = {method: motion for method, motion in found.items() if motion is not None}

    print_table(
        "Plans, and deviations at their end",
        (
            *("objective", "joint path [rad]", "Euler angle [deg]", "clearance [mm]"),
            *("solve time [s]", "deviation [mm]", "deviation [deg]"),
        ),
        [
            _figures(method.name, recorded[method].metrics, report)
            for method, report in flown.items()
        ],
    )
    print_table(
        "End effector when the plan is over",
        ("", "objective", "x [m]", "y [m]", "z [m]", "phi [deg]", "theta [deg]", "psi [deg]"),
        [
            (which, method.name, *_pose(report[which]))
            for method, report in flown.items()
            for which in ("predicted", "reached")
        ],
    )
    if problem.target_body is not None:
        print_table(
            "End effector at the capture, as the grasp sees it",
            ("objective", "after [s]", "apart [mm]", "[deg]", "moving apart [mm/s]", "[deg/s]"),
            [
                (method.name, f"{report['duration']:.3f}", *_relative(report["capture"]))
                for method, report in flown.items()
                if report["capture"] is not None
            ],
        )
    following = REPLANNED in flown
    if following:
        torques_alone = miss_by_torques_alone(problem.robot, motions[OPEN_LOOP])
        print_table("Planned again on the way", HEADER, list(rows(flown, torques_alone)))
    print(f"\nbag      {_shown(bag)}", flush=True)
    stop.check()
    pictures = save_figures(problem, motions, directory)
    if following:
        pictures.append(directory / "following.png")
        following_figure(flown).savefig(pictures[-1], dpi=150)
    for picture in pictures:
        print(f"picture  {_shown(picture)}")
    scene = directory / "scene.html"
    save_scene(problem, motions, motions, scene)
    print(f"scene    {_shown(scene)}")


def _figures(name: str, metrics: Mapping[str, Any], report: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        name,
        f"{metrics['joint_path_length']:.4f}",
        f"{math.degrees(metrics['max_chaser_euler']):.2f}",
        f"{metrics['min_clearance'] * 1e3:.1f}",
        f"{report['solve_time']:.2f}",
        f"{report['error']['position'] * 1e3:.3f}",
        f"{math.degrees(report['error']['angle']):.4f}",
    )


def _relative(capture: Mapping[str, float]) -> tuple[str, ...]:
    return (
        f"{capture['position_error'] * 1e3:.3f}",
        f"{math.degrees(capture['orientation_error']):.4f}",
        f"{capture['linear_speed'] * 1e3:.3f}",
        f"{math.degrees(capture['angular_speed']):.4f}",
    )


def _pose(pose: Mapping[str, list[float]]) -> tuple[str, ...]:
    turn = Rotation.from_quat(pose["quaternion_xyzw"]).as_matrix()
    angles = np.rad2deg(euler_from_rotation(np.asarray(turn)))
    return (*(f"{x:.4f}" for x in pose["position"]), *(f"{angle:.2f}" for angle in angles))


def _shown(path: Path) -> Path:
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
