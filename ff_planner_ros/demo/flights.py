"""The flights of the demonstration: what is flown, and the processes that fly it."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from ff_planner_ros.analysis.methods import SHORTEST, SOONER, STEADIEST, Method
from ff_planner_ros.demo.following import ARM_HEAVIER, OPEN_LOOP, RATE_BIAS, REPLANNED
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.background import StopRequest
from ff_planner_ros.share import share_directory

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
    "lemur": Testbed("The paper's capture", "lemur_capture_bodies.yaml", "planner.yaml"),
    "lines": Testbed(
        "The paper's capture, of which the centre lines are kept clear",
        "lemur_capture.yaml",
        "planner.yaml",
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


def fly(
    method: Method,
    flight: Flight,
    shown: Testbed,
    scenario: Path,
    directory: Path,
    node: subprocess.Popen[bytes],
    stop: StopRequest,
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
                logs["testbed"]: stack.enter_context(running(testbed, logs["testbed"])),
            }
            flying = stack.enter_context(running(executive, logs["executive"]))
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


def node_command(directory: Path, parameters: Path, robot: Robot) -> list[str]:
    """Return the command that starts the planner node, whose bag is in the directory."""
    # Quoted: ROS reads the value as YAML.
    bag = f"bag.directory:={json.dumps(str(directory))}"
    node = [sys.executable, "-m", "ff_planner_ros.ros.node", "--ros-args"]
    node += ["--params-file", str(parameters), "-p", bag]
    if robot.geometry is Geometry.LINES:  # as the scenario has it; shapes are the default
        node += ["-p", "robot.geometry:=lines"]
    return node


def _example(name: str) -> list[str]:
    return [sys.executable, str(share_directory() / "examples" / f"{name}.py")]


def _check(needed: Mapping[Path, subprocess.Popen[bytes]], stop: StopRequest) -> None:
    """Raise when there is nothing more to wait for."""
    if stop.is_set():
        raise KeyboardInterrupt
    for log, process in needed.items():
        if process.poll() is not None:
            raise FfPlannerError(
                Status.INTERNAL_ERROR, f"{log.stem} ended too early:\n{log.read_text()}"
            )


@contextmanager
def running(command: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
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
