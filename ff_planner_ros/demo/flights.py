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

# A plan is made on trial before each flight: how long that takes from the start of the processes to
# the plan is measured. The plan that is flown begins so many times as long after their start, so
# that it is there in time even if only half as much of the machine is free by then.
_LEAD_PER_MEASURED = 2.0
_TRIAL_LEAD = 180  # until the plan on trial would begin: it is not to be late on any machine [s]
# A machine that has become far slower since is measured once more.
_ATTEMPTS = 2
_TOO_SLOW = (Status.TOO_LATE, Status.START_IN_PAST, Status.OUT_OF_TIME)
_GRACE = 60.0  # [s] for a process to end after it was asked to: on a slow machine, too
_LOOK_INTERVAL = 0.1  # [s] between looks at the processes
_READY = "]: ready; "  # says the node's log when it answers requests


class Flight(NamedTuple):
    """A flight by one of the examples."""

    name: str  # of its files
    options: tuple[str, ...]  # of the example
    example: str = "mission_executive"


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
            SOONER: Flight("sooner", ("--objective", "sooner", "--durations", "8.0", "12.0")),
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


class Stage(NamedTuple):
    """Where flights take place."""

    shown: Testbed
    scenario: Path
    directory: Path  # of reports and logs
    node: subprocess.Popen[bytes]
    stop: StopRequest


def fly(method: Method, flight: Flight, stage: Stage) -> dict[str, Any]:
    """Measure how long a plan takes, fly one that begins when it will be there; return its report.

    Raises:
        FfPlannerError: A plan is refused, or a process ended.
    """
    _wait_for_node(stage)
    for attempt in range(1, _ATTEMPTS + 1):
        name = flight.name if attempt == 1 else f"{flight.name}_{attempt}"
        print(f"\nplanning {method.name} on trial", flush=True)
        begun = time.monotonic()
        trial = _run_example(f"{name}_trial", flight, stage, _TRIAL_LEAD, "--plan-only")
        _require_solved(trial)
        measured = time.monotonic() - begun
        lead = math.ceil(_LEAD_PER_MEASURED * measured)
        print(
            f"measured {measured:.1f} s with the start and the end of testbed and executive, "
            f"{trial['solve_time']:.2f} s for the plan alone\n"
            f"flying {method.name}: the plan begins in {lead} s",
            flush=True,
        )
        report = _run_example(name, flight, stage, lead)
        if report["status"] not in _TOO_SLOW or attempt == _ATTEMPTS:
            break
        print(f"too late, measuring again; end other programs if you can: {report['message']}")
    _require_solved(report)
    return report


def _wait_for_node(stage: Stage) -> None:
    """Wait until the planner node is ready: its start is not a part of what is measured."""
    log = stage.directory / "node.log"
    while _READY not in log.read_text(encoding="utf-8"):
        _check({log: stage.node}, stage.stop)
        time.sleep(_LOOK_INTERVAL)


def _run_example(
    name: str, flight: Flight, stage: Stage, lead: int, *options: str
) -> dict[str, Any]:
    """Run a testbed and an example whose plan begins in so long [s]; return the latter's report.

    Report and logs have files of their own: none is taken for another run's.
    """
    report = stage.directory / f"{name}.json"
    epoch = str(math.ceil(time.time()) + lead)
    testbed = [*_example("simulated_testbed"), str(stage.scenario), "--epoch", epoch]
    testbed += stage.shown.imperfections
    executive = [*_example(flight.example), str(stage.scenario), *flight.options, *options]
    executive += ["--start", epoch, "--json", str(report)]
    with ExitStack() as stack:
        logs = {word: stage.directory / f"{name}_{word}.log" for word in ("testbed", "executive")}
        needed = {
            stage.directory / "node.log": stage.node,
            logs["testbed"]: stack.enter_context(running(testbed, logs["testbed"])),
        }
        flying = stack.enter_context(running(executive, logs["executive"]))
        while flying.poll() is None:
            _check(needed, stage.stop)
            with suppress(subprocess.TimeoutExpired):
                flying.wait(_LOOK_INTERVAL)
    if not report.is_file():
        _check(needed={logs["executive"]: flying}, stop=stage.stop)
    told: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return told


def _require_solved(report: Mapping[str, Any]) -> None:
    if report["status"] != Status.SOLVED:
        raise FfPlannerError(Status(report["status"]), report["message"])


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
