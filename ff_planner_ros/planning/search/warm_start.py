"""Plans from a warm start: a given path, or the remainder of a running plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import EndedBy, NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.followed_path import followed_joints
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan, SolverReport
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import Objective, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.planning.search.attitude_search import AttitudeSearch
from ff_planner_ros.planning.search.candidate import plan_of_motion
from ff_planner_ros.planning.search.continuing import NEAR, PathNear, Remainder
from ff_planner_ros.planning.search.families import ways_of_guess
from ff_planner_ros.planning.search.grid_solver import GridSolver
from ff_planner_ros.planning.search.guided_search import plan_from, plans_near
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import accelerations

# Objective of the plan from which the attitude is searched: minimum joint path.
SHORTEST = Objective(1.0, 0.0)


def plan_near_guess(
    problem: PlanningProblem, settings: PlannerSettings, watch: Watch, guess: Array | None
) -> Plan:
    """Return the plan of a given duration that a guess leads to, without other guesses.

    Raises:
        InvalidInput: The start violates a requirement, or no family has so many variables.
        NoPlanFound: The guess is None or leads to no plan; if the attitude has a weight, to none
            better than that of minimum joint path. Or the goal is out of reach.
        OutOfTime: By the watch.
    """
    if guess is None:
        raise NoPlanFound(Status.CHECK_FAILED, "the first guess leads to no duration")
    require_plannable(problem, settings)
    ways, guess = ways_of_guess(problem, settings, guess)
    problem = replace(problem, parametrisation=Parametrisation(ways[0].name))

    def promise(family: PathFamily) -> tuple[float, float]:
        at_x = path_program(problem, family, settings).linearise(guess)
        return (max(at_x.violation, 0.0), at_x.objective) if at_x.is_defined else (np.inf, np.inf)

    # Decision variables are a good path in one of several ways round only.
    for family in sorted(ways, key=promise) if len(ways) > 1 else ways:
        plan = _plan_in_family(problem, settings, family, watch, guess)
        if plan is not None:
            return plan
    raise NoPlanFound(Status.CHECK_FAILED, "the first guess leads to no plan")


def _plan_in_family(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    guess: Array,
) -> Plan | None:
    """Return the plan of one family that a guess leads to, if there is one."""
    asked = problem.objective
    turns_count = asked.chaser_attitude > 0.0
    first = replace(problem, objective=SHORTEST if turns_count else asked)
    solver = GridSolver(path_program(first, family, settings), settings, watch)
    found = plan_from(solver, guess)
    if found is None or not turns_count:
        return found
    better = AttitudeSearch(solver, asked, found).better_at(guess)
    return None if better is found else better


def plan_near_remainder(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    groups: Sequence[Sequence[PathFamily]],
    rest: Remainder,
) -> tuple[Plan | None, Array]:
    """Return the plan near a remainder, if there is one, and a guess for a search without it.

    The plan is of the first family with a path within `NEAR` of the remainder, or of the one with
    the nearest. The remainder itself, if it passes the check, is the answer if no plan is found
    near it, and is offered to the watch if time runs out.

    Args:
        groups: Families of `path_families`.

    Raises:
        OutOfTime: By the watch.
    """
    paths = list[PathNear]()
    for family in chain.from_iterable(groups):
        paths.append(rest.path_near(problem, family))
        if paths[-1].off <= NEAR:
            break
    nearest = min(paths, key=lambda path: path.off)
    family, guess = nearest.family, nearest.x
    posed = replace(problem, parametrisation=Parametrisation(family.name))
    solver = GridSolver(path_program(posed, family, settings), settings, watch)
    try:
        near = next(plans_near(solver, guess), None)
    except OutOfTime:
        unchanged = _unchanged(problem, settings, rest)
        if unchanged is not None:
            watch.offer(unchanged)
        raise
    if near is None:
        unchanged = _unchanged(problem, settings, rest)
        near = unchanged and replace(unchanged, solver=solver.effort.report(unchanged.solver))
    return near, guess


def _unchanged(problem: PlanningProblem, settings: PlannerSettings, rest: Remainder) -> Plan | None:
    """Return the remainder of a running plan as a plan, if it passes the check unchanged."""
    robot = problem.robot
    time = np.linspace(0.0, 1.0, problem.points) * problem.duration
    joints = JointMotion(time, *rest.joints.at(time))
    motion = followed_joints(robot, *configuration(robot, problem.start), joints)
    if problem.posture is None:
        position, turn = np.linalg.norm(miss(robot, motion.q[-1], problem.target), axis=1)
        if position > settings.position_tolerance or turn > settings.orientation_tolerance:
            return None
    q, v = motion.q[:: motion.pieces], motion.v[:: motion.pieces]
    by_time = accelerations(robot, q, v, joints.accelerations)
    reason = "good enough: the remainder of the running plan"
    report = SolverReport(1, 0, 0, np.inf, reason, EndedBy.CONVERGED)
    plan, failures = plan_of_motion(problem, settings, q, v, by_time, report, REMAINDER)
    return None if failures else plan
