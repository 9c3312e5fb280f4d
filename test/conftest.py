"""What the tests share: robots, a plan, a planner node."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import robots
from chromium import browser  # noqa: F401 (a fixture of several files)
from shared_plans import planned

from ff_planner_ros.demo.domain import private_environment
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text

if TYPE_CHECKING:
    from ros_processes import PlannerProcess


@pytest.fixture(scope="session")
def lemur() -> Robot:
    """The paper's chaser and arm."""
    return load_robot(robots.LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.LINES)


@pytest.fixture(scope="session", params=list(robots.ROBOTS))
def robot(request: pytest.FixtureRequest) -> Robot:
    """One robot after the other: what holds for any robot."""
    return robot_from_urdf_text(*robots.ROBOTS[request.param])


@pytest.fixture(scope="session")
def lemur_capture() -> PlanningProblem:
    """The paper's capture."""
    return load_scenario(robots.LEMUR_SCENARIO)


@pytest.fixture(scope="session")
def lemur_plan(lemur_capture: PlanningProblem) -> Plan:
    """The paper's capture on the shortest joint path."""
    return planned(lemur_capture)


@pytest.fixture(scope="session")
def offline_bag(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The plan of the paper's capture in a bag, as `ff-planner plan --bag` writes it."""
    from ff_planner_ros.runs.offline_bag import record_answer

    bag = tmp_path_factory.mktemp("bags") / "offline"
    record_answer(bag, PlanningTask(lemur_capture, load_parameters().planner), lemur_plan, 0.5)
    return bag


@pytest.fixture(scope="session")
def standing_planner(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[PlannerProcess, dict[str, str]]]:
    """A worker's own planner node, and its domain."""
    # Not above: other tests run where ROS is not installed.
    from ros_processes import private_domain, running_planner

    environment = private_environment()
    patient = ("-p", "planning_lead_time:=60.0", "-p", "state_max_age:=3600.0")
    with ExitStack() as until_the_end:
        with private_domain(environment):
            node = running_planner(tmp_path_factory.mktemp("standing"), *patient)
            running = until_the_end.enter_context(node)
        yield running, environment


@pytest.fixture(scope="module")
def planner(standing_planner: tuple[PlannerProcess, dict[str, str]]) -> Iterator[PlannerProcess]:
    """The worker's node, for tests that bring state and scene and neither start nor stop it."""
    from ros_processes import private_domain

    running, environment = standing_planner
    with private_domain(environment):
        yield running
