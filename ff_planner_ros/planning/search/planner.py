"""From a problem to a plan: refuse what is impossible, search, check."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeAlias

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.check.preconditions import require_plannable, require_time
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan
from ff_planner_ros.planning.motion.steered import steered, why_not_steered
from ff_planner_ros.planning.motion.watch import PassingOn, Watch
from ff_planner_ros.planning.optimisation.objectives import plan_cost, weighted_sum
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.path_family import PathFamily
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
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.continuing import SAMPLES, Remainder
from ff_planner_ros.planning.search.families import is_detour, is_held, path_families
from ff_planner_ros.planning.search.grid import BEGINNING
from ff_planner_ros.planning.search.grid_solver import GridSolver, PathSolution
from ff_planner_ros.planning.search.guided_search import Allowance, plan_along, plan_from
from ff_planner_ros.planning.search.multi_start import PROMISING_VIOLATION, first_plan
from ff_planner_ros.planning.search.warm_start import (
    SHORTEST,
    plan_near_guess,
    plan_near_remainder,
)
from ff_planner_ros.robot.model import Robot

# Decision variables of a path, or the remainder of a running plan.
FirstGuess: TypeAlias = Array | Remainder

NOBODY = Watch()

# Initial guesses towards a goal with more conditions than the arm can meet at once.
_STARTS_OF_A_POOR_ARM = 3


def plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch = NOBODY,
    first_guess: FirstGuess | None = None,
) -> Plan:
    """Plan a trajectory: optimal, collision-free, checked.

    If the chaser's attitude has a weight, the search begins at the plan of minimum joint path and
    never returns a worse one. If there is no such plan, it searches for any.

    From a range of durations it chooses one (`best_moment`). A remainder keeps the goal time of its
    plan, or the nearest in the range, if there is a plan for that.

    With parametrisation `auto`, the paper's paths are searched first, if they apply. Joint splines
    are searched if those have no plan, and from their plan if the chaser's attitude has a weight or
    an active limit, or if the joint path is a detour.

    The same problem, settings and first guess give the same plan. If the watch ends the search, the
    best plan so far is returned.

    Args:
        watch: May end the search, and hears of its progress.
        first_guess: Decision variables of a path, as in `Plan.coefficients`: tried first, in the
            family that has as many. A remainder: a plan near it, if there is one, is the answer;
            otherwise the search goes on without it. None: the families' own guesses only.

    Raises:
        InvalidInput: The start violates a requirement, the first guess fits no family, or there is
            no plan and the arm cannot meet all conditions of the goal at once.
        NoPlanFound: The goal is out of reach, the search found no feasible path, or the check
            refused the path that it found.
        OutOfTime: The watch ended the search before there was a plan; `refusal` says how far it
            came.
    """
    best = _Best(watch, problem.objective)
    try:
        found = _plan(problem, settings, best, first_guess)
    except OutOfTime as end:
        if best.plan is None:
            raise
        is_remainder = best.plan.family == REMAINDER
        what = "the remainder of the running plan" if is_remainder else "the best plan so far"
        report = replace(best.plan.solver, stop_reason=f"{end}: {what}", ended_by=end.ended_by)
        return replace(best.plan, solver=report)
    return found


class _Best(PassingOn):
    """A watch that keeps the best plan that is offered."""

    def __init__(self, watch: Watch, objective: Objective) -> None:
        super().__init__(watch)
        self._objective = objective
        self.plan: Plan | None = None

    def offer(self, plan: Plan) -> None:
        """Keep a better plan, and pass it on."""
        cost, best = plan_cost(self._objective, plan), self.plan
        if best is None or cost < plan_cost(self._objective, best):
            self.plan = plan
            super().offer(plan)


def _plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: FirstGuess | None,
) -> Plan:
    """Return the plan of a search that came to its end; see `plan`."""
    window = problem.duration_range
    if window is not None and window.minimum == window.maximum:
        problem, window = lasting(problem, window.minimum), None
    if first_guess is not None and not isinstance(first_guess, Remainder):
        return _plan_beside_guess(problem, settings, watch, first_guess)
    if window is None:
        return _plan_in_time(problem, settings, watch, first_guess)
    if isinstance(first_guess, Remainder):
        kept = min(max(first_guess.goal, window.minimum), window.maximum)
        with suppress(NoPlanFound):
            return _plan_in_time(lasting(problem, kept), settings, watch, first_guess)
    return plan_at_best_moment(problem, settings, watch, None, _plan_in_time)


def _plan_beside_guess(
    problem: PlanningProblem, settings: PlannerSettings, watch: Watch, guess: Array
) -> Plan:
    """Return the plan that a guess leads to, or else the plan without a guess.

    The latter is the same to the last bit as if there had been none, and a guess takes no more than
    its allowance of evaluations.
    """
    allowance = Allowance(watch, problem.duration_range is not None)
    try:
        with suppress(NoPlanFound):
            if problem.duration_range is None:
                return plan_near_guess(problem, settings, allowance, guess)
            once = replace(settings, starts=1)
            return plan_at_best_moment(problem, once, allowance, guess, plan_near_guess)
    except OutOfTime:
        if not allowance.used_up:
            raise
    found = _plan(problem, settings, watch, None)
    return replace(found, solver=replace(found.solver, starts=found.solver.starts + 1))


def _plan_in_time(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: FirstGuess | None,
) -> Plan:
    """Return the plan of a problem whose duration is given; see `plan`."""
    require_plannable(problem, settings)
    require_time(problem)
    groups = path_families(problem, settings)
    if isinstance(first_guess, Remainder):
        near, first_guess = plan_near_remainder(problem, settings, watch, groups, first_guess)
        if near is not None:
            return near
    conditions = conditions_of(problem.robot, problem.target)
    met = steered(problem.robot, problem.target)
    too_many = problem.posture is None and met < sum(conditions.values())
    if too_many:  # a goal that the arm happens to be able to meet is found soon
        settings = replace(settings, starts=min(settings.starts, _STARTS_OF_A_POOR_ARM))
    if (along := plan_along(problem, settings, groups[-1][0], watch, first_guess)) is not None:
        return along
    refusals: list[NoPlanFound] = []
    for ways in groups:
        fits = first_guess is not None and len(first_guess) == ways[0].variables
        guess = first_guess if fits else None
        try:
            found = _ways_round(problem, settings, ways, watch, guess, groups[-1][0])
        except NoPlanFound as refused:
            refusals.append(refused)
            continue
        weighs_attitude = problem.objective.chaser_attitude > 0.0
        shortest = replace(problem, objective=SHORTEST) if weighs_attitude else problem
        more = _in_family_of_more(shortest, settings, groups[-1][0], watch, found)
        if weighs_attitude:
            return _least_attitude(problem, settings, groups[-1], watch, guess, found, more)
        return _best_of(problem, [*found, *more]).plan
    if too_many:
        why = why_not_steered(problem.robot, problem.target)
        raise too_many_conditions(problem.target, conditions, why, met)
    # A singularity of one family does not explain why there is no plan.
    others = [refused for refused in refusals if refused.status is not Status.SINGULAR]
    raise (others or refusals)[0]


class _Found(NamedTuple):
    """A plan, and the family of its path."""

    family: PathFamily
    plan: Plan


def _best_of(problem: PlanningProblem, found: Sequence[_Found]) -> _Found:
    return min(found, key=lambda one: weighted_sum(problem.objective, one.plan.metrics))


def _ways_round(
    problem: PlanningProblem,
    settings: PlannerSettings,
    ways: Sequence[PathFamily],
    watch: Watch,
    first_guess: Array | None,
    most_general: PathFamily,
) -> list[_Found]:
    """Return the plan of each way round that has one.

    If the attitude has a weight, plans are of minimum joint path, or of the objective itself if
    there are none. If a way's path is a detour or blocked, its plan may be of the most general one.

    Raises:
        NoPlanFound: There is none.
        OutOfTime: By the watch.
    """
    way, asked = Parametrisation(ways[0].name), problem.objective
    for objective in (asked,) if asked.chaser_attitude == 0.0 else (SHORTEST, asked):
        found, refusals = list[_Found](), list[NoPlanFound]()
        for family in ways:
            try:
                posed = replace(problem, parametrisation=way, objective=objective)
                solver = GridSolver(path_program(posed, family, settings), settings, watch)
                if objective is not asked and asked.joint_path_length == 0.0:
                    solver.grids[-1] = solver.grids[-1].with_stage(progress=BEGINNING)
                elsewhere = partial(_with_more_room, solver, most_general)
                plan = first_plan(solver, first_guess, elsewhere)
                found.append(_Found(family if plan.family == way else most_general, plan))
            except NoPlanFound as refused:
                refusals.append(refused)
        if found:
            return found
    raise refusals[0]


def _with_more_room(solver: GridSolver, family: PathFamily, coarse: PathSolution) -> Plan | None:
    """Return the plan of a more general family near a coarse detour or violation, if it has one.

    It is hardly worse than from the end of the path's own search, in half of the time.
    """
    own, joints = solver.program.family, coarse.at_x.motion.q[:, 7:]
    if family.name == own.name or coarse.at_x.violation > PROMISING_VIOLATION:
        return None
    if coarse.feasible and not is_detour(joints, solver.problem.robot.joint_weights):
        return None
    seen = own.motion(coarse.x, SAMPLES)
    if seen.singular_at is not None:
        return None
    seed = family.near(seen.q)
    return _near(solver.problem, solver.settings, family, solver.watch, solver.effort, seed)


def _in_family_of_more(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    found: Sequence[_Found],
) -> list[_Found]:
    """Return plans of a more general family to which found plans of another lead.

    From all, if a limit on the chaser's rotation is active; from the best one, if it is a detour:
    then that family has much shorter paths. Else they are hardly shorter, and double the time.
    """
    found = [one for one in found if one.family.name != family.name]
    if found and not any(is_held(problem, settings, one.plan) for one in found):
        best = _best_of(problem, found)
        joints = best.plan.trajectory.joint_positions
        found = [best] if is_detour(joints, problem.robot.joint_weights) else []
    more = list[_Found]()
    for one in found:
        effort = Effort()
        effort.add(one.plan.solver)
        seed = _seed(problem.robot, family, one)
        plan = _near(problem, settings, family, watch, effort, seed)
        more += [] if plan is None else [_Found(family, plan)]
    return more


def _near(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    effort: Effort,
    seed: Array,
) -> Plan | None:
    """Return the plan of a family to which a path of it leads, if there is one."""
    problem = replace(problem, parametrisation=Parametrisation(family.name))
    solver = GridSolver(path_program(problem, family, settings), settings, watch, effort)
    return plan_from(solver, seed)


def _seed(robot: Robot, family: PathFamily, found: _Found) -> Array:
    """Return the path of a family that is nearest to a plan."""
    if family is found.family:
        return found.plan.coefficients
    motion = found.family.motion(found.plan.coefficients, SAMPLES)
    if motion.singular_at is None:
        return family.near(motion.q)
    # What passes a singularity on the plan's points may meet it on fewer.
    return family.near(from_trajectory(robot, found.plan.trajectory)[0])


def _least_attitude(
    problem: PlanningProblem,
    settings: PlannerSettings,
    ways: Sequence[PathFamily],
    watch: Watch,
    first_guess: Array | None,
    found: Sequence[_Found],
    more: Sequence[_Found],
) -> Plan:
    """Return the best plan by an objective that weighs the attitude, searched from other plans.

    Args:
        ways: The most general family that the problem allows.
        found: Plans of minimum joint path.
        more: Plans of minimum joint path in the most general family, to which those lead.
    """
    first = _best_of(problem, found)
    family = next((way for way in ways if way is first.family), ways[0])
    effort = Effort()
    for one in more or found:  # `more` have the effort of those that led to them
        effort.add(one.plan.solver)
    begin = _best_of(problem, [*found, *more]).plan
    problem = replace(problem, parametrisation=Parametrisation(family.name))
    solver = GridSolver(path_program(problem, family, settings), settings, watch, effort)
    sources = [first] if family is first.family else found
    seeds = [_seed(problem.robot, family, one) for one in sources]
    search = AttitudeSearch(solver, problem.objective, begin, seeds)
    if first_guess is not None and len(first_guess) == family.variables:
        search.better_at(first_guess)
    return search.best_plan()
