"""The tiers of the tests, and how often a law is tried in each; a plugin of every pytest here."""

from __future__ import annotations

import math
import os
import random
import sqlite3
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from evidence import known_ids

from ff_planner_ros.common.process_environment import ONE_THREAD

# Before anything loads the libraries. With a thread a core in each process of the tests, those that
# plan took half as much time again.
os.environ.update(ONE_THREAD)
SEED = 20261123
# Tests without a mark run every day; `@pytest.mark.ci` and `@pytest.mark.nightly` say from which
# tier on a test runs, `@pytest.mark.sampled` that a part of its cases will do but at night.
TIERS = ("everyday", "ci", "nightly")
SAMPLES = {"ci": 1 / 10, "nightly": 1 / 3}  # of the cases; those beyond that run from this tier on
SLOWEST_FILES = 20  # told by the longer tiers, so that growth is seen
MEASURED = 3  # cases of a test whose coverage is measured: others run the same lines
# At night a page is as long as whole files, and the benchmark's longer than all others together.
PAGE = "test/test_typed_commands.py::test_the_commands_of_a_page_do_what_it_shows"
LONGEST_PAGE = f"{PAGE}[benchmark]"

OUTCOMES = ("passed", "skipped", "failed", "error")

_begun = pytest.StashKey[float]()
_left_out = pytest.StashKey[Counter[str]]()
_measured = pytest.StashKey[set[str]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    tiers = "what is run, and how often a law is tried"
    parser.addoption("--tier", choices=TIERS, default=TIERS[0], help=tiers)


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_left_out] = Counter()
    config.stash[_begun] = time.monotonic()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for tier, item in _beyond_the_samples(items):
        item.add_marker(tier)
    longer = TIERS[TIERS.index(config.getoption("tier")) + 1 :]
    later = {
        item: tier for item in items for tier in longer if item.get_closest_marker(tier) is not None
    }
    require_known_laws(items)
    config.stash[_left_out].update(later.values())
    config.hook.pytest_deselected(items=list(later))
    items[:] = [item for item in items if item not in later]
    cases: defaultdict[str, list[str]] = defaultdict(list)
    for item in items:
        cases[item.nodeid.partition("[")[0]].append(item.nodeid)
    config.stash[_measured] = {one for of_one in cases.values() for one in of_one[:MEASURED]}
    if hasattr(config, "workerinput"):
        # What takes longest comes first, then files that start processes: what waits so much must
        # not be what is waited for.
        items.sort(key=lambda one: (one.nodeid != LONGEST_PAGE, not _starts_processes(one.module)))


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any | None:
    """Give a file to one worker, but of the pages of commands each to any."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class LoadFileOrPageScheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return nodeid if nodeid.startswith(PAGE) else super()._split_scope(nodeid)

    return LoadFileOrPageScheduling(config, log)


def _starts_processes(module: ModuleType) -> bool:
    return any(hasattr(module, one) for one in ("connected_client", "subprocess"))


def _beyond_the_samples(items: list[pytest.Item]) -> Iterator[tuple[str, pytest.Item]]:
    """Yield the cases that each tier has more than those before it, drawn by a fixed seed."""
    cases: defaultdict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("nightly"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for of_one in cases.values():
        drawn = random.Random(SEED).sample(of_one, len(of_one))
        drawn.sort(key=lambda one: one.get_closest_marker("ci") is not None)  # slow ones last
        for tier, sample in SAMPLES.items():
            yield from ((tier, item) for item in drawn[math.ceil(len(of_one) * sample) :])


def require_known_laws(items: Iterable[pytest.Item]) -> None:
    """Refuse a test that names a law which laws.yaml does not have."""
    named = {
        law: item.nodeid for item in items for mark in item.iter_markers("law") for law in mark.args
    }
    if unknown := sorted(named.keys() - known_ids()):
        told = ", ".join(f"{law} of {named[law]}" for law in unknown)
        raise pytest.UsageError(f"test/laws.yaml has no law {told}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["left_out"] = dict(session.config.stash[_left_out])


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist: each worker has collected the same
def pytest_testnodedown(node: Any) -> None:
    node.config.stash[_left_out] = Counter(getattr(node, "workeroutput", {}).get("left_out", {}))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say in the longer tiers how long each file takes."""
    tier = config.getoption("tier")
    if tier != TIERS[0]:
        terminalreporter.section(f"slowest {SLOWEST_FILES} files")
        seconds: Counter[str] = Counter()
        for report in chain.from_iterable(terminalreporter.stats.values()):
            if isinstance(report, pytest.TestReport):
                seconds[report.nodeid.partition("::")[0]] += report.duration
        for file, taken in seconds.most_common(SLOWEST_FILES):
            terminalreporter.line(f"{taken:7.1f} s  {file}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Close with what ran, how long it took, and what the longer tiers hold."""
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    if hasattr(config, "workerinput") or config.option.collectonly or not reporter:
        return
    seconds = time.monotonic() - config.stash[_begun]
    ran = (f"{len(reporter.stats.get(kind, ()))} {kind}" for kind in OUTCOMES)
    reporter.section(f"tier {config.getoption('tier')}")
    reporter.line(f"{', '.join(ran)} in {seconds:.0f} s")
    for longer, tests in config.stash[_left_out].items():
        reporter.line(f"{tests} tests more run with --tier {longer}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Measure the coverage of some cases of a test that is not long: tracing doubles the time."""
    coverage: Any = sys.modules.get("coverage")
    measuring = coverage and coverage.Coverage.current()
    long = item.get_closest_marker("ci") or "times" in getattr(item, "fixturenames", ())
    if not measuring or (item.nodeid in item.config.stash[_measured] and not long):
        return (yield)
    with pytest.MonkeyPatch.context() as patch:
        if long:  # the processes that others start may be shared by tests
            patch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)
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


@pytest.fixture(scope="session")
def times(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """Choose how often a law is tried: in CI, a tenth of that every day, and at night."""
    tier = request.config.getoption("tier")

    def chosen(in_ci: int, at_night: int) -> int:
        return {"everyday": math.ceil(in_ci / 10), "ci": in_ci, "nightly": at_night}[tier]

    return chosen
