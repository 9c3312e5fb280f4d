"""The arm stays away from dynamic singularities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import LIMIT_TOLERANCE, Requirement, Samples
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.momentum import smallest_singular_values


class SingularValues(Requirement):
    """The smallest singular value of the generalised Jacobian stays above its threshold."""

    name = "singular_values"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a singular posture."""
        smallest = float(smallest_singular_values(problem.robot, q_start[None])[0])
        if not smallest >= settings.singular_value_threshold - LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_SINGULAR,
                "joints.position",
                np.array2string(problem.start.joint_positions, precision=4),
                "in this posture the end effector cannot move in every direction: the smallest "
                f"singular value of the generalised Jacobian is {smallest:.3g}, allowed is "
                f"{settings.singular_value_threshold:g}",
            )

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return the smallest singular value."""
        values = smallest_singular_values(samples.problem.robot, samples.q)
        return {"min_singular_value": float(values.min())}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield the most singular posture."""
        threshold = samples.settings.singular_value_threshold
        if metrics.min_singular_value >= threshold - LIMIT_TOLERANCE:
            return
        point = smallest_singular_values(samples.problem.robot, samples.q).argmin()
        yield Failure(
            Status.SINGULAR,
            f"the arm is in a dynamic singularity at {samples.when(point)}: the smallest "
            f"singular value of the generalised Jacobian is {metrics.min_singular_value:.3g}, "
            f"allowed is {threshold:g}",
            ("a nearer goal", "another goal orientation, start posture or duration"),
        )
