"""Robots that the tests share."""

from __future__ import annotations

import pytest
import robots

from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.robot.model import Robot, load_robot


@pytest.fixture(scope="session")
def lemur() -> Robot:
    """The paper's chaser and arm."""
    return load_robot(robots.LEMUR_URDF, "chaser", "end_effector")


@pytest.fixture(scope="session")
def lemur_capture() -> PlanningProblem:
    """The paper's capture."""
    return load_scenario(robots.LEMUR_SCENARIO)
