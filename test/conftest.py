"""Robots that the tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import robots

from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.settings import load_settings
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text


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
def resting_capture(lemur_capture: PlanningProblem) -> PlanningProblem:
    """The same by a chaser that does not drift: to be planned for a time however far ahead."""
    still = {
        "linear_velocity_chaser_in_inertial": np.zeros(3),
        "angular_velocity_chaser_in_inertial": np.zeros(3),
        "joint_velocities": np.zeros(len(lemur_capture.start.joint_velocities)),
    }
    return replace(lemur_capture, start=replace(lemur_capture.start, **still))


@pytest.fixture(scope="session")
def lemur_plan(lemur_capture: PlanningProblem) -> Plan:
    """The paper's capture on the shortest joint path."""
    return plan(lemur_capture, load_settings(robots.CONFIG / "planner.yaml"))
