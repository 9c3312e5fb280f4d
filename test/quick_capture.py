"""The paper's capture made easy, for tests in real time: flown in two seconds, or from rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from robots import LEMUR_SCENARIO, LEMUR_URDF

from ff_planner_ros.demo.executive import end_effector
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.scenario.scenario import load_scenario

DURATION = 2.0


def quick_capture(directory: Path, **changes: Any) -> Path:
    """Write the paper's capture with nothing in the way and the goal five centimetres ahead.

    Args:
        directory: Where the scenario file is put.
        changes: Entries of the scenario that are replaced.
    """
    problem = load_scenario(LEMUR_SCENARIO)
    start = end_effector(problem.robot, problem.start)
    scenario = yaml.safe_load(LEMUR_SCENARIO.read_text("utf-8"))
    scenario["robot"]["urdf"] = str(LEMUR_URDF)
    scenario["obstacles"] = []
    scenario["duration"] = DURATION
    scenario["target"] = {
        "position": (start.position + np.array([0.0, 0.03, 0.04])).tolist(),
        "quaternion_xyzw": start.rotation.as_quat().tolist(),
    }
    file = directory / "quick_capture.yaml"
    file.write_text(yaml.safe_dump(scenario | changes), encoding="utf-8")
    return file


def quick_whole_capture(directory: Path) -> Path:
    """Write the same goal as the grasp of a body of 150 kg that turns by 5 deg/s, and its stop."""
    file = quick_capture(directory)
    scenario = yaml.safe_load(file.read_text("utf-8"))
    goal, duration = scenario.pop("target"), scenario.pop("duration")
    grasp, turns = np.array([-0.6, 0.1, 0.3]), np.deg2rad([3.0, -4.0, 0.0])
    drift = np.array(scenario["chaser"]["linear_velocity"])
    at_grasp = TargetBody(
        position=np.array(goal["position"]) - grasp,
        quaternion_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity=drift,
        angular_velocity=turns,
        inertia=np.diag([90.0, 35.0, 100.0]),
        grasp_position=grasp,
        grasp_quaternion_xyzw=np.array(goal["quaternion_xyzw"]),
        mass=150.0,
    )
    body = at_grasp.after(-duration)
    capture = {
        "position": body.position.tolist(),
        "quaternion_xyzw": body.quaternion_xyzw.tolist(),
        "linear_velocity": drift.tolist(),
        "angular_velocity": body.angular_velocity.tolist(),
        "mass": 150.0,
        "inertia": {"ixx": 90.0, "iyy": 35.0, "izz": 100.0, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0},
        "grasp": {"position": grasp.tolist(), "quaternion_xyzw": goal["quaternion_xyzw"]},
    }
    scenario["phases"] = [
        {"target_body": capture, "duration": duration},
        {"target": {"at_rest": True}, "duration": 1.0},
    ]
    file.write_text(yaml.safe_dump(scenario), encoding="utf-8")
    return file


def resting_capture() -> PlanningProblem:
    """Return the paper's capture from a chaser at rest: whenever a plan begins, it is the same."""
    problem = load_scenario(LEMUR_SCENARIO)
    none, joints = np.zeros(3), np.zeros(problem.robot.joints)
    start = replace(
        problem.start,
        linear_velocity_chaser_in_inertial=none,
        angular_velocity_chaser_in_inertial=none,
        joint_velocities=joints,
    )
    return replace(problem, start=start)
