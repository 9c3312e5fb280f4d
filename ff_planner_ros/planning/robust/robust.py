"""Plans with a margin of k standard deviations on every constraint that model errors affect.

A robust plan is a fixed point: plan, predict the deviation of every margin (`margins`), tighten the
limits by what the margins lack (`back_off`), and plan again. The back-off only grows: of obstacles
by a radius each, of the chaser's Euler angles and its rotation, of the approach's corridor and of
the joints' torques. Errors do not change the motion of controlled joints: its limits stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.motion.plan import Plan, RobustReport
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings, RobustSettings
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, directions
from ff_planner_ros.planning.robust.back_off import (
    BackOff,
    exceeds,
    exhausted_limits,
    increase,
    largest_back_off,
    no_back_off,
    tighten,
)
from ff_planner_ros.planning.robust.base_spread import base_spread, tracked_motion
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    ROTATION,
    TORQUE,
    UNITS,
    WORDS,
    Margins,
    margins,
)
from ff_planner_ros.planning.robust.nearness import nearness

# Number of plans beside the plain one: three are enough unless the way round changes.
_ROUNDS = 6
# If so many deviations cannot be kept, bisection finds how many can: in so many steps, with so few
# initial guesses, which understate it at worst.
_HALVINGS, _STARTS = 3, 3

_STATUS = {
    CLEARANCE: Status.COLLISION,
    ATTITUDE: Status.LIMIT_VIOLATED,
    ROTATION: Status.LIMIT_VIOLATED,
    CORRIDOR: Status.LIMIT_VIOLATED,
    TORQUE: Status.TORQUE_TOO_HIGH,
}
_ADVICE = ("fewer planner.robust.sigmas", "smaller deviations", "a longer duration")


@dataclass(frozen=True, eq=False)
class _Asked:
    """The arguments of `robust_plan`, with the plain plan and the largest back-off."""

    problem: PlanningProblem
    settings: PlannerSettings
    watch: Any
    method: Callable[..., Plan]
    whole: Callable[[Plan], Plan]  # adds the post-goal segment to a plan
    plain: Plan
    largest: BackOff


def withstood(settings: RobustSettings) -> Uncertainty:
    """Return the standard deviations of the settings as an `Uncertainty`."""
    return Uncertainty(**_deviations(settings))


def robust_plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Any,
    guess: Any,
    method: Callable[..., Plan],
    whole: Callable[[Plan], Plan],
) -> Plan:
    """Return a plan with `robust.sigmas` standard deviations on every margin, and its report.

    With `robust.sigmas` zero it is the plan of the method.

    Args:
        watch: Passed to the method, like the guess.
        method: Plans a problem: its arguments are problem, settings, watch and guess.
        whole: Adds the post-goal segment, whose margins count, too, to a plan.

    Raises:
        InvalidInput: As by the method, or deviations are to be kept with wheels.
        NoPlanFound: There is no plan, or none that keeps so many deviations.
        OutOfTime: By the watch.
    """
    if settings.robust.sigmas and problem.robot.wheels is not None:
        allowed = "it must be 0 with robot.base attitude_held: how wheels share errors is not known"
        asked_for = settings.robust.sigmas
        raise InvalidInput(Status.UNSUPPORTED, "planner.robust.sigmas", asked_for, allowed)
    plain = method(problem, settings, watch, guess)
    if not settings.robust.sigmas:
        return plain
    asked = _Asked(problem, settings, watch, method, whole, plain, largest_back_off(problem))
    sigmas = settings.robust.sigmas
    found = _fixed_point(asked, sigmas)
    if isinstance(found, Plan):
        return found
    words = f"{found.constraint}; {_can_be_kept(asked, sigmas)}"
    message = f"no plan found that keeps planner.robust: {words}. What may help: "
    failure = Failure(found.status, words, _ADVICE)
    raise NoPlanFound(found.status, message + ", ".join(_ADVICE), found.attempt, (failure,))


def _fixed_point(asked: _Asked, sigmas: float) -> Plan | NoPlanFound:
    """Return a plan that keeps so many deviations, or the refusal that says what it lacks."""
    problem, found = asked.problem, asked.plain
    back_off = no_back_off(problem)
    for rounds in range(_ROUNDS + 1):
        kept = _margins(asked, found)
        lacking = [one for one in kept if one.lacking(sigmas).size]
        if not lacking:
            return replace(found, robust=_report(asked, sigmas, kept, back_off, rounds))
        larger = increase(back_off, sigmas, lacking, asked.largest)
        exhausted = exhausted_limits(problem, larger)
        beyond = [one for one in lacking if one.kind in exhausted]
        if beyond or rounds == _ROUNDS or not exceeds(larger, back_off):
            return _short_of(problem, sigmas, beyond or lacking, found)
        again = found.coefficients if found.coefficients.size else None
        try:
            found, back_off = _plan_with(asked, larger, again), larger
        except NoPlanFound as refused:
            return _short_of(problem, sigmas, lacking, found, refused)
    raise AssertionError  # the last round returns


def _can_be_kept(asked: _Asked, sigmas: float) -> str:
    """Return words for how many deviations some plan keeps, by bisection."""
    few = min(asked.settings.starts, _STARTS)
    asked = replace(asked, settings=replace(asked.settings, starts=few))
    low, high = 0.0, sigmas
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        try:
            found = _fixed_point(asked, middle)
        except OutOfTime:
            break
        if isinstance(found, Plan):
            low = middle
        else:
            high = middle
    return f"{low:.4g} can be kept" if low else f"not even {high:.4g} can be kept"


def _margins(asked: _Asked, plan: Plan) -> list[Margins]:
    """Return the margins of a plan and its post-goal segment."""
    problem, robot = lasting(asked.problem, plan.duration), asked.problem.robot
    with suppress(NoPlanFound):  # an infeasible tail is refused afterwards
        plan = asked.whole(plan)
    motion = tracked_motion(robot, plan.trajectory)
    scene = scene_of(problem).seen_from(motion.origin, motion.velocity)
    of = directions(robot, withstood(asked.settings.robust))
    near = nearness(robot, motion.q, motion.time, scene)
    return margins(motion, scene, near, problem.limits, of, base_spread(motion, of))


def _plan_with(asked: _Asked, back_off: BackOff, guess: Array | None) -> Plan:
    """Return a plan that keeps tighter limits.

    Raises:
        NoPlanFound: There is none; the error names the back-off of obstacles.
        OutOfTime: By the watch.
    """
    try:
        return asked.method(tighten(asked.problem, back_off), asked.settings, asked.watch, guess)
    except (InvalidInput, NoPlanFound) as refused:
        most = float(back_off[CLEARANCE].max(initial=0.0))
        why = str(refused).partition(". What may help")[0]
        words = f"with what is lacking kept back, obstacles up to {most:.3g} m larger: {why}"
        raise NoPlanFound(refused.status, words, getattr(refused, "attempt", None)) from None


def _report(
    asked: _Asked, sigmas: float, kept: Sequence[Margins], back_off: BackOff, rounds: int
) -> RobustReport:
    ids = [one.id for one in asked.problem.obstacles]

    def by_name(kind: str, names: Sequence[str]) -> tuple[tuple[str, float], ...]:
        pairs = zip(names, back_off[kind], strict=True)
        return tuple((name, float(amount)) for name, amount in pairs if amount)

    return RobustReport(
        sigmas=sigmas,
        least_sigmas=min((float(one.in_deviations(sigmas).min()) for one in kept), default=np.inf),
        rounds=rounds,
        plain_joint_path_length=asked.plain.metrics.joint_path_length,
        clearance=by_name(CLEARANCE, ids),
        chaser_attitude=float(back_off[ATTITUDE][0]),
        chaser_rotation=float(back_off[ROTATION][0]),
        torques=by_name(TORQUE, asked.problem.robot.joint_names),
        corridor=float(back_off[CORRIDOR][0]),
        deviations=tuple(_deviations(asked.settings.robust).items()),
    )


def _deviations(settings: RobustSettings) -> dict[str, float]:
    given = {item.name: getattr(settings, item.name) for item in fields(settings)}
    del given["sigmas"]
    return given


def _short_of(
    problem: PlanningProblem,
    sigmas: float,
    lacking: Sequence[Margins],
    plan: Plan,
    refused: NoPlanFound | None = None,
) -> NoPlanFound:
    """Return the refusal that names the margin with the fewest deviations.

    Args:
        refused: Why no plan with larger margins was found; None: none was searched.
    """
    worst = min(lacking, key=lambda one: float(one.in_deviations(sigmas).min()))
    in_deviations = worst.in_deviations(sigmas)
    row = int(in_deviations.argmin())
    number = int(worst.which[row])
    name = ""
    if worst.kind == CLEARANCE:
        name = f" {problem.obstacles[number].id}"
    elif worst.kind == TORQUE:
        name = f" {problem.robot.joint_names[number]}"
    tail = plan.duration if plan.duration is not None else problem.duration
    after = " after the goal," if worst.time[row] > tail else ""
    finding = (
        f"{WORDS[worst.kind]}{name} is {worst.values[row]:.3g} {UNITS[worst.kind]} at "
        f"t = {worst.time[row]:.2f} s,{after} {in_deviations[row]:.2f} of its deviations, and "
        f"{sigmas:g} are to be kept"
    )
    why = "" if refused is None else f" ({refused})"
    attempt = (refused and refused.attempt) or plan
    return NoPlanFound(_STATUS[worst.kind], finding + why, attempt)
