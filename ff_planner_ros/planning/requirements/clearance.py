"""The arm stays outside every obstacle, between the points too.

The summed penalty R_obst = 0 of the paper, Eq. (43), has no gradient on its feasible side. The
distances themselves are constrained instead, which says the same: every segment of the arm stays
outside every sphere at every point.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.certificate import certified_clearance
from ff_planner_ros.planning.clearance import (
    arm_points,
    clearance_rows,
    clearances,
    penalty,
    segments,
)
from ff_planner_ros.planning.followed import FollowedMotion
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import (
    OF_INTEREST,
    Requirement,
    Rows,
    Samples,
)
from ff_planner_ros.planning.search_certificate import search_certificate
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.model import Robot

# On fewer points than this an arm may jump over a corner of a sphere: it is looked at a quarter of
# the way between them, too, by the parabola through both points and the one half-way.
_FEW_POINTS = 40
# Of a motion at more times, every second is enough to begin with: between two of them it is looked
# at where it matters.
_ENOUGH = 98


class Clearance(Requirement):
    """The arm stays outside every obstacle."""

    name = "clearance"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start inside an obstacle."""
        positions = arm_points(problem.robot, q_start[None])
        starts = segments(positions)
        distance = clearances(positions, np.zeros(1), starts, problem.obstacles).distance[0]
        if distance.min(initial=np.inf) <= 0.0:
            segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
            raise InvalidInput(
                Status.START_IN_COLLISION,
                f"obstacles[{problem.obstacles[sphere].id}]",
                f"around {link_name(problem.robot, int(starts[segment]))}, "
                f"{-distance[segment, sphere]:.4f} m deep",
                "at the start the arm must be outside every obstacle",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return the clearance that the search keeps at the points [m]."""
        return settings.clearance_margin

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows:
        """Return the distances of interest, less the margin, at points and half-way between."""
        times = np.linspace(0.0, problem.duration, len(motion.q))
        times = np.concatenate([times[1:], (times[:-1] + times[1:]) / 2])
        few = len(motion.q) < _FEW_POINTS
        distances, jacobian, names = clearance_rows(
            problem.robot,
            np.concatenate([motion.q[1:], motion.q_half_way]),
            np.concatenate([sensitivity.q[1:], sensitivity.q_half_way]),
            np.concatenate([times, _quarter_way(times)]) if few else times,
            problem.obstacles,
            OF_INTEREST,
            quarter_way=few,
        )
        return Rows(distances - margin, jacobian, names)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance [m]."""
        return search_certificate(problem.robot, *_looked_at(motion), problem.obstacles)

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return certified clearance and R_obst."""
        problem, settings, times = samples.problem, samples.settings, samples.trajectory.time
        at_points = clearances(samples.arm, times, segments(samples.arm), problem.obstacles)
        return {
            "min_clearance": certified_clearance(
                problem.robot, *_looked_at(samples.followed), problem.obstacles
            )
            if problem.obstacles
            else np.inf,
            "penalty": penalty(
                at_points.distance, settings.penalty_gain, settings.penalty_exponent
            ),
        }

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield the deepest collision."""
        if metrics.min_clearance >= 0.0:
            return
        motion, obstacles = samples.followed, samples.problem.obstacles
        arm = arm_points(samples.problem.robot, motion.q)
        starts = segments(arm)
        distance = clearances(arm, motion.time, starts, obstacles).distance
        time, segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
        depth, obstacle = -distance[time, segment, sphere], obstacles[sphere].id
        link = link_name(samples.problem.robot, int(starts[segment]))
        when = samples.at(float(motion.time[time]))
        if depth <= 0.0:
            yield Failure(
                Status.COLLISION,
                f"{link} may touch obstacle {obstacle} near {when}: all that is certain is a "
                f" clearance of {metrics.min_clearance * 1e3:.2f} mm",
                ("more points", "a larger planner.clearance_margin"),
            )
            return
        margin = "a smaller planner.clearance_margin"
        yield Failure(
            Status.COLLISION,
            f"{link} is {depth:.3g} m inside obstacle {obstacle} at {when}",
            (
                "a longer duration",
                "a goal or start posture on another side of the obstacle",
                "more planner.starts",
                *([margin] if depth < samples.settings.clearance_margin else []),
            ),
        )


def _looked_at(motion: FollowedMotion) -> tuple[Array, Array, Array]:
    """Return the configurations, velocities and times that a certificate begins with."""
    every = 2 if len(motion.time) > _ENOUGH and len(motion.time) % 2 else 1
    return motion.q[::every], motion.v[::every], motion.time[::every]


def link_name(robot: Robot, start: int) -> str:
    """Return words for the arm's segment that starts at a joint."""
    ends = (*robot.joint_names, robot.tip_link)
    return f"the link from {ends[start]} to {ends[start + 1]}"


def _quarter_way(times: Array) -> Array:
    """Return the times a quarter of the way between points, then at three quarters.

    But in the first interval, whose beginning is the start.

    Args:
        times: Of all points but the first, then half-way in every interval.
    """
    at_points, _ = np.split(times, 2)
    step = np.diff(at_points)
    return np.concatenate([at_points[:-1] + step / 4, at_points[1:] - step / 4])
