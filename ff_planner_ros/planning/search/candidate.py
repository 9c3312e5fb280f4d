"""What a search tried and found: its effort, paths, and the plans along them, checked."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.check.check import assess
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.followed_path import followed_path
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory, may_be_singular
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial

# A path whose own motion is this near to the tracked one [m, rad] is published as it is: its end
# effector's twist is exact at the goal. From 1e-6 on, its torques led a wrist astray by 0.1 deg in
# open loop.
_NEAR = 1e-7


@dataclass
class Effort:
    """Counters of a search, over all its attempts so far."""

    starts: int = 0  # initial guesses
    iterations: int = 0
    rollouts: int = 0
    # Of the initial paths of all solves, how many met each requirement, by its name
    met: Counter[str] = field(default_factory=Counter)

    def add(self, report: SolverReport | Effort) -> None:
        """Add the effort that led to a plan, or that of a part of the search."""
        self.starts += report.starts
        self.iterations += report.iterations
        self.rollouts += report.rollouts
        if isinstance(report, Effort):
            self.met.update(report.met)

    def report(self, of_plan: SolverReport) -> SolverReport:
        """Return the report of the chosen plan, with the effort of the whole search."""
        return replace(
            of_plan, starts=self.starts, iterations=self.iterations, rollouts=self.rollouts
        )


@dataclass(frozen=True, eq=False)
class Candidate:
    """A path that the solver found, and the effort of the search until then."""

    at_x: PathLinearisation  # its motion may be singular
    report: SolverReport  # counts are those of the whole search so far
    followed: FollowedMotion | None = None  # the tracked motion; None: not computed yet


class CheckedPlan(NamedTuple):
    """A plan, and what it violates."""

    plan: Plan
    failures: tuple[tuple[str, Failure], ...]  # with the names of their requirements; empty: sound


def plan_of_path(
    problem: PlanningProblem, settings: PlannerSettings, family: PathFamily, path: Candidate
) -> CheckedPlan:
    """Return the plan along a regular path of the family."""
    motion = path.at_x.motion
    q, v, acceleration = motion.q, motion.v, path.at_x.acceleration
    driven = path.followed or followed_path(problem, q, v, acceleration)
    at_points = driven.q[:: driven.pieces]
    if len(at_points) < len(q) or not _is_near(at_points, q):
        q, v = at_points, driven.v[:: driven.pieces]
        acceleration = accelerations(problem.robot, q, v, driven.joints.accelerations)
    plain, failures = plan_of_motion(
        problem, settings, q, v, acceleration, path.report, family.name
    )
    plan = replace(
        plain,
        xi=family.decision_variables(motion.x),
        orientation_reading=family.reading,
        coefficients=motion.x,
    )
    return CheckedPlan(plan, failures)


def _is_near(q: Array, others: Array) -> bool:
    """Tell whether base poses differ by less than `_NEAR` from others."""
    turns = rotation_base_to_inertial(q) - rotation_base_to_inertial(others)
    return bool(max(np.abs(q[:, :3] - others[:, :3]).max(), np.abs(turns).max()) <= _NEAR)


def _turn_rate_at_rest(problem: PlanningProblem, trajectory: Trajectory) -> float | None:
    """Return the angular rate of the system at a goal at which the joints rest [rad/s]."""
    posture = problem.posture
    if posture is None or posture.rates.any():
        return None
    return float(np.linalg.norm(trajectory.chaser_angular_velocities[-1]))


def plan_of_motion(
    problem: PlanningProblem,
    settings: PlannerSettings,
    q: Array,
    v: Array,
    acceleration: Array,
    solver: SolverReport,
    family: str = "",
) -> CheckedPlan:
    """Return the plan along any motion.

    Args:
        q: Configurations at equal steps of time. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        acceleration: dv/dt. Shape (points, 6 + joints).
        family: Of the plan.
    """
    time = np.linspace(0.0, 1.0, len(q)) * problem.duration
    trajectory = to_trajectory(problem.robot, time, q, v, acceleration)
    found = assess(problem, trajectory, settings, may_be_singular(family))
    plan = Plan(
        joint_names=problem.robot.joint_names,
        trajectory=trajectory,
        xi=np.empty(0),
        orientation_reading="",
        metrics=found.metrics,
        solver=solver,
        family=family,
        duration=problem.duration,
        wheels=found.wheels,
        turn_rate_at_rest=_turn_rate_at_rest(problem, trajectory),
    )
    return CheckedPlan(plan, found.failures)
