"""The check after the solve: what the plan's samples themselves say, whatever the solver said.

Nothing here uses the velocity map, the path family or the optimisation problem. Poses, momentum
and clearance are recomputed by forward kinematics and dynamics from the samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ff_planner_ros.planning.failures import failures, refusal
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.objectives import chaser_euler, joint_path_length
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements import REQUIREMENTS
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.planning.settings import PlannerSettings


def measure(problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings) -> Metrics:
    """Return the metrics of a trajectory, computed from its samples alone.

    Args:
        trajectory: What comes after the problem's duration is its tail.
        settings: For the penalty's g1 and g2.
    """
    samples = Samples(problem, settings, trajectory)
    to_goal = slice(samples.goal + 1)
    required: dict[str, Any] = {}
    for requirement in REQUIREMENTS:
        required |= requirement.metrics(samples)
    return Metrics(
        joint_path_length=joint_path_length(
            trajectory.joint_velocities[to_goal], problem.duration / samples.goal
        ),
        max_chaser_euler=float(np.abs(chaser_euler(problem.robot, samples.q[to_goal])).max()),
        **required,
    )


def require_sound(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> None:
    """Refuse a plan that fails the check.

    Args:
        plan: With metrics of `measure`.

    Raises:
        NoPlanFound: Names every failure, where it is and by how much; carries the plan.
    """
    found = list(failures(problem, plan, settings))
    if found:
        raise refusal(plan, found)
