"""The tests that a change needs, in half a minute; `make quick` runs it.

    .venv/bin/python tools/quick.py [--begun TIME] [FILE ...]

First the tests that changed and those that `test/faults` names for a changed file, then the files
of tests that import it, those with its name and with fewest imports first. None starts a node
unless `ros` changed.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import time
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from faults import AREAS, HERE, PACKAGE, faults_of

LIMIT = 30.0  # from the start of the command [s]
IMPORT = re.compile(r"^\s*(?:from ([\w.]+) import (\([^)]*\)|.*)|import (.*))", re.MULTILINE)


def main() -> int:
    """Run them; exit code 0: of those that had been run after half a minute, none failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", metavar="FILE", help="of the project or the package")
    parser.add_argument("--begun", type=float, default=time.time(), help="start of the command")
    given = parser.parse_args()
    changed = [named(file) for file in given.files] or differing()
    chosen = tests_of(changed)
    print(f"Changed: {', '.join(changed)}\nTests: {', '.join(chosen) or 'none knows of that'}")
    if not chosen:
        return 0
    run = Run(chosen)
    signal.signal(signal.SIGALRM, lambda *_: pytest.exit("cut", 0))
    try:
        signal.setitimer(signal.ITIMER_REAL, max(given.begun + LIMIT - time.time(), 1e-3))
        options = ["-q", "--exitfirst", "--no-header", "--keep-duplicates"]
        code = int(pytest.main([*options, *chosen], [run]))
    except pytest.exit.Exception:  # before pytest began
        code = 0
    if code == pytest.ExitCode.OK and run.left:
        left = Counter(test.partition("::")[0] for test in run.left)
        print(f"CUT after {LIMIT:.0f} s. Left out:", *(f"{left[file]} of {file}" for file in left))
    return 0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else code or int(run.failed)


def named(file: str) -> str:
    """Return the path of a file that exists in the project or in the package."""
    for path in (file, f"{PACKAGE}/{file}"):
        if Path(path).is_file():
            return path
    raise SystemExit(f"there is neither {file} nor {PACKAGE}/{file}")


def differing() -> list[str]:
    """Return what differs from the last commit on main; if nothing does, what that one changed."""
    (base,) = git("merge-base", "HEAD", "main")
    untracked = git("ls-files", "--others", "--exclude-standard")
    if found := git("diff", "--name-only", base) + untracked:
        return sorted(found)
    print("Nothing differs from the last commit on main: these are the tests of that commit.")
    return git("diff", "--name-only", "HEAD~")


def git(*arguments: str) -> list[str]:
    said = subprocess.run(["git", *arguments], capture_output=True, text=True)
    if said.returncode:
        raise SystemExit(f"{said.stderr.strip()}; name files: make quick MODULES=...")
    return said.stdout.splitlines()


def tests_of(changed: list[str]) -> list[str]:
    """Return test files and names of tests, those first of which a failure is likely."""
    own = [file for file in changed if is_test(file) and Path(file).exists()]
    of_faults = [test for file in changed for test in tests_of_faults(file)]
    names = [test for test in of_faults if "::" in test]
    files = {test for file in changed for test in tests_that_know(file)} | {*of_faults} - {*names}
    namesakes = {f"test_{Path(file).stem}" for file in changed}
    by_name = sorted(files)
    least = sorted(by_name, key=lambda one: (Path(one).stem not in namesakes, len(imports_of(one))))
    with_ros = any(file.startswith(f"{PACKAGE}/ros/") for file in changed)
    some = [test for test in (*names, *least) if with_ros or not starts_node(test)]
    return [*dict.fromkeys([*own, *some])]


def tests_of_faults(file: str) -> list[str]:
    """Return the tests, or files of tests, that are to notice the faults of a file."""
    areas = [area for area in AREAS if Path(file).name in text_of(HERE / f"{area}.yaml")]
    faults = [fault for area in areas for fault in faults_of(area)]
    of_file = [one for one in faults if os.path.normpath(f"{PACKAGE}/{one.file}") == file]
    return [f"test/{test.partition('[')[0]}" for one in of_file for test in one.tests.split()]


def tests_that_know(file: str) -> set[str]:
    """Return the tests that import a file, or else what imports it; or else those that name it."""
    sources = [str(path) for top in SOURCES for path in Path(top).rglob("*.py")]
    waiting, seen = {module_of(file)}, set[str]()
    while waiting:
        seen |= waiting
        importing = [source for source in sources if imports_of(source) & waiting]
        if found := set(filter(is_test, importing)):
            return found
        waiting = {module_of(source) for source in importing} - seen
    path = Path(file)
    name = path.stem if path.suffix in {".msg", ".srv", ".action"} else path.name
    name_in = re.compile(rf"\b{re.escape(name)}\b").search
    pages = {"test/test_docs.py"} if path.suffix == ".md" else set()
    return pages | {test for test in filter(is_test, sources) if name_in(text_of(test))}


SOURCES = (PACKAGE, "benchmark", "test", "tools")


def is_test(file: str) -> bool:
    return Path(file).match("test/test_*.py")


def starts_node(test: str) -> bool:
    text = text_of(test.partition("::")[0])
    return "ros_processes" in text and bool(re.search("connected_client|Popen|subprocess", text))


def module_of(file: str) -> str:
    path = Path(file)
    if file.startswith(f"{PACKAGE}/core/") and path.suffix in {".cpp", ".hpp", ".pyi"}:
        return f"{PACKAGE}.core.compiled"
    parts = path.with_suffix("").parts[path.parts[0] in {"benchmark", "test", "tools"} :]
    return ".".join(parts).removesuffix(".__init__")


@cache
def imports_of(source: str) -> frozenset[str]:
    """Return the modules that a file imports, and the names that may be modules."""
    found = set[str]()
    for module, names, modules in IMPORT.findall(text_of(source)):
        found |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))}
        found |= {*re.findall(r"[\w.]+", modules)}
    return frozenset(found - {""})


@cache
def text_of(file: str | Path) -> str:
    return Path(file).read_text("utf-8")


class Run:
    """A plugin of pytest: runs each test once, and knows what is left, whole files at first."""

    def __init__(self, chosen: list[str]) -> None:
        self.left = dict.fromkeys(chosen)
        self.failed = False

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        once = dict[str, pytest.Item]()
        for item in items:
            once.setdefault(item.nodeid, item)
        items[:] = once.values()
        self.left = dict.fromkeys(once)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.left.pop(nodeid, None)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.failed |= report.failed


if __name__ == "__main__":
    raise SystemExit(main())
