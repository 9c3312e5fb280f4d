"""Plans that tests only look at: one for each task in a session, whoever asks for it."""

from __future__ import annotations

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.planning_task import PlanningTask

_made: dict[tuple[str, bytes], Plan] = {}


def planned(problem: PlanningProblem, settings: PlannerSettings | None = None) -> Plan:
    """Return the plan of a problem, by the node's own settings unless others are given."""
    settings = settings or load_parameters().planner
    robot = problem.robot
    # A digest takes a robot's limits from its URDF, and a test may have changed them since.
    limits = (
        *(robot.lower_position_limits, robot.upper_position_limits),
        *(robot.velocity_limits, robot.effort_limits),
    )
    key = PlanningTask(problem, settings).digest, b"".join(each.tobytes() for each in limits)
    if key not in _made:
        _made[key] = plan(problem, settings)
    return _made[key]
