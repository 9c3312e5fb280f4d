"""The plans of a bag or of an answer in JSON: robot, motion and scene of each of their phases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.analysis.plan_document import (
    phases_of,
    planned_motion,
    planned_scene,
    uncertainty_in,
)
from ff_planner_ros.bag.exchanges import exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import BagError, InvalidInput, Status, fields_placed
from ff_planner_ros.messages.plans import plan_of_task
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import Limits, lasting
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.robust.robust import withstood
from ff_planner_ros.planning.scenario.scenario import limits_from
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.model import Robot


class PlannedMotion(NamedTuple):
    """A phase of a plan."""

    plan: str  # plan id, or name of the file
    name: str  # that of the plan, and which phase it is of several
    robot: Robot
    trajectory: Trajectory
    scene: Scene | None  # None: it is not known
    limits: Limits = Limits()
    uncertainty: Uncertainty = Uncertainty()  # that it was planned for, or else the default
    start_ns: int = 0  # of the plan, since the epoch; zero: not known


def recorded_motions(source: Path, tell: Callable[..., None]) -> Iterator[PlannedMotion]:
    """Yield each phase of each plan of a bag or of an answer in JSON.

    Args:
        tell: Is given the notes on a bag, a list, once it is read.

    Raises:
        BagError: The bag cannot be read, or holds no plan.
        InvalidInput: A task or an answer is damaged.
    """
    if source.suffix == ".json":
        yield from _motions_in_json(source)
        return
    refusals, count = list[str](), 0
    with open_bag(source) as bag:
        for one in exchanges(bag):
            if one.status is Status.SOLVED:
                with fields_placed(one.plan_id):
                    task = one.planned_task()
                    plan = plan_of_task(task, one.answer)
                start_ns = nanoseconds(one.answer.plans[0].joint_trajectory.header.stamp)
                yield from motions_of(one.plan_id, task, plan, start_ns)
                count += 1
            elif one.answer is not None:
                refusals.append(f"{one.plan_id}: {one.answer.status.message}")
        tell(bag.notes)
        if not count:
            reasons = "; ".join([f"its answers: {'; '.join(refusals) or 'none'}", *bag.notes])
            raise BagError(f"bag {source} holds no plan; {reasons}")


def motions_of(
    name: str, task: PlanningTask, plan: Plan, start_ns: int = 0
) -> Iterator[PlannedMotion]:
    """Yield each phase of a plan; arguments as the fields of `PlannedMotion`."""
    usual = withstood(task.settings.robust)
    for number, (one, found) in enumerate(phase_tasks(task, plan), start=1):
        problem = lasting(one.problem, found.duration)
        called = f"{name}, phase {number}" if plan.then else name
        motion = problem.robot, found.trajectory, scene_of(problem)
        yield PlannedMotion(name, called, *motion, problem.limits, usual, start_ns)


def _motions_in_json(source: Path) -> Iterator[PlannedMotion]:
    for name, answer in phases_of(read_json(source), source.name):
        try:
            motion = *planned_motion(answer), planned_scene(answer)
            limits = limits_from(answer.get("limits", {}), Limits())
            told = uncertainty_in(answer)
        except InvalidInput as error:
            field = f"{source}: {error.field}"
            raise InvalidInput(error.status, field, error.value, error.allowed) from None
        yield PlannedMotion(source.name, name, *motion, limits, told)
