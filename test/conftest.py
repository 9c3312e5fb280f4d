"""What the tests share: robots, a plan, the order of the files, how often a law is tried."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
import robots

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text

# The files that take longest begin first, so that the workers end at about the same time.
LONGEST_FIRST = (
    "test_demo",
    "test_examples",
    "test_any_file",
    "test_node_hard_life",
    "test_node_robustness",
    "test_node_lifecycle",
    "test_node",
    "test_replay",
    "test_node_recording",
    "test_node_action",
    "test_rollout",
    "test_publish",
    "test_planner",
    "test_verify",
    "test_node_answers",
    "test_recorder_killed",
    "test_bench_success",
    "test_bench_report",
    "test_forward",
    "test_compare",
    "test_worker",
    "test_node_refusals",
)

# They repeat at length what other files run, too: coverage, whose tracing takes time, leaves them
# and the processes that they start out.
NOT_MEASURED = (
    "test_any_file",
    "test_bag_fuzz",
    "test_bag_without_ros",
    "test_bench_success",
    "test_demo",
    "test_docs",
    "test_dynamics",
    "test_examples",
    "test_foreign_readers",
    "test_forward",
    "test_interoperation",
    "test_model_errors",
    "test_node_action",
    "test_node_answers",
    "test_node_hard_life",
    "test_node_lifecycle",
    "test_node_refusals",
    "test_node_robustness",
    "test_planner",
    "test_planner_determinism",
    "test_publish",
    "test_recorder_killed",
    "test_rollout",
    "test_urdf_fuzz",
    "test_without_ros",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--nightly", action="store_true", help="try each law as often as it deserves")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {name: number for number, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    coverage: Any = sys.modules.get("coverage")
    measuring = coverage and coverage.Coverage.current()
    if not measuring or item.path.stem not in NOT_MEASURED:
        return (yield)
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)  # for the processes it starts
        measuring.stop()
        try:
            return (yield)
        finally:
            measuring.start()


@pytest.hookimpl(wrapper=True, trylast=True)  # pytest-cov combines right after it
def pytest_runtestloop(session: pytest.Session) -> Generator[None, Any, Any]:
    result = yield
    if session.config.pluginmanager.hasplugin("_cov") and not hasattr(
        session.config, "workerinput"
    ):
        for file in session.config.rootpath.glob(".coverage.*"):
            discard_if_torn(file)
    return result


def discard_if_torn(file: Path) -> None:
    """Delete the coverage data of a process that was killed while it wrote them.

    Combining would stop at them, after all tests have passed.
    """
    from coverage import CoverageData, CoverageException

    try:
        CoverageData(no_disk=True).update(CoverageData(str(file), read_only=True))
    except (CoverageException, sqlite3.Error) as error:
        print(f"{file.name} is left out of the coverage: {error}")
        file.unlink()


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker one file after the other, in the order of the collection."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


@pytest.fixture(scope="session")
def times(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """Choose how often a law is tried: usually, and in the nightly run."""
    nightly = request.config.getoption("nightly")
    return lambda usually, at_night: at_night if nightly else usually


@pytest.fixture(scope="session")
def lemur() -> Robot:
    """The paper's chaser and arm."""
    return load_robot(robots.LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.LINES)


@pytest.fixture(scope="session", params=list(robots.ROBOTS))
def robot(request: pytest.FixtureRequest) -> Robot:
    """One robot after the other: what holds for any robot."""
    return robot_from_urdf_text(*robots.ROBOTS[request.param])


@pytest.fixture(scope="session")
def lemur_capture() -> PlanningProblem:
    """The paper's capture."""
    return load_scenario(robots.LEMUR_SCENARIO)


@pytest.fixture(scope="session")
def lemur_plan(lemur_capture: PlanningProblem) -> Plan:
    """The paper's capture on the shortest joint path."""
    return plan(lemur_capture, load_parameters().planner)
