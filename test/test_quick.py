"""`make quick` on a made-up project: which tests a change needs, their order, and the cut."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from textwrap import indent

import pytest

TOOLS = Path(__file__).resolve().parents[1] / "tools"
PASSES, FAILS = "assert True", "assert False"
FILES = {
    ".gitignore": "__pycache__/",
    "pyproject.toml": '[tool.pytest.ini_options]\npythonpath = ["test"]',
    "README.md": "",
    "ff_planner_ros/__init__.py": "",
    "ff_planner_ros/leaf.py": "",
    "ff_planner_ros/inner.py": "",
    "ff_planner_ros/outer.py": "from ff_planner_ros.inner import (\n    something,\n)",
    "ff_planner_ros/core/compiled.pyi": "",
    "ff_planner_ros/core/row.hpp": "",
    "ff_planner_ros/ros/session.py": "",
    "test/faults/area.yaml": (
        "- {file: leaf.py, old: a, new: b, wrong: c, tests: "
        "'test_far.py::test_law[1] test_many.py::test_law'}\n"
        "- {file: other/leaf.py, old: a, new: b, wrong: c, tests: test_page.py}"
    ),
    "test/test_many.py": "import os, ff_planner_ros.leaf as leaf, sys",
    "test/test_leaf.py": "from ff_planner_ros import leaf",
    "test/test_far.py": "",
    "test/test_outer.py": "def later():\n    from ff_planner_ros.outer import x",
    "test/test_core.py": "from ff_planner_ros.core.compiled import Row",
    "test/test_node.py": (
        "from ros_processes import connected_client\nfrom ff_planner_ros.ros import session\n"
        "from ff_planner_ros import leaf"
    ),
    "test/test_page.py": '"""Of README.md."""',
    "test/test_docs.py": "",
}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project whose last commit on main is its first."""
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if name.startswith("test/test_"):
            never = indent(text or "pass", "    ")
            text = f"if False:\n{never}\n\n\ndef test_law():\n    {PASSES}\n"
        file.write_text(text)
    (tmp_path / "tools").mkdir()
    for name in ("quick.py", "faults.py"):
        shutil.copy(TOOLS / name, tmp_path / "tools" / name)
    git(tmp_path, "init", "--initial-branch=main")
    commit(tmp_path)
    return tmp_path


def git(project: Path, *arguments: str) -> None:
    own = ("-c", "user.name=a", "-c", "user.email=a@b")
    subprocess.run(["git", *own, *arguments], cwd=project, check=True, capture_output=True)


def commit(project: Path) -> None:
    git(project, "add", ".")
    git(project, "commit", "--message=a change")


def quick(project: Path, *arguments: str) -> tuple[int, str]:
    """Return exit code and output."""
    command = [sys.executable, "tools/quick.py", *arguments]
    ran = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
    return ran.returncode, ran.stdout + ran.stderr


def chosen(project: Path, *arguments: str) -> list[str]:
    code, said = quick(project, *arguments)
    assert code == 0, said
    (tests,) = (line for line in said.splitlines() if line.startswith("Tests: "))
    return tests.removeprefix("Tests: ").replace("test/", "").split(", ")


def test_a_changed_module_has_its_faults_tests_then_those_that_import_it(project: Path) -> None:
    (project / "ff_planner_ros/leaf.py").write_text("a = 1\n")
    of_faults = ["test_far.py::test_law", "test_many.py::test_law"]
    assert chosen(project) == [*of_faults, "test_leaf.py", "test_many.py"]
    assert "3 passed" in quick(project)[1]  # each once


def test_a_new_test_comes_first_whatever_it_starts(project: Path) -> None:
    git(project, "switch", "--create=branch")
    (project / "ff_planner_ros/leaf.py").write_text("a = 1\n")
    commit(project)
    (project / "test/test_new.py").write_text("def test_law():\n    pass\n")
    (project / "test/test_node.py").write_text("def test_law():\n    pass\n")
    assert chosen(project)[:3] == ["test_new.py", "test_node.py", "test_far.py::test_law"]


def test_on_main_with_nothing_changed_it_is_the_last_commit(project: Path) -> None:
    (project / "ff_planner_ros/core/row.hpp").write_text("// row\n")
    commit(project)
    assert "Nothing differs from the last commit on main" in quick(project)[1]
    assert chosen(project) == ["test_core.py"]


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("named", "tests"),
    [
        ("inner.py", ["test_outer.py"]),
        ("ros/session.py", ["test_node.py"]),
        ("core/compiled.pyi", ["test_core.py"]),
        ("README.md", ["test_docs.py", "test_page.py"]),
        ("pyproject.toml", ["none knows of that"]),
    ],
)
def test_what_no_test_imports_is_known_by_what_imports_it_or_names_it(
    project: Path, named: str, tests: list[str]
) -> None:
    assert chosen(project, named) == tests


def test_a_file_that_does_not_exist_is_named(project: Path) -> None:
    code, said = quick(project, "no.py")
    assert code != 0
    assert "there is neither no.py nor ff_planner_ros/no.py" in said


def test_the_first_failure_ends_it_with_another_exit_code(project: Path) -> None:
    file = project / "test/test_leaf.py"
    file.write_text(f"def test_one():\n    {FAILS}\n\n\ndef test_two():\n    {FAILS}\n")
    code, said = quick(project)
    assert code == 1
    assert "1 failed" in said


def test_after_half_a_minute_it_ends_and_tells_what_was_left_out(project: Path) -> None:
    file = project / "test/test_leaf.py"
    file.write_text("import time\n\n\ndef test_one():\n    pass\n\n\ndef test_two():\n    time.")
    file.write_text(f"{file.read_text()}sleep(600)\n\n\ndef test_three():\n    pass\n")
    code, said = quick(project, f"--begun={time.time() - 28.0}")
    assert code == 0
    # On a busy machine not even the first test is over, or read.
    assert re.search(r"CUT after 30 s\. Left out: [123] of test/test_leaf\.py", said), said


def test_where_the_half_minute_is_over_nothing_passes_for_tested(project: Path) -> None:
    (project / "test/test_leaf.py").write_text("def test_one():\n    pass\n")
    code, said = quick(project, f"--begun={time.time() - 31.0}")
    assert (code, "Left out: 1 of test/test_leaf.py" in said) == (0, True)
