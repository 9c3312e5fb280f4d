"""One thing that a plan must keep: how the search keeps it, how the check measures it, its words.

The check takes its measure from the plan's samples alone and never uses the solver's rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.system_frame import SystemFrame
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.momentum import momentum_maps

# A limit violated by less is violated by rounding; no arm and no motor feels it. In the unit of the
# limit: rad, rad/s, N m, and that of singular values.
LIMIT_TOLERANCE = 1e-6
# So far beyond a limit, in rad or in parts of a limit of rates or accelerations, a plan may be, and
# so a start, which may be where another plan ended: a joint that is measured at its limit and moves
# outward cannot stop at once. The search keeps the limits themselves, but for what the start
# already is beyond them.
ALLOWED_EXCESS = 1e-4
# A joint or the chaser further from its limit [rad], or a link further from a sphere [m], cannot
# reach it in one step of the solver that the linearisation still describes.
OF_INTEREST = 0.25


class Rows(NamedTuple):
    """Constraints of the solver along one path; those that are far from violated are left out."""

    values: Array  # to stay positive; shape (rows,)
    jacobian: Array  # shape (rows, variables)
    # Of one requirement: the rows of two paths with the same name are the same constraint
    names: Indices


@dataclass(frozen=True, eq=False)
class Samples:
    """A plan's samples, what comes of them, and what several requirements work out from them."""

    problem: PlanningProblem
    settings: PlannerSettings  # for tolerances
    trajectory: Trajectory  # what comes after the problem's duration is its tail

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
        """What the system does, at the points and between them, when a controller follows them."""
        q, v = self.q_and_v
        return followed(self.problem.robot, q[0], v[0], joint_motion(self.trajectory))

    @cached_property
    def arm(self) -> Array:
        """Joint origins and end effector. Shape (points, joints + 1, 3) [m]."""
        return arm_points(self.problem.robot, self.q)

    @cached_property
    def torques(self) -> Array:
        """What makes the joints move so while nothing pushes. Shape (points, joints) [N m]."""
        accelerations = self.trajectory.joint_accelerations
        return joint_torques(self.problem.robot, *self.q_and_v, accelerations, self.maps)

    @cached_property
    def maps(self) -> Array:
        """What makes momentum of velocities. Shape (points, 6, 6 + joints)."""
        robot = self.problem.robot
        return momentum_maps(robot, robot.model.createData(), self.q)

    @cached_property
    def goal(self) -> int:
        """Index of the point at the goal; those after it are the tail."""
        return int(np.abs(self.trajectory.time - self.problem.duration).argmin())

    @property
    def followed_to_goal(self) -> tuple[Array, Array, Array]:
        """Times, configurations and tangent velocities of the motion that follows, to the goal."""
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


class Requirement:
    """Requires nothing. Each requirement overrides what it needs.

    One that a user brings is a frozen dataclass whose fields are declared (`common.declared`): a
    scenario, digests and records are made of them.
    """

    name: ClassVar[str]  # of a user's: that of its entry point, too
    # The search keeps it only when a path has broken it: most problems are far from it
    is_on_demand: ClassVar[bool] = False

    def seen_from(self, frame: SystemFrame) -> Self:
        """Return it in the frame that plans are made in; what names no frame stays as it is."""
        return self

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start that violates the requirement by itself.

        Args:
            q_start: Configuration at the start. Shape (7 + joints,).

        Raises:
            InvalidInput: Names what is violated.
        """

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return by how much more the search keeps it at the points, for what lies between."""
        return 0.0

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows | None:
        """Return what the solver keeps from being negative, with exact derivatives.

        Returns:
            Values, shape (rows,), and their Jacobian, (rows, variables). None: the search does
            not keep this requirement.
        """
        return None

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return what is left of it along a motion, in the unit of the margin; negative: nothing.

        What the search cannot mend by a larger margin has a slack without end.
        """
        return np.inf

    def metrics(self, samples: Samples) -> Mapping[str, float | str | tuple[float, ...]]:
        """Return metrics by their names in `METRICS`, measured from the samples."""
        return {}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield where, and by how much, a plan violates the requirement, and what may help."""
        yield from ()


def eased(limits: Array, at_start: Array, excess: Array | float = ALLOWED_EXCESS) -> Array:
    """Return upper limits that a start keeps which is beyond them by no more than is allowed.

    Args:
        excess: That is allowed.
    """
    return np.where(at_start <= limits + excess, np.maximum(limits, at_start), limits)


def within(
    values: Array, jacobian: Array, lower: Array, upper: Array, interest: Array | float
) -> Rows:
    """Return the distances to both limits that are below the interest, with their derivatives.

    Args:
        values: Shape (points, values).
        jacobian: Shape (points, values, variables).
        lower: Shape (values,).
        upper: Shape (values,).
        interest: Shape (values,), or one number for all.
    """
    margins = np.stack([upper - values, values - lower])
    side, point, value = rows = np.nonzero(margins < interest)
    by_x = jacobian[point, value]
    to_upper = by_x[: np.count_nonzero(side == 0)]  # these rows come first
    np.negative(to_upper, out=to_upper)
    return Rows(margins[rows], by_x, np.ravel_multi_index(rows, margins.shape))


def too_large(
    metrics: Metrics, name: str, tolerance: float, unit: str, *advice: str
) -> Iterator[Failure]:
    """Yield a failure where a metric, an error, is not within its tolerance."""
    value = getattr(metrics, name)
    if not value <= tolerance:
        yield Failure(
            Status.CHECK_FAILED,
            f"{name} is {value:.3g}{unit}, allowed is {tolerance:.3g}{unit}",
            advice,
        )
