"""The benchmark robot's shapes: nothing of it touches itself where the paper has it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from bodied_robots import lemur_with_bodies
from whole_bodies import judge_of

from ff_planner_ros.analysis.methods import OBJECTIVES, SHORTEST, STEADIEST, WEIGHTED
from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_distances import pair_distances
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask, attempted, without_search

SETTINGS = load_parameters().planner


def drifted(problem: PlanningProblem) -> Array:
    """Joint angles from 12 s before to 12 s after the start, which is in the middle.

    The planner carries the state forward for 10 s where nobody says when a plan shall begin.
    """
    times = np.linspace(-12.0, 12.0, 49)
    return problem.start.joint_positions + np.outer(times, problem.start.joint_velocities)


def least_distance(angles: Array) -> float:
    """Of all bodies that must not touch, in all postures [m]."""
    robot = lemur_with_bodies()
    rows = np.indices((len(angles), len(robot.pairs))).reshape(2, -1)
    distances = pair_distances(robot, placed_bodies(robot, angles), (rows[0], rows[1]))
    return float(distances.distance.min())


def test_the_papers_start_and_its_drift_are_free_of_self_contact(
    lemur_capture: PlanningProblem,
) -> None:
    assert least_distance(drifted(lemur_capture)) > 0.0


def test_pinocchio_and_coal_find_no_self_contact_there_either(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    judge = judge_of("lemur", tmp_path)
    for pair in judge.pairs:
        judge.geometry.addCollisionPair(pin.CollisionPair(*pair))
    data, placed = judge.model.createData(), judge.geometry.createData()
    for angles in drifted(lemur_capture):
        q = np.concatenate([pin.neutral(judge.model)[:7], angles])
        pin.updateGeometryPlacements(judge.model, data, judge.geometry, placed, q)
        assert not pin.computeCollisions(judge.geometry, placed, False), angles


def test_the_reference_plans_of_centre_lines_are_free_of_self_contact(
    lemur_capture: PlanningProblem, times: Callable[[int, int], int]
) -> None:
    solvers = [(SHORTEST, without_search(straight_line))]
    solvers += [(method, plan) for method in (SHORTEST, STEADIEST, WEIGHTED)[: times(1, 3)]]
    for method, solve in solvers:
        for family in (Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE):
            asked = replace(lemur_capture, objective=OBJECTIVES[method], parametrisation=family)
            made, _ = attempted(PlanningTask(asked, SETTINGS), solve)
            assert isinstance(made, Plan)
            assert least_distance(made.trajectory.joint_positions) > 0.0, (method.name, family)
