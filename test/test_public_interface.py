"""The public Python interface: its names, what importing it costs, and its example."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ff_planner_ros
from ff_planner_ros.planning.problem.problem import Obstacle

SOURCE_TREE = Path(__file__).resolve().parents[1]


def test_every_public_name_is_the_one_that_its_module_has() -> None:
    assert ff_planner_ros.Obstacle is Obstacle
    for name in ff_planner_ros.__all__:
        found = getattr(ff_planner_ros, name)
        assert found.__name__ == ff_planner_ros._NAME_THERE.get(name, name)
        assert found.__module__.startswith("ff_planner_ros.")


def test_the_type_checker_sees_the_same_names() -> None:
    tree = ast.parse(Path(ff_planner_ros.__file__).read_text(encoding="utf-8"))
    (only_typed,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in only_typed.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname: node.module for node in imports for alias in node.names}
    modules = ff_planner_ros._MODULE_OF.items()
    assert seen == {name: f"ff_planner_ros.{module}" for name, module in modules}


def test_no_public_name_is_that_of_a_module_which_would_hide_it() -> None:
    modules = {path.stem for path in (SOURCE_TREE / "ff_planner_ros").iterdir()}
    assert not modules & set(ff_planner_ros.__all__)


def test_an_unknown_name_is_refused_as_python_does() -> None:
    with pytest.raises(AttributeError, match="no attribute 'plan_everything'"):
        _ = ff_planner_ros.plan_everything


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import ff_planner_ros, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {"numpy", "scipy", "pinocchio", "matplotlib", "plotly", "mujoco", "rclpy"}
    assert "ff_planner_ros" in loaded
    assert not heavy & set(loaded)
    assert not [name for name in loaded if name.startswith("ff_planner_ros.")]


@pytest.mark.nightly
def test_the_example_plans_draws_and_verifies(tmp_path: Path) -> None:
    example = SOURCE_TREE / "examples" / "plan_in_python.py"
    done = subprocess.run(
        [sys.executable, str(example)], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "50 points, 1.1072 rad of joint path" in done.stdout
    shortest, steady = re.findall(r"the chaser rotates by ([\d.]+) rad at most", done.stdout)
    assert float(steady) <= 0.2 < float(shortest)
    assert "no plan in 0.5 s: " in done.stdout
    assert (tmp_path / "plan_in_python" / "scene.html").is_file()
    assert "verified: True" in done.stdout
