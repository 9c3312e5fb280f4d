"""Constraint back-off: limits are tightened so that margins keep k standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.approach import Margins as Inside
from ff_planner_ros.planning.problem.problem import (
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.robust.grasp_frames import grasp_frames
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    ROTATION,
    TORQUE,
    Margins,
)
from ff_planner_ros.planning.robust.nearness import nearness
from ff_planner_ros.robot.configuration import configuration

# By kind of margin, in its unit: growth of each obstacle, reduction of each joint's torque limit,
# and one number for each other kind.
BackOff: TypeAlias = Mapping[str, Array]

# Factor on the back-off: the next plan's deviations differ.
_MORE = 1.02
# An obstacle does not grow nearer to the robot's start than this, nor the corridor's wall to the
# end effector there [m].
_AT_START = 1e-4


@dataclass(frozen=True, eq=False)
class _NarrowerApproach(Approach):
    """An approach whose corridor is narrower by a constant, all along it."""

    back_off: float = 0.0  # [m]

    def margins(self, places: Array) -> Inside:
        """Return the margins of the approach, less the back-off."""
        found = super().margins(places)
        return found._replace(values=found.values - self.back_off)


def no_back_off(problem: PlanningProblem) -> BackOff:
    """Return a back-off that tightens nothing."""
    return {
        CLEARANCE: np.zeros(len(problem.obstacles)),
        ATTITUDE: np.zeros(1),
        ROTATION: np.zeros(1),
        CORRIDOR: np.zeros(1),
        TORQUE: np.zeros(problem.robot.joints),
    }


def largest_back_off(problem: PlanningProblem) -> BackOff:
    """Return the largest back-off of obstacles and corridor that keeps the start feasible."""
    robot, scene = problem.robot, scene_of(problem)
    q, _ = configuration(robot, problem.start)
    near = nearness(robot, q[None], np.zeros(1), scene)
    obstacles = near.distance.min(axis=(0, 1), initial=np.inf) - _AT_START
    found = {CLEARANCE: np.maximum(obstacles, 0.0)}
    frames = grasp_frames(scene, robot.base, np.linspace(0.0, problem.duration, 2))
    if problem.approach is not None and frames is not None:
        place = frames.sees(arm_points(robot, q[None])[:, -1].repeat(frames.until, axis=0))[:1]
        found[CORRIDOR] = np.maximum(problem.approach.margins(place).values - _AT_START, 0.0)
    return found


def increase(
    back_off: BackOff, sigmas: float, lacking: Sequence[Margins], largest: BackOff
) -> BackOff:
    """Return the back-off, raised to k sigma for the margins that lack it, at most to `largest`."""
    increased = {kind: amounts.copy() for kind, amounts in back_off.items()}
    for one in lacking:
        rows, amounts = one.lacking(sigmas), increased[one.kind]
        which = one.which[rows] if one.kind in (CLEARANCE, TORQUE) else np.zeros_like(rows)
        np.maximum.at(amounts, which, _MORE * sigmas * one.deviations(sigmas)[rows])
    for kind, most in largest.items():
        increased[kind] = np.minimum(increased[kind], most)
    return increased


def exceeds(back_off: BackOff, other: BackOff) -> bool:
    """Tell whether any entry of a back-off is larger than another's."""
    return any(bool((amounts > other[kind]).any()) for kind, amounts in back_off.items())


def exhausted_limits(problem: PlanningProblem, back_off: BackOff) -> list[str]:
    """Return the kinds of margins whose back-off is as large as the limit itself."""
    limits = {
        ATTITUDE: np.array([problem.limits.chaser_attitude]),
        ROTATION: np.array([problem.limits.chaser_rotation]),
        TORQUE: problem.robot.effort_limits,
    }
    if problem.approach is not None:
        # At the grasp the corridor is narrow, and there the end effector has to be.
        limits[CORRIDOR] = problem.approach.margins(np.zeros((1, 3))).values
    return [kind for kind, most in limits.items() if not (back_off[kind] < most).all()]


def tighten(problem: PlanningProblem, back_off: BackOff) -> PlanningProblem:
    """Return a problem whose limits are tightened by a back-off."""
    limits, robot, approach = problem.limits, problem.robot, problem.approach
    attitude, rotation, corridor = (
        float(back_off[kind][0]) for kind in (ATTITUDE, ROTATION, CORRIDOR)
    )
    if back_off[TORQUE].any():
        robot = replace(robot, effort_limits=robot.effort_limits - back_off[TORQUE])
    if approach is not None and corridor:
        of_approach = {item.name: getattr(approach, item.name) for item in fields(Approach)}
        approach = _NarrowerApproach(**of_approach, back_off=corridor)
    ids = [one.id for one in problem.obstacles]
    grown = dict(zip(ids, back_off[CLEARANCE].tolist(), strict=True))
    tighter = replace(
        problem,
        robot=robot,
        limits=replace(
            limits,
            chaser_attitude=limits.chaser_attitude - attitude,
            chaser_rotation=limits.chaser_rotation - rotation,
        ),
        approach=approach,
        obstacles=tuple(_grown(one, grown[one.id]) for one in problem.obstacles),
    )
    body = problem.target_body
    if body is None or not any(grown[one.id] for one in body.obstacles):
        return tighter
    # A change of frame makes attached obstacles anew from those of the body: grow these, too.
    fixed = tuple(_grown(one, grown[one.id]) for one in body.obstacles)
    return with_capture_target(replace(body, obstacles=fixed), tighter)


def _grown(one: Any, amount: float) -> Any:
    """Return an obstacle, attached or not, that is grown by a distance [m]."""
    return replace(one, shape=replace(one.shape, grown=amount)) if amount else one
