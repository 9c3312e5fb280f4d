"""Every goal orientation can be planned to, whatever its Euler angles are."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


def planned_orientations(
    problem: PlanningProblem, settings: PlannerSettings, goal: Array
) -> list[pin.Quaternion]:
    """Plan the capture with another goal orientation, obstacles included."""
    target = replace(problem.target, quaternion_xyzw=pin.Quaternion(goal).coeffs())
    answer = plan(replace(problem, target=target), settings)
    assert answer.metrics.min_clearance >= 0.0
    assert np.allclose(answer.trajectory.ee_positions[-1], target.position, atol=1e-3)
    found = [pin.Quaternion(np.array(xyzw)) for xyzw in answer.trajectory.ee_quaternions_xyzw]
    assert found[-1].angularDistance(pin.Quaternion(goal)) < 1e-3
    # It turns there without a jump: nowhere faster than eight times the mean rate of the turn.
    steps = [a.angularDistance(b) for a, b in pairwise(found)]
    assert max(steps) < 8.0 * found[0].angularDistance(found[-1]) / len(steps)
    return found


def rotation_at_start(problem: PlanningProblem) -> Array:
    """Return the rotation of the end effector to the inertial frame."""
    robot = problem.robot
    data = robot.model.createData()
    q, _ = configuration(robot, problem.start)
    pin.forwardKinematics(robot.model, data, q)
    rotation: Array = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).rotation
    return rotation.copy()


@pytest.mark.parametrize(
    "roll_yaw_deg", [(0.0, 0.0), (-65.0, -85.0), (0.0, 90.0)], ids=lambda pair: f"{pair}"
)
def test_a_goal_at_a_pitch_of_90_deg_is_planned(
    lemur_capture: PlanningProblem, settings: PlannerSettings, roll_yaw_deg: tuple[float, float]
) -> None:
    """The singularity of the paper's Euler angles."""
    roll, yaw = np.deg2rad(roll_yaw_deg)
    planned_orientations(lemur_capture, settings, pin.rpy.rpyToMatrix(roll, np.pi / 2, yaw))


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 1.0)], ids=lambda axis: f"{axis}")
@pytest.mark.parametrize("angle_deg", [150.0, 170.0])
def test_a_turn_by_almost_half_a_circle_is_planned(
    lemur_capture: PlanningProblem,
    settings: PlannerSettings,
    angle_deg: float,
    axis: tuple[float, float, float],
) -> None:
    start = rotation_at_start(lemur_capture)
    turn = np.deg2rad(angle_deg) * np.array(axis) / np.linalg.norm(axis)
    found = planned_orientations(lemur_capture, settings, start @ pin.exp3(turn))
    assert found[0].angularDistance(found[-1]) == pytest.approx(np.deg2rad(angle_deg), abs=1e-3)


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)], ids=lambda axis: f"{axis}")
def test_half_a_turn_plans_like_a_little_less_either_way_round(
    lemur_capture: PlanningProblem, settings: PlannerSettings, axis: tuple[float, float, float]
) -> None:
    """As well as the better of both, and about the opposite axis it is the same goal."""
    start = rotation_at_start(lemur_capture)

    def length(angle_deg: float) -> float:
        goal = start @ pin.exp3(np.deg2rad(angle_deg) * np.array(axis))
        target = replace(lemur_capture.target, quaternion_xyzw=pin.Quaternion(goal).coeffs())
        problem = replace(lemur_capture, target=target, obstacles=())
        try:
            found = perform(PlanningTask(problem, replace(settings, starts=2)))
        except NoPlanFound:
            return np.inf
        return found.metrics.joint_path_length

    shorter = min(length(179.99), length(-179.99))
    assert shorter < 10.0
    assert length(180.0) == pytest.approx(shorter, rel=0.01)
    assert length(-180.0) == pytest.approx(length(180.0), abs=1e-6)
