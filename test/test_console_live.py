"""The console on a running node: what waits, two consoles, release, reject, cancel, a lost node."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_console import (
    AGE,
    ARGUMENTS,
    LEAD,
    SCENE,
    Console,
    World,
    ask_for_the_capture,
    opened_console,
    wait_for,
)
from ros_processes import (
    DEADLINE,
    PlannerProcess,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.console.changes import lasting_for
from ff_planner_ros.console.live.open import live_page
from ff_planner_ros.console.live.plans import WAITS, fit_of
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    with private_domain(), running_planner(tmp_path_factory.mktemp("live"), *ARGUMENTS) as planner:
        yield planner


@pytest.fixture(scope="module")
def world(planner: PlannerProcess) -> Iterator[World]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        yield World(client)


@pytest.fixture(scope="module")
def console(world: World) -> Iterator[Console]:  # noqa: ARG001 (it must publish)
    with opened_console() as console:
        ask_for_the_capture(console)
        yield console


@pytest.fixture(scope="module")
def other(console: Console) -> Iterator[Console]:  # noqa: ARG001 (the first one)
    with opened_console() as other:
        yield other


def stamp_of_state(console: Console) -> int:
    """When the newest state that a console has heard was measured [ns]; the node hears the same."""
    knowledge = console.live._link.knowledge
    return knowledge.states.snapshot(knowledge.now_ns, AGE, AGE).stamp_ns


def heard(world: World, plan_id: str) -> bool:
    return any(one.plan_id == plan_id for one in world.client.received["published_plan"])


def test_the_goal_begins_where_the_end_effector_is_measured(console: Console) -> None:
    first = console.page.entries[0].task
    assert first is not None
    start = first.problem.start
    assert start.joint_positions == pytest.approx(SCENE.problem.start.joint_positions)
    assert {one.id for one in first.problem.obstacles} == {
        one.id for one in SCENE.problem.obstacles
    }


def test_a_plan_waits_until_it_is_released_by_two_clicks_and_all_consoles_see_it(
    console: Console, other: Console, world: World
) -> None:
    entry = console.plan()
    assert entry.status == WAITS, entry.words
    assert entry.plan is not None
    place = entry.plan.trajectory.ee_positions[-1]
    assert entry.plan.trajectory.time[-1] >= SCENE.problem.duration
    goal = int(np.abs(entry.plan.trajectory.time - SCENE.problem.duration).argmin())
    place = entry.plan.trajectory.ee_positions[goal]
    assert place == pytest.approx(SCENE.problem.target.position, abs=1e-3)
    wait_for(lambda: console.shows("the node would publish it now"), "the plan's fit")
    wait_for(lambda: other.status(entry.name) == WAITS, "the plan in the other console")
    same = other.entry(entry.name)
    assert same is not None
    assert same.plan is not None
    assert np.array_equal(
        same.plan.trajectory.joint_positions, entry.plan.trajectory.joint_positions
    )
    assert other.live._plans.waiting(same) is not None
    # One click alone does nothing, and another plan disarms the second.
    console.panel.first_click("release")
    console.page.choose("goal")
    console.panel.look()
    console.panel.second_click()
    assert not heard(world, entry.plan_id)
    console.page.choose(entry.name)
    console.panel.second_click()
    assert not heard(world, entry.plan_id)
    console.panel.first_click("release")
    console.panel.second_click()
    assert console.shows("is published, ff-planner console asked for it")
    for one in (console, other):
        wait_for(lambda one=one: "published by" in one.status(entry.name), "the publication")
        assert one.status(entry.name) == "published by ff-planner console"
        assert one.live._plans.waiting(one.entry(entry.name)) is None
    wait_for(lambda: heard(world, entry.plan_id), "the plan on its topic")


def test_a_plan_whose_start_the_system_has_left_is_refused_in_the_nodes_words(
    console: Console, world: World
) -> None:
    entry = console.plan()
    assert entry.status == WAITS, entry.words
    made = console.live._plans.waiting(entry)
    assert made is not None
    world.aside = 0.05
    try:
        wait_for(lambda: console.shows("MOVED"), "the mark of what has moved")
        moved_ns = world.client.now_ns()
        wait_for(lambda: stamp_of_state(console) > moved_ns + NANOSECONDS, "ten more states")
        refusal = fit_of(made, console.live._link.knowledge).refusal
        assert "position by 0.05 m, more than tracking.max_position, 0.02 m" in refusal
        status, words = console.live._link.release(made.plan_id)
        assert status is Status.STATE_MOVED
        assert refusal == f"{status.name}: {words}"
        console.panel.first_click("release")
        console.panel.second_click()
        assert console.shows("is not released: STATE_MOVED: ")
    finally:
        world.aside = 0.0
    assert not heard(world, entry.plan_id)


def test_a_joint_that_is_measured_elsewhere_than_the_model_fixes_it_is_told_as_the_node_tells_it(
    console: Console, world: World
) -> None:
    elsewhere = "chaser_state.joint_positions[end_effector_mount] is 0.4 rad"
    back_ns = world.client.now_ns()  # from where the test before had the chaser
    wait_for(lambda: stamp_of_state(console) > back_ns + NANOSECONDS, "ten more states")
    entry = console.plan()
    assert entry.status == WAITS, entry.words
    made = console.live._plans.waiting(entry)
    assert made is not None
    world.mount = 0.4
    try:
        wait_for(lambda: elsewhere in console.panel._state.content, "the refusal of the state")
        assert not console.panel._measured._above.visible
        moved_ns = world.client.now_ns()
        wait_for(lambda: world.client.now_ns() > moved_ns + NANOSECONDS, "ten more states")
        status, words = console.live._link.release(made.plan_id)
        assert status is Status.START_OUTSIDE_LIMITS
        assert elsewhere in words
    finally:
        world.mount = 0.0
    wait_for(lambda: console.shows("drawn in green"), "the state")


def test_a_rejected_plan_cannot_be_released_any_more(console: Console, world: World) -> None:
    entry = console.plan()
    made = console.live._plans.waiting(entry)
    assert made is not None
    console.panel.first_click("reject")
    console.panel.second_click()
    assert console.status(entry.name) == "rejected"
    console.panel.first_click("release")
    console.panel.second_click()
    assert console.live._plans.waiting(console.page.chosen) is None
    status, _ = console.live._link.release(made.plan_id)
    assert status is Status.UNKNOWN_PLAN, "the node has dropped it"
    assert not heard(world, entry.plan_id)


def test_a_plan_that_another_client_asks_for_is_released_here_too(
    console: Console, world: World
) -> None:
    request = SCENE.request()
    request.plan_only, request.requester = True, "executive"
    answer = world.client.plan(request)
    assert answer.status.code == Status.SOLVED, answer.status
    name = f"plan {answer.plan_id.rpartition('.')[2]}"
    wait_for(lambda: console.status(name) == WAITS, "the plan of another")
    console.page.choose(name)
    console.panel.look()
    assert not console.panel._release.disabled
    console.panel.first_click("release")
    console.panel.second_click()
    wait_for(lambda: "published" in console.status(name), "the publication")


def test_a_search_tells_its_progress_and_is_cancelled(
    planner: PlannerProcess, console: Console
) -> None:
    console.page.choose("goal")
    ask_for_the_capture(console)
    task = console.page.task
    assert task is not None
    # With so many points a search in vain takes long.
    task = replace(task, problem=replace(task.problem, points=2000))
    console.page.change(lasting_for(task, 0.6, 0.6))
    console.page.plan()
    try:
        wait_for(lambda: "no plan yet" in console.page._progress.content, "the progress")
        # Stopped, it does not end however late a busy machine cancels it.
        planner.send_to_solvers(signal.SIGSTOP)
        console.page.cancel()
        while console.page.search is not None:
            console.page.search.wait()
    finally:
        planner.send_to_solvers(signal.SIGCONT)
    assert console.page.chosen.status == "refused, CANCELLED", console.page.chosen.words


def test_a_plan_runs_beside_the_measured_chaser(console: Console, other: Console) -> None:
    console.page.choose("goal")
    ask_for_the_capture(console)
    console.panel.lead.value = 20.0
    entry = console.plan()
    assert entry.status == WAITS, entry.words
    console.panel.first_click("release")
    console.panel.second_click()
    wait_for(lambda: other.shows(f"{entry.name} begins in "), "the time to its start")
    for one in (console, other):
        wait_for(lambda one=one: one.status(entry.name) == "runs", "the start")
    wait_for(lambda: not other.shows(f"{entry.name} begins in "), "its end")
    wait_for(lambda: console.shows(f"{entry.name} runs: "), "words on it")
    wait_for(lambda: float(console.page._time.value) > 1.0, "the slider that follows it")
    assert console.panel._measured._above is not None
    # The chaser stands still: that is told, too.
    wait_for(lambda: console.shows("chaser "), "the deviation")
    console.panel.lead.value = LEAD


def test_an_answer_that_is_lost_is_asked_for_again(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, asked = console.live._link, []
    read = link._parameters

    def lost_at_first(patience: float) -> Any:
        asked.append(patience)
        if len(asked) == 1:
            raise FfPlannerError(Status.NOT_ACTIVE, "/ff_planner did not answer within 5 s")
        return read(patience)

    monkeypatch.setattr(link, "_parameters", lost_at_first)
    link._changed.set()
    wait_for(lambda: len(asked) > 1, "the second question")


def test_who_is_not_there_is_told_so() -> None:
    with pytest.raises(InvalidInput, match="/nobody/get_parameters: no node offers it within"):
        live_page("nobody", None, 0.5, [])


def test_a_scenario_that_cannot_be_read_is_refused_before_a_page_is_served(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"none\.yaml: it cannot be read"):
        live_page("nobody", tmp_path / "none.yaml", 0.5, [])


@pytest.mark.nightly
def test_a_lost_node_is_told_and_found_again(
    planner: PlannerProcess, world: World, console: Console, tmp_path_factory: Any
) -> None:
    """The last test: it ends the node."""
    entry = console.plan()
    assert entry.status == WAITS, entry.words
    planner.stop(signal.SIGKILL)
    wait_for(lambda: console.shows("LOST: nothing was heard from /ff_planner"), "the loss")
    assert console.panel._release.disabled
    made = console.live._plans.waiting(entry)
    assert made is not None
    with pytest.raises(FfPlannerError, match="LOST"):
        console.live._link.release(made.plan_id)
    lost = console.plan()
    assert lost.status == "refused, NOT_ACTIVE"
    with running_planner(tmp_path_factory.mktemp("again"), *ARGUMENTS):
        wait_for(lambda: console.shows("/ff_planner is heard"), "the node that came back")
        world.client.publish_obstacles(SCENE.obstacles())
        console.page.choose(entry.name)
        console.panel.look()
        # The new node knows nothing of the plan.
        status, words = console.live._link.release(made.plan_id)
        assert status is Status.UNKNOWN_PLAN, words
        tried = [console.plan()]
        while tried[-1].status == "refused, NO_STATE":  # which the new node has not heard yet
            assert len(tried) < DEADLINE
            tried.append(console.plan())
        assert tried[-1].status == WAITS, tried[-1].words
        assert tried[-1].name == f"plan {len(tried)} of start 2"
