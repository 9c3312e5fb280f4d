"""The console of a running node in a real Chromium: plan, two clicks to release, a lost node."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from typing import Any

import pytest
from chromium import NEEDS_CHROMIUM, OF_CONTRAST, SMALL
from live_console import (
    ARGUMENTS,
    Console,
    World,
    ask_for_the_capture,
    opened_console,
    wait_for,
)
from ros_processes import PlannerProcess, connected_client, private_domain, running_planner

pytestmark = [pytest.mark.ci, NEEDS_CHROMIUM]
WAIT = 300_000  # [ms]


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    directory = tmp_path_factory.mktemp("in_browser")
    with private_domain(), running_planner(directory, *ARGUMENTS) as planner:
        yield planner


@pytest.fixture(scope="module")
def console(planner: PlannerProcess) -> Iterator[Console]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        World(client)
        with opened_console() as console:
            ask_for_the_capture(console)
            yield console


@pytest.fixture(scope="module")
def pages(console: Console, browser: Any) -> list[Any]:
    """Two browsers' pages of one console."""
    opened = [browser.new_context(viewport=SMALL).new_page() for _ in range(2)]
    for page in opened:
        page.set_default_timeout(WAIT)
        page.goto(console.served.address)
        button(page, "plan").wait_for(timeout=WAIT)
    return opened


def button(page: Any, name: str) -> Any:
    return page.get_by_role("button", name=name, exact=True)


def wait_for_words(page: Any, words: str) -> None:
    page.get_by_text(re.compile(words)).first.wait_for(timeout=WAIT)


def test_a_plan_is_released_by_the_second_click_and_both_browsers_see_it(
    console: Console, pages: list[Any]
) -> None:
    first, second = pages
    assert button(first, "release").is_disabled()
    button(first, "plan").click()
    for page in pages:
        wait_for_words(page, "plan 1 waits for approval: made [0-9.]+ s ago")
        wait_for_words(page, "the node would publish it now")
    assert first.evaluate(OF_CONTRAST) == []
    button(first, "release").dblclick()  # the second click of two in a hurry hits nothing
    for page in pages:
        button(page, "yes, release plan 1").wait_for(timeout=WAIT)
    assert console.status("plan 1") == "waits for approval"
    button(second, "no").click()
    button(first, "yes, release plan 1").wait_for(state="hidden", timeout=WAIT)
    button(first, "release").click()
    button(second, "yes, release plan 1").click()
    for page in pages:
        wait_for_words(page, "is published, ff-planner console asked for it")
        wait_for_words(page, "plan 1: published by ff-planner console")
        off = page.get_by_role("button", name="release", exact=True, disabled=True)
        off.wait_for(timeout=WAIT)


def test_a_lost_node_is_told(planner: PlannerProcess, console: Console, pages: list[Any]) -> None:
    """The last test: it ends the node."""
    planner.stop(signal.SIGKILL)
    for page in pages:
        wait_for_words(page, "LOST: nothing was heard from /ff_planner for [0-9]+ s; waiting")
    button(pages[0], "plan").click()
    wait_for(lambda: console.page.chosen.status == "refused, NOT_ACTIVE", "the refusal")
    wait_for_words(pages[0], "not planned: refused, NOT_ACTIVE")
