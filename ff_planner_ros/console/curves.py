"""Curves of a plan over time with its limits, and a line at the time of the slider."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
import viser

from ff_planner_ros.analysis.drawing.panels import (
    CHASER_POSE,
    Panel,
    Quantity,
    clearance_panel,
    joint_rates,
    joint_torques,
    panels,
)
from ff_planner_ros.analysis.methods import SHORTEST
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.colours import CURVES, LINE, css
from ff_planner_ros.console.stages import Stage
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.scene import scene_of

CLEARANCE, ATTITUDE = "clearance [mm]", "attitude since the start [deg]"
VELOCITIES, TORQUES = "joint velocities [% of limit]", "joint torques [% of limit]"
NAMES = (CLEARANCE, ATTITUDE, VELOCITIES, TORQUES)
_EULER = ("roll", "pitch", "yaw")
_HEIGHT, _PANEL = 190, 400  # [pixels]
# The line follows the slider this much later [s]: without a graphics card, drawing curves anew at
# each of its steps would take a third of the pictures of the scene.
_BEHIND = 0.1
_AIR = 0.06  # above and below the curves, in parts of their span


@dataclass(frozen=True, eq=False)
class Curves:
    """Quantities over the time of a plan."""

    times: Array  # from the first point on; shape (times,) [s]
    values: dict[str, Array]  # by name; each of shape (times,)
    limits: tuple[float, ...] = ()  # of all of them


def curves_of(name: str, stages: Sequence[Stage]) -> Curves | None:
    """Return the curves of one of `NAMES` for a plan; None: no plan, or no such limit.

    Args:
        stages: Phases of the plan, in order.
    """
    motions = [stage.motion for stage in stages if stage.motion is not None]
    if not motions or len(motions) < len(stages):
        return None
    if name == CLEARANCE:
        return _clearance(stages)
    robot, limits = stages[0].problem.robot, stages[0].problem.limits
    whole = motions[0]
    for stage, motion in zip(stages[1:], motions[1:], strict=True):
        whole = whole.followed_by(motion, stage.begin)
    if name == ATTITUDE:
        most = float(np.rad2deg(limits.chaser_attitude))
        kept = (-most, most) if np.isfinite(most) else ()
        angles = _panels(CHASER_POSE[1], whole)
        values = {_EULER[k]: one.curves[SHORTEST][1] for k, one in enumerate(angles)}
        return Curves(whole.time, values, kept)
    quantity = joint_rates(robot) if name == VELOCITIES else joint_torques(robot)
    return _shares(whole, quantity, robot.joint_names)


def _panels(quantity: Quantity, motion: Trajectory) -> list[Panel]:
    return panels(quantity, {SHORTEST: motion})


def _shares(motion: Trajectory, quantity: Quantity, joints: Sequence[str]) -> Curves | None:
    """Return each joint's part of its own limit; joints without a limit are left out."""
    found = {
        name: 100.0 * one.curves[SHORTEST][1] / one.levels[1]
        for name, one in zip(joints, _panels(quantity, motion), strict=True)
        if np.isfinite(one.levels[1])
    }
    return Curves(motion.time, found, (-100.0, 100.0)) if found else None


def _clearance(stages: Sequence[Stage]) -> Curves | None:
    """Return the distance to the closest obstacle, without pairs that may touch at the goal."""
    times, values = list[Array](), list[Array]()
    for stage in stages:
        problem = stage.problem
        if stage.motion is None or not problem.obstacles:
            continue
        panel = clearance_panel(
            problem.robot, problem.obstacles, {SHORTEST: stage.motion}, scene_of(problem)
        )
        time, distance = panel.curves[SHORTEST]
        times.append(stage.begin + time)
        values.append(distance)
    if not times:
        return None
    return Curves(np.concatenate(times), {"closest obstacle": np.concatenate(values)}, (0.0,))


class CurvesView:
    """A panel with a choice of curves, and a line at the time of the slider."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Begin with nothing to draw."""
        self._stages: Sequence[Stage] = ()
        self._curves: Curves | None = None
        self._time = 0.0
        self._lock = Lock()  # of curves and plot: the line is moved in the server's thread
        self._is_behind = False
        self._loop = server.get_event_loop()
        self._gui = server.gui
        panel = server.gui.add_panel()
        with panel.add_tab("Curves"):
            self._choice = server.gui.add_dropdown("curves", NAMES)
            self._words = server.gui.add_markdown("")
            self._plot = server.gui.add_uplot(*_drawn(None, 0.0), height=_HEIGHT, visible=False)
        panel.float(x=12, y=-12, width=_PANEL)
        self._choice.on_update(lambda _: self._draw())

    def show(self, stages: Sequence[Stage], time: float) -> None:
        """Draw another plan, at a time [s]."""
        self._stages, self._time = stages, time
        self._draw()

    def move_to(self, time: float) -> None:
        """Move the line to a time [s], soon."""
        self._time = time
        if not self._is_behind and self._curves is not None:
            self._is_behind = True
            self._loop.call_soon_threadsafe(self._loop.call_later, _BEHIND, self._move_line)

    def _move_line(self) -> None:
        self._is_behind = False  # first of all: a later time is not missed
        with self._lock:
            if self._curves is not None:
                self._plot.data = _data(self._curves, self._time)

    def _draw(self) -> None:
        curves = curves_of(str(self._choice.value), self._stages)
        with self._lock:
            self._curves = curves
            self._put(curves)

    def _put(self, curves: Curves | None) -> None:
        self._plot.visible = curves is not None
        self._words.visible = curves is None
        planned = any(stage.motion is not None for stage in self._stages)
        self._words.content = "there is no such limit" if planned else "nothing is planned yet"
        if curves is None:
            return
        data, series = _drawn(curves, self._time)
        self._plot.series, self._plot.data = series, data
        low, high = _span(curves)
        self._plot.scales = {
            "x": {"time": False, "range": (float(curves.times[0]), float(curves.times[-1]))},
            "y": {"range": (low, high)},
        }


def _span(curves: Curves) -> tuple[float, float]:
    numbers = np.concatenate([*curves.values.values(), curves.limits])
    low, high = float(np.nanmin(numbers)), float(np.nanmax(numbers))
    air = _AIR * (high - low) or 1.0
    return low - air, high + air


def _data(curves: Curves, time: float) -> tuple[Array, ...]:
    """Return times and curves with two more points at a time, between which a line stands."""
    at = int(np.searchsorted(curves.times, time))
    times = np.insert(curves.times, at, [time, time])
    drawn = [np.interp(times, curves.times, one) for one in curves.values.values()]
    limits = [np.full(len(times), limit) for limit in curves.limits]
    now = np.full(len(times), np.nan)
    now[at : at + 2] = _span(curves)
    return (times, *drawn, *limits, now)


def _drawn(curves: Curves | None, time: float) -> tuple[tuple[Array, ...], tuple[Any, ...]]:
    """Return data and series of the plot."""
    if curves is None:
        curves = Curves(np.arange(2.0), {"nothing": np.zeros(2)})
    series: list[Any] = [{"label": "time [s]"}]
    for number, name in enumerate(curves.values):
        turn, place = divmod(number, len(CURVES))
        dashed = {"dash": (6, 3)} if turn else {}
        series.append({"label": name, "stroke": css(CURVES[place]), "width": 2, **dashed})
    limit = {"label": "limit", "stroke": css(LINE), "width": 1.5, "dash": (2, 3)}
    series += [limit for _ in curves.limits]
    series.append({"label": "now", "stroke": css(LINE), "width": 1})
    return _data(curves, time), tuple(series)
