"""The one door to the planner: everything that a plan depends on, and the way to the plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_number, frozen
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import changes
from ff_planner_ros.common.forms import a_number, a_vector, a_whole_number, a_word, or_none
from ff_planner_ros.errors import (
    Failure,
    FfPlannerError,
    InvalidInput,
    NoPlanFound,
    OutOfTime,
    Status,
)
from ff_planner_ros.planning.check.check import failures, out_of_time, refusal
from ff_planner_ros.planning.motion.forward import as_measured, carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import SystemFrame, system_frame
from ff_planner_ros.planning.motion.watch import Steps, Watch
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.robust.robust import robust_plan
from ff_planner_ros.planning.search.continuing import Remainder, joined
from ff_planner_ros.planning.search.planner import NOBODY, FirstGuess, plan
from ff_planner_ros.planning.task.controller_rules import Command, Controller, require_acceptable
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.notes import hull_notes
from ff_planner_ros.planning.task.tail import FORMER_END_BEHAVIOURS, EndBehaviour, with_tail
from ff_planner_ros.robot.state import SystemState

# Problem, in the frame that the plan is made in, settings, who watches, first guess.
Method: TypeAlias = Callable[[PlanningProblem, PlannerSettings, Watch, FirstGuess | None], Plan]

_NANOSECONDS = 1e9
# Durations that are tried where the tail of the one that was chosen cannot be driven: as far apart
# as an eighth of the range.
_OTHER_MOMENTS = 9
# More steps than any search takes; messages count them in a uint64.
MOST_STEPS = 2**53
# A goal is at its motion's last point, but for this [s].
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """A problem with everything else that its plan depends on.

    Raises:
        InvalidInput: A time that is negative, or a number that is not finite.
    """

    problem: PlanningProblem  # its start is the state as measured
    settings: PlannerSettings = declare(
        changes(PlannerSettings),
        "settings of the planner, as the parameters of this group",
        key="planner",
        since="0.3",
        optional=True,
    )
    ahead: float = declare(
        a_number(at_least=0.0),
        "time from the state to the first point of the plan, for which the state is carried "
        "forward",
        key="start_after",
        unit="s",
        since="0.3",
        default=0.0,
    )
    running: JointMotion | None = declare(
        changes(JointMotion),
        "what the joints do until then; default: they keep their velocities",
        since="0.3",
        default=None,
    )
    # It begins exactly on that motion, and is looked for near what remains of it
    running_goal: float | None = declare(
        a_number(),
        "when that motion is at its goal: the plan takes over from it; default: a plan of its own",
        unit="s from the state",
        since="0.3",
        default=None,
        late=True,
    )
    end_behaviour: EndBehaviour = declare(
        a_word(EndBehaviour, FORMER_END_BEHAVIOURS),
        "what the arm does after the goal",
        since="0.3",
        default=EndBehaviour.NONE,
        message="end_behaviour",
    )
    tail: float = declare(  # zero for `none`
        a_number(),
        "how long it does so",
        key="post_goal_duration",
        formerly="tail_duration",
        unit="s",
        since="0.3",
        default=0.0,
    )
    controller: Controller | None = declare(
        or_none(changes(Controller)),
        "rules that the plan must keep; none: nobody's",
        since="0.3",
        default=None,
    )
    first_guess: Array | None = declare(
        a_vector(None),
        "decision variables of the path family, tried before anything else",
        since="0.3",
        default=None,
    )
    effort: int = declare(
        a_whole_number(0, MOST_STEPS),
        "step at which the search ends, as an answer tells it; default: it goes to its end",
        key="search.effort",
        since="0.3",
        brief=True,
        default=0,
        message="search.effort",
        late=True,
    )

    def __post_init__(self) -> None:
        """Check the times, and keep read-only copies of the arrays."""
        check_declared(self, "")
        if self.end_behaviour is EndBehaviour.NONE:
            object.__setattr__(self, "tail", 0.0)
        if self.running is not None:
            motion = {item.name: getattr(self.running, item.name) for item in fields(JointMotion)}
            copy = JointMotion(**{name: frozen(rows) for name, rows in motion.items()})
            object.__setattr__(self, "running", copy)
        if self.running_goal is not None:
            self._require_remainder(self.running_goal)

    def _require_remainder(self, goal: float) -> None:
        """Refuse to take over from a motion that does not run then, or is at its goal already."""
        if self.running is None:
            allowed = "there is no running motion to go on from"
            raise InvalidInput(Status.NO_ACTIVE_PLAN, "running_goal", goal, allowed)
        first, last = self.running.time[[0, -1]].tolist()
        if not first <= self.ahead < finite_number("running_goal", goal) <= last + _ROUNDING:
            allowed = (
                f"it must be after start_after, {self.ahead:g} s, and both within running.time, "
                f"{first:g} s to {last:g} s"
            )
            raise InvalidInput(Status.OUT_OF_RANGE, "running_goal", goal, allowed)

    def ended_at(self, effort: int) -> PlanningTask:
        """Return the task whose search ends at a step, as an answer tells it; zero: at its end."""
        return replace(self, effort=effort) if effort else self

    @cached_property
    def digest(self) -> str:
        """A hash of everything that the plan depends on: equal tasks have equal digests."""
        # A controller that lets joints move at the end takes every sound plan.
        strict = self.controller
        if strict is not None and strict.allow_nonzero_velocity_at_trajectory_end:
            strict = None
        return digest_of(replace(self, controller=strict))


def without_search(solve: Callable[[PlanningProblem, PlannerSettings], Plan]) -> Method:
    """Return a method that searches for nothing: a first guess and a watch are of no use to it."""
    return lambda problem, settings, _watch, _guess: solve(problem, settings)


def in_frame_of_user(
    solve: Callable[[PlanningProblem, PlannerSettings], Plan], problem: PlanningProblem
) -> Method:
    """Return a method for one task whose motion depends on the frame: it solves the user's problem.

    Args:
        problem: The task's, from whose start it plans.
    """
    frame = system_frame(problem.robot, problem.start)
    return lambda _problem, settings, _watch, _guess: frame.plan(solve(problem, settings))


def perform(task: PlanningTask, watch: Watch = NOBODY, method: Method = plan) -> Plan:
    """Plan from where the system will be to the end of the tail, and judge the plan.

    The same task gives the same plan. Where the watch ends the search, the same task with the
    effort that the plan, or the refusal, tells gives the same again. The plan is made and judged in
    the frame of the system's centre of mass (`system_frame`), where it does not depend on the frame
    of the task; the plan, and the attempt of a refusal, are in the frame of the task.

    Raises:
        InvalidInput: The start violates what the plan must keep, or the tail is too long.
        NoPlanFound: The method found no plan, or what it found does not pass the check, with its
            tail or without; or the controller would not take it; or the watch ended the search.
    """
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
    try:
        found = _performed(task, problem, steps, method, guess)
        notes = hull_notes(task.problem.obstacle_bodies)
        return frame.plan_seen_by_user(replace(found, effort=steps.ended_at, notes=notes))
    except OutOfTime as end:
        refused = end.refusal or out_of_time(end)
    except NoPlanFound as found_none:
        refused = found_none
    except InvalidInput as error:
        raise as_measured(error, problem.robot, task.problem.start, task.ahead) from None
    refused.effort = steps.ended_at
    if isinstance(refused.attempt, Plan):
        refused.attempt = frame.plan_seen_by_user(refused.attempt)
    raise refused


@lru_cache(maxsize=2)
def as_it_begins(
    problem: PlanningProblem, ahead: float, running: JointMotion | None
) -> tuple[SystemFrame, PlanningProblem]:
    """Return the frame that a plan of its own is made in, and the problem from its start there.

    A library asks for it before the plan is made.

    Args:
        ahead: Time from the measurement to the plan's first point [s].
        running: Of the joints meanwhile; None: they keep their measured rates.
    """
    start = carried_forward(problem.robot, problem.start, ahead, running)
    return _seen_from_system(problem, start)


def _seen_from_system(
    problem: PlanningProblem, start: SystemState
) -> tuple[SystemFrame, PlanningProblem]:
    """Return the frame of a system at the plan's first point, and the problem from there in it."""
    frame = system_frame(problem.robot, start)
    return frame, frame.problem(replace(problem, start=start))


