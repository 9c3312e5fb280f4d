"""The second robot: heavier by three orders of magnitude, and planned for like the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from judging import require_sound
from robots import CANADARM2_SCENARIO

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def capture() -> PlanningProblem:
    return load_scenario(CANADARM2_SCENARIO)


# Nguyen and Hughes 1994: offset and axis of joints 1 to 7 [m].
JOINTS = (
    ((1.3589, 0.0, 0.0), (1, 0, 0)),
    ((0.0, 0.0, 0.7026), (0, 0, 1)),
    ((0.0, -0.5692, 0.0), (0, 1, 0)),
    ((7.11, -0.475, 0.0), (0, 1, 0)),
    ((7.11, 0.0, 0.0), (0, 1, 0)),
    ((0.0, -0.5692, 0.0), (0, 0, 1)),
    ((0.0, 0.0, -0.7026), (1, 0, 0)),
)
HAND = (1.3589, 0.0, 0.0)
# Mass [kg] and xx, yy, zz, xy [kg m2] of B2 to B8; every centre of mass in its frame's origin.
BODIES = (
    (105.98, (12.19, 12.13, 3.061, 0.0)),
    (105.98, (8.088, 3.061, 8.446, 0.0)),
    (314.88, (15.41, 2094.71, 2103.19, 49.52)),
    (279.2, (9.522, 1966.28, 1966.28, -39.95)),
    (105.98, (8.305, 3.061, 8.0386, 0.0)),
    (105.98, (12.13, 12.13, 3.061, 0.0)),
    (243.66, (9.336, 44.41, 44.41, 0.0)),
)


def test_the_arm_is_the_published_one(capture: PlanningProblem) -> None:
    robot, model = capture.robot, capture.robot.model
    assert model.inertias[1].mass == 1e5 + 243.66  # the station and B1
    for i, (mass, (xx, yy, zz, xy)) in enumerate(BODIES, 2):
        body = model.inertias[i]
        assert body.mass == mass
        np.testing.assert_array_equal(body.lever, np.zeros(3))
        inertia = [[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, zz]]
        np.testing.assert_allclose(body.inertia, inertia, rtol=1e-12, atol=1e-9)
    frames = model.jointPlacements
    for i, (offset, _) in enumerate(JOINTS[1:], 3):
        np.testing.assert_array_equal(frames[i].translation, offset)
        np.testing.assert_array_equal(frames[i].rotation, np.eye(3))
    mount = model.frames[model.getFrameId("arm_mount", pin.FrameType.FIXED_JOINT)].placement
    np.testing.assert_allclose(mount.actInv(frames[2].translation), JOINTS[0][0], atol=1e-15)
    np.testing.assert_array_equal(model.frames[robot.tip_frame_id].placement.translation, HAND)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for i, (_, axis) in enumerate(JOINTS):
        turned = pin.getJointJacobian(model, data, 2 + i, pin.LOCAL)[3:, 6 + i]
        np.testing.assert_allclose(turned, axis, atol=1e-15)
    np.testing.assert_array_equal(robot.lower_position_limits, np.full(7, -4.71239))
    np.testing.assert_array_equal(robot.upper_position_limits, np.full(7, 4.71239))
    np.testing.assert_array_equal(robot.velocity_limits, np.full(7, 0.0698132))
    np.testing.assert_array_equal(robot.effort_limits, np.full(7, 2332.0))


def test_the_system_has_momentum_and_the_straight_path_hits_two_obstacles(
    capture: PlanningProblem,
) -> None:
    robot = capture.robot
    q, v = configuration(robot, capture.start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    assert np.linalg.norm(momentum[:3]) > 1e3
    assert np.linalg.norm(momentum[3:]) > 3e3
    straight = end_effector_paths(capture).motion(np.zeros(18), capture.points)
    positions = arm_points(robot, straight.q)
    times = np.linspace(0.0, capture.duration, capture.points)
    distance = clearances(positions, times, segments(positions), capture.obstacles).distance
    hit = {
        sphere.id
        for sphere, nearest in zip(capture.obstacles, distance.min(axis=(0, 1)), strict=True)
        if nearest < -0.1
    }
    assert hit == {"antenna", "boom"}


@pytest.mark.nightly
@pytest.mark.parametrize("limit_joint_velocities", [True, False])
def test_both_objectives_are_planned_and_each_is_best_at_its_own(
    capture: PlanningProblem, settings: PlannerSettings, limit_joint_velocities: bool
) -> None:
    asked = replace(capture, limits=Limits(joint_velocities=limit_joint_velocities))
    answers = []
    for objective in (Objective(1.0, 0.0), Objective(0.0, 1.0)):
        problem = replace(asked, objective=objective)
        answer = plan(problem, settings)
        require_sound(replace(problem, limits=Limits(joint_velocities=True)), answer, settings)
        assert not answer.solver.stop_reason.startswith("stuck")
        answers.append(answer.metrics)
    shortest, steadiest = answers
    # The steadiest joint splines are hardly longer than the shortest of the paper's paths.
    assert shortest.joint_path_length < steadiest.joint_path_length
    assert steadiest.max_chaser_euler < 0.95 * shortest.max_chaser_euler
    for metrics in answers:
        assert metrics.min_clearance > 0.0
        assert metrics.torque_error < 1e-9
        # Of a size that the limit means something to.
        assert 0.1 < max(metrics.peak_joint_torques) / 2332.0 < 0.5


def test_a_capture_in_too_much_haste_is_refused_for_the_torque_that_it_needs(
    capture: PlanningProblem, settings: PlannerSettings
) -> None:
    hurried = replace(capture, duration=6.0, limits=Limits())
    message = r"joint joint_\d needs \S+ N m, \S+ N m beyond its effort limit of 2332 N m"
    with pytest.raises(NoPlanFound, match=message) as refusal:
        plan(hurried, replace(settings, starts=2))
    assert refusal.value.status is Status.TORQUE_TOO_HIGH
