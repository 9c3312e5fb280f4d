"""The reaction wheels of a robot in a scenario file, with their momenta at the start."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import a_vector
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.wheels import Wheels


@dataclass(frozen=True, eq=False)
class WheelsFile(Wheels):
    """Wheels, and their momenta in the start state.

    Raises:
        InvalidInput: As by `Wheels`.
    """

    stored: Array | None = declare(
        a_vector(None),
        "momentum of each wheel at the start; default: zero",
        unit="N m s",
        default=None,
    )

    @property
    def wheels(self) -> Wheels:
        """The wheels without their momenta."""
        return Wheels(self.axes, self.momentum, self.torque)


def wheels_file(problem: PlanningProblem) -> WheelsFile | None:
    """Return the wheels of a problem's robot; None: it has none."""
    wheels, stored = problem.robot.wheels, problem.start.wheel_momenta
    if wheels is None:
        return None
    return WheelsFile(wheels.axes, wheels.momentum, wheels.torque, stored)
