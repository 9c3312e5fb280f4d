"""The table from promises to the tests that provoke them: docs/reference/evidence.md.

Promises, called laws, are in laws.yaml; a test names those that it provokes by
`@pytest.mark.law("PLAN-03")`. Run as a script, it writes the page. Run with JUnit files of pytest
as arguments, it first keeps what they say of these tests in docs/evidence.json.
"""

from __future__ import annotations

import ast
import json
import platform
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import yaml

SOURCE_TREE = Path(__file__).resolve().parents[1]
LAWS = SOURCE_TREE / "test" / "laws.yaml"
DOCS = SOURCE_TREE / "docs"
PAGE = DOCS / "reference" / "evidence.md"
RESULTS = DOCS / "evidence.json"
TIERS = ("nightly", "ci")
BLOCK = re.compile(r"(<!-- evidence: (\w+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


class Law(NamedTuple):
    """A promise, the page below docs/ that explains it, and what shows it without a test."""

    promise: str
    page: str
    shown_by: str = ""


class Test(NamedTuple):
    """A test that provokes laws, and from which tier on all of its cases run."""

    file: str
    name: str
    laws: tuple[str, ...]
    tier: str


@cache
def laws() -> dict[str, dict[str, Law]]:
    """Return the laws by their ids, in their sections."""
    read: dict[str, dict[str, list[str]]] = yaml.safe_load(LAWS.read_text(encoding="utf-8"))
    return {title: {id_: Law(*law) for id_, law in of.items()} for title, of in read.items()}


@cache
def known_ids() -> frozenset[str]:
    """Return the id of each law."""
    return frozenset(id_ for section in laws().values() for id_ in section)


@cache
def provoking_tests() -> tuple[Test, ...]:
    """Return every test that names a law, as the sources have them."""
    files = sorted([*SOURCE_TREE.glob("test/test_*.py"), *SOURCE_TREE.glob("benchmark/test/*.py")])
    return tuple(test for file in files for test in _tests_of(file))


def _tests_of(file: Path) -> Iterator[Test]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    of_all = [
        _mark(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            marks = [_mark(decorator) for decorator in node.decorator_list] + of_all
            named = tuple(law for name, arguments in marks if name == "law" for law in arguments)
            if named:
                tiers = [tier for tier in TIERS if tier in (name for name, _ in marks)]
                path = str(file.relative_to(SOURCE_TREE))
                yield Test(path, node.name, named, tiers[0] if tiers else "everyday")


def _mark(node: ast.expr) -> tuple[str, list[str]]:
    """Return name and arguments of `pytest.mark.NAME(...)`."""
    called, arguments = (node.func, node.args) if isinstance(node, ast.Call) else (node, [])
    name = ast.unparse(called)
    if not name.startswith("pytest.mark."):
        return "", []
    return name.rpartition(".")[2], [str(a.value) for a in arguments if isinstance(a, ast.Constant)]


@cache
def faults() -> Counter[str]:
    """Count the faults of test/faults that `make mutants` puts in for a test to notice."""
    listed = Counter[str]()
    for file in sorted((SOURCE_TREE / "test" / "faults").glob("*.yaml")):
        for fault in yaml.safe_load(file.read_text(encoding="utf-8")):
            if "survives" not in fault:
                listed.update({test.partition("[")[0] for test in fault["tests"].split()})
    return listed


def results_of(reports: Iterable[Path]) -> dict[str, dict[str, int]]:
    """Return how often each test passed, failed and was skipped, of JUnit files."""
    found: dict[str, Counter[str]] = {}
    for report in reports:
        for case in ElementTree.parse(report).iter("testcase"):
            outcome = "passed"
            for child in case:
                outcome = {"skipped": "skipped", "failure": "failed", "error": "failed"}.get(
                    child.tag, outcome
                )
            file = case.get("classname", "").replace(".", "/") + ".py"
            name = case.get("name", "").partition("[")[0]
            found.setdefault(f"{file}::{name}", Counter())[outcome] += 1
    named = {f"{test.file}::{test.name}" for test in provoking_tests()}
    return {name: dict(found[name]) for name in sorted(named & found.keys())}


@cache
def last_run() -> dict[str, Any]:
    """Return what docs/evidence.json holds: the run and the result of each test."""
    if not RESULTS.is_file():
        return {"run": {}, "tests": {}}
    return dict(json.loads(RESULTS.read_text(encoding="utf-8")))


def run() -> str:
    """Say which run the results are of, and what has no test."""
    told = last_run()["run"]
    proven = {law for test in provoking_tests() for law in test.laws}
    missing = sorted(known_ids() - proven)
    counted = f"{len(known_ids())} laws, {len(provoking_tests())} tests that provoke them."
    without = f"Without a test: {', '.join(missing) or 'none'}."
    results = "Results: none yet, see `make evidence`."
    if told:
        results = (
            f"Results: a run of {told['date']}, commit {told['commit']}, tier "
            f"`{told['tier']}`, Python {told['python']} on {told['machine']}."
        )
    return f"{counted} {without}\n{results}\n"


def table() -> str:
    """Return the table of each section."""
    parts = []
    for title, section in laws().items():
        rows = [
            f"### {title}",
            "",
            "| law | promise | tests that provoke it | faults | last result | explained in |",
            "| --- | --- | --- | --- | --- | --- |",
            *(_row(id_, law) for id_, law in section.items()),
        ]
        parts.append("\n".join(rows) + "\n")
    return "\n".join(parts)


def _row(id_: str, law: Law) -> str:
    tests = [test for test in provoking_tests() if id_ in test.laws]
    names = "<br>".join(map(_link, tests)) or f"**none**; {law.shown_by or 'nothing shows it'}"
    noticed = sum(faults()[f"{Path(test.file).name}::{test.name}"] for test in tests)
    page = f"[{Path(law.page).stem.replace('_', ' ')}](../{law.page})"
    cells = (id_, law.promise, names, str(noticed or ""), _result(tests), page)
    return f"| {' | '.join(cells)} |"


def _link(test: Test) -> str:
    tier = "" if test.tier == "everyday" else f" ({test.tier})"
    words = test.name.removeprefix("test_").replace("_", " ")
    return f"[{words}](../../{test.file}){tier}"


def _result(tests: Iterable[Test]) -> str:
    counted, not_run = Counter[str](), 0
    for test in tests:
        result = last_run()["tests"].get(f"{test.file}::{test.name}")
        not_run += result is None
        counted.update(result or {})
    told = [f"{counted[word]} {word}" for word in ("failed", "passed", "skipped") if counted[word]]
    return ", ".join(told + ([f"{not_run} not run"] if not_run else [])) or "none"


def expected(text: str) -> str:
    """Return a page with its marked blocks as they must be."""
    return BLOCK.sub(
        lambda block: block[1] + {"run": run, "table": table}[block[2]]() + block[4], text
    )


def keep(reports: list[Path], tier: str) -> None:
    """Write the results of a run into docs/evidence.json."""
    git = ["git", "-C", str(SOURCE_TREE), "describe", "--always", "--dirty", "--exclude=*"]
    told = {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip(),
        "tier": tier,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }
    content = {"run": told, "tests": results_of(reports)}
    RESULTS.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:]:
        keep([Path(name) for name in sys.argv[2:]], sys.argv[1])
    PAGE.write_text(expected(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
