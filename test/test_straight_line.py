"""The straight line: known numbers, and no knowledge of obstacles."""

from dataclasses import replace

import numpy as np
import pytest
from judging import require_sound

from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.problems.paths import STRAIGHT, roll_out

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def line(lemur_capture):
    return straight_line(lemur_capture, SETTINGS)


def test_it_is_the_reference_of_an_independent_implementation(line):
    """Path and attitude as benchmark_robot.md has them; postures to the printed digits."""
    metrics, motion = line.metrics, line.trajectory
    assert metrics.joint_path_length == pytest.approx(1.2196, abs=1e-4)
    assert np.rad2deg(metrics.max_chaser_euler) == pytest.approx(13.08, abs=0.01)
    assert metrics.min_clearance == pytest.approx(-0.140, abs=1e-3)
    assert np.rad2deg(motion.joint_positions[-1]) == pytest.approx(
        [-1.55, -34.84, -7.38, -37.59, -88.00, 64.50, -98.74], abs=0.02
    )
    assert motion.chaser_positions[-1] == pytest.approx([0.1804, -0.0008, 0.5037], abs=2e-4)


def test_its_end_effector_moves_on_the_line_from_start_to_target(lemur_capture, line):
    positions, target = line.trajectory.ee_positions, lemur_capture.target.position
    along = target - positions[0]
    off = np.cross(positions - positions[0], along) / np.linalg.norm(along)
    assert np.abs(off).max() < 1e-6
    assert positions[-1] == pytest.approx(target, abs=1e-6)


def test_it_is_the_rollout_with_xi_zero(lemur_capture, line):
    rollout = roll_out(lemur_capture, STRAIGHT)
    assert np.array_equal(line.trajectory.joint_positions, rollout.q[:, 7:])
    assert np.array_equal(line.xi, np.zeros(18))
    assert line.orientation_reading == "inertial"
    assert line.solver.optimality == np.inf


def test_its_collision_is_a_plan_that_the_check_refuses(lemur_capture, line):
    assert line.metrics.penalty > 0.0
    with pytest.raises(NoPlanFound, match="inside obstacle c1") as refusal:
        require_sound(lemur_capture, line, SETTINGS)
    assert refusal.value.status is Status.COLLISION
    assert refusal.value.attempt is line


def test_it_refuses_what_no_motion_can_start_from_or_reach(lemur_capture):
    around = Obstacle.sphere("rock", np.array([0.2, 0.1, 0.5]), 0.2)
    with pytest.raises(InvalidInput, match="rock"):
        straight_line(replace(lemur_capture, obstacles=(around,)), SETTINGS)
    far = replace(lemur_capture.target, position=np.array([9.0, 0.4, 0.6]))
    with pytest.raises(NoPlanFound, match=r"target\.position"):
        straight_line(replace(lemur_capture, target=far), SETTINGS)
