"""The launch file, run without ROS's launch, of which there is no wheel: what it names exists.

Stand-ins for `launch` and `launch_ros` record every call; on a machine that has them they are not
used either, so that the test is the same everywhere.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from ff_planner_ros.common.share import share_directory

LAUNCH_FILE = Path(__file__).parents[1] / "launch" / "planner.launch.py"
# Where the real packages have these names.
NAMES = {
    "launch": ("LaunchDescription",),
    "launch.actions": ("DeclareLaunchArgument", "ExecuteProcess"),
    "launch.conditions": ("IfCondition",),
    "launch.substitutions": ("LaunchConfiguration", "PathJoinSubstitution", "PythonExpression"),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
    "launch_ros.substitutions": ("FindPackageShare",),
}


class Call:
    """One thing that the launch file made."""

    def __init__(self, kind: str, *args: Any, **kwargs: Any) -> None:
        self.kind, self.args, self.kwargs = kind, args, kwargs


@pytest.fixture(scope="module")
def described() -> Iterator[list[Call]]:
    """What the launch file describes."""
    with pytest.MonkeyPatch.context() as patch:
        for module_name, kinds in NAMES.items():
            module = ModuleType(module_name)
            for kind in kinds:
                setattr(module, kind, lambda *a, _kind=kind, **k: Call(_kind, *a, **k))
            patch.setitem(sys.modules, module_name, module)
        source: dict[str, Any] = {}
        exec(compile(LAUNCH_FILE.read_text("utf-8"), str(LAUNCH_FILE), "exec"), source)
        (entities,) = source["generate_launch_description"]().args
        yield entities


def of(described: list[Call], kind: str) -> list[Call]:
    return [call for call in described if call.kind == kind]


def resolved(value: Any, chosen: dict[str, str]) -> str:
    """What the substitutions in a value come to."""
    if isinstance(value, str):
        return value
    if isinstance(value, list):
        return "".join(resolved(part, chosen) for part in value)
    (argument,) = value.args
    if value.kind == "LaunchConfiguration":
        return chosen[argument]
    if value.kind == "FindPackageShare":
        assert argument == "ff_planner_ros"
        return str(share_directory())
    assert value.kind == "PathJoinSubstitution"
    return str(Path(*(resolved(part, chosen) for part in argument)))


def test_every_argument_has_a_default_and_a_description(described: list[Call]) -> None:
    arguments = {call.args[0]: call.kwargs for call in of(described, "DeclareLaunchArgument")}
    assert set(arguments) == {"parameters", "namespace", "use_sim_time", "testbed"}
    for given in arguments.values():
        assert given["description"]
        assert given["default_value"] is not None


def test_every_argument_that_is_used_is_declared(described: list[Call]) -> None:
    declared = {call.args[0] for call in of(described, "DeclareLaunchArgument")}
    used: set[str] = set()

    def look(value: Any) -> None:
        if isinstance(value, Call):
            if value.kind == "LaunchConfiguration":
                used.update(value.args)
            look([*value.args, *value.kwargs.values()])
        elif isinstance(value, list | tuple):
            for part in value:
                look(part)
        elif isinstance(value, dict):
            look(list(value.values()))

    look(described)
    assert used == declared


def test_the_node_is_the_installed_one_under_its_own_name(described: list[Call]) -> None:
    (node,) = of(described, "Node")
    assert node.kwargs["package"] == "ff_planner_ros"
    scripts = entry_points(group="console_scripts", name=node.kwargs["executable"])
    assert [script.value for script in scripts] == ["ff_planner_ros.cli:planner_node"]
    assert node.kwargs["name"] == "ff_planner"


def test_the_default_parameters_are_the_documented_ones(described: list[Call]) -> None:
    (given,) = (c for c in of(described, "DeclareLaunchArgument") if c.args[0] == "parameters")
    file = Path(resolved(given.kwargs["default_value"], {}))
    assert file == share_directory() / "config" / "planner.yaml"
    assert "ros__parameters" in yaml.safe_load(file.read_text("utf-8"))["/**"]


def test_the_testbed_is_the_example_and_its_scenario_one_of_ours(described: list[Call]) -> None:
    (process,) = of(described, "ExecuteProcess")
    chosen = {"testbed": "lemur_capture.yaml", "namespace": "chaser_1", "use_sim_time": "true"}
    _, script, scenario, *rest = (resolved(part, chosen) for part in process.kwargs["cmd"])
    assert Path(script).is_file()
    assert Path(scenario).is_file()
    assert rest == ["--ros-args", "-r", "__ns:=/chaser_1", "-p", "use_sim_time:=true"]


@pytest.mark.parametrize(("testbed", "starts"), [("", False), ("lemur_capture.yaml", True)])
def test_the_testbed_starts_only_where_a_scenario_is_named(
    described: list[Call], testbed: str, starts: bool
) -> None:
    (process,) = of(described, "ExecuteProcess")
    (expression,) = process.kwargs["condition"].args
    assert expression.kind == "PythonExpression"
    (parts,) = expression.args
    assert eval(resolved(parts, {"testbed": testbed})) is starts


def test_launch_file_and_examples_are_installed_and_their_needs_declared() -> None:
    package = LAUNCH_FILE.parents[1]
    assert 'installed_as_they_are("config", "examples", "launch")' in (
        (package / "setup.py").read_text("utf-8")
    )
    declared = (package / "package.xml").read_text("utf-8")
    for needed in ("launch", "launch_ros"):
        assert f"<exec_depend>{needed}</exec_depend>" in declared
