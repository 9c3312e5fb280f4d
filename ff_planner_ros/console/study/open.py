"""The page of a campaign: a click in its map plans a case again, and shows the plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import viser

from ff_planner_ros.campaign.again import defaults_of, scenario_again
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.campaign.table import read_plans
from ff_planner_ros.console.entries import Entry, Running, entry_of
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.search import Answer, Search
from ff_planner_ros.console.study.panel import StudyPanel
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.scenario.scenario import load_task
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.report.statistics import Row
from ff_planner_ros.report.study.case import differences


class StudyPage:
    """A page about one campaign."""

    def __init__(self, directory: Path) -> None:
        """Read the campaign's table of plans.

        Raises:
            InvalidInput: There is no campaign, or a file of it is damaged or too large.
        """
        self._directory = directory
        rows = read_plans(directory).sort_by("number").to_pylist()
        self._rows: dict[str, Row] = {f"case {k}": row for k, row in enumerate(rows, start=1)}

    def page_on(self, server: viser.ViserServer) -> Page:
        """Build the page on a server, and plan again the first case that had a plan.

        Raises:
            InvalidInput: Fewer than two quantities were varied.
        """
        names = sorted(self._rows, key=lambda name: not self._rows[name]["solved"])
        page = Page(server, [self._entry(names[0])])
        self._page, self._panel = page, StudyPanel(server, self._rows)
        page.unlisted, page.shown = self._show, lambda entry: self._panel.show(entry.name)
        self._show(names[0])
        return page

    def _entry(self, name: str) -> Entry:
        """Return the entry of a case before it is planned again."""
        row = self._rows[name]
        try:
            task = load_task(scenario_again(row, self._directory), defaults_of(self._directory))
        except (FfPlannerError, OSError) as error:
            if not isinstance(error, FfPlannerError):
                error = InvalidInput(Status.UNSUPPORTED, "case", row["id"], str(error))
            return Entry(
                name, None, error=error, status=f"refused, {error.status.name}", words=str(error)
            )
        return Entry(name, task, status="not planned")

    def _show(self, name: str) -> None:
        """Plan the case of a click again, and show its plan or refusal."""
        if name not in self._rows:
            return
        entry = self._entry(name)
        if entry.task is None:
            self._page.put(entry)
            self._page.choose(name)
        else:
            self._page.plan_by(self._begin(name), entry.task)

    def _begin(self, name: str) -> Callable[..., Running]:
        row = self._rows[name]

        def begin(
            task: PlanningTask, told: Callable[[str], None], done: Callable[[Entry], None]
        ) -> Running:
            def answered(answer: Answer) -> None:
                entry, came = entry_of(name, answer), answer.plan or answer.error
                notes = () if answer.cancelled or came is None else differences(row, came)
                done(replace(entry, words=" ".join((entry.words, *notes))))

            return Search(task, told, answered, method_of(row["planned_by"], task))

        return begin
