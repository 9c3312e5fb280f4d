"""Force and torque through the grasp of a payload stay within their limits, between points too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion, Peaks, peaks_of_steps
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import frame_wrenches
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.payload import payload_frame

# A load further from its limit than this fraction of it cannot reach it in one solver step.
_OF_INTEREST = 0.4
# Between 50 points a wrench rises above those at the points by less, as a fraction of its limits.
_MARGIN = 1e-3
_NAMES, _UNITS = ("grasp_force", "grasp_torque"), ("N", "N m")


class GraspWrench(Requirement):
    """Force and torque through the grasp stay within their limits."""

    name = "grasp_wrench"
    is_on_demand = True

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start whose joint accelerations load the grasp beyond its limits."""
        frame, limits, start = payload_frame(problem.robot), _limits(problem), problem.start
        if frame is None or start.joint_accelerations is None or not np.isfinite(limits).any():
            return
        _, v = configuration(problem.robot, start)
        sample = q_start[None], v[None], start.joint_accelerations[None]
        (parts,) = _norms(frame_wrenches(problem.robot, frame, *sample)) / limits
        worst = int(parts.argmax())
        if parts[worst] > 1.0 + ALLOWED_EXCESS:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                "joints.acceleration",
                f"one that takes {parts[worst] * limits[worst]:.4g} {_UNITS[worst]} of the grasp",
                f"limits.{_NAMES[worst]} is {limits[worst]:g} {_UNITS[worst]}",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, as a fraction of them."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether a grasp with limits holds a payload."""
        return payload_frame(problem.robot) is not None and bool(
            np.isfinite(_limits(problem)).any()
        )

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        robot, number = problem.robot, payload_frame(problem.robot)
        if number is None:
            return ()
        frame = robot.model.frames[number]
        return (
            compiled.grasp_wrench_within(
                robot.base,
                # The first two joints are Pinocchio's: the universe and the free-flyer.
                joints_before=frame.parentJoint - 1,
                position=frame.placement.translation,
                rotation=frame.placement.rotation,
                mass=frame.inertia.mass,
                center=frame.inertia.lever,
                inertia=frame.inertia.inertia,
                parts=1.0 / _limits(problem),
                margin=margin,
                interest=_OF_INTEREST,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to a limit, as a fraction of the limit."""
        frame, limits = payload_frame(problem.robot), _limits(problem)
        if frame is None or not np.isfinite(limits).any():
            return np.inf
        peaks = _peaks(problem.robot, frame, motion)
        return float((1.0 + ALLOWED_EXCESS - peaks.values / limits).min())

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest force [N] and torque [N m], if there is a payload."""
        frame = payload_frame(samples.problem.robot)
        if frame is None:
            return Assessment()
        found = _peaks(samples.problem.robot, frame, samples.followed)
        force, torque = found.values.tolist()
        metrics = {"peak_grasp_force": force, "peak_grasp_torque": torque}
        return Assessment(metrics, tuple(self._failures(samples, found)))

    def _failures(self, samples: Samples, found: Peaks) -> Iterator[Failure]:
        """Yield the force or torque, whichever exceeds its limit by the larger fraction."""
        limits, (peaks, times) = _limits(samples.problem), found
        if (peaks <= limits * (1.0 + ALLOWED_EXCESS)).all():
            return
        worst = int((peaks / limits).argmax())
        name, unit = _NAMES[worst], _UNITS[worst]
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"peak_{name} is {peaks[worst]:.4g} {unit}, {peaks[worst] - limits[worst]:.4g} {unit} "
            f"more than limits.{name} of {limits[worst]:g} {unit}, at {samples.at(times[worst])}",
            ("a longer duration", f"a larger limits.{name}"),
        )


def _limits(problem: PlanningProblem) -> Array:
    """Return the limits of force [N] and torque [N m], infinite: none. Shape (2,)."""
    return np.array([problem.limits.grasp_force, problem.limits.grasp_torque])


def _norms(wrenches: Array) -> Array:
    """Return the sizes of force and torque. Shape (points, 2)."""
    norms: Array = np.linalg.norm(wrenches.reshape(-1, 2, 3), axis=2)
    return norms


def _peaks(robot: Robot, frame: int, motion: FollowedMotion) -> Peaks:
    """Return the largest force and torque, to 5e-4, and their times."""
    wrenches = frame_wrenches(robot, frame, motion.q, motion.v, motion.joint_accelerations)
    return peaks_of_steps(_norms(wrenches), motion)
