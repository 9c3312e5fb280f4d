"""Panel of a running node: its state, the plan that runs, release and rejection of others."""

from __future__ import annotations

import html
import threading

import numpy as np
import viser

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.console.colours import STYLE
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.link import Link
from ff_planner_ros.console.live.measured import MeasuredRobot
from ff_planner_ros.console.live.plans import WAITS, Fit, Plans, fit_of
from ff_planner_ros.console.page import Page
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.parameters.published_plans import TrackingParameters
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.outputs.prediction import deviations, too_far
from ff_planner_ros.ros.requests.reading import measured_state

_RELEASE, _REJECT = "release", "reject"
_MEANS = {
    _RELEASE: "The node sends {} to the controller, and the arm will move.",
    _REJECT: "The node drops {}: nobody can release it any more.",
}
_DONE = {_RELEASE: "released", _REJECT: "rejected"}


class NodePanel:
    """Shows the state of a node and of its plans; `look` has to be called again and again."""

    def __init__(
        self, server: viser.ViserServer, page: Page, link: Link, plans: Plans, lead: float
    ) -> None:
        """Build the controls.

        Args:
            lead: Initial time from a request to the start of its plan [s].
        """
        self._page, self._link, self._plans = page, link, plans
        self._measured = MeasuredRobot(server, link.robot)
        self._lock = threading.RLock()
        self._asked_twice: tuple[str, Entry] | None = None  # what, of which: after the first click
        gui = server.gui
        with gui.add_folder("Node", order=-1):
            self._state = gui.add_html("")
            most = link.parameters.start_horizon
            hint = "how long after the request the plan begins: time to look at it is part of that"
            self.lead = gui.add_number(
                "start after [s]", lead, min=0.0, max=most, step=1.0, hint=hint
            )
            self._follow = gui.add_checkbox("follow the plan that runs", True)
            self._fit = gui.add_html("")
            self._release = gui.add_button(_RELEASE, disabled=True)
            self._reject = gui.add_button(_REJECT, disabled=True)
            self._means = gui.add_html("", visible=False)
            self._yes = gui.add_button("yes", visible=False)
            self._no = gui.add_button("no", visible=False)
            self._said = gui.add_html("")
            self._deviations = gui.add_html("")
        self._release.on_click(lambda _: self.first_click(_RELEASE))
        self._reject.on_click(lambda _: self.first_click(_REJECT))
        self._yes.on_click(lambda _: self.second_click())
        self._no.on_click(lambda _: self._ask_twice(None))

    def first_click(self, what: str) -> None:
        """Ask to confirm the release, or the rejection, of the plan that is shown."""
        with self._lock:
            if self._plans.waiting(self._page.chosen) is not None:
                self._ask_twice((what, self._page.chosen))

    def second_click(self) -> None:
        """Release or reject the confirmed plan if it still waits, and show the node's answer."""
        with self._lock:
            asked = self._asked_twice
            self._ask_twice(None)
            made = None if asked is None else self._plans.waiting(asked[1])
            if asked is None or made is None:
                return
            what, entry = asked
            rejects = what == _REJECT
            try:
                status, words = self._link.release(made.plan_id, rejects)
            except FfPlannerError as error:
                status, words = error.status, str(error)
            if status is not Status.SOLVED:
                self._say(f"{entry.name} is not {_DONE[what]}: {status.name}: {words}", "bad")
                return
            if rejects:
                self._plans.reject(made.plan_id)
            self._say(f"{entry.name}: {words}")

    def look(self) -> None:
        """Update all that the panel shows."""
        with self._lock:
            link, entry = self._link, self._page.chosen
            asked = self._asked_twice
            if asked is not None and self._plans.waiting(asked[1]) is None:
                self._ask_twice(None)  # another has released it
            if asked is not None and asked[1].plan_id != entry.plan_id:
                self._ask_twice(None)
            lost, measured = link.lost, self._snapshot()
            words = [_line(lost or f"{link.name} is heard", "bad" if lost else "good")]
            if link.other_robot:
                words.append(_line(link.other_robot, "bad"))
            if isinstance(measured, FfPlannerError):
                self._measured.hide()
                words.append(_line(str(measured), "bad"))
            else:
                robot = link.robot
                self._measured.place(configuration(robot, measured.state)[0])
                age = (link.now_ns() - measured.stamp_ns) / NANOSECONDS
                words.append(_line(f"state {max(age, 0.0):.2f} s old, drawn in green"))
                words += self._running(measured)
            words += [_line(f"{part}: {said}", "bad") for part, said in link.warnings.items()]
            self._show_waiting(entry, bool(lost))
            _show(self._state, "".join(words))

    def _snapshot(self) -> Snapshot | FfPlannerError:
        try:
            return measured_state((), self._link.knowledge)
        except FfPlannerError as error:
            return error

    def _running(self, measured: Snapshot) -> list[str]:
        """Return lines on plans that run or will, and show one at its time if it is followed."""
        last, now_ns = self._link.published, self._link.now_ns()
        if last is None:
            return []
        until = (last.start_ns - now_ns) / NANOSECONDS
        words = f"{self._plans.name_of(last.plan_id)} begins in {until:.1f} s"
        coming = [_line(words)] if until > 0.0 else []
        running = last.at(now_ns)
        if running is None:
            return coming
        name = self._plans.name_of(running.plan_id)
        time = (now_ns - running.start_ns) / NANOSECONDS
        shown = self._page.chosen
        if self._follow.value and shown.plan_id == running.plan_id:
            self._page.go_to(time)
        words = f"{name} runs: {time:.1f} s of {running.trajectory.time[-1]:.1f} s"
        if not np.isfinite(running.trajectory.chaser_positions).all():
            return [_line(words), *coming]  # what the plan has the chaser do was not heard
        since = (measured.stamp_ns - running.start_ns) / NANOSECONDS
        robot, allowed = self._link.knowledge.robot, self._link.parameters.tracking
        found = deviations(measured.state, running.trajectory, since, robot)
        if not found:
            return [_line(words), *coming]
        position, angle = (one.amount for one in found[:2])
        kind = "bad" if too_far(found, allowed) else "good"
        off = f"chaser {position * 1e3:.2f} mm, {angle:.5f} rad from it"
        return [_line(f"{words}; {off}", kind), *coming]

    def _show_waiting(self, entry: Entry, is_lost: bool) -> None:
        made = self._plans.waiting(entry)
        self._release.disabled = made is None or is_lost
        self._reject.disabled = made is None
        if made is None:
            _show(self._fit, "")
            _show(self._deviations, "")
            return
        parameters = self._link.parameters
        fit = fit_of(made, self._link.knowledge)
        _show(self._fit, _of_fit(entry.name, fit, parameters.publication.max_age))
        _show(self._deviations, _of_deviations(fit, parameters.tracking))

    def _ask_twice(self, what: tuple[str, Entry] | None) -> None:
        self._asked_twice = what
        for one in (self._means, self._yes, self._no):
            one.visible = what is not None
        if what is not None:
            doing, entry = what
            self._yes.label = f"yes, {doing} {entry.name}"
            _show(self._means, _line(_MEANS[doing].format(entry.name), "bad"))

    def _say(self, words: str, kind: str = "good") -> None:
        _show(self._said, _line(words, kind))


