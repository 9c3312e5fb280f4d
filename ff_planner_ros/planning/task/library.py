"""The warm-start library: earlier plans as initial guesses for similar problems.

Problems of one kind differ by numbers alone. Their distance d is Euclidean, in the frame that plans
are made in (`system_frame`), so that it does not depend on the user's frame. With differences D,
duration T and the arm's reach R,

    d^2 = sum (D angle)^2 + (D(rate T))^2 + (D length / R)^2 + (D(speed T) / R)^2 + (D log T)^2.

Its unit is 1 rad of a joint, which moves the end effector by at most R. In a slower motion, joints
are off by the relative change of T times their path of about 1 rad.

The planner solves from the initial guess and checks the plan: a bad neighbour only costs time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem, lasting
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.task.digest import canonical
from ff_planner_ros.planning.task.task import PlanningTask, as_it_begins
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.kinematics import arm_reach
from ff_planner_ros.robot.model import Robot

_DIGITS = 16  # of a kind
# Plans at a larger distance [rad] tend to lead to another path, not to a similar one.
_FARTHEST = 1.0


@dataclass(frozen=True, eq=False)
class StoredPlan:
    """A plan in the library: the coordinates of its problem, and its path."""

    kind: str  # a hash of what its problem shares with its neighbours; see `kind_and_place`
    place: Array  # among the problems of its kind, in the units above
    coefficients: Array  # decision variables of its path family, as in `Plan.coefficients`

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("place", "coefficients"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Library:
    """A warm-start library of earlier plans."""

    plans: tuple[StoredPlan, ...]

    @cached_property
    def _by_kind(self) -> dict[tuple[str, int, int], tuple[Array, list[StoredPlan]]]:
        found: dict[tuple[str, int, int], list[StoredPlan]] = {}
        for one in self.plans:
            key = one.kind, len(one.place), len(one.coefficients)
            found.setdefault(key, []).append(one)
        return {key: (np.array([p.place for p in some]), some) for key, some in found.items()}

    def first_guess(self, task: PlanningTask) -> Array | None:
        """Return the path of the plan nearest to a task; None: none is nearer than 1 rad.

        Of plans equally near, the first is taken. A task that takes over from a running plan gets
        none, since its search begins with that plan; nor does a task that is refused as invalid.
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
            with np.errstate(over="ignore"):  # an infinite distance is a large one
                apart = np.linalg.norm(places - place, axis=1)
            if apart.min() < nearest[0]:
                nearest = float(apart.min()), plans[int(apart.argmin())]
        return None if nearest[1] is None else nearest[1].coefficients


def kind_and_place(task: PlanningTask) -> tuple[str, Array]:
    """Return the kind of a task's problem, and its coordinates among problems of that kind.

    The kind is a hash of robot, objective, parameterisation, the free directions of the goal, the
    number of obstacles and the shapes of bodies among them. Limits, margins and the end behaviour
    do not count: a path that violates them is as good an initial guess as another.
    """
    _, problem = as_it_begins(task.problem, task.ahead, task.running)
    target, reach = problem.target, arm_reach(problem.robot)
    shared: list[Any] = [
        problem.objective,
        problem.parametrisation,
        target.orientation,
        target.free_axis_in_ee,
        len(problem.obstacles),
    ]
    if problem.posture is not None:
        shared.append(int(problem.posture.at_rest))
    if problem.path is not None:
        shared.append(problem.path)
    if shapes := [one.shape for one in problem.obstacles if not one.is_sphere]:
        shared.append(shapes)
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
    for one in problem.obstacles:
        motion = one.motion
        radius, axes = np.array([one.radius / reach]), motion.rotation.ravel() / np.sqrt(2.0)
        parts += [motion.position / reach, radius if one.is_sphere else axes]
        parts.append(motion.velocity * lasts / reach)
        if not one.is_sphere:
            parts.append(motion.angular_velocity * lasts)
    return kind, np.concatenate(parts)


@kept_with_it
def _canonical_robot(robot: Robot) -> bytes:
    return b"".join(canonical(robot))


def _attitude(problem: PlanningProblem) -> Array:
    """Return coordinates of the goal attitude, whose distances are about the angle between two.

    Rotation matrices of attitudes that are a small angle a apart differ by sqrt(2) a.
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


def _variables(task: PlanningTask) -> Sequence[int]:
    """Return the numbers of decision variables of the path families that apply."""
    _, problem = as_it_begins(task.problem, task.ahead, task.running)
    groups = path_families(lasting(problem, None), task.settings)
    return [ways[0].variables for ways in groups]
