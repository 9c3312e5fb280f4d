"""The console in a real Chromium: it loads, plans, tells refusals, and cancels."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.serve import Served, serve
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task

playwright = pytest.importorskip(
    "playwright.sync_api", reason="no playwright: pip install playwright"
)
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.ci,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
]
CAPTURE = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
# Where a machine has no graphics, WebGL by software.
OPTIONS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
]
WAIT = 60_000  # [ms]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield chromium
        chromium.close()


class Console:
    """A page that a browser has open."""

    def __init__(self, served: Served, page: Any) -> None:
        self.served, self.page = served, page
        self.errors, self.addresses = list[str](), list[str]()
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
        opened.append(Console(served, browser.new_page()))
        return opened[-1]

    yield opened_with
    for one in opened:
        one.page.close()
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
    clip = {"x": 0, "y": 200, "width": 800, "height": 500}
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
        page.page.wait_for_timeout(500)
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
