"""The impulse on a body that is captured stays within its limit."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.followed import Peaks
from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.limits.limited import Extremes, Limit
from ff_planner_ros.planning.requirements.requirement import (
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.impact import impact, largest_impulses


class CaptureImpulse(Requirement):
    """The impulse of the capture stays within its limit; only the check knows it."""

    name = "capture_impulse"

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse a limit if the mass of the target body is not given."""
        body, limit = problem.target_body, problem.limits.capture_impulse
        if body is not None and np.isfinite(limit) and body.mass == 0.0:
            allowed = f"limits.capture_impulse, {limit:g} N s, needs it, and the inertia in kg m2"
            raise InvalidInput(Status.OUT_OF_RANGE, "target_body.mass", "missing", allowed)

    def assess(self, samples: Samples) -> Assessment:
        """Return bounds of the impulses [N s, N m s]: of the plan's twist error and tolerances."""
        problem, settings = samples.problem, samples.settings
        body = problem.target_body
        if body is None or body.mass == 0.0:
            return Assessment()
        before = state_at(samples.trajectory, samples.goal)
        twist = body.grasp(np.array([problem.duration])).twists[0]
        inertia = body.inertia_at_grasp
        missed = impact(problem.robot, inertia, before, twist).impulse_in_ee
        errors = settings.capture_velocity_tolerance, settings.capture_turn_rate_tolerance
        linear, angular = largest_impulses(problem.robot, inertia, before, errors)
        found = {
            "capture_impulse": float(np.linalg.norm(missed[:3])) + linear,
            "capture_angular_impulse": float(np.linalg.norm(missed[3:])) + angular,
        }
        named = "capture_velocity_tolerance", "capture_turn_rate_tolerance"
        wide = (f"a smaller planner.{name}" for name in named if getattr(settings, name))
        limit = np.array([problem.limits.capture_impulse])
        judged = Limit(
            -limit,
            limit,
            ["capture_impulse"],
            "within the tolerances of the grasp is",
            ["N s"],
            (*wide, "another posture at the goal"),
            name="limits.capture_impulse",
            excess=0.0,
            is_relative=False,
        )
        impulse, at_goal = (
            np.array([found["capture_impulse"]]),
            samples.trajectory.time[samples.goal],
        )
        extremes = Extremes.of(Peaks(impulse, np.array([at_goal])), impulse)
        return Assessment(found, tuple(judged.failures(samples, extremes)))
