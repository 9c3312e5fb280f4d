"""Where a motion is at its worst: found between the points, too, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import distance_to_arm, drawn_plan, paper_terms_at

from ff_planner_ros.analysis.extremes import distances, joint_extremes, nearest
from ff_planner_ros.common.arrays import frozen
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.problems import bodies
from ff_planner_ros.report.plan_words import joint_table
from ff_planner_ros.robot.model import Robot


@pytest.fixture(scope="module")
def fine(lemur_capture: PlanningProblem) -> Plan:
    return plan(replace(lemur_capture, points=481), load_parameters().planner)


def every(motion: Trajectory, step: int) -> Trajectory:
    names = motion.__dataclass_fields__
    return Trajectory(**{name: getattr(motion, name)[::step] for name in names})


def test_the_least_clearance_is_found_between_few_points(
    lemur_capture: PlanningProblem, fine: Plan
) -> None:
    """Of thirteen points of a motion, the same as of all."""
    problem, coarse = lemur_capture, every(fine.trajectory, 40)
    found = distances(problem.robot, problem.obstacles, coarse)
    assert len(found.time) > 400
    least = nearest(problem.robot, problem.obstacles, found)
    truth = distances(problem.robot, problem.obstacles, fine.trajectory)
    assert least.distance == pytest.approx(truth.closest.min(), abs=2e-4)
    assert least.distance < found.closest[:: (len(found.time) - 1) // 12].min()
    number = [sphere.id for sphere in problem.obstacles].index(least.obstacle)
    row = int(np.abs(fine.trajectory.time - least.time).argmin())
    sphere = problem.obstacles[number]
    by_hand = distance_to_arm(fine, row, sphere.center) - sphere.radius
    assert least.distance == pytest.approx(by_hand, abs=5e-4)
    assert least.link == "the link from joint_4 to joint_5"


def test_each_obstacle_has_its_own_nearest_place_wherever_it_moves(
    lemur: Robot, fine: Plan
) -> None:
    terms = paper_terms_at(fine, -1)
    lengths = np.linalg.norm(terms.r_ee - terms.r_joint, axis=1)
    before = int(np.flatnonzero(lengths > 1e-6)[-1])  # the last joint of the spherical wrist's link
    ahead = (terms.r_ee - terms.r_joint[before]) / lengths[before]
    spheres = (
        Obstacle.sphere("there", terms.r_ee + 0.4 * ahead, 0.1),
        Obstacle.sphere("coming", terms.r_ee + 1.2 * ahead, 0.1, velocity=-0.1 * ahead),
    )
    found = distances(lemur, spheres, fine.trajectory)
    there, coming = (nearest(lemur, spheres, found, k) for k in range(2))
    assert there.distance <= 0.3 + 1e-9
    assert (coming.time, coming.distance) == (10.0, pytest.approx(0.1, abs=1e-6))
    assert coming.link == f"the link from joint_{before + 1} to joint_{before + 2}"
    assert nearest(lemur, spheres, found) == coming


def test_thousands_of_obstacles_are_measured_piece_by_piece(lemur: Robot) -> None:
    rng = np.random.default_rng(1)
    spheres = tuple(Obstacle.sphere(f"s{k}", rng.uniform(-3, 3, 3), 0.05) for k in range(2000))
    motion = drawn_plan(lemur, 2).trajectory
    found = distances(lemur, spheres, motion)
    few = distances(lemur, spheres[500:503], motion)
    np.testing.assert_array_equal(found.of_each[:, 500:503], few.of_each)
    assert found.closest.shape == found.time.shape


def test_joints_at_their_worst_are_those_of_a_fine_motion(lemur: Robot, fine: Plan) -> None:
    upper = lemur.upper_position_limits.copy()
    upper[6] = fine.trajectory.joint_positions[:, 6].max() + 0.01
    robot = replace(lemur, upper_position_limits=frozen(upper))
    for k, joint in enumerate(joint_extremes(robot, every(fine.trajectory, 40))):
        angle, rate = fine.trajectory.joint_positions[:, k], fine.trajectory.joint_velocities[:, k]
        assert joint.name == f"joint_{k + 1}"
        assert (joint.start, joint.end) == (angle[0], angle[-1])
        assert joint.lowest == pytest.approx(angle.min(), abs=1e-4)
        assert joint.highest == pytest.approx(angle.max(), abs=1e-4)
        margin = np.minimum(angle - robot.lower_position_limits[k], upper[k] - angle)
        assert joint.margin == pytest.approx(margin.min(), abs=1e-4)
        assert np.interp(joint.margin_time, fine.trajectory.time, margin) == pytest.approx(
            joint.margin, abs=1e-4
        )
        assert joint.rate == pytest.approx(np.abs(rate).max(), abs=1e-4)
        assert abs(np.interp(joint.rate_time, fine.trajectory.time, rate)) == pytest.approx(
            joint.rate, abs=1e-4
        )


def test_of_a_measured_motion_only_the_measurements_count(lemur: Robot) -> None:
    motion = drawn_plan(lemur, 3).trajectory
    unknown = np.full(motion.joint_torques.shape, np.nan)
    measured = replace(motion, joint_accelerations=unknown, joint_torques=unknown)
    for k, joint in enumerate(joint_extremes(lemur, measured)):
        rates = np.abs(motion.joint_velocities[:, k])
        assert (joint.rate, joint.rate_time) == (rates.max(), motion.time[rates.argmax()])
        assert joint.highest == motion.joint_positions[:, k].max()
        assert np.isnan(joint.torque)
    found = distances(lemur, (Obstacle.sphere("s", [1, 0, 1], 0.1),), measured)
    np.testing.assert_array_equal(found.time, motion.time)


def test_torques_between_the_points_come_from_who_knows_them(lemur: Robot) -> None:
    motion = drawn_plan(lemur, 3).trajectory
    peak = float(np.abs(motion.joint_torques[:, 0]).max()) + 0.1
    first, second, *_ = joint_extremes(lemur, motion, [peak, *[np.nan] * 6])
    assert first.torque == peak
    assert second.torque == np.abs(motion.joint_torques[:, 1]).max()


@pytest.mark.parametrize(("more", "is_between"), [(0.0, False), (0.1, True)])
def test_the_time_beside_a_torque_is_one_at_which_it_is_needed(
    lemur: Robot, more: float, is_between: bool
) -> None:
    made = drawn_plan(lemur, 3)
    torques = np.abs(made.trajectory.joint_torques)
    peaks = tuple(torques.max(axis=0) + more)
    metrics = replace(made.metrics, peak_joint_torques=peaks)
    rows = joint_table(lemur, made.trajectory, metrics).findall(".//tr")[1:]
    for k, row in enumerate(rows):
        words = "".join(row[-1].itertext())
        at = torques[:, k].argmax()
        assert words.startswith(f"{peaks[k]:.4g} N m (")
        assert words.endswith(f", at {made.trajectory.time[at]:.2f} s")
        assert (f" between points; at points {torques[at, k]:.4g} N m" in words) == is_between


def test_the_least_clearance_of_bodies_is_that_which_was_certified() -> None:
    """The check measures otherwise: in pieces of the motion, to half a millimetre."""
    problem = bodies.problem("arm6", 0).problem
    made = plan(problem, load_parameters().planner)
    found = distances(problem.robot, problem.obstacles, made.trajectory)
    least = nearest(problem.robot, problem.obstacles, found)
    assert f"{least.link}/{least.obstacle}" == made.metrics.min_clearance_pair
    assert least.time == pytest.approx(made.metrics.min_clearance_time, abs=0.1)
    assert 0.0 <= least.distance - made.metrics.min_clearance < 1e-3
