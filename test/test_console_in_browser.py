"""The console in a real Chromium: it loads, plans, tells refusals, and cancels."""

from __future__ import annotations

import gc
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from chromium import NEEDS_CHROMIUM, OF_CONTRAST, SMALL
from managed_node import holdings

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.changes import GOAL
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.serve import Served, serve
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task

pytestmark = [pytest.mark.ci, NEEDS_CHROMIUM]
CAPTURE = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
WAIT = 300_000  # as long as a busy machine may take [ms]


class Console:
    """A page that a browser has open."""

    def __init__(self, served: Served, page: Any) -> None:
        self.served, self.page = served, page
        self.errors, self.addresses = list[str](), list[str]()
        page.set_default_timeout(WAIT)
        page.on("console", lambda said: self._heard(said.type, said.text))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("requestfailed", lambda request: self.errors.append(request.url))
        page.on("request", lambda request: self.addresses.append(request.url))
        page.goto(served.address)
        self.button("plan").wait_for(timeout=WAIT)

    def _heard(self, kind: str, text: str) -> None:
        if kind == "error":
            self.errors.append(text)

    def button(self, name: str) -> Any:
        return self.page.get_by_role("button", name=name, exact=True)

    def wait_for(self, words: str) -> None:
        self.page.get_by_text(re.compile(words)).first.wait_for(timeout=WAIT)


@pytest.fixture
def console(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Console]]:
    opened = list[Console]()

    def opened_with(host: str = "127.0.0.1", **changes: Any) -> Console:
        scenario = yaml.safe_load(CAPTURE.read_text("utf-8")) | changes
        scenario["robot"]["urdf"] = str(CAPTURE.parent / scenario["robot"]["urdf"])
        file = tmp_path / "capture.yaml"
        file.write_text(yaml.safe_dump(scenario), "utf-8")
        task = load_task(file, Defaults(load_parameters().planner))
        entry = Entry("capture", task, status="not planned")
        served = serve(lambda server: Page(server, [entry]), host, 8600)
        opened.append(Console(served, browser.new_page(viewport=SMALL)))
        return opened[-1]

    yield opened_with
    for one in opened:
        one.page.close()
        with one.served.page._lock:  # what has ended may still be drawn
            one.served.server.stop()


def test_it_loads_from_this_machine_alone_and_plans(console: Callable[..., Console]) -> None:
    page = console()
    page.wait_for("capture: not planned")
    page.button("plan").click()
    page.wait_for("plan 1: planned")
    page.wait_for("1[.]1072")  # the joint path that the README tells [rad]
    assert page.errors == []
    address = page.served.address.partition("/?")[0]
    inside = ("data:", f"blob:{address}", address)
    assert [one for one in page.addresses if not one.startswith(inside)] == []


def test_the_slider_moves_the_arm_by_the_keyboard(console: Callable[..., Console]) -> None:
    page = console()
    page.button("plan").click()
    page.wait_for("plan 1: planned")
    clip = {"x": 0, "y": 0, "width": 400, "height": 300}
    page.page.wait_for_timeout(1000)
    before = page.page.screenshot(clip=clip)
    page.page.get_by_role("slider").first.focus()
    page.page.keyboard.press("End")
    page.page.wait_for_timeout(1000)
    assert page.served.page._time.value == pytest.approx(10.0)
    assert page.page.screenshot(clip=clip) != before


def test_a_goal_moved_by_numbers_is_planned_for(console: Callable[..., Console]) -> None:
    page = console()
    inputs = page.page.locator("input")

    def showing(value: str) -> Any:
        is_there = "value => [...document.querySelectorAll('input')].some(x => x.value === value)"
        page.page.wait_for_function(is_there, arg=value)
        count = inputs.count()
        return next(one for k in range(count) if (one := inputs.nth(k)).input_value() == value)

    showing("nothing").click()
    page.page.get_by_role("option", name="goal", exact=True).click()
    x = showing("1.7")
    x.fill("1.68")
    x.press("Enter")
    page.wait_for("changed: not planned yet")
    page.button("plan").click()
    page.wait_for("plan 1: planned")
    shown = page.served.page.chosen.plan
    assert shown is not None
    assert shown.trajectory.ee_positions[-1] == pytest.approx([1.68, 0.4, 0.6], abs=1e-5)
    assert page.errors == []


