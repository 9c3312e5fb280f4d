"""The methods that plan: ours, and the baselines."""

from __future__ import annotations

from functools import partial
from typing import NoReturn

from ff_planner_ros.baselines import APF, FIXED_BASE, OPTIMAL, STRAIGHT, ZERO_MOMENTUM
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import Method, in_frame_of_user, without_search


def method_of(name: str, task: PlanningTask) -> Method:
    """Return a method for one task, by its name in `baselines.METHODS`.

    Those that plan in the user's frame, for a fixed base or zero momentum, refuse phases.
    """
    if name == OPTIMAL:  # needs none of the others' modules
        return plan
    from ff_planner_ros.baselines.artificial_potential_field import artificial_potential_field
    from ff_planner_ros.baselines.beliefs import fixed_base, zero_momentum
    from ff_planner_ros.baselines.potential_field import load_parameters
    from ff_planner_ros.baselines.straight_line import straight_line

    if name == STRAIGHT:
        return without_search(straight_line)
    if name == APF:
        field = load_parameters(share_directory() / "config" / "baselines.yaml")
        return without_search(partial(artificial_potential_field, parameters=field))
    solve = {FIXED_BASE: fixed_base, ZERO_MOMENTUM: zero_momentum}[name]
    if task.then:
        return in_frame_of_user(partial(_refuse_phases, name), task.problem)
    return in_frame_of_user(solve, task.problem)


def _refuse_phases(name: str, _problem: PlanningProblem, _settings: PlannerSettings) -> NoReturn:
    allowed = f"of a scenario with phases it must be {OPTIMAL}, {STRAIGHT} or {APF}"
    raise InvalidInput(Status.UNSUPPORTED, "method", name, allowed)
