"""A problem that was drawn, and a motion that solves it; draws are repeated until one is sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem, Target
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

T = TypeVar("T")
W = TypeVar("W", covariant=True)

# Sound draws are one of a few, or of a thousand. A class that has none would be drawn for ever.
_MOST_DRAWS = 100_000
_STILL = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Drawn(Generic[W]):
    """A problem, and its witness: a motion, or the coefficients of a path, that solves it."""

    problem: PlanningProblem
    witness: W
    then: tuple[Phase, ...] = ()  # phases after the problem

    def task(self, settings: PlannerSettings) -> PlanningTask:
        """Return the planning task of all phases."""
        return PlanningTask(self.problem, settings, then=self.then)


def first_sound(kind: str, robot: str, draw: Callable[[], T | None], most: int = _MOST_DRAWS) -> T:
    """Return the first result of a draw that is not None.

    Raises:
        InvalidInput: There is none, as for a robot that is never free of its own links.
    """
    for _ in range(most):
        if (drawn := draw()) is not None:
            return drawn
    allowed = f"of {most} problems of kind {kind} that were drawn for it none has a plan"
    raise InvalidInput(Status.UNSUPPORTED, "robot", robot, allowed)


def asked(
    robot: Robot, start: SystemState, target: Target, duration: float, **more: Any
) -> PlanningProblem:
    """Return a problem without obstacles, for the shortest joint path within limits of rates.

    Args:
        duration: [s].
        **more: Its other fields, and those that are not to be so.
    """
    usual: dict[str, Any] = {
        "points": 50,
        "obstacles": (),
        "objective": Objective(1.0, 0.0),
        "limits": Limits(joint_velocities=True),
    }
    return PlanningProblem(
        robot=robot, start=start, target=target, duration=duration, **(usual | more)
    )


def state(
    joints: Array, rates: Array, drift: Array = _STILL, spin: Array = _STILL, at: Array = _STILL
) -> SystemState:
    """Return a state in which the chaser frame has the axes of the inertial frame.

    Args:
        joints: Positions. Shape (joints,) [rad].
        rates: Of the joints. Shape (joints,) [rad/s].
        drift: The chaser's linear velocity. Shape (3,) [m/s].
        spin: Its angular velocity. Shape (3,) [rad/s].
        at: Its position. Shape (3,) [m].
    """
    return SystemState(
        position_chaser_in_inertial=at,
        quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity_chaser_in_inertial=drift,
        angular_velocity_chaser_in_inertial=spin,
        joint_positions=joints,
        joint_velocities=rates,
    )
