"""The flights of the demonstration, and the processes that fly them."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ff_planner_ros.analysis.methods import OBJECTIVES, SHORTEST, SOONER, STEADIEST, Method
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.demo.following import ARM_HEAVIER, OPEN_LOOP, RATE_BIAS, REPLANNED
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.problem.problem import DurationRange, Objective, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.process import StopRequest

# The time to start a ROS process and to make the plan is measured. A plan that is flown begins this
# many times as long after the start of its processes, so that it is in time even on a busier
# machine; after a plan that was late, twice as many.
_LEAD_PER_MEASURED = 1.5
_ATTEMPTS = 3
_TOO_SLOW = (Status.TOO_LATE, Status.START_IN_PAST, Status.TIMED_OUT)
_GRACE = 60.0  # [s] for a process to end after it was asked to: on a slow machine, too
_LOOK_INTERVAL = 0.1  # [s] between looks at the processes
_READY = "]: ready; "  # in the node's log once it answers requests


class Flight(NamedTuple):
    """A flight by one of the examples."""

    name: str  # of its report and logs
    options: tuple[str, ...]  # of the example
    changes: Mapping[str, Any]  # changed fields of the scenario's problem, as by the options
    example: str = "mission_executive"  # in examples/

    def problem(self, scenario: PlanningProblem) -> PlanningProblem:
        """Return the problem that the example plans, to plan it on trial."""
        return replace(scenario, **self.changes)


_BOTH_OBJECTIVES: Mapping[Method, Flight] = {
    method: Flight(name, ("--objective", name), {"objective": OBJECTIVES[method]})
    for method, name in ((SHORTEST, "length"), (STEADIEST, "attitude"))
}
_DURATIONS = DurationRange(8.0, 12.0)  # [s]


class Testbed(NamedTuple):
    """A demonstration: its scenario, parameters and flights."""

    title: str
    scenario: str  # in config/scenarios
    parameters: str  # of the node, in config
    flights: Mapping[Method, Flight] = _BOTH_OBJECTIVES
    imperfections: tuple[str, ...] = ()  # options of the simulated testbed


TESTBEDS: Mapping[str, Testbed] = {
    "lemur": Testbed("The paper's capture", "lemur_capture_bodies.yaml", "ends_in_motion.yaml"),
    "lines": Testbed(
        "The paper's capture, of which the centre lines are kept clear",
        "lemur_capture.yaml",
        "ends_in_motion.yaml",
    ),
    "planar": Testbed(
        "A capture on an air-bearing table", "planar_capture.yaml", "planar_testbed.yaml"
    ),
    "tumbling": Testbed(
        "The capture of a body that tumbles",
        "lemur_tumbling.yaml",
        "ends_in_motion.yaml",
        {
            SHORTEST: _BOTH_OBJECTIVES[SHORTEST],
            SOONER: Flight(
                "sooner",
                (
                    *("--objective", "sooner"),
                    *("--durations", f"{_DURATIONS.minimum}", f"{_DURATIONS.maximum}"),
                ),
                {
                    "objective": Objective(1.0, 0.0, 0.02),  # as the example has it
                    "duration": _DURATIONS.maximum,
                    "duration_range": _DURATIONS,
                },
            ),
        },
    ),
    "following": Testbed(
        "The paper's capture by a testbed that is not as its model",
        "lemur_capture.yaml",
        "ends_in_motion.yaml",
        {
            OPEN_LOOP: Flight("open_loop", ("--rate", "0"), {}, "follower"),
            REPLANNED: Flight("replanned", ("--rate", "5"), {}, "follower"),
        },
        ("--arm-heavier", f"{ARM_HEAVIER}", "--rate-bias", f"{RATE_BIAS:.6f}"),
    ),
}


class Stage(NamedTuple):
    """A running demonstration."""

    shown: Testbed
    scenario: Path
    directory: Path  # of reports and logs
    node: subprocess.Popen[bytes]  # the planner node
    stop: StopRequest


def fly(method: Method, flight: Flight, stage: Stage, seconds: float) -> dict[str, Any]:
    """Run a flight whose plan begins once it can be ready, and return its report.

    Args:
        seconds: Measured time to start a process and to make the plan [s].

    Raises:
        FfPlannerError: The plan is refused, or a process ended.
    """
    for attempt in range(1, _ATTEMPTS + 1):
        name = flight.name if attempt == 1 else f"{flight.name}_{attempt}"
        lead = math.ceil(_LEAD_PER_MEASURED * 2 ** (attempt - 1) * seconds)
        print(f"\nflying {method.name}: the plan begins in {lead} s", flush=True)
        report = _run_example(name, flight, stage, lead)
        if report["status"] not in _TOO_SLOW or attempt == _ATTEMPTS:
            break
        print(f"too late, later once more; end other programs if you can: {report['message']}")
    if report["status"] != Status.SOLVED:
        raise FfPlannerError(Status(report["status"]), report["message"])
    return report


def plans_on_trial(flights: Mapping[Method, Flight], task: PlanningTask) -> dict[Method, float]:
    """Make each plan once, and return the wall times [s].

    Raises:
        FfPlannerError: A plan is refused.
    """
    seconds = {}
    for method, flight in flights.items():
        begun = time.monotonic()
        perform(replace(task, problem=flight.problem(task.problem)))
        seconds[method] = time.monotonic() - begun
    return seconds


def wait_for_node(stage: Stage) -> None:
    """Wait until the planner node is ready.

    Raises:
        FfPlannerError: The node ended.
    """
    log = stage.directory / "node.log"
    while _READY not in log.read_text(encoding="utf-8"):
        _check({log: stage.node}, stage.stop)
        time.sleep(_LOOK_INTERVAL)


def _run_example(name: str, flight: Flight, stage: Stage, lead: int) -> dict[str, Any]:
    """Run a testbed and an example whose plan begins after `lead` [s]; return its report.

    Report and logs have files of their own: none is taken for another run's.
    """
    report = stage.directory / f"{name}.json"
    epoch = str(math.ceil(time.time()) + lead)
    testbed = [*_example("simulated_testbed"), str(stage.scenario), "--epoch", epoch]
    testbed += stage.shown.imperfections
    executive = [*_example(flight.example), str(stage.scenario), *flight.options]
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


def node_command(directory: Path, parameters: Path, robot: Robot) -> list[str]:
    """Return the command that starts the planner node, with its bag in a directory."""
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
    """Raise if the user has stopped the demonstration, or a process has ended."""
    stop.check()
    for log, process in needed.items():
        if process.poll() is not None:
            raise FfPlannerError(
                Status.INTERNAL_ERROR, f"{log.stem} ended too early:\n{log.read_text()}"
            )


@contextmanager
def running(command: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process with its output in a log, and stop it by SIGINT at the end."""
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
