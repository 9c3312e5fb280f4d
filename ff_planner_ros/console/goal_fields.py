"""Fields of the page for the goal: the chaser's attitude there, and a path to follow."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from ff_planner_ros.common.declared import written_object
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.console.changes import along, attaining
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import ChaserGoal, PathToFollow, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask

_ANY, _ROTATION, _ATTITUDE = "any attitude", "rotated by at most", "at an attitude"
# Before an angle is asked for [deg]; before there is a path: its tolerances [mm, deg].
_ANGLE, _WITHIN = 1.0, (1.0, 0.1)
# Of a point of a path, in a line.
_COLUMNS = "time x y z [qx qy qz qw]"


class GoalFields:
    """Fields of the page for the chaser's attitude at the goal and a path to follow."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Build the fields."""
        kinds = (_ANY, _ROTATION, _ATTITUDE)
        self._chaser = gui.add_dropdown("chaser at the goal", kinds)
        self._attitude = gui.add_text(
            "attitude x y z w", "", hint="quaternion, chaser axes to inertial axes"
        )
        hint = "since the start, or off the attitude"
        self._angle = gui.add_number("angle at most [deg]", _ANGLE, min=0.0, step=0.01, hint=hint)
        self._path = gui.add_text(
            "path",
            "",
            multiline=True,
            hint=f"a line for each point: {_COLUMNS} [s, m]; empty: any way to the goal",
        )
        self._apart = gui.add_number("off the path [mm]", _WITHIN[0], min=0.0, step=0.01)
        self._turned = gui.add_number("off its orientation [deg]", _WITHIN[1], min=0.0, step=0.01)
        self._of_chaser = self._chaser, self._attitude, self._angle
        self._of_path = self._path, self._apart, self._turned
        self.every: tuple[Any, ...] = (*self._of_chaser, *self._of_path)

    def show(self, problem: PlanningProblem) -> None:
        """Set the fields to a problem's values."""
        for field, value in zip(self.every, (*_chaser(problem), *_path(problem)), strict=True):
            field.value = value
        self.offer(problem)

    def offer(self, problem: PlanningProblem) -> None:
        """Show the fields that a problem can have values of."""
        goal = problem.chaser_goal
        self._attitude.visible = goal.quaternion_xyzw is not None
        self._angle.visible = bool(np.isfinite(goal.most))
        self._path.visible = problem.posture is None and problem.target_body is None
        for one in self._of_path[1:]:
            one.visible = problem.path is not None

    def changed(self, task: PlanningTask) -> PlanningTask:
        """Return a task with the values of the fields; what they say already stays as it is.

        Raises:
            InvalidInput: A value is not allowed.
        """
        if tuple(one.value for one in self._of_chaser) != _chaser(task.problem):
            task = attaining(task, self._goal())
        if tuple(one.value for one in self._of_path) != _path(task.problem):
            task = along(task, self._followed())
        return task

    def _goal(self) -> ChaserGoal:
        kind, angle = self._chaser.value, float(np.deg2rad(self._angle.value))
        if kind == _ATTITUDE:
            numbers = _numbers("target.chaser_quaternion_xyzw", self._attitude.value)
            return ChaserGoal(quaternion_xyzw=np.array(numbers), tolerance=angle)
        return ChaserGoal(rotation=angle if kind == _ROTATION else None)

    def _followed(self) -> PathToFollow | None:
        lines = [line for line in self._path.value.splitlines() if line.strip()]
        if not lines:
            return None
        told = {
            "path": [_point(f"target.path[{k}]", line) for k, line in enumerate(lines)],
            "position_tolerance": self._apart.value / 1e3,
            "orientation_tolerance": float(np.deg2rad(self._turned.value)),
        }
        path: PathToFollow = part(PathToFollow).read("target", told)
        return path


def _chaser(problem: PlanningProblem) -> tuple[str, str, float]:
    """Return the values of the fields of the chaser's attitude; any: those to begin with."""
    goal = problem.chaser_goal
    kind = _ANY if np.isinf(goal.most) else _ROTATION
    kind = kind if goal.quaternion_xyzw is None else _ATTITUDE
    at_start = problem.start.quaternion_chaser_to_inertial_xyzw
    angle = _ANGLE if kind == _ANY else float(np.rad2deg(goal.most))
    return kind, _words(goal.wanted(at_start).tolist()), angle


def _path(problem: PlanningProblem) -> tuple[str, float, float]:
    """Return the values of the fields of a path: its points to the last bit."""
    path = problem.path
    if path is None:
        return "", *_WITHIN
    points = written_object(path)["path"]
    lines = (
        _words([one["time"], *one["position"], *one.get("quaternion_xyzw", ())]) for one in points
    )
    turned = float(np.rad2deg(path.orientation_tolerance))
    return "\n".join(lines), path.position_tolerance * 1e3, turned


def _point(field: str, line: str) -> dict[str, Any]:
    numbers = _numbers(field, line)
    if len(numbers) not in (4, 8):
        raise InvalidInput(Status.WRONG_SIZE, field, line, f"a line must be {_COLUMNS}")
    turned = {"quaternion_xyzw": numbers[4:]} if numbers[4:] else {}
    return {"time": numbers[0], "position": numbers[1:4], **turned}


def _numbers(field: str, text: str) -> list[float]:
    """Read numbers with blanks or commas between them."""
    try:
        return [float(one) for one in text.replace(",", " ").split()]
    except ValueError:
        raise InvalidInput(Status.WRONG_SIZE, field, text, "it must be numbers") from None


def _words(numbers: list[float]) -> str:
    return " ".join(map(repr, numbers))
