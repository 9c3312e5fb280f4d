"""The entry point of the planner: from a task to its plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.errors import (
    Failure,
    FfPlannerError,
    InvalidInput,
    NoPlanFound,
    OutOfTime,
    Status,
)
from ff_planner_ros.planning.check.check import assess, out_of_time, refusal
from ff_planner_ros.planning.motion.forward import as_measured, carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import SystemFrame, system_frame
from ff_planner_ros.planning.motion.watch import Steps, Watch
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.robust.robust import robust_plan
from ff_planner_ros.planning.search.continuing import Remainder, joined
from ff_planner_ros.planning.search.planner import NOBODY, FirstGuess, plan
from ff_planner_ros.planning.task.controller_rules import require_acceptable
from ff_planner_ros.planning.task.following import following, require_askable_phases
from ff_planner_ros.planning.task.notes import notes_on, with_notes
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.tail import EndBehaviour, with_tail
from ff_planner_ros.robot.state import SystemState

__all__ = [
    "Method",
    "PlanningTask",
    "as_it_begins",
    "attempted",
    "in_frame_of_user",
    "perform",
    "without_search",
]

# Takes the problem in the frame that the plan is made in, settings, watch and initial guess.
Method: TypeAlias = Callable[[PlanningProblem, PlannerSettings, Watch, FirstGuess | None], Plan]

# A phase that another follows keeps so much more clearance [m], if one of a few initial guesses
# leads to such a plan: the next phase begins there, with one body more.
_ROOM, _FEW = 0.02, 3
# Index among the tasks of such a phase of the one without more clearance.
_AS_IT_IS = 1
# Durations that are tried if the post-goal segment of the chosen one is not feasible: an eighth of
# the range apart.
_OTHER_MOMENTS = 9


def without_search(solve: Callable[[PlanningProblem, PlannerSettings], Plan]) -> Method:
    """Return a method from a function that uses neither a watch nor an initial guess."""
    return lambda problem, settings, _watch, _guess: solve(problem, settings)


def in_frame_of_user(
    solve: Callable[[PlanningProblem, PlannerSettings], Plan], problem: PlanningProblem
) -> Method:
    """Return a method for one task from a function whose plan depends on the frame.

    The function solves the problem in the user's frame instead of that of the system.

    Args:
        problem: The task's problem, in the user's frame; the plan begins at its start.
    """
    frame = system_frame(problem.robot, problem.start)
    return lambda _problem, settings, _watch, _guess: frame.plan(solve(problem, settings))


def perform(task: PlanningTask, watch: Watch = NOBODY, method: Method = plan) -> Plan:
    """Plan from the predicted start to the end of the post-goal segment, and check the plan.

    The same task gives the same plan. If the watch ended the search, the same task with the
    `effort` of the plan or of the refusal gives the same plan or refusal again. The plan is made
    and checked in the frame of the system's centre of mass (`system_frame`), so that it does not
    depend on the frame of the task, in which the plan and the attempt of a refusal are.

    In a sequence of phases each begins where the plan before ends, and the last one has the
    post-goal segment. The plan is that of the first phase, with those of the others in `then`.

    Raises:
        InvalidInput: `task` is no task, or the start violates what the plan must keep.
        NoPlanFound: The method found no plan; or its plan does not pass the check, with the
            post-goal segment or without; or the controller would not accept it; or the watch ended
            the search. In a sequence, the message names the phase, `found` holds the plans before
            it, and `cause` an InvalidInput of a later phase.
    """
    an_object("task", task, PlanningTask)
    if method is plan:
        require_askable_phases(task)
    if not task.then:
        return _perform(task, watch, method)
    count = 1 + len(task.then)
    phases, plans, others = [task], list[Plan](), list[Iterator[PlanningTask]]()
    refused: FfPlannerError | None = None
    while len(plans) < count:
        phase, share = phases[-1], watch.share(count - len(plans))
        try:
            ways = _ways(phase)
            found = _first(ways, share, method)
            after = [following(phase, found)] if phase.then else []
        except FfPlannerError as error:
            refused = refused or _without_rest(error, plans, count)
            clocked = isinstance(error, NoPlanFound) and error.effort
            again = None if clocked else _otherwise(phases, plans, others, share, method)
            if again is None:
                raise refused from None
            plans[-1], phases[-1] = again
            continue
        plans.append(found)
        others.append(ways)
        phases += after
        refused = None
    return replace(plans[0], then=tuple(plans[1:]))


def _first(ways: Iterator[PlanningTask], watch: Watch, method: Method) -> Plan:
    """Return the plan of the first task that has one.

    Raises:
        InvalidInput, NoPlanFound: No task has one; the error is that of the phase as it is.
    """
    refused = list[FfPlannerError]()
    for task in ways:
        try:
            return _perform(task, watch, method)
        except (InvalidInput, NoPlanFound) as error:
            if isinstance(error, NoPlanFound) and error.effort:
                raise  # no time is left
            refused.append(error)
    raise refused[: _AS_IT_IS + 1][-1]


def _otherwise(
    phases: Sequence[PlanningTask],
    plans: Sequence[Plan],
    others: Sequence[Iterator[PlanningTask]],
    watch: Watch,
    method: Method,
) -> tuple[Plan, PlanningTask] | None:
    """Return another plan of the last planned phase, with the next one's task; None: there is none.

    There is none if the clock ended a search before: a repetition would not go the same way.
    """
    if not plans or any(one.effort for one in plans):
        return None
    for task in others[-1]:
        with suppress(InvalidInput, NoPlanFound):
            found = _perform(task, watch, method)
            return None if found.effort else (found, following(phases[-2], found))
    return None


def _ways(task: PlanningTask) -> Iterator[PlanningTask]:
    """Yield the tasks to try for a phase: with more clearance for the next one, then as it is."""
    alone = _to_goal_alone(task)
    if not task.then:
        yield alone
        return
    margin, starts = alone.settings.clearance_margin, alone.settings.starts
    roomy = replace(alone.settings, clearance_margin=margin + _ROOM, starts=min(_FEW, starts))
    yield replace(alone, settings=roomy)
    yield alone
    if alone.problem.posture is None and alone.problem.parametrisation is Parametrisation.AUTO:
        for family in (Parametrisation.JOINT_SPLINE, Parametrisation.END_EFFECTOR_POLYNOMIAL):
            yield replace(alone, problem=replace(alone.problem, parametrisation=family))


def _to_goal_alone(task: PlanningTask) -> PlanningTask:
    """Return the task of the first phase by itself, without a post-goal segment."""
    if not task.then:
        return task
    controller = task.controller
    if controller is not None:
        controller = replace(controller, allow_nonzero_velocity_at_trajectory_end=True)
    return replace(task, then=(), end_behaviour=EndBehaviour.NONE, tail=0.0, controller=controller)


def _without_rest(error: FfPlannerError, plans: Sequence[Plan], count: int) -> FfPlannerError:
    """Return the error with the number of the phase that has no plan, and the plans before it."""
    which = f"phase {len(plans) + 1} of {count}"
    if not plans and isinstance(error, InvalidInput):
        return error  # of the start
    told = NoPlanFound(error.status, f"{which}: {error}")
    if isinstance(error, NoPlanFound):
        told = NoPlanFound(
            error.status, f"{which}: {error}", error.attempt, error.failures, error.effort
        )
    if isinstance(error, InvalidInput):
        field = f"then[{len(plans) - 1}].{error.field}"
        told.cause = InvalidInput(error.status, field, error.value, error.allowed)
    if plans:
        told.found = replace(plans[0], then=tuple(plans[1:]))
    return told


def _perform(task: PlanningTask, watch: Watch, method: Method) -> Plan:
    """Return the plan of one phase: `perform`."""
    problem, running = task.problem, task.running
    guess: FirstGuess | None = task.first_guess
    if running is None or task.running_goal is None:
        frame, problem = as_it_begins(problem, task.ahead, running)
    else:
        start = joined(problem.robot, problem.start, task.ahead, running)
        rest = replace(running, time=running.time - task.ahead)
        guess = Remainder(rest, task.running_goal - task.ahead)
        frame, problem = _seen_from_system(problem, start)
    steps = Steps(watch, task.effort)
    notes = notes_on(problem, task.settings)
    try:
        found = _performed(task, problem, steps, method, guess)
        return frame.plan_seen_by_user(replace(found, effort=steps.ended_at, notes=notes))
    except OutOfTime as end:
        refused = end.refusal or out_of_time(end)
    except NoPlanFound as found_none:
        refused = found_none
    except InvalidInput as error:
        raise as_measured(error, problem.robot, task.problem.start, task.ahead) from None
    refused = with_notes(refused, notes)
    refused.effort = steps.ended_at
    if isinstance(refused.attempt, Plan):
        refused.attempt = frame.plan_seen_by_user(refused.attempt)
    raise refused


@lru_cache(maxsize=2)
def as_it_begins(
    problem: PlanningProblem, ahead: float, running: JointMotion | None
) -> tuple[SystemFrame, PlanningProblem]:
    """Return the frame that a plan is made in, and the problem from the plan's start in that frame.

    Not for a plan that takes over from a running one. A library needs both before the planner.

    Args:
        ahead: Time from the measurement to the plan's first point [s].
        running: Motion of the joints until then; None: they keep their measured velocities.
    """
    start = carried_forward(problem.robot, problem.start, ahead, running)
    return _seen_from_system(problem, start)


def _seen_from_system(
    problem: PlanningProblem, start: SystemState
) -> tuple[SystemFrame, PlanningProblem]:
    """Return the `system_frame` of the plan's first state, and the problem from there in it."""
    frame = system_frame(problem.robot, start)
    return frame, frame.problem(problem)  # which begins at the frame's own start


