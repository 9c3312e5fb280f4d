"""The arm stays away from dynamic singularities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    ANOTHER_DURATION,
    LIMIT_TOLERANCE,
    Assessment,
    Requirement,
    Samples,
    elsewhere,
)
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import arm_jacobian, smallest_singular_values

# A singular value above this many margins does not fall below one margin in one solver step.
_OF_INTEREST = 4.0


class SingularValues(Requirement):
    """The smallest singular value of the generalised Jacobian stays above its threshold.

    Joint splines do not invert it: their plans may pass singular postures.
    """

    name = "singular_values"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a singular posture, unless joint splines may begin there."""
        if problem.parametrisation is not Parametrisation.END_EFFECTOR_POLYNOMIAL:
            return
        robot, smallest = problem.robot, _smallest(problem.robot, q_start)
        if not smallest >= settings.singular_value_threshold - LIMIT_TOLERANCE:
            alone = arm_jacobian(robot, robot.model.createData(), q_start) / robot.joint_weights
            of_arm = float(np.linalg.svd(alone, compute_uv=False)[-1])
            raise InvalidInput(
                Status.START_SINGULAR,
                "joints.position",
                np.array2string(problem.start.joint_positions, precision=4),
                "in this posture the end effector cannot move in every direction: the smallest "
                f"singular value of the generalised Jacobian is {smallest:.3g} ({of_arm:.3g} on a "
                f"base that stands still), allowed is {settings.singular_value_threshold:g}",
            )

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether the paths follow the end effector's."""
        return problem.parametrisation is not Parametrisation.JOINT_SPLINE

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        if margin == 0.0:
            return ()
        return (compiled.singular_value_above(problem.robot.base.rows, margin, _OF_INTEREST),)

    def assess(self, samples: Samples) -> Assessment:
        """Return the smallest singular value at the points; a failure if it is too small."""
        threshold = samples.settings.singular_value_threshold
        values = smallest_singular_values(samples.problem.robot, samples.q, samples.maps)
        point, smallest = values.argmin(), float(values.min())
        found = {"min_singular_value": smallest}
        if samples.may_be_singular or smallest >= threshold - LIMIT_TOLERANCE:
            return Assessment(found)
        failure = Failure(
            Status.SINGULAR,
            f"the arm is in a dynamic singularity at {samples.when(point)}: the smallest "
            f"singular value of the generalised Jacobian is {smallest:.3g}, allowed is "
            f"{threshold:g}",
            ("a nearer goal", elsewhere(samples.problem), ANOTHER_DURATION),
        )
        return Assessment(found, (failure,))


def is_regular(robot: Robot, q: Array, settings: PlannerSettings) -> bool:
    """Tell whether the smallest singular value is above its threshold; q: shape (7 + joints,)."""
    return _smallest(robot, q) >= settings.singular_value_threshold - LIMIT_TOLERANCE


def _smallest(robot: Robot, q: Array) -> float:
    return float(smallest_singular_values(robot, q[None])[0])
