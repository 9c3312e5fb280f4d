"""The check after the solve: metrics and failures of a plan, from its samples alone.

Nothing here uses the velocity map, the path family or the optimisation problem. Poses, momentum
and clearance are recomputed by forward kinematics and dynamics from the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ff_planner_ros.errors import Failure, NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.motion.metrics import Metrics, chaser_euler, joint_path_length
from ff_planner_ros.planning.motion.plan import Plan, Trajectory, WheelMotion
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements import requirements_of
from ff_planner_ros.planning.requirements.requirement import ANOTHER_DURATION, Samples
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.robot.wheels import momenta_of

# What may help where the best attempt, on few points, violates nothing.
_TRY_MORE = ("more planner.starts", "more planner.max_iterations")


def measure(problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings) -> Metrics:
    """Return the metrics of a trajectory, computed from its samples alone."""
    samples = Samples(problem, settings, trajectory)
    to_goal = slice(samples.goal + 1)
    required: dict[str, Any] = {}
    for requirement in requirements_of(problem):
        required |= requirement.metrics(samples)
    return Metrics(
        joint_path_length=joint_path_length(
            trajectory.joint_velocities[to_goal],
            problem.duration / samples.goal,
            problem.robot.joint_weights,
        ),
        max_chaser_euler=float(np.abs(chaser_euler(problem.robot, samples.q[to_goal])).max()),
        **required,
    )


def wheels_told(
    problem: PlanningProblem, trajectory: Trajectory, settings: PlannerSettings
) -> WheelMotion | None:
    """Return momenta and torques of the wheels along a trajectory; None without wheels."""
    robot, wheels, start = problem.robot, problem.robot.wheels, problem.start
    if wheels is None:
        return None
    samples = Samples(problem, settings, trajectory)
    q, v = samples.q_and_v
    stored = momenta_of(wheels, start)
    rows = wheels_along(robot, wheels, stored, q, v, trajectory.joint_accelerations)
    return WheelMotion(*rows)


def failures(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> Iterator[Failure]:
    """Yield the failures of a measured plan, in the order of `REQUIREMENTS`: most harmful first."""
    for _, failure in named_failures(problem, plan, settings):
        yield failure


def named_failures(
    problem: PlanningProblem, plan: Plan, settings: PlannerSettings
) -> Iterator[tuple[str, Failure]]:
    """Yield `failures` with the names of their requirements."""
    samples = Samples(problem, settings, plan.trajectory)
    for required in requirements_of(problem):
        if not (plan.may_be_singular and required.name == SingularValues.name):
            for failure in required.failures(samples, plan.metrics):
                yield required.name, failure


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
