"""A requirement: constraint rows for the search, measures and failure messages for the check.

The check measures the plan's samples alone and never uses the solver's rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.system_frame import SystemFrame
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.dynamics import joint_torques

# A limit violated by less is violated by rounding; no arm and no motor feels it. In the unit of the
# limit: rad, rad/s, N m, and that of singular values.
LIMIT_TOLERANCE = 1e-6
# A plan, and so a start where another plan ended, may exceed position limits by this much [rad, m],
# and limits of velocities, accelerations, wheels and grasps by this fraction of them: a joint that
# is measured at its limit and moves outward cannot stop at once. The search keeps the limits
# themselves, but for what the start already exceeds.
ALLOWED_EXCESS = 1e-4
# Advice that "a longer duration" says better, where both are given.
ANOTHER_DURATION = "another duration"
# A joint or the chaser further from its limit [rad], or a link further from a sphere [m], cannot
# reach it in one step of the solver that the linearisation still describes.
OF_INTEREST = 0.25


class Rows(NamedTuple):
    """Constraints g(x) >= 0 of one requirement and path; those far from violated are left out."""

    values: Array  # g, not to become negative; shape (rows,)
    jacobian: Array  # shape (rows, variables)
    # Numbers of the constraints, the same for every path of a time grid; shape (rows,)
    names: Indices


@dataclass(frozen=True, eq=False)
class Samples:
    """A plan's trajectory points, and quantities derived from them that requirements share."""

    problem: PlanningProblem
    settings: PlannerSettings  # for tolerances
    trajectory: Trajectory  # points after the problem's duration are the post-goal segment
    may_be_singular: bool = False  # the motion may begin, pass and end at singularities

    @cached_property
    def q_and_v(self) -> tuple[Array, Array]:
        """Configurations and tangent velocities. (points, 7 + joints), (points, 6 + joints)."""
        return from_trajectory(self.problem.robot, self.trajectory)

    @property
    def q(self) -> Array:
        """Configurations. Shape (points, 7 + joints)."""
        return self.q_and_v[0]

    @cached_property
    def followed(self) -> FollowedMotion:
        """Motion of the system, between the points too, when a controller tracks the joints."""
        q, v = self.q_and_v
        return followed(self.problem.robot, q[0], v[0], joint_motion(self.trajectory))

    @cached_property
    def arm(self) -> Array:
        """Joint origins and end effector, inertial frame. Shape (points, joints + 1, 3) [m]."""
        return arm_points(self.problem.robot, self.q)

    @cached_property
    def torques(self) -> Array:
        """Joint torques by inverse dynamics, without external forces. (points, joints) [N m, N]."""
        accelerations = self.trajectory.joint_accelerations
        return joint_torques(self.problem.robot, *self.q_and_v, accelerations, self.maps)

    @property
    def maps(self) -> Array | None:
        """Of `followed`, at the points: they depend on the joints alone."""
        maps = self.followed.maps
        return None if maps is None else maps[:: self.followed.pieces]

    @cached_property
    def goal(self) -> int:
        """Index of the point at the goal; later points are the post-goal segment."""
        return int(np.abs(self.trajectory.time - self.problem.duration).argmin())

    @property
    def followed_to_goal(self) -> tuple[Array, Array, Array]:
        """Times, configurations and tangent velocities of `followed`, up to the goal."""
        motion = self.followed
        to_goal = slice(motion.pieces * self.goal + 1)
        return motion.time[to_goal], motion.q[to_goal], motion.v[to_goal]

    def when(self, point: np.intp) -> str:
        """Return words for the time of a point."""
        return self.at(float(self.trajectory.time[point]))

    def at(self, time: float) -> str:
        """Return words for a time [s]."""
        duration, goal = self.problem.duration, self.trajectory.time[self.goal]
        if time > goal:
            return f"t = {time:.2f} s, {time - duration:.2f} s after the goal"
        words = f"t = {time:.2f} s of {duration:g} s"
        return f"the goal, {words}" if time == goal else words


@dataclass(frozen=True)
class Assessment:
    """What a requirement measures along a plan, and where the plan violates it."""

    metrics: Mapping[str, Any] = field(default_factory=dict)
    # Where, and by how much, the plan violates it, and what may help; empty: it does not
    failures: Sequence[Failure] = ()


class Requirement:
    """Base class of requirements: it requires nothing, subclasses override what they need.

    A plug-in's requirement is a frozen dataclass with declared fields (`common.declared`), which
    scenario files, digests and records are written from.
    """

    name: ClassVar[str]  # of a plug-in: also the name of its entry point
    # The search adds its rows only once a path has violated it: most problems are far from it
    is_on_demand: ClassVar[bool] = False

    def seen_from(self, frame: SystemFrame) -> Self:
        """Return the requirement with its vectors in the planning frame; it has none by default."""
        return self

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse a problem that the requirement cannot be asked of, whatever its start.

        Raises:
            InvalidInput: It cannot; the error names the field and what is allowed.
        """

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start that violates the requirement by itself.

        Args:
            q_start: Configuration at the start. Shape (7 + joints,).

        Raises:
            InvalidInput: The start violates it; the error names the field and its limit.
        """

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return the margin that the search keeps at the points, for the motion between them."""
        return 0.0

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows | None:
        """Return constraints g(x) >= 0 for the solver, with exact derivatives, by Python.

        Args:
            margin: That of `margin`, or more where the search has tightened the requirement.

        Returns:
            Values, shape (rows,), and their Jacobian, (rows, variables). None: nothing is near a
            limit, or the search does not keep this requirement.
        """
        return None

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether a path may have rows: without, neither `rows` nor `in_core` is called."""
        mine = type(self)
        return mine.rows is not Requirement.rows or mine.in_core is not Requirement.in_core

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement] | None:
        """Return what makes the rows in the core, for paths of so many points.

        None: the core does not know the requirement, and `rows` is called, which is slower. All of
        the package are known to it. Who overrides `rows` of one overrides this, too.
        """
        return None

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to the limit along a motion, in the unit of `margin`.

        Negative if the motion violates it; infinite if no larger margin could mend that.
        """
        return np.inf

    def assess(self, samples: Samples) -> Assessment:
        """Return metrics by their names in `METRICS` and failures, both from the samples alone."""
        return Assessment()


def elsewhere(problem: PlanningProblem) -> str:
    """Return advice to begin or to end in another posture, as far as the goal has one."""
    if problem.posture is not None:
        ends = problem.posture.positions is not None
        return "another goal or start posture" if ends else "another start posture"
    is_free = problem.target.orientation is Orientation.FREE
    return f"another goal{'' if is_free else ' orientation'} or start posture"


def eased(limits: Array, at_start: Array, excess: Array | float = ALLOWED_EXCESS) -> Array:
    """Return upper limits, raised to the start's values where those exceed them by little.

    Args:
        excess: Largest excess of a start that raises a limit, in the unit of the limits.
    """
    return np.where(at_start <= limits + excess, np.maximum(limits, at_start), limits)


def too_large(
    name: str, value: float, tolerance: float, unit: str, *advice: str
) -> Iterator[Failure]:
    """Yield a failure if the metric of this name, an error, exceeds its tolerance or is NaN."""
    if not value <= tolerance:
        yield Failure(
            Status.CHECK_FAILED,
            f"{name} is {value:.3g}{unit}, allowed is {tolerance:.3g}{unit}",
            advice,
        )
