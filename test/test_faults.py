"""The faults that `make mutants` puts into the code: each still has its place and its tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from faults import AREAS, PACKAGE, PROJECT, SAID, SHARE, Fault, copy_of, faults_of


@pytest.mark.parametrize("area", AREAS)
def test_each_fault_changes_one_place_and_names_tests_that_are_there(area: str) -> None:
    for fault in faults_of(area):
        text = (PROJECT / PACKAGE / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.old) == 1, fault
        assert fault.new != fault.old, fault
        for test in fault.tests.split():
            file, _, name = test.partition("::")
            assert f"def {name.partition('[')[0]}" in (PROJECT / "test" / file).read_text("utf-8")


def test_of_all_faults_so_few_may_survive() -> None:
    faults = [fault for area in AREAS for fault in faults_of(area)]
    assert sum(bool(fault.survives) for fault in faults) <= (1.0 - SHARE) * len(faults)


def test_a_fault_is_put_into_its_place_alone(tmp_path: Path) -> None:
    (tmp_path / PACKAGE).mkdir()
    file = tmp_path / PACKAGE / "one.py"
    file.write_text("a = 1\nb = 2\nb = 2\n")
    Fault("area", "one.py", "a = 1", "a = 0", "wrong", "test_one.py").put_into(tmp_path)
    assert file.read_text() == "a = 0\nb = 2\nb = 2\n"
    for old in ("b = 2", "c = 3"):  # twice, and nowhere
        with pytest.raises(ValueError, match=r"^area: one\.py has"):
            Fault("area", "one.py", old, "", "wrong", "test_one.py").put_into(tmp_path)


def test_a_copy_has_a_package_and_an_answer_of_its_own(tmp_path: Path) -> None:
    """Or else every fault would be told to be noticed by the tests of the last one."""
    for directory in (PACKAGE, "test", "config"):
        (tmp_path / directory).mkdir()
    (tmp_path / PACKAGE / "one.py").write_text("a = 1\n")
    (tmp_path / SAID).write_text("FAILED another\n")
    objects = tmp_path / "build" / "temp.here"
    objects.mkdir(parents=True)
    for name in ("one.o", "one.o.d"):
        (objects / name).write_text("sound")
    with copy_of(tmp_path) as tree:
        (tree / PACKAGE / "one.py").write_text("a = 0\n")
        (tree / "build/temp.here/one.o").unlink()  # as a build does
        (tree / "build/temp.here/one.o.d").write_text("faulty")
        assert not (tree / SAID).exists()
        assert (tree / "config").samefile(tmp_path / "config")
    assert (tmp_path / PACKAGE / "one.py").read_text() == "a = 1\n"
    assert {of.read_text() for of in objects.iterdir()} == {"sound"}
    assert (tmp_path / SAID).read_text() == "FAILED another\n"