def _performed(
    task: PlanningTask,
    problem: PlanningProblem,
    watch: Watch,
    method: Method,
    guess: FirstGuess | None,
) -> Plan:
    """Return the checked plan, with its post-goal segment, in the frame that it is made in."""
    settings, window = task.settings, problem.duration_range

    def whole_of(to_goal: Plan) -> Plan:
        chosen = lasting(problem, to_goal.duration)
        try:
            return with_tail(chosen, to_goal, task.end_behaviour, task.tail, settings)
        except InvalidInput as error:  # of the range, this duration has too many points
            raise NoPlanFound(Status.CHECK_FAILED, str(error), to_goal) from None

    to_goal = robust_plan(problem, settings, watch, guess, method, whole_of)
    chosen = lasting(problem, to_goal.duration)
    if method is not plan or settings.robust.sigmas:  # the planner's own plans passed the check
        checked = assess(chosen, to_goal.trajectory, settings, to_goal.may_be_singular)
        to_goal = replace(to_goal, metrics=checked.metrics)
        found = tuple(failure for _, failure in checked.failures)
        if found:
            raise _refused(to_goal, found, is_planner=method is plan)
    try:
        whole = whole_of(to_goal)
    except NoPlanFound as undrivable:
        if window is None:
            raise
        moments = set(np.linspace(window.minimum, window.maximum, _OTHER_MOMENTS).tolist())
        moment = chosen.duration
        others = sorted(moments - {moment}, key=lambda other: (abs(other - moment), other))
        return _at_another_moment(task, problem, watch, method, others, undrivable)
    if task.controller is not None:
        require_acceptable(task.controller, whole)
    return whole


