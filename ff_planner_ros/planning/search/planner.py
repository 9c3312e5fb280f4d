"""From a problem to a plan: refuse what is impossible, search, check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.errors import NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.check.check import (
    failures,
    measure,
    out_of_time,
    out_of_time_beside,
    refusal,
)
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.followed_path import followed_path
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.steered import steered
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.objectives import weighted_sum
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.path_family import PathFamily, singular_refusal
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.target import conditions_of, too_many_conditions
from ff_planner_ros.planning.search.attitude_search import AttitudeSearch
from ff_planner_ros.planning.search.best_moment import plan_at_best_moment
from ff_planner_ros.planning.search.continuing import NEAR, PathNear, Remainder
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.guided_search import Allowance, GuidedSearch
from ff_planner_ros.planning.search.search import FoundPath, Search
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial

# Coefficients of a path, or what remains of a plan.
FirstGuess: TypeAlias = Array | Remainder

NOBODY = Watch()
# Weights of the plan at which a search for a better attitude begins.
SHORTEST = Objective(1.0, 0.0)

# A path whose own motion is as near as this to what comes of it [m, rad] is published as it is: its
# end effector's twist is exact at the goal. From 1e-6 on its torques, open loop, led a wrist astray
# by 0.1 deg.
_NEAR = 1e-7
# First guesses towards a goal with more conditions than the arm can meet at once.
_STARTS_OF_A_POOR_ARM = 3


def plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch = NOBODY,
    first_guess: FirstGuess | None = None,
) -> Plan:
    """Plan a trajectory: optimal, collision-free, checked.

    Where the chaser's attitude has a weight, the search begins at the plan of least joint path and
    never answers one that is worse. Where there is no such plan, it searches for any.

    Where a range of durations is given, it chooses one of them (`best_moment`); what remains of a
    plan keeps that plan's moment, or the nearest of the range, as long as there is a plan then.

    Where the parametrisation is left to the planner, the paper's paths come first, if they apply,
    and joint splines if there is no plan among those.

    The same problem, settings and first guess give the same plan. The time that a search may take
    decides only whether there is a plan, never which one.

    Args:
        watch: May end the search, and is told how far it has come.
        first_guess: Coefficients of a path, as in `Plan.coefficients`: tried first in the family
            that has as many. A remainder: the plan near it, if there is one, is the answer; only
            else are others looked for. None: the families' own guesses alone.

    Raises:
        InvalidInput: The start violates what the plan must keep, the first guess is no path, or
            there is no plan and the arm cannot meet all conditions of the goal at once.
        NoPlanFound: The goal is out of reach, the search found no feasible path or was ended, or
            the check refused the path that it found.
    """
    window = problem.duration_range
    if window is not None and window.minimum == window.maximum:
        problem, window = lasting(problem, window.minimum), None
    if first_guess is not None and not isinstance(first_guess, Remainder):
        return _plan_beside_guess(problem, settings, watch, first_guess)
    if window is None:
        return _plan_in_time(problem, settings, watch, first_guess)
    if isinstance(first_guess, Remainder):
        kept = min(max(first_guess.goal, window.minimum), window.maximum)
        try:
            return _plan_in_time(lasting(problem, kept), settings, watch, first_guess)
        except NoPlanFound as refused:
            if refused.status is Status.TIMED_OUT:
                raise
    return plan_at_best_moment(problem, settings, watch, None, _plan_in_time)


def _plan_beside_guess(
    problem: PlanningProblem, settings: PlannerSettings, watch: Watch, guess: Array
) -> Plan:
    """Return the plan that a guess leads to, or else the one that is found without it.

    What is found without it is the same to the last bit: a guess never costs a plan. Nor does it
    cost more than its allowance of the time.
    """
    allowance = Allowance(watch, problem.duration_range is not None)
    try:
        if problem.duration_range is None:
            return _plan_near_guess(problem, settings, allowance, guess)
        once = replace(settings, starts=1)
        return plan_at_best_moment(problem, once, allowance, guess, _plan_near_guess)
    except NoPlanFound as refused:
        if refused.status is Status.TIMED_OUT and not allowance.used_up:
            raise
    found = plan(problem, settings, watch)
    return replace(found, solver=replace(found.solver, starts=found.solver.starts + 1))


def _plan_near_guess(
    problem: PlanningProblem, settings: PlannerSettings, watch: Watch, guess: Array | None
) -> Plan:
    """Return the plan of a given duration that a guess leads to by itself.

    Raises:
        InvalidInput: No family has so many variables.
        NoPlanFound: It leads to none; where the attitude has a weight, to none that is better than
            the one of least joint path.
    """
    if guess is None:
        raise NoPlanFound(Status.CHECK_FAILED, "the first guess leads to no duration")
    require_plannable(problem, settings)
    groups = path_families(problem, settings)
    fitting = [ways for ways in groups if len(guess) == ways[0].variables]
    if not fitting:
        finite_vector("first_guess", guess, groups[0][0].variables)
    ways = fitting[0]
    problem = replace(problem, parametrisation=Parametrisation(ways[0].name))

    def promise(family: PathFamily) -> tuple[float, float]:
        at_x = path_program(problem, family, settings).linearise(guess)
        return (max(at_x.violation, 0.0), at_x.objective) if at_x.is_defined else (np.inf, np.inf)

    # Of several ways round, the same numbers are a good path in one alone.
    refusals: list[NoPlanFound] = []
    for family in sorted(ways, key=promise) if len(ways) > 1 else ways:
        try:
            return _plan_near_in_family(problem, settings, family, watch, guess)
        except NoPlanFound as refused:
            if refused.status is Status.TIMED_OUT:
                raise
            refusals.append(refused)
    raise refusals[0]


def _plan_near_in_family(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    guess: Array,
) -> Plan:
    """Return the plan of one family that a guess leads to in a few steps."""

    def judged(path: FoundPath) -> Plan | None:
        found = plan_of_path(problem, settings, family, path)
        return None if any(failures(problem, found, settings)) else found

    guess = finite_vector("first_guess", guess, family.variables)
    asked = problem.objective
    turns_count = asked.chaser_attitude > 0.0
    first = replace(problem, objective=SHORTEST if turns_count else asked)
    search = GuidedSearch(path_program(first, family, settings), settings, watch, guess)
    try:
        paths = search.paths_from(guess)
        found = next((made for path in paths if (made := judged(path))), None)
        if found is not None and turns_count:
            shortest = found
            found = search.better_at_guess(asked, shortest, judged)
            found = None if found is shortest else found
    except OutOfTime as end:
        raise out_of_time(end) from None
    if found is None:
        raise NoPlanFound(Status.CHECK_FAILED, "the first guess leads to no plan")
    return found


def _plan_in_time(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: FirstGuess | None,
) -> Plan:
    """Return a plan whose duration is given; `plan` says the rest."""
    require_plannable(problem, settings)
    groups = path_families(problem, settings)
    if isinstance(first_guess, Remainder):
        near, first_guess = _plan_near(problem, settings, watch, groups, first_guess)
        if near is not None:
            return near
    conditions = conditions_of(problem.robot, problem.target)
    met = steered(problem.robot, problem.target)
    too_many = met < sum(conditions.values())
    if too_many:  # a goal that happens to be one of those that it can meet is found soon
        settings = replace(settings, starts=min(settings.starts, _STARTS_OF_A_POOR_ARM))
    refusals: list[NoPlanFound] = []
    for ways in groups:
        fits = first_guess is not None and len(first_guess) == ways[0].variables
        try:
            return _best_plan(problem, settings, ways, watch, first_guess if fits else None)
        except NoPlanFound as refused:
            if refused.status is Status.TIMED_OUT:
                raise
            refusals.append(refused)
    if too_many:
        why = f"and as its axes lie the arm meets no more than {met} of them at once"
        raise too_many_conditions(problem.target, conditions, why, met)
    # That one family meets a singularity is no reason why there is no plan.
    others = [refused for refused in refusals if refused.status is not Status.SINGULAR]
    raise (others or refusals)[0]


def _plan_near(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    groups: Sequence[Sequence[PathFamily]],
    rest: Remainder,
) -> tuple[Plan | None, Array]:
    """Return the plan near what remains of another one, if there is one, and a guess for others.

    It is a path of the first family that has one as near as it takes, or of the nearest.
    """
    paths = list[PathNear]()
    for family in chain.from_iterable(groups):
        paths.append(rest.path_near(problem, family))
        if paths[-1].off <= NEAR:
            break
    nearest = min(paths, key=lambda path: path.off)
    family, guess = nearest.family, nearest.x
    problem = replace(problem, parametrisation=Parametrisation(family.name))
    search = Search(path_program(problem, family, settings), settings, watch, None)
    try:
        for path in search.paths_near(guess):
            found = plan_of_path(problem, settings, family, path)
            if not any(failures(problem, found, settings)):
                return found, guess
    except OutOfTime as end:
        raise out_of_time(end) from None
    return None, guess


def _best_plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    ways: Sequence[PathFamily],
    watch: Watch,
    first_guess: Array | None,
) -> Plan:
    """Return the better plan of several ways round; `plan` says the rest."""
    problem = replace(problem, parametrisation=Parametrisation(ways[0].name))
    if len(ways) == 1:
        return _plan_in_family(problem, settings, ways[0], watch, first_guess)
    plans: list[Plan] = []
    refusals: list[NoPlanFound] = []
    for family in ways:
        try:
            plans.append(_plan_in_family(problem, settings, family, watch, first_guess))
        except NoPlanFound as refused:
            if refused.status is Status.TIMED_OUT:
                raise
            refusals.append(refused)
    if not plans:
        raise refusals[0]
    return min(plans, key=lambda found: weighted_sum(problem.objective, found.metrics))


def _plan_in_family(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    first_guess: Array | None,
) -> Plan:
    """Return a plan from the paths of one family; `plan` says the rest."""
    if first_guess is not None:
        first_guess = finite_vector("first_guess", first_guess, family.variables)

    def judged(path: FoundPath) -> Plan | None:
        """Return the plan along a path if it is sound."""
        found = plan_of_path(problem, settings, family, path)
        return None if any(failures(problem, found, settings)) else found

    asked = problem.objective
    ended, shortest = None, None
    for objective in (asked,) if asked.chaser_attitude == 0.0 else (SHORTEST, asked):
        program = path_program(replace(problem, objective=objective), family, settings)
        search = AttitudeSearch(program, settings, watch, first_guess)
        try:
            found = next((made for path in search.paths() if (made := judged(path))), None)
            if found is not None and objective is not asked:
                shortest = found
                found = search.improved(asked, shortest, judged)
            if found is not None:
                return found
        except OutOfTime as end:
            ended = end
            break
    if shortest is not None and ended is not None:
        raise out_of_time_beside(ended, shortest)
    best = search.best()
    singular_at = None if best is None else best.at_x.motion.singular_at
    if best is None or singular_at is not None:
        singular = singular_refusal(singular_at or 0.0, problem.duration)
        raise singular if ended is None else out_of_time(ended)
    attempt = plan_of_path(problem, settings, family, best)
    violated = list(failures(problem, attempt, settings))
    raise refusal(attempt, violated) if ended is None else out_of_time(ended, attempt, violated)


def plan_of_path(
    problem: PlanningProblem, settings: PlannerSettings, family: PathFamily, path: FoundPath
) -> Plan:
    """Return what comes of a regular path of the family, measured and not yet judged."""
    motion = path.at_x.motion
    q, v, acceleration = motion.q, motion.v, path.at_x.acceleration
    driven = path.followed or followed_path(problem, q, v, acceleration)
    at_points = driven.q[:: driven.pieces]
    if len(at_points) < len(q) or not _is_near(at_points, q):
        q, v = at_points, driven.v[:: driven.pieces]
        acceleration = accelerations(problem.robot, q, v, driven.joints.accelerations)
    plain = plan_of_motion(problem, settings, q, v, acceleration, path.report)
    return replace(
        plain,
        xi=family.decision_variables(motion.x),
        orientation_reading=family.reading,
        family=family.name,
        coefficients=motion.x,
    )


def _is_near(q: Array, others: Array) -> bool:
    """Tell whether the base is where it is in other configurations, but for what nobody feels."""
    turns = rotation_base_to_inertial(q) - rotation_base_to_inertial(others)
    return bool(max(np.abs(q[:, :3] - others[:, :3]).max(), np.abs(turns).max()) <= _NEAR)


def plan_of_motion(
    problem: PlanningProblem,
    settings: PlannerSettings,
    q: Array,
    v: Array,
    acceleration: Array,
    solver: SolverReport,
) -> Plan:
    """Return a motion that need not follow a polynomial path, measured and not yet judged.

    Args:
        q: Configurations at equal steps of time. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        acceleration: dv/dt. Shape (points, 6 + joints).
    """
    time = np.linspace(0.0, 1.0, len(q)) * problem.duration
    trajectory = to_trajectory(problem.robot, time, q, v, acceleration)
    return Plan(
        joint_names=problem.robot.joint_names,
        trajectory=trajectory,
        xi=np.empty(0),
        orientation_reading="",
        metrics=measure(problem, trajectory, settings),
        solver=solver,
        duration=problem.duration,
    )
