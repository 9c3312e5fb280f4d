"""The demonstration: the paper's capture, planned by real processes that talk over ROS."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from ff_planner_msgs.srv import PlanTrajectory

from ff_planner_ros.analysis.figures import save_figures
from ff_planner_ros.analysis.methods import OBJECTIVES, SHORTEST, STEADIEST, Method
from ff_planner_ros.analysis.scene import save_scene
from ff_planner_ros.bag.writer import unique_directory
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.scenario import SCENARIO_FRAME, load_scenario
from ff_planner_ros.ros.domain import private_environment
from ff_planner_ros.ros.executive import MissionExecutive
from ff_planner_ros.ros.from_messages import plan_from_response
from ff_planner_ros.ros.to_messages import request_message
from ff_planner_ros.share import share_directory

_METHODS = (SHORTEST, STEADIEST)
_COLUMNS = ("objective", "joint path [rad]", "attitude [deg]", "clearance [mm]", "solve time [s]")
_PATIENCE = 120.0  # [s] far more than the slowest machine needs
_GRACE = 20.0  # [s] for a process to end after it was asked to


def run_demo(output: Path = Path("demo_output")) -> int:
    """Plan the paper's capture for both objectives and show the result.

    Args:
        output: Every run makes a new directory in here.

    Returns:
        Exit code: 0 both solved, 2 something could not run, 3 a plan was not found,
        130 interrupted.
    """
    # Only noted: an exception out of nowhere could be lost, or leave a process without its owner.
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    directory = unique_directory(output.resolve(), "demo")
    try:
        directory.mkdir(parents=True)
        _demonstrate(directory, stop)
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


def _demonstrate(directory: Path, stop: threading.Event) -> None:
    scenario = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
    problem = load_scenario(scenario)
    print(
        f"The paper's capture ({_shown(scenario)}): {problem.robot.joints} joints, "
        f"{len(problem.obstacles)} obstacles, {problem.duration:g} s, {problem.points} points.\n"
        "Three processes talk over ROS 2: planner node, chaser, mission executive. The chaser\n"
        "here only repeats its initial state, so both plans start from the published benchmark.\n"
        f"\n{_line(_COLUMNS)}",
        flush=True,
    )
    os.environ.update(private_environment())
    answers: dict[Method, PlanTrajectory.Response] = {}
    with ExitStack() as stack:
        arguments = {
            "mock_chaser": [str(scenario)],
            # Quoted: ROS reads the value as YAML.
            "node": ["--ros-args", "-p", f"bag.directory:={json.dumps(str(directory))}"],
        }
        processes = {
            module: stack.enter_context(_running(module, rest, _log(directory, module)))
            for module, rest in arguments.items()
        }

        def check() -> None:
            if stop.is_set():
                raise KeyboardInterrupt
            for module, process in processes.items():
                if process.poll() is not None:
                    raise FfPlannerError(
                        Status.INTERNAL_ERROR,
                        f"{module} ended too early:\n{_log(directory, module).read_text()}",
                    )

        executive = stack.enter_context(closing(MissionExecutive(check, _PATIENCE)))
        for method in _METHODS:
            asked = replace(problem, objective=OBJECTIVES[method])
            answers[method] = executive.plan(request_message(asked, SCENARIO_FRAME))
            print(_line(_figures(method.name, answers[method])), flush=True)

    bag = next(metadata.parent for metadata in directory.glob("*/metadata.yaml"))
    print(f"\nbag      {_shown(bag)}")
    if stop.is_set():
        raise KeyboardInterrupt
    plans = {method: plan_from_response(answer) for method, answer in answers.items()}
    for picture in save_figures(problem, plans, directory):
        print(f"picture  {_shown(picture)}")
    scene = directory / "scene.html"
    save_scene(problem, plans, plans, scene)
    print(f"scene    {_shown(scene)}")


@contextmanager
def _running(module: str, arguments: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a module of this room in a process of its own; stop it cleanly at the end."""
    command = [sys.executable, "-m", f"ff_planner_ros.ros.{module}", *arguments]
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


def _figures(name: str, response: PlanTrajectory.Response) -> tuple[str, ...]:
    metrics = response.metrics
    return (
        name,
        f"{metrics.joint_path_length:.4f}",
        f"{math.degrees(metrics.max_chaser_euler):.2f}",
        f"{metrics.min_clearance * 1e3:.1f}",
        f"{response.solver.solve_time:.2f}",
    )


def _line(cells: tuple[str, ...]) -> str:
    name, *numbers = (cell.rjust(len(head)) for cell, head in zip(cells, _COLUMNS, strict=True))
    return "   ".join([name.strip().ljust(10), *numbers])


def _log(directory: Path, module: str) -> Path:
    return directory / f"{module}.log"


def _shown(path: Path) -> Path:
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
