"""A plan that keeps so many deviations from everything that errors of the model could break.

It is a fixed point: plan, foretell the deviation of every margin (`margins`), keep back what they
lack, and plan again. What is kept back only grows: obstacles by a radius each, the chaser's Euler
angles and its rotation, the corridor of the approach and the joints' torques. Rates and
accelerations of joints that are controlled are those of the plan, whatever the errors: nothing is
kept back of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.distance.base_spread import base_spread, tracked_motion
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.nearness import nearness
from ff_planner_ros.planning.motion.plan import Plan, RobustReport
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.approach import Margins as Inside
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings, RobustSettings
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, directions
from ff_planner_ros.planning.robust.grasp_frames import grasp_frames
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
from ff_planner_ros.robot.configuration import configuration

# Plans that may be made beside the plain one: three are enough but where the way round changes.
_ROUNDS = 6
# What is kept back is this much more than what is lacking: the next plan's deviations differ.
_MORE = 1.02
# A margin that lacks less lacks nothing, in parts of what is asked for.
_EXACT = 1e-3
# An obstacle does not grow nearer to the robot's start than this, nor the corridor's wall to the
# end effector there [m].
_AT_START = 1e-4
# Where so many deviations cannot be kept, it is halved in how many can, so often and with so few
# first guesses: what they find more of them find, too.
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
class _Narrower(Approach):
    """An approach of whose corridor something is kept back: its wall is nearer, all along it."""

    kept: float = 0.0  # [m]

    def margins(self, places: Array) -> Inside:
        """Return the margins of the approach, less what is kept back."""
        found = super().margins(places)
        return found._replace(values=found.values - self.kept)


class _Back(NamedTuple):
    """What is kept back of each limit."""

    spheres: Array  # shape (spheres,) [m]
    attitude: float  # of the Euler angles [rad]
    rotation: float  # [rad]
    corridor: float  # [m]
    torques: Array  # shape (joints,) [N m]

    def exceeds(self, other: _Back) -> bool:
        """Whether more is kept back of anything."""
        mine, theirs = (
            np.concatenate([np.atleast_1d(part).ravel() for part in back]) for back in (self, other)
        )
        return bool((mine > theirs).any())


@dataclass(frozen=True, eq=False)
class _Asked:
    """Everything that a robust plan is looked for with."""

    problem: PlanningProblem
    settings: PlannerSettings
    watch: Any
    method: Callable[..., Plan]
    whole: Callable[[Plan], Plan]  # a plan with its tail
    plain: Plan
    most: _Back  # that may be kept back without the start being refused


def withstood(settings: RobustSettings) -> Uncertainty:
    """Return the deviations that a plan withstands."""
    return Uncertainty(**_told(settings))


def robust_plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Any,
    guess: Any,
    method: Callable[..., Plan],
    whole: Callable[[Plan], Plan],
) -> Plan:
    """Return a plan of which every margin keeps its deviations, and the price of that.

    Args:
        watch: Of the method, like the guess.
        whole: Returns a plan with its tail, of which the margins are looked at.

    Raises:
        InvalidInput: As by the method.
        NoPlanFound: There is no plan, or none that keeps so much.
    """
    plain = method(problem, settings, watch, guess)
    if not settings.robust.sigmas:
        return plain
    asked = _Asked(problem, settings, watch, method, whole, plain, _most(problem))
    sigmas = settings.robust.sigmas
    found = _keeping(asked, sigmas)
    if isinstance(found, Plan):
        return found
    words = f"{found.constraint}; {_can_be_kept(asked, sigmas)}"
    message = f"no plan found that keeps planner.robust: {words}. What may help: "
    failure = Failure(found.status, words, _ADVICE)
    raise NoPlanFound(found.status, message + ", ".join(_ADVICE), found.attempt, (failure,))


def _keeping(asked: _Asked, sigmas: float) -> Plan | NoPlanFound:
    """Return a plan that keeps so many deviations, or what it lacks."""
    problem, found = asked.problem, asked.plain
    back = _Back(np.zeros(len(problem.obstacles)), 0.0, 0.0, 0.0, np.zeros(problem.robot.joints))
    for rounds in range(_ROUNDS + 1):
        kept = _margins(asked, found)
        lacking = [one for one in kept if _lacking(sigmas, one).size]
        if not lacking:
            return replace(
                found,
                metrics=measure(lasting(problem, found.duration), found.trajectory, asked.settings),
                robust=_report(asked, sigmas, kept, back, rounds),
            )
        more = _more(sigmas, back, lacking, asked.most)
        beyond = [one for one in lacking if one.kind in _beyond_all(problem, more)]
        if beyond or rounds == _ROUNDS or not more.exceeds(back):
            return _short_of(problem, sigmas, beyond or lacking, found)
        again = found.coefficients if found.coefficients.size else None
        try:
            found, back = _planned(asked, more, again), more
        except NoPlanFound as refused:
            return _short_of(problem, sigmas, lacking, found, refused)
    raise AssertionError  # the last round returns


def _can_be_kept(asked: _Asked, sigmas: float) -> str:
    """Return words for how many deviations a plan keeps."""
    few = min(asked.settings.starts, _STARTS)
    asked = replace(asked, settings=replace(asked.settings, starts=few))
    low, high = 0.0, sigmas
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        try:
            found = _keeping(asked, middle)
        except OutOfTime:
            break
        if isinstance(found, Plan):
            low = middle
        else:
            high = middle
    return f"{low:.4g} can be kept" if low else f"not even {high:.4g} can be kept"


def _margins(asked: _Asked, plan: Plan) -> list[Margins]:
    """Return the margins of a plan and its tail."""
    problem, robot = lasting(asked.problem, plan.duration), asked.problem.robot
    with suppress(NoPlanFound):  # a tail that cannot be driven is refused afterwards
        plan = asked.whole(plan)
    motion = tracked_motion(robot, plan.trajectory)
    scene = scene_of(problem).seen_from(motion.origin, motion.velocity)
    of = directions(robot, withstood(asked.settings.robust))
    near = nearness(robot, motion.q, motion.time, scene)
    return margins(motion, scene, near, problem.limits, of, base_spread(motion, of))


def _lacking(sigmas: float, one: Margins) -> Indices:
    """Return which margins keep less than they should."""
    return np.flatnonzero(one.values < sigmas * _deviations(sigmas, one) * (1.0 - _EXACT))


def _deviations(sigmas: float, one: Margins) -> Array:
    """Return the deviation of each margin; where it may be lost to all sides, one that makes up.

    A normal error is beyond k deviations to one side with the chance 1 - Phi(k). In a plane it is
    beyond c of them, to any side, with exp(-c^2 / 2): c deviations are as sure as k to one side.
    """
    if one.kind != CORRIDOR:
        return one.sigmas
    from scipy.special import log_ndtr  # slow to load, and only robust plans come here

    return float(np.sqrt(-2.0 * log_ndtr(-sigmas))) / sigmas * one.sigmas


def _most(problem: PlanningProblem) -> _Back:
    """Return how much may be kept back of each limit: the robot stays where it starts."""
    robot, scene = problem.robot, scene_of(problem)
    q, _ = configuration(robot, problem.start)
    near = nearness(robot, q[None], np.zeros(1), scene)
    spheres = near.distance.min(axis=(0, 1), initial=np.inf) - _AT_START
    corridor = np.inf
    frames = grasp_frames(scene, robot.base, np.linspace(0.0, problem.duration, 2))
    if problem.approach is not None and frames is not None:
        place = frames.sees(arm_points(robot, q[None])[:, -1].repeat(frames.until, axis=0))[:1]
        corridor = float(problem.approach.margins(place).values[0]) - _AT_START
    joints = np.full(robot.joints, np.inf)
    return _Back(np.maximum(spheres, 0.0), np.inf, np.inf, max(corridor, 0.0), joints)


def _more(sigmas: float, back: _Back, lacking: Sequence[Margins], most: _Back) -> _Back:
    """Return what is to be kept back so that the margins that lack something have it."""
    kept = {
        CLEARANCE: back.spheres.copy(),
        ATTITUDE: np.array([back.attitude]),
        ROTATION: np.array([back.rotation]),
        CORRIDOR: np.array([back.corridor]),
        TORQUE: back.torques.copy(),
    }
    for one in lacking:
        rows, of = _lacking(sigmas, one), kept[one.kind]
        which = one.which[rows] if one.kind in (CLEARANCE, TORQUE) else np.zeros_like(rows)
        np.maximum.at(of, which, _MORE * sigmas * _deviations(sigmas, one)[rows])
    return _Back(
        spheres=np.minimum(kept[CLEARANCE], most.spheres),
        attitude=float(kept[ATTITUDE][0]),
        rotation=float(kept[ROTATION][0]),
        corridor=min(float(kept[CORRIDOR][0]), most.corridor),
        torques=kept[TORQUE],
    )


def _beyond_all(problem: PlanningProblem, back: _Back) -> list[str]:
    """Return the kinds of margins of which all that there is would be kept back."""
    found = []
    if not back.attitude < problem.limits.chaser_attitude:
        found.append(ATTITUDE)
    if not back.rotation < problem.limits.chaser_rotation:
        found.append(ROTATION)
    # At the grasp the corridor is narrow, and there the end effector has to be.
    if problem.approach is not None and not (
        back.corridor < problem.approach.margins(np.zeros((1, 3))).values[0]
    ):
        found.append(CORRIDOR)
    if not (back.torques < problem.robot.effort_limits).all():
        found.append(TORQUE)
    return found


def _planned(asked: _Asked, back: _Back, guess: Array | None) -> Plan:
    """Return a plan that keeps something back.

    Raises:
        NoPlanFound: There is none; it tells what was kept back.
    """
    problem, limits, robot = asked.problem, asked.problem.limits, asked.problem.robot
    if back.torques.any():
        robot = replace(robot, effort_limits=robot.effort_limits - back.torques)
    approach = problem.approach
    if approach is not None and back.corridor:
        told = {item.name: getattr(approach, item.name) for item in fields(Approach)}
        approach = _Narrower(**told, kept=back.corridor)
    less = replace(
        problem,
        robot=robot,
        limits=replace(
            limits,
            chaser_attitude=limits.chaser_attitude - back.attitude,
            chaser_rotation=limits.chaser_rotation - back.rotation,
        ),
        approach=approach,
        obstacles=tuple(
            replace(sphere, radius=sphere.radius + float(grown))
            for sphere, grown in zip(problem.obstacles, back.spheres, strict=True)
        ),
    )
    try:
        return asked.method(less, asked.settings, asked.watch, guess)
    except (InvalidInput, NoPlanFound) as refused:
        most = float(back.spheres.max(initial=0.0))
        why = str(refused).partition(". What may help")[0]
        words = f"with what is lacking kept back, obstacles up to {most:.3g} m larger: {why}"
        raise NoPlanFound(refused.status, words, getattr(refused, "attempt", None)) from None


def _report(
    asked: _Asked, sigmas: float, kept: Sequence[Margins], back: _Back, rounds: int
) -> RobustReport:
    ids = [sphere.id for sphere in asked.problem.obstacles]
    names = asked.problem.robot.joint_names
    return RobustReport(
        sigmas=sigmas,
        least_sigmas=min((float(_in_sigmas(sigmas, one).min()) for one in kept), default=np.inf),
        rounds=rounds,
        plain_joint_path_length=asked.plain.metrics.joint_path_length,
        clearance=tuple(
            (name, float(grown)) for name, grown in zip(ids, back.spheres, strict=True) if grown
        ),
        chaser_attitude=back.attitude,
        chaser_rotation=back.rotation,
        torques=tuple(
            (name, float(less)) for name, less in zip(names, back.torques, strict=True) if less
        ),
        corridor=back.corridor,
        deviations=tuple(_told(asked.settings.robust).items()),
    )


def _told(settings: RobustSettings) -> dict[str, float]:
    told = {item.name: getattr(settings, item.name) for item in fields(settings)}
    del told["sigmas"]
    return told


def _in_sigmas(sigmas: float, one: Margins) -> Array:
    """Return the margins in their deviations; one without a deviation keeps any number."""
    deviations = _deviations(sigmas, one)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Array = np.where(deviations > 0.0, one.values / deviations, np.inf)
    return found


def _short_of(
    problem: PlanningProblem,
    sigmas: float,
    lacking: Sequence[Margins],
    plan: Plan,
    refused: InvalidInput | NoPlanFound | None = None,
) -> NoPlanFound:
    """Return the refusal that names the margin that has least.

    Args:
        refused: Why no plan was found that has more; None: none was looked for any more.
    """
    worst = min(lacking, key=lambda one: float(_in_sigmas(sigmas, one).min()))
    in_sigmas = _in_sigmas(sigmas, worst)
    row = int(in_sigmas.argmin())
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
        f"t = {worst.time[row]:.2f} s,{after} {in_sigmas[row]:.2f} of its deviations, and "
        f"{sigmas:g} are to be kept"
    )
    why = "" if refused is None else f" ({refused})"
    attempt = getattr(refused, "attempt", None) or plan
    return NoPlanFound(_STATUS[worst.kind], finding + why, attempt)
