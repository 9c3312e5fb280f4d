"""The straight line: the paper's path with xi = 0, which knows of no obstacle."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.plan import Plan, SolverReport
from ff_planner_ros.planning.planner import end_effector_paths, plan_of_path, sound_start
from ff_planner_ros.planning.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.rollout import RolloutModel
from ff_planner_ros.planning.settings import PlannerSettings


def straight_line(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Return the motion along the path without free terms, Sec. 4.1 of the paper.

    Returns:
        Measured and not judged: `require_sound` tells what is wrong with it.

    Raises:
        InvalidInput: The start violates what a plan must keep.
        NoPlanFound: The goal is out of reach, or the path meets a dynamic singularity.
    """
    q_start, v_start, momentum = sound_start(problem, settings)
    paths = end_effector_paths(problem, q_start, v_start)
    rollouts = RolloutModel(problem.robot, q_start, momentum, paths, problem.points)
    report = SolverReport(
        starts=1,
        iterations=0,
        rollouts=1,
        optimality=np.inf,
        stop_reason="straight line: xi = 0, nothing is optimised",
    )
    rollout = rollouts.roll_out(np.zeros((COMPONENTS, FREE_TERMS)))
    acceleration = rollouts.sensitivity(rollout).acceleration
    return plan_of_path(problem, settings, paths, rollout, acceleration, report)
