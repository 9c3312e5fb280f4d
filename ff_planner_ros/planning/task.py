"""What a mission asks for: a plan from where the system will be, and what comes after its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ff_planner_ros.planning.forward import carried_forward
from ff_planner_ros.planning.joint_motion import JointMotion
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.tail import EndBehaviour, with_tail
from ff_planner_ros.planning.watch import Progress, Watch


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """A question that takes the time until its answer is executed into account.

    Attributes:
        problem: The question; its start is the state as measured.
        ahead: Time from the measurement to the first point of the plan [s].
        running: What a controller does with the joints meanwhile, its time counted from the
            measurement; None: they keep their measured rates.
        end_behaviour: What the arm does after the goal.
        tail: For how long [s].
    """

    problem: PlanningProblem
    ahead: float
    running: JointMotion | None
    end_behaviour: EndBehaviour
    tail: float


def perform(
    task: PlanningTask,
    settings: PlannerSettings,
    keep_going: Callable[[], None],
    report: Callable[[Progress], None],
) -> Plan:
    """Plan from where the system will be to the end of the tail.

    Args:
        keep_going: As for `plan`.
        report: As for `plan`.

    Raises:
        InvalidInput: As by `plan` and `with_tail`.
        NoPlanFound: As by `plan` and `with_tail`.
    """
    measured = task.problem.start
    start = carried_forward(task.problem.robot, measured, task.ahead, task.running)
    problem = replace(task.problem, start=start)
    to_goal = plan(problem, settings, Calls(keep_going, report))
    return with_tail(problem, to_goal, task.end_behaviour, task.tail, settings)


@dataclass(frozen=True)
class Calls(Watch):
    """A watch made of two functions."""

    require_time: Callable[[], None]
    report: Callable[[Progress], None]  # type: ignore[assignment]
