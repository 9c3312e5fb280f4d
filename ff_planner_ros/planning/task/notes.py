"""Notes for the user on the files of a task, and on the problem that a plan was made for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.configuration import whole_turns


def notes_on_files(task: PlanningTask) -> tuple[str, ...]:
    """Return notes on the files of robot, target bodies and obstacles."""
    bodies = (task.problem.target_body, *(phase.target_body for phase in task.then))
    of_bodies = (note for body in bodies if body is not None for note in body.notes)
    of_meshes = (note for one in task.problem.obstacles for note in one.solid.notes)
    return tuple(dict.fromkeys((*task.problem.robot.notes, *of_bodies, *of_meshes)))


def notes_on(problem: PlanningProblem, settings: PlannerSettings) -> tuple[str, ...]:
    """Return notes on target body, meshes, postures a turn away, margins, and plug-ins."""
    body = problem.target_body
    of_meshes = dict.fromkeys(note for one in problem.obstacles for note in one.solid.notes)
    notes = (*(() if body is None else body.notes), *of_meshes, *_turn_notes(problem))
    if settings.robust.sigmas and (without := list(_without_margin(problem))):
        notes += (f"planner.robust keeps no margin on {', '.join(without)}",)
    slower = ", ".join(one.name for one in problem.requirements if one.concerns(problem))
    if slower:
        notes += (f"the search asks Python for the rows of {slower}, which makes it slower",)
    return notes


def _turn_notes(problem: PlanningProblem) -> Iterator[str]:
    """Yield a note on each joint that goes further round to its posture than it would have to."""
    robot, posture = problem.robot, problem.posture
    if posture is None or posture.positions is None:
        return
    way = posture.positions - problem.start.joint_positions
    nearest = posture.positions - whole_turns(way)
    within = robot.lower_position_limits <= nearest, nearest <= robot.upper_position_limits
    for joint in np.flatnonzero((nearest != posture.positions) & np.logical_and(*within)).tolist():
        if not robot.slides(joint):
            yield (
                f"{robot.joint_names[joint]} turns by {abs(way[joint]):.4g} rad to "
                f"{posture.positions[joint]:.4g} rad, and {nearest[joint]:.4g} rad, the same "
                f"posture, is {abs(way - whole_turns(way))[joint]:.3g} rad away"
            )


def _without_margin(problem: PlanningProblem) -> Iterator[str]:
    """Yield what errors affect and a robust plan keeps without a margin, by its key."""
    for name in ("grasp_force", "grasp_torque", "capture_impulse"):
        if np.isfinite(getattr(problem.limits, name)):
            yield f"limits.{name}"
    if problem.camera is not None:
        yield "camera"
    if problem.path is not None:
        yield "target.path"
    if np.isfinite(problem.chaser_goal.most):
        wanted = problem.chaser_goal.quaternion_xyzw
        yield "target.chaser_rotation" if wanted is None else "target.chaser_quaternion_xyzw"
    yield from (f"requirements.{one.name}" for one in problem.requirements)


def with_notes(refused: NoPlanFound, notes: Sequence[str]) -> NoPlanFound:
    """Return a refusal whose message ends with notes, as the message of a plan does."""
    if not notes:
        return refused
    words = "; ".join([refused.constraint, *notes])
    return NoPlanFound(refused.status, words, refused.attempt, refused.failures, refused.effort)
