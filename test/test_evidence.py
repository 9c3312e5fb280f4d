"""The laws of laws.yaml: the tests that name them, and the page that is made of both."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from evidence import (
    DOCS,
    PAGE,
    SOURCE_TREE,
    expected,
    faults,
    known_ids,
    laws,
    provoking_tests,
    results_of,
)
from tiers import require_known_laws

JUNIT = """<testsuites><testsuite>
<testcase classname="test.test_check" name="test_a_sound_plan_passes"/>
<testcase classname="{module}" name="{name}[1]"/>
<testcase classname="{module}" name="{name}[2]"><failure/></testcase>
<testcase classname="{module}" name="{name}[3]"><skipped/></testcase>
<testcase classname="{module}" name="{name}[4]"><properties/></testcase>
</testsuite></testsuites>"""


def test_the_page_is_made_of_laws_and_tests_as_they_are() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == expected(text), "run .venv/bin/python tools/evidence.py"
    shown = re.findall(r"^\| ([A-Z]+-\d\d) \|", text, re.MULTILINE)
    assert sorted(shown) == sorted(known_ids())


def test_every_law_is_one_sentence_and_a_page_explains_it() -> None:
    ids = [id_ for section in laws().values() for id_ in section]
    assert len(ids) == len(set(ids))
    for section in laws().values():
        for number, (id_, law) in enumerate(section.items(), 1):
            assert re.fullmatch(rf"[A-Z]+-{number:02d}", id_), id_
            assert law.promise[0].isupper(), id_
            assert "|" not in law.promise, id_
            assert not law.promise.endswith("."), id_
            assert (DOCS / law.page).is_file(), id_


def test_a_test_that_names_a_law_which_is_none_is_refused() -> None:
    def item(*names: str) -> pytest.Item:
        marks = [SimpleNamespace(args=names)]
        return cast(Any, SimpleNamespace(nodeid="test_x", iter_markers=lambda _: marks))

    require_known_laws([item("PLAN-01", "BAG-02")])
    with pytest.raises(pytest.UsageError, match=r"has no law PLAN-99 of test_x$"):
        require_known_laws([item("PLAN-01"), item("PLAN-99")])


def test_the_marks_of_the_sources_are_those_that_pytest_collects(
    request: pytest.FixtureRequest,
) -> None:
    """Of the tests of this run, which need not be all."""
    read = {(test.file, test.name): set(test.laws) for test in provoking_tests()}
    root = request.config.rootpath
    collected: dict[tuple[str, str], set[str]] = {}
    for item in request.session.items:
        named = {law for mark in item.iter_markers("law") for law in mark.args}
        if named:
            function = getattr(item, "originalname", item.name)
            collected[str(item.path.relative_to(root)), function] = named
    assert collected.items() <= read.items()


def test_results_are_counted_for_each_test_and_others_are_left_out(tmp_path: Path) -> None:
    test = provoking_tests()[0]
    module = test.file.removesuffix(".py").replace("/", ".")
    report = tmp_path / "junit.xml"
    report.write_text(JUNIT.format(module=module, name=test.name), encoding="utf-8")
    counted = {"passed": 2, "failed": 1, "skipped": 1}
    assert results_of([report]) == {f"{test.file}::{test.name}": counted}


def test_faults_that_tests_let_survive_count_for_nothing() -> None:
    """Those of the check are noticed, by its tests of one law each."""
    name = "test_check_by_hand.py::test_a_singular_posture_is_refused_wherever_it_is"
    assert faults()[name] > 0


def test_results_are_of_this_run_even_where_pytest_writes_none() -> None:
    """Or else those of the run before would be told with the present date and commit."""
    recipe = (SOURCE_TREE / "Makefile").read_text(encoding="utf-8").split("\nevidence: env", 1)[1]
    commands = recipe.split("\n\n")[0]
    assert commands.index("rm -f build/evidence.xml") < commands.index("--junitxml")