def _performed(
    task: PlanningTask,
    problem: PlanningProblem,
    watch: Watch,
    method: Method,
    guess: FirstGuess | None,
) -> Plan:
    """Return the plan for a problem in the frame of the plan, judged."""
    settings, window = task.settings, problem.duration_range

    def whole_of(to_goal: Plan) -> Plan:
        chosen = lasting(problem, to_goal.duration)
        return with_tail(chosen, to_goal, task.end_behaviour, task.tail, settings)

    to_goal = robust_plan(problem, settings, watch, guess, method, whole_of)
    chosen = lasting(problem, to_goal.duration)
    found = tuple(failures(chosen, to_goal, settings))
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
        require_acceptable(task.controller, _command(whole, task.controller))
    return whole


def _at_another_moment(
    task: PlanningTask,
    problem: PlanningProblem,
    watch: Watch,
    method: Method,
    moments: Sequence[float],
    undrivable: NoPlanFound,
) -> Plan:
    """Return the plan of the first duration that has one with its tail.

    Args:
        undrivable: Why there is none of the duration that was chosen; raised where none has one.
    """
    for moment in moments:
        with suppress(InvalidInput, NoPlanFound):
            return _performed(task, lasting(problem, moment), watch, method, None)
    raise undrivable


def attempted(
    task: PlanningTask, method: Method
) -> tuple[Plan | FfPlannerError, tuple[Failure, ...]]:
    """Return a method's motion, sound or not, or why it made none; and what the check found."""
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


def _command(plan: Plan, controller: Controller) -> Command:
    """Return what a controller is sent of a plan."""
    motion = plan.trajectory
    torques = motion.joint_torques if controller.effort_interface else motion.joint_torques[:, :0]
    return Command(
        joint_names=plan.joint_names,
        time_from_start_ns=np.rint(motion.time * _NANOSECONDS).astype(np.int64).tolist(),
        positions=motion.joint_positions.tolist(),
        velocities=motion.joint_velocities.tolist(),
        accelerations=motion.joint_accelerations.tolist(),
        effort=torques.tolist(),
    )
