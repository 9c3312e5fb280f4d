"""The check after the solve: metrics and failures of a plan, from its samples alone.

Nothing here uses the velocity map, the path family or the optimisation problem. Poses, momentum
and clearance are recomputed by forward kinematics and dynamics from the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ff_planner_ros.errors import Failure, NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.motion import chaser_euler, joint_path_length
from ff_planner_ros.planning.motion.plan import Plan, Trajectory, WheelMotion
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements import requirements_of
from ff_planner_ros.planning.requirements.requirement import ANOTHER_DURATION, Samples
from ff_planner_ros.robot.wheels import momenta_of

# What may help where the best attempt, on few points, violates nothing.
_TRY_MORE = ("more planner.starts", "more planner.max_iterations")


class Assessed(NamedTuple):
    """What the check finds along a trajectory."""

    metrics: Metrics
    wheels: WheelMotion | None  # None: the robot has none
    # Failures with the names of their requirements, in the order of `REQUIREMENTS`, the most
    # harmful first; empty: the trajectory keeps all of them
    failures: tuple[tuple[str, Failure], ...]


def assess(
    problem: PlanningProblem,
    trajectory: Trajectory,
    settings: PlannerSettings,
    may_be_singular: bool = False,
) -> Assessed:
    """Return metrics, motion of the wheels and failures of a trajectory, from its samples alone.

    Args:
        may_be_singular: As of the plan.
    """
    samples = Samples(problem, settings, trajectory, may_be_singular)
    to_goal = slice(samples.goal + 1)
    required, failures = dict[str, Any](), list[tuple[str, Failure]]()
    for requirement in requirements_of(problem):
        found = requirement.assess(samples)
        required |= found.metrics
        failures += ((requirement.name, failure) for failure in found.failures)
    metrics = Metrics(
        joint_path_length=joint_path_length(
            trajectory.joint_velocities[to_goal],
            problem.duration / samples.goal,
            problem.robot.joint_weights,
        ),
        max_chaser_euler=float(np.abs(chaser_euler(problem.robot, samples.q[to_goal])).max()),
        **required,
    )
    return Assessed(metrics, _wheels_along(samples), tuple(failures))


def measure(problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings) -> Metrics:
    """Return the metrics of a trajectory, computed from its samples alone."""
    return assess(problem, trajectory, settings).metrics


def failures(
    problem: PlanningProblem, plan: Plan, settings: PlannerSettings
) -> tuple[Failure, ...]:
    """Return the failures of a plan's trajectory, the most harmful first."""
    found = assess(problem, plan.trajectory, settings, plan.may_be_singular)
    return tuple(failure for _, failure in found.failures)


def _wheels_along(samples: Samples) -> WheelMotion | None:
    """Return momenta and torques of the wheels at the points; None without wheels."""
    robot, wheels, trajectory = (
        samples.problem.robot,
        samples.problem.robot.wheels,
        samples.trajectory,
    )
    if wheels is None:
        return None
    stored = momenta_of(wheels, samples.problem.start)
    rows = wheels_along(robot, wheels, stored, *samples.q_and_v, trajectory.joint_accelerations)
    return WheelMotion(*rows)


def refusal(
    plan: Plan, found: Sequence[Failure], advice: Sequence[str] | None = None
) -> NoPlanFound:
    """Return the error with all failures of a plan; advice None: that of the failures.

    An attempt on fewer points than asked for may have none.
    """
    starts = plan.solver.starts
    attempts = "the only attempt" if starts == 1 else f"{starts} attempts; in the best"
    if advice is None:
        advice = list(dict.fromkeys(word for failure in found for word in failure.advice))
        if "a longer duration" in advice:
            advice = [word for word in advice if word != ANOTHER_DURATION]
    message = f"no plan found in {attempts}, {_findings(found)}"
    if advice or not found:
        message += f". What may help: {', '.join(advice or _TRY_MORE)}"
    status = found[0].status if found else Status.CHECK_FAILED
    return NoPlanFound(status, message, plan, found)


def out_of_time(
    end: OutOfTime, plan: Plan | None = None, found: Sequence[Failure] = ()
) -> NoPlanFound:
    """Return the error of a search that was ended: its best attempt, and the failures of that."""
    used = f" ({end.used_for})" if end.used_for else ""
    message = (
        f"{end}{used}; whether there is a plan is not known: give it more time or fewer points"
    )
    if plan is not None:
        points = f"the best attempt so far, on {len(plan.trajectory.time)} points"
        message += f"; {points}: {_findings(found)}"
    return NoPlanFound(Status.TIMED_OUT, message, plan, found)


def _findings(found: Sequence[Failure]) -> str:
    """Return what an attempt violates, in words."""
    findings = "; ".join(failure.finding for failure in found)
    return findings or "it keeps every constraint, but was not yet optimised to the end"