def _of_fit(name: str, fit: Fit, most: float) -> str:
    """Return in HTML whether the node would publish a waiting plan now."""
    words = [
        _line(
            f"{name} {WAITS}: made {fit.age:.1f} s ago (at most {most:g} s), "
            + (
                f"begins in {fit.until_start:.1f} s"
                if fit.until_start > 0.0
                else "its start is over"
            )
        )
    ]
    if fit.refusal:
        words.append(_line(f"The node would refuse it now. {fit.refusal}", "bad"))
    else:
        words.append(_line("By what is heard here, the node would publish it now.", "good"))
    return "".join(words)


def _of_deviations(fit: Fit, allowed: TrackingParameters) -> str:
    """Return the deviations of the system from a plan's first point, in HTML."""
    rows = [
        f"<tr><td>{html.escape(one.what)}</td><td>{one.amount:.4f}</td>"
        f"<td>{getattr(allowed, one.tolerance):g}</td><td>{one.unit}</td>"
        f"<td class='{'bad' if one.words(allowed) else 'good'}'>"
        f"{'MOVED' if one.words(allowed) else 'fits'}</td></tr>"
        for one in fit.deviations
    ]
    head = "<tr><th>at its start</th><th>deviation</th><th>allowed</th><th></th><th></th></tr>"
    return f"<table>{head}{''.join(rows)}</table>" if rows else ""


def _line(words: str, kind: str = "") -> str:
    return f"<p class='{kind}'>{html.escape(words)}</p>"


def _show(handle: viser.GuiHtmlHandle, words: str) -> None:
    """Set an element's words if they differ from those shown: nothing is sent in vain."""
    content = f"{STYLE}<div class='ff'>{words}</div>" if words else ""
    if handle.content != content:
        handle.content = content
