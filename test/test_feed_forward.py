"""Torques between the points of a plan, against a plan on the same path that has more points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_rows import sensitivity_of

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.simulation.feed_forward import feed_forward, torque_spline

STEPS = 4


def on_one_path(problem: PlanningProblem, points: int) -> Trajectory:
    """Sample a winding path from the capture's start to its target; the same path every time."""
    paths = end_effector_paths(problem)
    motion = paths.motion(np.random.default_rng(1).normal(scale=0.2, size=18), points)
    accelerations = sensitivity_of(paths, motion).acceleration
    time = np.linspace(0.0, problem.duration, points)
    return to_trajectory(problem.robot, time, motion.q, motion.v, accelerations)


def off(found: Array, wanted: Array) -> float:
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


def test_every_point_of_the_plan_is_the_end_of_a_step(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    command = feed_forward(lemur_capture.robot, lemur_plan.trajectory, STEPS)
    assert command.time.shape == (49 * 2 * STEPS + 1,)
    assert command.time[:: 2 * STEPS].tolist() == lemur_plan.trajectory.time.tolist()
    in_steps = np.diff(command.time).reshape(49, -1)
    assert in_steps == pytest.approx(in_steps.mean(), rel=1e-9)


def test_between_the_points_they_are_those_of_the_motion(lemur_capture: PlanningProblem) -> None:
    coarse, fine = (on_one_path(lemur_capture, 48 * n + 1) for n in (1, 2 * STEPS))
    command = feed_forward(lemur_capture.robot, coarse, STEPS)
    assert command.time == pytest.approx(fine.time, abs=1e-12)
    assert off(command.torques, fine.joint_torques) < 3e-4


def test_with_twice_the_points_they_are_eight_times_as_near(
    lemur_capture: PlanningProblem,
) -> None:
    """A step of the plan is off by its length's fifth power, and its accelerations by the third."""
    fine = on_one_path(lemur_capture, 96 * 2 * STEPS + 1)
    few, more = (on_one_path(lemur_capture, 48 * n + 1) for n in (1, 2))
    robot = lemur_capture.robot
    of_few = off(feed_forward(robot, few, 2 * STEPS).torques, fine.joint_torques)
    of_more = off(feed_forward(robot, more, STEPS).torques, fine.joint_torques)
    assert 7.0 < of_few / of_more < 9.0


def test_a_plans_own_torques_are_commanded_at_its_points_and_what_they_differ_by_between(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    motion = lemur_plan.trajectory
    bias = np.random.default_rng(2).normal(size=(50, 7))
    wrong = replace(motion, joint_torques=motion.joint_torques + bias)
    right, biased = (feed_forward(lemur_capture.robot, m, 1).torques for m in (motion, wrong))
    assert biased[::2] == pytest.approx(wrong.joint_torques, abs=1e-12)
    assert (biased - right)[1::2] == pytest.approx((bias[1:] + bias[:-1]) / 2, abs=1e-12)


def test_the_sign_of_a_quaternion_does_not_matter(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    motion = lemur_plan.trajectory
    signs = np.where(np.arange(50) % 3 == 0, -1.0, 1.0)[:, None]
    flipped = replace(motion, chaser_quaternions_xyzw=signs * motion.chaser_quaternions_xyzw)
    same, other = (feed_forward(lemur_capture.robot, m, STEPS).torques for m in (motion, flipped))
    assert other == pytest.approx(same, abs=1e-12)


def test_the_spline_goes_through_the_torques(lemur_plan: Plan) -> None:
    motion = lemur_plan.trajectory
    command = torque_spline(motion, STEPS)
    assert command.torques[:: 2 * STEPS] == pytest.approx(motion.joint_torques, abs=1e-12)
    assert command.steps_per_point == STEPS
