"""Stages of the scene: the motion of each phase, or the robot at its start before a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.analysis.drawing.surroundings import (
    constraint_lines,
    corridor_lines,
    path_lines,
)
from ff_planner_ros.analysis.nearest import Nearest, nearest_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.path.followed import end_effector
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.configuration import configuration

# Number of times at which obstacles are shown before there is a plan.
_MOMENTS = 25


@dataclass(frozen=True, eq=False)
class Stage:
    """A phase: one robot among obstacles, at some times."""

    begin: float  # of the phase, from the first point of the first one [s]
    problem: PlanningProblem  # its obstacles are those at the first point of the phase
    times: Array  # from that point on; shape (points,) [s]
    q: Array  # shape (points, 7 + joints)
    constraints: dict[str, Array]  # lines of corridor, camera and path, each (lines, 2, 3) [m]
    motion: Trajectory | None = None  # None: nothing is planned yet

    @property
    def end(self) -> float:
        """When the phase ends, from the first point of the first one [s]."""
        return self.begin + float(self.times[-1])

    @property
    def tip(self) -> Array:
        """Path of the end effector. Shape (points, 3) [m]."""
        return arm_points(self.problem.robot, self.q)[:, -1]

    def nearest(self, point: int) -> Nearest | None:
        """Return the pair at the smallest distance at a point; None: the robot has no bodies."""
        only = slice(point, point + 1)
        problem = self.problem
        return nearest_of(problem.robot, self.q[only], self.times[only], problem.obstacles)

    def may_touch(self, pair: str) -> bool:
        """Return whether a pair, `body/other`, is allowed to touch near the goal."""
        one, _, other = pair.partition("/")
        link, other_link = one.partition("#")[0], other.partition("#")[0]
        names = {f"{link}/{other}", f"{link}/{other_link}", f"{other_link}/{link}"}
        return not names.isdisjoint(self.problem.allowed_collisions)


def stages_of(task: PlanningTask, plan: Plan | None) -> tuple[Stage, ...]:
    """Return the phases of a plan; without one, the robot at its start through the duration."""
    if plan is None:
        return (_before_plan(task),)
    stages, begin = list[Stage](), 0.0
    for one, of_phase in phase_tasks(task, plan):
        problem, motion = lasting(one.problem, of_phase.duration), of_phase.trajectory
        q, _ = from_trajectory(problem.robot, motion)
        lines = constraint_lines(scene_of(problem), problem.robot, motion)
        times = motion.time - motion.time[0]
        stages.append(Stage(begin, problem, times, q, lines, motion))
        begin = stages[-1].end
    return tuple(stages)


def at_time(stages: Sequence[Stage], time: float) -> tuple[int, int]:
    """Return the index of the stage at a time [s], and of its point nearest in time."""
    begins = [stage.begin for stage in stages]
    number = max(0, int(np.searchsorted(begins, time, side="right")) - 1)
    stage = stages[number]
    return number, int(np.abs(stage.begin + stage.times - time).argmin())


def _before_plan(task: PlanningTask) -> Stage:
    problem = task.problem
    start = carried_forward(problem.robot, problem.start, task.ahead, task.running)
    q, _ = configuration(problem.robot, start)
    goal, lines = problem.target, dict[str, Array]()
    if problem.approach is not None:
        lines["approach"] = corridor_lines(problem.approach, goal.position, goal.quaternion_xyzw)
    if problem.path is not None:
        _, twist = end_effector(problem.robot, start)
        lines["path"] = path_lines(problem.path, twist)
    times = np.linspace(0.0, problem.duration, _MOMENTS)
    return Stage(0.0, problem, times, np.repeat(q[None], _MOMENTS, axis=0), lines)
