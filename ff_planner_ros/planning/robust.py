"""A plan that keeps so many deviations from everything that errors of the model could break.

It is a fixed point: plan, foretell the deviation of every margin (`margins`), keep back what they
lack, and plan again. What is kept back only grows: obstacles by a radius each, the chaser's
attitude, and the joints' torques. The corridor of an approach is not among them: at its narrow end
nothing but a better model keeps a system in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ff_planner_ros.arrays import Array, Indices, finite_number
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.base_spread import base_spread, tracked_motion
from ff_planner_ros.planning.check import measure
from ff_planner_ros.planning.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    TORQUE,
    UNITS,
    WORDS,
    Margins,
    margins,
)
from ff_planner_ros.planning.nearness import nearness
from ff_planner_ros.planning.plan import Plan, RobustReport
from ff_planner_ros.planning.problem import PlanningProblem, lasting
from ff_planner_ros.planning.scene import scene_of
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.uncertainty import Uncertainty, directions
from ff_planner_ros.robot.configuration import configuration

# Of what is not known, what counts where the joints are controlled.
KEPT_BACK = ("mass", "inertia", "center_of_mass", "linear_velocity", "angular_velocity")
# Beyond three deviations a normal error is once in 740 times. Ten is more than any model is worth.
SIGMAS, _MOST_SIGMAS = 3.0, 10.0
# Plans that may be made beside the plain one: three are enough but where the way round changes.
_ROUNDS = 6
# What is kept back is this much more than what is lacking: the next plan's deviations differ.
_MORE = 1.02
# A margin that lacks less lacks nothing, in parts of what is asked for.
_EXACT = 1e-3
# An obstacle does not grow nearer to the robot's start than this [m].
_AT_START = 1e-4

_STATUS = {
    CLEARANCE: Status.COLLISION,
    ATTITUDE: Status.LIMIT_VIOLATED,
    TORQUE: Status.TORQUE_TOO_HIGH,
}


@dataclass(frozen=True)
class Robust:
    """What a plan has to withstand.

    Raises:
        InvalidInput: A number of deviations that is not positive, or absurd.
    """

    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    sigmas: float = SIGMAS  # so many deviations each margin keeps

    def __post_init__(self) -> None:
        """Check the number of deviations."""
        name = "planner.robust.sigmas"
        if not 0.0 < finite_number(name, self.sigmas) <= _MOST_SIGMAS:
            allowed = f"it must be greater than 0 and at most {_MOST_SIGMAS:g}"
            raise InvalidInput(Status.OUT_OF_RANGE, name, self.sigmas, allowed)


@dataclass(frozen=True, eq=False)
class _Back:
    """What is kept back of each limit."""

    spheres: Array  # shape (spheres,) [m]
    attitude: float  # [rad]
    torques: Array  # shape (joints,) [N m]


def robust_plan(
    robust: Robust,
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Any,
    guess: Any,
    method: Callable[..., Plan],
) -> Plan:
    """Return a plan of which every margin keeps its deviations, and the price of that.

    Args:
        watch: Of the method, like the guess.

    Raises:
        InvalidInput: As by the method.
        NoPlanFound: There is no plan, or none that keeps so much.
    """
    plain = found = method(problem, settings, watch, guess)
    robot = problem.robot
    back = _Back(np.zeros(len(problem.obstacles)), 0.0, np.zeros(robot.joints))
    most = _most_growth(problem)
    for rounds in range(_ROUNDS + 1):
        kept = _margins(robust, problem, found)
        lacking = [one for one in kept if _lacking(robust, one).size]
        if not lacking:
            return replace(
                found,
                metrics=measure(lasting(problem, found.duration), found.trajectory, settings),
                robust=_report(robust, problem, plain, kept, back, rounds),
            )
        before, back = back, _more(robust, back, lacking, most)
        grown = (back.spheres > before.spheres).any() or (back.torques > before.torques).any()
        if rounds == _ROUNDS or not (grown or back.attitude > before.attitude):
            break
        again = found.coefficients if found.coefficients.size else None
        found = _planned(problem, back, settings, watch, again, method)
    raise _not_robust(robust, problem, lacking, found)


def _margins(robust: Robust, problem: PlanningProblem, plan: Plan) -> list[Margins]:
    """Return the margins of a plan up to its goal, but that of the corridor."""
    problem = lasting(problem, plan.duration)
    robot = problem.robot
    motion = tracked_motion(robot, plan.trajectory)
    scene = scene_of(problem).seen_from(motion.origin, motion.velocity)
    of = directions(robot, robust.uncertainty)
    spread = base_spread(motion, of)
    near = nearness(robot, motion.q, motion.time, scene)
    found = margins(motion, scene, near, problem.limits, of, spread)
    return [one for one in found if one.kind != CORRIDOR]


def _lacking(robust: Robust, one: Margins) -> Indices:
    """Return which margins keep less than they should."""
    return np.flatnonzero(one.values < robust.sigmas * one.sigmas * (1.0 - _EXACT))


def _most_growth(problem: PlanningProblem) -> Array:
    """Return how far each obstacle may grow without reaching the robot at its start [m]."""
    q, _ = configuration(problem.robot, problem.start)
    near = nearness(problem.robot, q[None], np.zeros(1), scene_of(problem))
    least: Array = near.distance.min(axis=(0, 1), initial=np.inf)
    return np.maximum(least - _AT_START, 0.0)


def _more(robust: Robust, back: _Back, lacking: Sequence[Margins], most: Array) -> _Back:
    """Return what is to be kept back so that the margins that lack something have it."""
    spheres, torques, attitude = back.spheres.copy(), back.torques.copy(), back.attitude
    for one in lacking:
        rows = _lacking(robust, one)
        needed = _MORE * robust.sigmas * one.sigmas[rows]
        if one.kind == CLEARANCE:
            np.maximum.at(spheres, one.which[rows], needed)
        elif one.kind == ATTITUDE:
            attitude = max(attitude, float(needed.max()))
        else:
            np.maximum.at(torques, one.which[rows], needed)
    return _Back(np.minimum(spheres, most), attitude, torques)


def _planned(
    problem: PlanningProblem,
    back: _Back,
    settings: PlannerSettings,
    watch: Any,
    guess: Array | None,
    method: Callable[..., Plan],
) -> Plan:
    """Return a plan that keeps something back."""
    limits, robot = problem.limits, problem.robot
    attitude = limits.chaser_attitude - back.attitude
    if back.torques.any():
        least = np.finfo(float).tiny
        efforts = np.maximum(robot.effort_limits - back.torques, least)
        robot = replace(robot, effort_limits=efforts)
    if not attitude > 0.0:
        raise NoPlanFound(
            Status.LIMIT_VIOLATED,
            f"no plan found that keeps planner.robust: the chaser's attitude is not known to "
            f"{back.attitude:.3g} rad, and limits.chaser_attitude is "
            f"{limits.chaser_attitude:.3g} rad",
        )
    asked = replace(
        problem,
        robot=robot,
        limits=replace(limits, chaser_attitude=attitude),
        obstacles=tuple(
            replace(sphere, radius=sphere.radius + float(grown))
            for sphere, grown in zip(problem.obstacles, back.spheres, strict=True)
        ),
    )
    try:
        return method(asked, settings, watch, guess)
    except NoPlanFound as refused:
        if refused.status is Status.OUT_OF_TIME:
            raise
        most = float(back.spheres.max(initial=0.0))
        words = (
            f"with planner.robust, obstacles up to {most * 1e3:.3g} mm larger: {refused.constraint}"
        )
        raise NoPlanFound(refused.status, words, refused.attempt, refused.failures) from None


def _report(
    robust: Robust,
    problem: PlanningProblem,
    plain: Plan,
    kept: Sequence[Margins],
    back: _Back,
    rounds: int,
) -> RobustReport:
    ids = [sphere.id for sphere in problem.obstacles]
    names = problem.robot.joint_names
    return RobustReport(
        sigmas=robust.sigmas,
        least_sigmas=min((float(_in_sigmas(one).min()) for one in kept), default=np.inf),
        rounds=rounds,
        plain_joint_path_length=plain.metrics.joint_path_length,
        clearance=tuple(
            (name, float(grown)) for name, grown in zip(ids, back.spheres, strict=True) if grown
        ),
        chaser_attitude=back.attitude,
        torques=tuple(
            (name, float(less)) for name, less in zip(names, back.torques, strict=True) if less
        ),
    )


def _in_sigmas(one: Margins) -> Array:
    """Return the margins in their deviations; one without a deviation keeps any number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Array = np.where(one.sigmas > 0.0, one.values / one.sigmas, np.inf)
    return found


def _not_robust(
    robust: Robust, problem: PlanningProblem, lacking: Sequence[Margins], plan: Plan
) -> NoPlanFound:
    worst = min(lacking, key=lambda one: float(_in_sigmas(one).min()))
    row = int(_in_sigmas(worst).argmin())
    number = int(worst.which[row])
    name = ""
    if worst.kind == CLEARANCE:
        name = f" {problem.obstacles[number].id}"
    elif worst.kind == TORQUE:
        name = f" {problem.robot.joint_names[number]}"
    advice = ("fewer planner.robust.sigmas", "smaller deviations", "a longer duration")
    finding = (
        f"{WORDS[worst.kind]}{name} is {worst.values[row]:.3g} {UNITS[worst.kind]} at "
        f"t = {worst.time[row]:.2f} s, {_in_sigmas(worst)[row]:.2f} of its deviations, and "
        f"{robust.sigmas:g} are to be kept"
    )
    message = f"no plan found that keeps planner.robust: {finding}. What may help: "
    failure = Failure(_STATUS[worst.kind], finding, advice)
    return NoPlanFound(failure.status, message + ", ".join(advice), plan, (failure,))
