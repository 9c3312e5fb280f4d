"""Panel of a campaign: its map, and the choice of quantities and cases in it."""

from __future__ import annotations

import html
from collections.abc import Mapping
from threading import RLock

import viser

from ff_planner_ros.console.colours import STYLE
from ff_planner_ros.console.study.cells import plane
from ff_planner_ros.console.study.picture import Case, heat_map
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.report.statistics import Row
from ff_planner_ros.report.study.columns import Column, metrics, quantities, words
from ff_planner_ros.report.study.explorer import code_of, first_shown

_ALL = "all"
_MOST_VALUES = 16  # of a quantity that can be held at one of them


class StudyPanel:
    """The map of a campaign's cases, over two quantities that a person chooses."""

    def __init__(self, server: viser.ViserServer, rows: Mapping[str, Row]) -> None:
        """Build the controls, and draw nothing yet.

        Args:
            rows: Rows of the campaign's table, by the names of their cases.

        Raises:
            InvalidInput: Fewer than two quantities were varied.
        """
        self._names, self._rows = list(rows), list(rows.values())
        self._lock, self._shown = RLock(), ""
        varied = quantities(self._rows)
        # Of cases that are all refused unplanned nothing is measured: the map shows their causes.
        measured = metrics(self._rows) or [Column("cause", "cause", [None] * len(self._rows))]
        if len(varied) < 2:
            allowed = "a map needs two quantities that were varied"
            raise InvalidInput(Status.UNSUPPORTED, "varied", len(varied), allowed)
        self._varied = {one.name: one for one in varied}
        self._costs = {one.name: one for one in measured}
        causes = sorted({row["status"] for row in self._rows if not row["solved"]}, key=code_of)
        self._causes = {one: f"{code_of(one)} {one.upper()}" for one in causes}
        first = first_shown(varied, measured, random=False)
        across, up = varied[int(first["across"])].name, varied[int(first["up"])].name
        cost = measured[int(first["left"])].name if first["left"].isdigit() else measured[0].name
        gui = server.gui
        panel = gui.add_panel()
        with panel.add_tab("Map"):
            self._picture = gui.add_html("")
            self._across = gui.add_dropdown("across", tuple(self._varied), initial_value=across)
            self._up = gui.add_dropdown("up", tuple(self._varied), initial_value=up)
            self._cost = gui.add_dropdown("colour", tuple(self._costs), initial_value=cost)
            self._held = [
                (
                    column,
                    gui.add_dropdown(column.name, (_ALL, *_values(column)), initial_value=held),
                )
                for column, held in self._to_hold(first["others"])
            ]
            self._told = gui.add_html("")
        panel.dock_left()
        for one in (self._across, self._up, self._cost, *(held for _, held in self._held)):
            one.on_update(lambda _: self._draw())

    def show(self, name: str) -> None:
        """Draw the map, with one of its cases marked."""
        with self._lock:
            self._shown = name
            self._draw()

    def _to_hold(self, others: Mapping[str, float]) -> list[tuple[Column, str]]:
        """Return the quantities that can be fixed at one value, and their initial values."""
        methods = words("method", [row["method"] for row in self._rows])
        sources = words("scenario", [row["source"] for row in self._rows])
        found = list[tuple[Column, str]]()
        for column in (methods, sources, *self._varied.values()):
            values = sorted(set(column.known))
            if not 1 < len(values) <= _MOST_VALUES:
                continue
            at: float | None = values[0] if column is methods else others.get(column.name)
            found.append((column, _ALL if at is None else _said(column, at)))
        return found

    def _draw(self) -> None:
        with self._lock:
            kept = list(range(len(self._rows)))
            for column, held in self._held:
                held.visible = column.name not in (self._across.value, self._up.value)
                if held.visible and held.value != _ALL:
                    values = column.values
                    kept = [k for k in kept if _said(column, values[k]) == held.value]
            cost = self._costs[self._cost.value]
            cases = [
                Case(name, cost.values[k], None if row["solved"] else row["status"])
                for k, (name, row) in enumerate(zip(self._names, self._rows, strict=True))
            ]
            over = self._varied[self._across.value], self._varied[self._up.value]
            self._picture.content = heat_map(
                plane(*over, kept), cases, cost.name, self._causes, self._shown
            )
            self._told.content = self._of_shown()

    def _of_shown(self) -> str:
        """Return the table's values and result of the case that is shown, in HTML."""
        if self._shown not in self._names:
            return ""
        k = self._names.index(self._shown)
        row = self._rows[k]
        values = ", ".join(
            f"{name} {_said(one, one.values[k])}" for name, one in self._varied.items()
        )
        said = "solved" if row["solved"] else f"{self._causes[row['status']]}: {row['message']}"
        told = html.escape(f"{values}, {row['method']}; the table says: {said}")
        return f"{STYLE}<div class='ff'><p><b>{html.escape(self._shown)}</b> {told}</p></div>"


def _values(column: Column) -> tuple[str, ...]:
    return tuple(_said(column, value) for value in sorted(set(column.known)))


def _said(column: Column, value: float | None) -> str:
    """Return a value as the page shows it."""
    if value is None:
        return "-"
    return f"{value:.6g}" if column.labels is None else column.labels[int(value)]
