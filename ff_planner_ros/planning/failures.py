"""What is wrong with a plan: which constraint is not met, where, by how much, what may help."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ff_planner_ros.errors import Failure as Failure
from ff_planner_ros.errors import NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements import REQUIREMENTS
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.planning.settings import PlannerSettings


def refusal(
    plan: Plan, found: Sequence[Failure], advice: Sequence[str] | None = None
) -> NoPlanFound:
    """Return the error that tells an operator of all failures of the best attempt.

    Args:
        found: At least one failure; the first gives the status.
        advice: What may help; None: what the failures advise.
    """
    starts = plan.solver.starts
    attempts = "the only attempt" if starts == 1 else f"{starts} attempts; in the best"
    helps = ", ".join(_advice(found) if advice is None else advice)
    message = f"no plan found in {attempts}, {_findings(found)}. What may help: {helps}"
    return NoPlanFound(found[0].status, message, plan, found)


def out_of_time(
    end: OutOfTime, plan: Plan | None = None, found: Sequence[Failure] = ()
) -> NoPlanFound:
    """Return the error that tells an operator how far a search came that was ended.

    Args:
        plan: The best attempt; None if there is none.
    """
    message = f"{end}; whether there is a plan is not known: give it more time or fewer points"
    if plan is not None:
        points = f"the best attempt so far, on {len(plan.trajectory.time)} points"
        state = (
            _findings(found) or "it keeps every constraint, but was not yet optimised to the end"
        )
        message += f"; {points}: {state}"
    return NoPlanFound(Status.OUT_OF_TIME, message, plan, found)


def _findings(found: Sequence[Failure]) -> str:
    return "; ".join(failure.finding for failure in found)


def _advice(found: Sequence[Failure]) -> list[str]:
    return list(dict.fromkeys(word for failure in found for word in failure.advice))


def failures(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> Iterator[Failure]:
    """Yield every requirement that a plan does not meet, what can do most harm first.

    Args:
        plan: With metrics of `measure`.
    """
    samples = Samples(problem, settings, plan.trajectory)
    for required in REQUIREMENTS:
        yield from required.failures(samples, plan.metrics)
