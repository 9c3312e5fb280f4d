"""Tails of plans whose goal is a part of a pose, and on a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import CONFIG
from scipy.spatial.transform import Rotation

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.problem.problem import Orientation, Parametrisation, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
TAIL = 3.0


def problem_of(name: str, lemur_capture: PlanningProblem) -> PlanningProblem:
    if name.startswith("table"):
        problem = load_scenario(CONFIG / "scenarios/planar_capture.yaml")
        free = replace(problem.target, orientation=Orientation.FREE)
        return replace(problem, target=free) if name == "table, position" else problem
    target = replace(
        lemur_capture.target,
        orientation=Orientation.ABOUT_AXIS if name == "about an axis" else Orientation.FIXED,
        free_axis_in_ee=np.array([1.0, 0.0, 0.0]) if name == "about an axis" else None,
    )
    splines = Parametrisation.JOINT_SPLINE
    return replace(lemur_capture, target=target, parametrisation=splines)


@pytest.mark.parametrize("name", ["table, pose", "table, position", "about an axis", "whole pose"])
def test_the_end_effector_is_held_as_far_as_the_target_says(
    name: str, lemur_capture: PlanningProblem
) -> None:
    problem = problem_of(name, lemur_capture)
    held = EndBehaviour.HOLD_END_EFFECTOR
    plan = perform(PlanningTask(problem, SETTINGS, end_behaviour=held, tail=TAIL))
    motion, target = plan.trajectory, problem.target
    assert motion.time[-1] == problem.duration + TAIL
    verdict = verify(problem.robot, motion)
    assert verdict.passed, verdict.deviation
    after = motion.time >= problem.duration
    wanted = target.position + np.outer(
        motion.time[after] - problem.duration, target.linear_velocity
    )
    np.testing.assert_allclose(motion.ee_positions[after], wanted, rtol=0.0, atol=1e-4)
    here = Rotation.from_quat(motion.ee_quaternions_xyzw[after].copy())
    there = Rotation.from_quat(target.quaternion_xyzw.copy())
    if target.orientation is Orientation.FIXED:
        assert (there.inv() * here).magnitude().max() < 1e-3
    elif target.free_axis_in_ee is not None:
        axis = target.free_axis_in_ee.copy()
        assert np.linalg.norm(here.apply(axis) - there.apply(axis), axis=1).max() < 1e-3
    # Nothing jumps: the rates of a fine grid change as the accelerations say.
    fine = np.linspace(0.0, motion.time[-1], 4001)
    _, rates, _ = joint_motion(motion).at(fine)
    changes = np.abs(np.diff(rates, axis=0)).max()
    assert changes < 1.5 * np.abs(motion.joint_accelerations).max() * fine[1]