def test_a_refusal_is_told_in_words_and_marked(console: Callable[..., Console]) -> None:
    far = {"position": [30.0, 0.0, 0.0], "euler_xyz_deg": [0.0, 0.0, 0.0]}
    page = console(target=far)
    page.button("plan").click()
    page.wait_for("plan 1: refused, GOAL_OUT_OF_REACH")
    page.wait_for("marked in the scene: (.* from the goal|goal out of reach)")
    assert page.errors == []


def test_a_search_can_be_cancelled(console: Callable[..., Console]) -> None:
    page = console(duration=0.5, planner={"starts": 1_000})
    page.button("plan").click()
    page.wait_for("no plan yet")
    page.button("cancel").click()
    page.wait_for("plan 1: cancelled")
    assert page.errors == []
    assert page.button("plan").is_enabled()


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_address_needs_its_token(
    console: Callable[..., Console], browser: Any, host: str
) -> None:
    page = console(host=host)
    page.wait_for("capture: not planned")
    stranger = browser.new_context().new_page()
    answer = stranger.goto(page.served.address.partition("?")[0])
    assert answer.status == 403
    stranger.context.close()


def test_all_words_of_the_page_have_contrast(console: Callable[..., Console]) -> None:
    page = console()
    page.button("plan").click()
    page.wait_for("plan 1: planned")
    assert page.page.evaluate(OF_CONTRAST) == []
    # It finds what is too pale.
    page.page.evaluate("document.querySelector('.ff b').style.color = '#999999'")
    assert page.page.evaluate(OF_CONTRAST) != []


def test_everything_is_done_by_the_keyboard(console: Callable[..., Console]) -> None:
    page = console()

    def focused() -> str:
        one = "document.activeElement"
        return str(page.page.evaluate(f"{one}.innerText || {one}.value || ''"))

    def tab_to(words: str) -> None:
        for _ in range(200):  # the way begins anew where the table is drawn meanwhile
            page.page.keyboard.press("Tab")
            if focused() == words:
                return
        raise AssertionError(f"no way to {words} by the keyboard")

    tab_to("plan")
    page.page.keyboard.press("Enter")
    page.wait_for("plan 1: planned")
    tab_to("plan 1")
    marked = page.page.locator("[data-combobox-selected]")
    for _ in range(1_000):  # while the list opens, a key may mark another plan: press again
        page.page.keyboard.press("ArrowUp")
        if marked.all_inner_texts() == ["capture"]:
            page.page.keyboard.press("Enter")
            if page.served.page.chosen.name == "capture":
                break
    page.wait_for("^capture: not planned")
    page.page.wait_for_function("document.querySelector('.ff b').innerText.startsWith('capture')")
    assert page.served.page.chosen.name == "capture"
    assert page.errors == []


@pytest.mark.nightly
def test_longer_use_does_not_grow(console: Callable[..., Console]) -> None:
    """Of the server's memory, what is kept for the browser; of the browser, its own."""
    page = console()
    page.button("plan").click()
    page.wait_for("plan 1: planned")
    shown, place = page.served.page, np.array([1.7, 0.4, 0.6])

    def use(rounds: int) -> tuple[int, int, int]:
        for number in range(rounds):
            for name in ("capture", "plan 1"):
                shown.choose(name)
                for step in range(10):
                    shown.go_to(step)
            shown.move(GOAL, place + 1e-3 * (number % 5), None)
        # Through the queue: what was sent before has been drawn.
        page.page.wait_for_timeout(1_000)
        gc.collect()
        page.page.evaluate("window.gc && window.gc()")
        heap = page.page.evaluate("performance.memory.usedJSHeapSize")
        messages = len(shown._server._websock_server._broadcast_buffer.message_from_id)
        return holdings(os.getpid()).memory, messages, int(heap)

    use(5)
    memory, messages, heap = use(5)
    after, more, later = use(40)
    assert more <= messages + 5
    assert after - memory < 5_000  # [kB]
    assert later - heap < 10_000_000  # [bytes]
