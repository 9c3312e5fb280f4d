"""Robots that the tests share."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
import robots

from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.settings import load_settings
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Let files of tests run side by side, but never two that start processes of ROS."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return "ros" if _starts_processes_of_ros(config.rootpath / file) else file

    return Scheduling(config, log)


@cache
def _starts_processes_of_ros(file: Path) -> bool:
    return "ros_processes" in file.read_text("utf-8")


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
