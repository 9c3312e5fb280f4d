"""The demonstration: the paper's capture, planned and flown by processes that talk over ROS."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.figures import save_figures
from ff_planner_ros.analysis.methods import SHORTEST, SOONER, STEADIEST, Method
from ff_planner_ros.analysis.scene import save_scene
from ff_planner_ros.bag.robot_plans import robot_plans
from ff_planner_ros.bag.writer import unique_directory
from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.demo.following import (
    ARM_HEAVIER,
    HEADER,
    OPEN_LOOP,
    RATE_BIAS,
    REPLANNED,
    following_figure,
    miss_by_torques_alone,
    rows,
)
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import euler_from_rotation
from ff_planner_ros.ros.background import stop_on_signals
from ff_planner_ros.share import share_directory
from ff_planner_ros.text_table import print_table

# From the start of the testbed until the chaser passes through the scenario's start [s]: time to
# find each other and to plan. A machine that needs longer is given it.
_LEADS = (7, 20, 60)
_NEEDS_LONGER = (Status.TOO_LATE, Status.START_IN_PAST, Status.OUT_OF_TIME)
_GRACE = 60.0  # [s] for a process to end after it was asked to: on a slow machine, too
_LOOK_INTERVAL = 0.1  # [s] between looks at the processes


class Flight(NamedTuple):
    """A flight by one of the examples."""

    name: str  # of its files
    options: tuple[str, ...]  # of the example
    example: str = "mission_executive"
    shortest_lead: int = 0  # [s]


_BOTH_OBJECTIVES: Mapping[Method, Flight] = {
    SHORTEST: Flight("length", ("--objective", "length")),
    STEADIEST: Flight("attitude", ("--objective", "attitude")),
}


class Testbed(NamedTuple):
    """What is demonstrated."""

    title: str
    scenario: str  # in config/scenarios
    parameters: str  # of the node, in config
    flights: Mapping[Method, Flight] = _BOTH_OBJECTIVES
    imperfections: tuple[str, ...] = ()  # options of the simulated testbed


TESTBEDS: Mapping[str, Testbed] = {
    "lemur": Testbed("The paper's capture", "lemur_capture.yaml", "planner.yaml"),
    "bodies": Testbed(
        "The paper's capture with the whole robot", "lemur_capture_bodies.yaml", "planner.yaml"
    ),
    "planar": Testbed(
        "A capture on an air-bearing table", "planar_capture.yaml", "planar_testbed.yaml"
    ),
    "tumbling": Testbed(
        "The capture of a body that tumbles",
        "lemur_tumbling.yaml",
        "planner.yaml",
        {
            SHORTEST: _BOTH_OBJECTIVES[SHORTEST],
            SOONER: Flight(
                "sooner",
                ("--objective", "sooner", "--durations", "8.0", "12.0"),
                shortest_lead=20,
            ),
        },
    ),
    "following": Testbed(
        "The paper's capture by a testbed that is not as its model",
        "lemur_capture.yaml",
        "planner.yaml",
        {
            OPEN_LOOP: Flight("open_loop", ("--rate", "0"), "follower"),
            REPLANNED: Flight("replanned", ("--rate", "5"), "follower"),
        },
        ("--arm-heavier", f"{ARM_HEAVIER}", "--rate-bias", f"{RATE_BIAS:.6f}"),
    ),
}


def run_demo(
    output: Path = Path("demo_output"), scenario: Path | None = None, testbed: str = "lemur"
) -> int:
    """Plan and fly a capture twice and show the result.

    Args:
        scenario: None: that of the testbed.
        testbed: One of `TESTBEDS`.

    Returns:
        Exit code: 0 both flown, 2 something could not run, 3 a plan was not found,
        130 interrupted.
    """
    stop = stop_on_signals()
    shown, config = TESTBEDS[testbed], share_directory() / "config"
    scenario = scenario or config / "scenarios" / shown.scenario
    directory = unique_directory(output.resolve(), "demo")
    try:
        directory.mkdir(parents=True)
        _demonstrate(shown, directory, scenario.resolve(), config / shown.parameters, stop)
    except KeyboardInterrupt:
        print("ff-planner demo: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"ff-planner demo: {error}", file=sys.stderr)
        return 2
    except FfPlannerError as error:
        print(f"ff-planner demo: {error}\nlogs are in {_shown(directory)}", file=sys.stderr)
        return 3 if Status.GOAL_OUT_OF_REACH <= error.status < Status.INTERNAL_ERROR else 2
    return 0


def _demonstrate(
    shown: Testbed, directory: Path, scenario: Path, parameters: Path, stop: threading.Event
) -> None:
    problem = load_scenario(scenario)
    print(
        f"{shown.title} ({_shown(scenario)}): {problem.robot.joints} joints, "
        f"{len(problem.obstacles)} obstacles, {problem.duration:g} s, {problem.points} points.\n"
        "Three processes talk over ROS 2: planner node, simulated testbed, mission executive. The\n"
        "chaser drifts while the planner plans ahead, and passes through the published start when\n"
        "the plan begins. Both flights are in real time.",
        flush=True,
    )
    os.environ.update(private_environment())
    flown: dict[Method, dict[str, Any]] = {}
    with _running(_node(directory, parameters, problem.robot), directory / "node.log") as node:
        for method, flight in shown.flights.items():
            flown[method] = _fly(method, flight, shown, scenario, directory, node, stop)
    (bag,) = (metadata.parent for metadata in directory.glob("*/metadata.yaml"))
    recorded = robot_plans(bag)
    ids = {method: report["plan_id"] for method, report in flown.items()}
    motions = {method: recorded.motions[plan_id] for method, plan_id in ids.items()}

    print_table(
        "Planned, and off by how much in the end",
        (
            *("objective", "joint path [rad]", "attitude [deg]", "clearance [mm]"),
            *("solve time [s]", "off by [mm]", "off by [deg]"),
        ),
        [
            _figures(method.name, recorded.metrics[ids[method]], report)
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
    if stop.is_set():
        raise KeyboardInterrupt
    pictures = save_figures(problem, motions, directory)
    if following:
        pictures.append(directory / "following.png")
        following_figure(flown).savefig(pictures[-1], dpi=150)
    for picture in pictures:
        print(f"picture  {_shown(picture)}")
    scene = directory / "scene.html"
    save_scene(problem, motions, motions, scene)
    print(f"scene    {_shown(scene)}")


def _fly(
    method: Method,
    flight: Flight,
    shown: Testbed,
    scenario: Path,
    directory: Path,
    node: subprocess.Popen[bytes],
    stop: threading.Event,
) -> dict[str, Any]:
    """Start testbed and executive, wait until the executive is done, and return its report."""
    name = flight.name
    leads = [lead for lead in _LEADS if lead >= flight.shortest_lead]
    for number, lead in enumerate(leads, 1):
        # Each attempt has files of its own: no report or log of the one before is taken for its.
        attempt = name if number == 1 else f"{name}_{number}"
        report = directory / f"{attempt}.json"
        epoch = math.ceil(time.time()) + lead
        print(f"\nflying {method.name}: the plan begins in {lead} s", flush=True)
        testbed = [*_example("simulated_testbed"), str(scenario), "--epoch", str(epoch)]
        testbed += shown.imperfections
        executive = [*_example(flight.example), str(scenario), *flight.options]
        executive += ["--start", str(epoch), "--json", str(report)]
        with ExitStack() as stack:
            logs = {word: directory / f"{attempt}_{word}.log" for word in ("testbed", "executive")}
            needed = {
                directory / "node.log": node,
                logs["testbed"]: stack.enter_context(_running(testbed, logs["testbed"])),
            }
            flying = stack.enter_context(_running(executive, logs["executive"]))
            while flying.poll() is None:
                _check(needed, stop)
                with suppress(subprocess.TimeoutExpired):
                    flying.wait(_LOOK_INTERVAL)
        if not report.is_file():
            _check(needed={logs["executive"]: flying}, stop=stop)
        told: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
        status = Status(told["status"])
        if status is Status.SOLVED:
            return told
        if status not in _NEEDS_LONGER or lead == leads[-1]:
            raise FfPlannerError(status, told["message"])
        print(f"this machine needs longer: {told['message']}")
    raise FfPlannerError(Status.INTERNAL_ERROR, "no lead to try")


def _node(directory: Path, parameters: Path, robot: Robot) -> list[str]:
    # Quoted: ROS reads the value as YAML.
    bag = f"bag.directory:={json.dumps(str(directory))}"
    geometry = ["-p", f"robot.geometry:={robot.geometry}"]  # as the scenario has it
    node = [sys.executable, "-m", "ff_planner_ros.ros.node", "--ros-args"]
    return [*node, "--params-file", str(parameters), "-p", bag, *geometry]


def _example(name: str) -> list[str]:
    return [sys.executable, str(share_directory() / "examples" / f"{name}.py")]


def _check(needed: Mapping[Path, subprocess.Popen[bytes]], stop: threading.Event) -> None:
    """Raise when there is nothing more to wait for."""
    if stop.is_set():
        raise KeyboardInterrupt
    for log, process in needed.items():
        if process.poll() is not None:
            raise FfPlannerError(
                Status.INTERNAL_ERROR, f"{log.stem} ended too early:\n{log.read_text()}"
            )


@contextmanager
def _running(command: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process and stop it cleanly at the end."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE)
        process.kill()
        process.wait()


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
