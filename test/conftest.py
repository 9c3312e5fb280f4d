"""Robots that the tests share."""

from __future__ import annotations

from itertools import groupby

import pytest
import robots

from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.settings import load_settings
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let files of tests run side by side, but never two that start processes of ROS."""
    for path, of_file in groupby(items, key=lambda item: item.path):
        group = "ros" if "ros_processes" in path.read_text("utf-8") else path.name
        for item in of_file:
            item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(scope="session")
def lemur() -> Robot:
    """The paper's chaser and arm."""
    return load_robot(robots.LEMUR_URDF, "chaser", "end_effector")


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
    return plan(lemur_capture, load_settings(robots.CONFIG / "planner.yaml"))
