"""The interface of a path family: motions, their derivatives and initial guesses.

A path family is a set of motions from the start to the goal, one for each choice of its decision
variables x. Another family is another class with these members.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.problem import PlanningProblem, Target


@dataclass(frozen=True, eq=False)
class GoalMotion:
    """Derivatives of a goal by the duration, linear part first, in inertial axes."""

    place: Array  # of the pose; shape (6,) [m/s, rad/s]
    twist: Array  # shape (6,) [m/s2, rad/s2]
    acceleration: Array  # shape (6,) [m/s3, rad/s3]


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """A motion at each point, in Pinocchio's configurations and velocities."""

    x: Array  # decision variables; shape (variables,)
    q: Array  # configurations; shape (points, 7 + joints)
    v: Array  # tangent velocities; shape (points, 6 + joints)
    q_half_way: Array  # configurations half-way between the points; shape (points - 1, 7 + joints)
    goal_error: Array  # in the conditions of the goal that the family does not fix; shape (rows,)
    # Time of a dynamic singularity, where the motion ends [s]; then only x has a meaning
    singular_at: float | None = None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a regular motion with respect to x, exact as discretised.

    If the duration T is one more variable, the last column is by T at fixed normalised time
    s = t / T: a point is at the time s T, and velocities are 1 / T times the derivatives by s.
    """

    q: Array  # in the tangent space at each point; shape (points, 6 + joints, variables)
    v: Array  # shape (points, 6 + joints, variables)
    q_half_way: Array  # shape (points - 1, 6 + joints, variables)
    goal_error: Array  # shape (rows, variables)
    acceleration: Array  # dv/dt itself at each point; shape (points, 6 + joints)
    goal_motion: GoalMotion | None = None  # None: the duration is given

    @property
    def variables(self) -> int:
        """Number of columns."""
        return int(self.q.shape[2])


class PathFamily(Protocol):
    """The motions of one family from a start to a goal."""

    @property
    def name(self) -> str:
        """Name in scenario files and plans."""

    @property
    def variables(self) -> int:
        """Number of decision variables."""

    @property
    def stride(self) -> float:
        """Length of a bold step along one variable, in that of the paper's coefficients."""

    @property
    def directions(self) -> Array | None:
        """Directions in x, as columns, that change the path orthogonally and about equally far.

        Shape (variables, variables). None: the variables themselves do.
        """

    @property
    def goal_motion(self) -> GoalMotion | None:
        """How the goal changes with the duration, if that is one more variable."""

    @property
    def reading(self) -> str:
        """How the Euler angles in `decision_variables` are defined; empty: there are none."""

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Return the motion of one path on two points or more.

        With damping, a motion that meets a singularity leaves its path instead of ending there.
        """

    def on_grid(self, points: int, damping: float) -> compiled.PathsOnGrid:
        """Return the motions with their derivatives, as the core has them."""

    def first_guesses(
        self, obstacles: Sequence[Obstacle], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield initial guesses of the decision variables, always the same for one problem."""

    def near(self, q: Array) -> Array:
        """Return the decision variables of the path that fits a motion, apart from its goal.

        Args:
            q: Ten configurations or more at equal steps of the duration, the first that of the
                start. Shape (times, 7 + joints).
        """

    def towards(self, target: Target) -> PathFamily:
        """Return the motions to a target near this one; x keeps its meaning."""

    def lasting(
        self, problem: PlanningProblem, goal_motion: GoalMotion | None = None
    ) -> PathFamily:
        """Return the motions of the problem with another duration; x keeps its meaning.

        Args:
            goal_motion: Makes the duration one more variable of the sensitivities.
        """

    def decision_variables(self, x: Array) -> Array:
        """Return the paper's xi of a path, Eq. (42), for the plan; empty for other families."""


def singular_refusal(time: float, duration: float) -> NoPlanFound:
    """Return the error of a motion that meets a dynamic singularity at some time [s]."""
    return NoPlanFound(
        Status.SINGULAR,
        f"dynamic singularity at t = {time:.2f} s of {duration:g} s: the arm cannot follow the "
        "end effector's path there; choose a nearer goal, another start posture or a longer "
        "duration",
    )
