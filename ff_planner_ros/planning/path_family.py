"""What the search needs of a path family: motions, their sensitivities and first guesses.

A path family is a set of motions from the start to the goal, one for each choice of its decision
variables x. Another family is another class with these members.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.problem import Sphere


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """A motion at each point, as Pinocchio writes it.

    Attributes:
        x: Decision variables. Shape (variables,).
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        q_half_way: Configurations half-way between the points. Shape (points - 1, 7 + joints).
        goal_error: What the family does not hold at the goal by itself, to become zero. Shape
            (rows,), may be empty.
        singular_at: Time of a dynamic singularity, at which the motion ends [s]; all arrays but x
            are meaningless then. None: the motion is regular.
    """

    x: Array
    q: Array
    v: Array
    q_half_way: Array
    goal_error: Array
    singular_at: float | None = None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a regular motion with respect to x, exact as discretised.

    Attributes:
        q: In the tangent space at each point. Shape (points, 6 + joints, variables).
        v: Shape (points, 6 + joints, variables).
        q_half_way: Shape (points - 1, 6 + joints, variables).
        goal_error: Shape (rows, variables).
        acceleration: dv/dt itself at each point. Shape (points, 6 + joints).
    """

    q: Array
    v: Array
    q_half_way: Array
    goal_error: Array
    acceleration: Array


class PathFamily(Protocol):
    """The motions of one family from a start to a goal."""

    @property
    def name(self) -> str:
        """Name in scenario files and plans."""

    @property
    def variables(self) -> int:
        """Number of decision variables."""

    @property
    def reading(self) -> str:
        """How the orientation is described, for a reader of `decision_variables`."""

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Return the motion of one path.

        Args:
            x: Shape (variables,).
            points: At least 2.
            damping: Of a singularity in the way, if the family can meet one: a damped motion
                leaves its path there instead of ending.
        """

    def sensitivity(self, motion: Motion, damping: float = 0.0) -> Sensitivity:
        """Differentiate a regular motion of this family.

        Args:
            damping: That of the motion.
        """

    def first_guesses(
        self, obstacles: Sequence[Sphere], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield decision variables to start from, always the same for the same problem.

        Args:
            points: Of the motions that the guesses are for.
            damping: Of these motions.
        """

    def decision_variables(self, x: Array) -> Array:
        """Return what the plan reports of a path: for the paper's family xi, Eq. (42)."""


def singular_refusal(time: float, duration: float) -> NoPlanFound:
    """Return the error of a motion that meets a dynamic singularity.

    Args:
        time: Of the singularity [s].
        duration: Of the whole motion [s].
    """
    return NoPlanFound(
        Status.SINGULAR,
        f"dynamic singularity at t = {time:.2f} s of {duration:g} s: the arm cannot follow the "
        "end effector's path there; choose a nearer goal, another start posture or a longer "
        "duration",
    )
