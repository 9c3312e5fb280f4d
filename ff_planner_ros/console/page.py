"""The page: a scene, a slider through time, controls that change the task, a table of plans."""

from __future__ import annotations

from collections.abc import Sequence
from threading import RLock
from typing import Any

import numpy as np
import viser

from ff_planner_ros.console.changes import (
    GOAL,
    lasting_for,
    movable,
    moved,
    place_of,
    rounded,
    weighted,
)
from ff_planner_ros.console.curves import CurvesView
from ff_planner_ros.console.entries import Begin, Entry, PlansHere, Running, in_words, table_of
from ff_planner_ros.console.goal_fields import GoalFields
from ff_planner_ros.console.scene import SceneView
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.task.task import PlanningTask

_NOTHING = "nothing"
_STEPS = 200  # of the slider through time
# Of the sliders: the largest weight, unless the task's is larger, and the durations beside it.
_WEIGHT, _SHORTER, _LONGER = 10.0, 0.2, 3.0
_HANDLE = "/handle"
_CHANGED = "changed: not planned yet"


class Page:
    """One page that all viewers share: a change by one of them is seen by the others."""

    def __init__(
        self,
        server: viser.ViserServer,
        entries: Sequence[Entry],
        begin: Begin | None = None,
        moves_obstacles: bool = True,
    ) -> None:
        """Show the first entry of which anything can be drawn, or else the first one.

        Args:
            begin: How a task is planned; None: in this process.
            moves_obstacles: Whether obstacles can be moved by hand.
        """
        self._lock = RLock()  # callbacks come in many threads
        self._server = server
        self._begin, self._moves_obstacles = begin or PlansHere(), moves_obstacles
        self.entries = list(entries)
        self.chosen = next((one for one in self.entries if one.stages), self.entries[0])
        self.task: PlanningTask | None = None  # what will be planned
        self.search: Running | None = None  # None: no search runs
        self._changed_since = False  # whether the task was changed while a search runs
        self._scene = SceneView(server)
        self._curves = CurvesView(server)
        self._handle: viser.TransformControlsHandle | None = None
        gui = server.gui
        self._time = gui.add_slider("time [s]", 0.0, 1.0, 0.01, 0.0)
        self._near = gui.add_markdown("")
        with gui.add_folder("Task"):
            self._move = gui.add_dropdown("move", (_NOTHING,))
            self._place = gui.add_vector3("position [m]", (0.0, 0.0, 0.0), step=0.01, visible=False)
            self._path = gui.add_slider("weight of joint path", 0.0, _WEIGHT, 0.1, 1.0)
            self._attitude = gui.add_slider("weight of attitude", 0.0, _WEIGHT, 0.1, 0.0)
            self._duration = gui.add_slider("duration [s]", 0.1, 1.0, 0.1, 1.0)
            self._range = gui.add_multi_slider("durations [s]", 0.1, 1.0, 0.1, (0.1, 1.0))
            self._goal = GoalFields(gui)
            self._undo = gui.add_button("undo", disabled=True, hint="back to the answer shown")
        with gui.add_folder("Plan"):
            self._plan = gui.add_button("plan")
            self._cancel = gui.add_button("cancel", disabled=True)
            self._progress = gui.add_markdown("")
        with gui.add_folder("Answers"):
            self._choice = gui.add_dropdown("shown", tuple(one.name for one in self.entries))
            self._words = gui.add_html("")
            self._table = gui.add_html("")
        self._listen()
        self._choose(self.chosen)

    def _listen(self) -> None:
        self._time.on_update(lambda event: self._by_user(event, self._show_time))
        self._move.on_update(lambda event: self._by_user(event, self._place_handle))
        self._place.on_update(lambda event: self._by_user(event, self._moved_by_numbers))
        sliders = self._path, self._attitude, self._duration, self._range
        for one in (*sliders, *self._goal.every):
            one.on_update(lambda event: self._by_user(event, self._changed_by_sliders))
        self._plan.on_click(lambda _: self._locked(self.plan))
        self._cancel.on_click(lambda _: self._locked(self.cancel))
        self._undo.on_click(lambda _: self._choose_named())
        self._choice.on_update(lambda event: self._by_user(event, self._choose_named))

    def _locked(self, what: Any) -> None:
        with self._lock:
            what()

    def _by_user(self, event: Any, what: Any) -> None:
        # What the page sets itself, no client has sent.
        if event.client is not None:
            self._locked(what)

    def choose(self, name: str) -> None:
        """Show the entry of a name, and its task."""
        with self._lock:
            self._choose(next(one for one in self.entries if one.name == name))

    @property
    def is_idle(self) -> bool:
        """Whether nothing is being changed or planned, so that another entry may be shown."""
        return self.search is None and bool(self._undo.disabled)

    def put(self, entry: Entry) -> None:
        """Add an entry or replace the one of its name; show a new one if the page is idle."""
        with self._lock:
            names = [one.name for one in self.entries]
            if entry.name not in names:
                self.entries.append(entry)
                self._choice.options = (*names, entry.name)
                if self.is_idle:
                    self._choose(entry)
                else:
                    self._tabulate()
                return
            before = self.entries[names.index(entry.name)]
            self.entries[names.index(entry.name)] = entry
            if before is not self.chosen:
                self._tabulate()
            elif self._undo.disabled and (before.plan, before.task) != (entry.plan, entry.task):
                self._choose(entry)
            else:  # its status alone is another, or a change is drawn: the scene stays
                self.chosen = entry
                self._tabulate()

    def go_to(self, time: float) -> None:
        """Show the plan at a time from its first point on [s]."""
        with self._lock:
            _set(self._time, min(max(time, 0.0), float(self._time.max)))
            self._show_time()

    def change(self, task: PlanningTask, is_elsewhere: bool = True) -> None:
        """Make a changed task the one to plan next.

        Args:
            is_elsewhere: Whether places or times have changed, so that the task is drawn again.
        """
        with self._lock:
            self.task, self._changed_since = task, self.search is not None
            self._undo.disabled = False
            self._progress.content = _CHANGED
            if is_elsewhere:
                self._draw(Entry("changed", task))

    def plan(self) -> None:
        """Begin to plan the current task, unless a search runs."""
        with self._lock:
            if self.task is not None and self.search is None:
                self._plan.disabled, self._cancel.disabled = True, False
                self._progress.content = "searching"
                self.search = self._begin(self.task, self._told, self._done)

    def cancel(self) -> None:
        """End the search that runs."""
        if self.search is not None:
            self.search.cancel()

    def _told(self, words: str) -> None:
        self._progress.content = words

    def _done(self, entry: Entry) -> None:
        with self._lock:
            self.search = None
            # What was changed before is what was planned.
            self._undo.disabled = not self._changed_since
            self._cancel.disabled = True
            self.put(entry)
            if self._changed_since:
                self._changed_since = self._plan.disabled = False
                self._progress.content = _CHANGED

    def _choose(self, entry: Entry) -> None:
        self.chosen, self.task, self._changed_since = entry, entry.task, False
        self._undo.disabled = True
        self._progress.content = ""
        _set(self._choice, entry.name)
        self._tabulate()
        self._plan.disabled = self.task is None or self.search is not None
        self._set_sliders()
        self._draw(entry)

    def _tabulate(self) -> None:
        self._words.content = in_words(self.chosen)
        self._table.content = table_of(self.entries, self.chosen)

    def _draw(self, entry: Entry) -> None:
        self._curves.show(entry.stages, 0.0)
        if not entry.stages:
            self._near.content = "of this request nothing can be drawn"
            return
        self._scene.show(entry.stages, entry.fault)
        end = entry.stages[-1].end
        self._time.step = end / _STEPS
        self._time.max = end
        _set(self._time, min(0.0 if entry.fault is None else entry.fault.time, end))
        self._show_time()

    def _show_time(self) -> None:
        if self._scene.is_empty:
            return
        time = float(self._time.value)
        self._near.content = self._scene.move_to(time)
        self._curves.move_to(time)

    def _set_sliders(self) -> None:
        """Set the controls to the task's values."""
        self._offer()
        if self.task is None:
            return
        problem = self.task.problem
        self._goal.show(problem)
        for slider, weight in (
            (self._path, problem.objective.joint_path_length),
            (self._attitude, problem.objective.chaser_attitude),
        ):
            slider.max = max(_WEIGHT, weight, slider.max)
            _set(slider, weight)
        window = problem.durations
        for one in (self._duration, self._range):
            one.min = min(one.min, _SHORTER * window.minimum)
            one.max = max(one.max, _LONGER * window.maximum)
        _set(self._duration, problem.duration)
        _set(self._range, (window.minimum, window.maximum))

    def _offer(self) -> None:
        """Show the controls that the task can be changed by."""
        names = () if self.task is None else movable(self.task.problem)
        shown = (name for name in names if name == GOAL or self._moves_obstacles)
        self._move.options = (_NOTHING, *shown)
        self._place_handle()
        if self.task is None:
            return
        problem = self.task.problem
        self._goal.offer(problem)
        self._duration.visible = problem.duration_range is None and problem.path is None
        self._range.visible = problem.duration_range is not None

    def _choose_named(self) -> None:
        self.choose(self._choice.value)

    def _changed_by_sliders(self) -> None:
        if self.task is None:
            return
        durations = (float(self._duration.value),) * 2
        if self.task.problem.duration_range is not None:
            durations = (float(self._range.value[0]), float(self._range.value[1]))
        try:
            task = weighted(self.task, float(self._path.value), float(self._attitude.value))
            task = self._goal.changed(task)
            window = task.problem.durations
            if task.problem.path is None and durations != (window.minimum, window.maximum):
                task = lasting_for(task, *durations)
        except FfPlannerError as error:
            self._refuse(error)
            return
        before, after = self.task.problem, task.problem
        self.change(task, after.path is not before.path or after.durations != before.durations)
        self._offer()

    def _place_handle(self) -> None:
        """Put the handle on the goal or obstacle that is chosen to be moved."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        name = self._move.value
        self._place.visible = self.task is not None and name != _NOTHING
        if self.task is None or name == _NOTHING:
            return
        position, turned = place_of(self.task.problem, name)
        _set(self._place, tuple(position.tolist()))
        x, y, z, w = (0.0, 0.0, 0.0, 1.0) if turned is None else turned.tolist()
        self._handle = self._server.scene.add_transform_controls(
            _HANDLE,
            scale=0.4,
            disable_rotations=turned is None,
            position=position,
            wxyz=(w, x, y, z),
            depth_test=False,
        )
        self._handle.on_update(self._moved_by_handle)

    def _moved_by_handle(self, event: viser.TransformControlsEvent) -> None:
        if event.phase != "end":
            return
        with self._lock:
            w, x, y, z = event.target.wxyz
            quaternion = np.array([x, y, z, w]) / np.linalg.norm([x, y, z, w])
            self.move(self._move.value, event.target.position, quaternion)

    def _moved_by_numbers(self) -> None:
        self.move(self._move.value, np.array(self._place.value), None)

    def move(self, name: str, position: Any, quaternion_xyzw: Any) -> None:
        """Move the goal or an obstacle; a refusal is shown and changes nothing."""
        with self._lock:
            if self.task is None or name == _NOTHING:
                return
            _, turned = place_of(self.task.problem, name)
            try:
                given = None if turned is None else quaternion_xyzw
                self.change(moved(self.task, name, rounded(position), given))
            except FfPlannerError as error:
                self._refuse(error)
            self._place_handle()

    def _refuse(self, error: FfPlannerError) -> None:
        self._progress.content = f"not changed: {error}"


def _set(handle: Any, value: Any) -> None:
    """Set a control to a value: viser's types know such an attribute as read-only."""
    handle.value = value
