"""Plans that were made before, as first guesses for problems that are like theirs.

Two problems of one kind differ by numbers alone, and the distance between them is Euclidean. Both
are seen in the frame that plans are made in (`system_frame`), so that neither the user's frame nor
where the system is in it counts. One unit is a joint that is one radian elsewhere, and all else
counts by how far it moves joints:

- an angle [rad], and a rate [rad/s] times the duration, by itself;
- a length [m] by the arm's reach: a joint that turns by 1 rad moves the hand by at most the reach;
- a speed [m/s] likewise, times the duration;
- the duration by its logarithm: of a motion that is run slower, joints are off by the part of the
  duration, times the way of about 1 rad that they make.

What is found is a first guess: the planner solves from it and checks what comes of it. So a
neighbour that is no good costs time, and nothing else.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem, lasting
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.task.digest import canonical
from ff_planner_ros.planning.task.task import PlanningTask, as_it_begins
from ff_planner_ros.robot.model import Robot

_DIGITS = 16  # of a kind
# A joint that is as far off as this leads to another way round rather than to the same one.
_FARTHEST = 1.0


@dataclass(frozen=True, eq=False)
class StoredPlan:
    """A plan in the library: where its problem lies, and its path."""

    kind: str  # a hash of what its problem shares with its neighbours; see `kind_and_place`
    place: Array  # among the problems of its kind, in the units above
    coefficients: Array  # decision variables of its path family, as in `Plan.coefficients`

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("place", "coefficients"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


class Guesses(Protocol):
    """What tells a task what to begin with."""

    def first_guess(self, task: PlanningTask) -> Array | None:
        """Return a path to try first; None: there is none."""


@dataclass(frozen=True, eq=False)
class KnownGuess:
    """The guess that a task is known to have had, from a record of it."""

    coefficients: Array  # empty: it had none

    def first_guess(self, task: PlanningTask) -> Array | None:
        """Return it; None where the task was changed and takes no paths of so many numbers."""
        known = frozen(self.coefficients)
        return known if len(known) and len(known) in _variables(task) else None


@dataclass(frozen=True, eq=False)
class Library:
    """Plans that were made before."""

    plans: tuple[StoredPlan, ...]

    @cached_property
    def _by_kind(self) -> dict[tuple[str, int, int], tuple[Array, list[StoredPlan]]]:
        found: dict[tuple[str, int, int], list[StoredPlan]] = {}
        for one in self.plans:
            key = one.kind, len(one.place), len(one.coefficients)
            found.setdefault(key, []).append(one)
        return {key: (np.array([p.place for p in some]), some) for key, some in found.items()}

    def first_guess(self, task: PlanningTask) -> Array | None:
        """Return the path of the plan that is nearest to a task; None: none is near.

        Of those equally near, the first is taken. A plan that goes on from a running one begins
        with that, and gets none; nor does a task that is refused for what it asks.
        """
        if task.running_goal is not None or not self.plans:
            return None
        try:
            kind, place = kind_and_place(task)
            in_question = _variables(task)
        except FfPlannerError:  # the planner says what is wrong with it
            return None
        nearest: tuple[float, StoredPlan | None] = (_FARTHEST, None)
        for variables in in_question:
            if (kind, len(place), variables) not in self._by_kind:
                continue
            places, plans = self._by_kind[kind, len(place), variables]
            with np.errstate(over="ignore"):  # what is as far as that is far
                apart = np.linalg.norm(places - place, axis=1)
            if apart.min() < nearest[0]:
                nearest = float(apart.min()), plans[int(apart.argmin())]
        return None if nearest[1] is None else nearest[1].coefficients


def kind_and_place(task: PlanningTask) -> tuple[str, Array]:
    """Return what a task shares with its neighbours, and where it lies among them.

    The kind is a hash of robot, objective, parametrisation, what the target leaves open, how many
    obstacles there are, and the shapes of bodies among them. Limits, margins and what the arm does
    at the end are none of it: a path that breaks them is as good to begin with as another.
    """
    _, problem = as_it_begins(task.problem, task.ahead, task.running)
    target, reach = problem.target, _reach(problem.robot)
    shared: list[Any] = [
        problem.objective,
        problem.parametrisation,
        target.orientation,
        target.free_axis_in_ee,
        len(problem.obstacles),
    ]
    if problem.posture is not None:
        shared.append(int(problem.posture.at_rest))
    if problem.obstacle_bodies:
        shared.append([one.shape for one in problem.obstacle_bodies])
    parts_of_kind = [_canonical_robot(problem.robot), *map(b"".join, map(canonical, shared))]
    kind = hashlib.sha256(b"".join(parts_of_kind)).hexdigest()[:_DIGITS]
    window, lasts = problem.durations, problem.duration
    parts = [
        problem.start.joint_positions,
        problem.start.joint_velocities * lasts,
        problem.start.angular_velocity_chaser_in_inertial * lasts,
        np.log([window.minimum, window.maximum]),
        target.position / reach,
        target.linear_velocity * lasts / reach,
        target.angular_velocity * lasts,
        _attitude(problem),
    ]
    if problem.posture is not None and problem.posture.positions is not None:
        parts.append(problem.posture.positions)
    for sphere in problem.spheres:
        parts += [sphere.center / reach, np.array([sphere.radius / reach])]
        parts.append(sphere.velocity * lasts / reach)
    now = np.zeros(1)
    for one in problem.obstacle_bodies:
        (axes,), (origin,) = one.poses(now)
        (twist,) = one.twists(now)
        parts += [origin / reach, axes.ravel() / np.sqrt(2.0)]
        parts += [twist[:3] * lasts / reach, twist[3:] * lasts]
    return kind, np.concatenate(parts)


@lru_cache(maxsize=8)
def _canonical_robot(robot: Robot) -> bytes:
    return b"".join(canonical(robot))


def _attitude(problem: PlanningProblem) -> Array:
    """Return numbers of which those of two attitudes are as far apart as the angle between them.

    The rotation matrices of attitudes that are a small angle apart differ by sqrt(2) times that.
    """
    target = problem.target
    if target.orientation is Orientation.FREE:
        return np.empty(0)
    axes: Array = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    if target.free_axis_in_ee is not None:
        free: Array = axes @ target.free_axis_in_ee
        return free
    entries: Array = axes.ravel() / np.sqrt(2.0)
    return entries


def _reach(robot: Robot) -> float:
    """Return the length of the arm, stretched out: of all links from the base to the end [m]."""
    model = robot.model
    # The free-flyer is joint 1, the arm's first joint 2.
    placements = [model.jointPlacements[2 + k] for k in range(1, robot.joints)]
    placements.append(model.frames[robot.tip_frame_id].placement)
    lengths = sum(float(np.linalg.norm(place.translation)) for place in placements)
    return lengths + float(robot.furthest_slides.sum())


def _variables(task: PlanningTask) -> Sequence[int]:
    """Return how many decision variables paths of the families have that apply."""
    _, problem = as_it_begins(task.problem, task.ahead, task.running)
    groups = path_families(lasting(problem, None), task.settings)
    return [ways[0].variables for ways in groups]