def _at_another_moment(
    task: PlanningTask,
    problem: PlanningProblem,
    watch: Watch,
    method: Method,
    moments: Sequence[float],
    undrivable: NoPlanFound,
) -> Plan:
    """Return the plan of the first duration that has one with its post-goal segment.

    Args:
        undrivable: Error of the duration that was chosen; raised if no other has a plan.
    """
    for moment in moments:
        with suppress(InvalidInput, NoPlanFound):
            return _performed(task, lasting(problem, moment), watch, method, None)
    raise undrivable


def attempted(
    task: PlanningTask, method: Method
) -> tuple[Plan | FfPlannerError, tuple[Failure, ...]]:
    """Return a method's plan, valid or not, or its error; and the failures that the check found."""
    made: list[Plan] = []

    def kept(*arguments: Any) -> Plan:
        made.append(method(*arguments))
        return made[-1]

    try:
        return perform(task, method=kept), ()
    except FfPlannerError as error:
        if made and isinstance(error, NoPlanFound) and isinstance(error.attempt, Plan):
            return error.attempt, error.failures
        return error, error.failures if isinstance(error, NoPlanFound) else ()


def _refused(found: Plan, why: tuple[Failure, ...], is_planner: bool) -> NoPlanFound:
    if is_planner:
        return refusal(found, why)
    ending = Failure(why[0].status, found.solver.stop_reason, ())
    words = refusal(found, [ending, *why], advice=["--method optimal"]).constraint
    return NoPlanFound(why[0].status, words, found, why)
