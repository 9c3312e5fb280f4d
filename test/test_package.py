"""What holds for the package as a whole: order of imports, versions, docstrings, declarations."""

import ast
import builtins
import importlib.metadata
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ff_planner_msgs.msg import PlanStatus

from ff_planner_ros import errors
from ff_planner_ros.share import installation_prefixes

SOURCE_TREE = Path(__file__).resolve().parents[1]
PACKAGE = SOURCE_TREE / "ff_planner_ros"
MODULES = sorted(PACKAGE.rglob("*.py"))
TESTS = sorted((SOURCE_TREE / "test").glob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in MODULES + TESTS}

# A room may import itself and every room of a lower floor.
FLOORS = {
    "": 0,  # ff_planner_ros/__init__.py
    "errors": 0,
    "arrays": 0,
    "share": 0,
    "text_table": 0,
    "robot": 1,
    "planning": 2,
    "parameters": 3,
    "baselines": 3,
    "simulation": 3,
    "analysis": 3,
    "bench": 4,
    "bag": 5,
    "time_budget": 5,
    "compare": 6,
    "verify": 6,
    "ros": 6,
    "runs": 7,
    "demo": 8,
    "commands": 9,
    "cli": 10,
}
SHARED_FLOOR, HIGHEST_FLOOR_WITHOUT_ROS = 0, 4
ROOM_WITH_CLOCKS = "bench"
# Import name to name for pip, where the two differ.
PIP_NAMES = {
    "mcap_ros2": "mcap-ros2-support",
    "mujoco": "mujoco-core",
    "pinocchio": "pin",
    "yaml": "pyyaml",
}

every_module = pytest.mark.parametrize(
    "path", MODULES, ids=[str(path.relative_to(PACKAGE)) for path in MODULES]
)


def room_of(module):
    """`ff_planner_ros.robot.model` and `robot/model.py` lie in the room `robot`."""
    return module.partition(".")[2].partition(".")[0]


def floor_of(room):
    assert room in FLOORS, f"{room} has no floor in FLOORS of this test yet"
    return FLOORS[room]


def module_name(path):
    parts = path.relative_to(SOURCE_TREE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_at_run_time(tree):
    """Dotted names of everything a module imports, without what only the type checker sees."""
    found = []
    for node in nodes_at_run_time(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports here are absolute"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def nodes_at_run_time(tree):
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from nodes_at_run_time(node)


def top_level_imports(paths):
    return {name.split(".")[0] for path in paths for name in imports_at_run_time(TREES[path])}


def ros_packages(names):
    indexes = [
        prefix / "share/ament_index/resource_index/packages" for prefix in installation_prefixes()
    ]
    return {name for name in names if any((index / name).is_file() for index in indexes)}


@every_module
def test_imports_run_one_way(path):
    here = room_of(module_name(path))
    for name in imports_at_run_time(TREES[path]):
        there = room_of(name)
        if name.split(".")[0] == "ff_planner_ros" and there != here:
            downwards = floor_of(there) < floor_of(here)
            both_shared = floor_of(there) == floor_of(here) == SHARED_FLOOR
            assert downwards or both_shared, f"{here or 'ff_planner_ros'} must not import {name}"


@every_module
def test_rooms_below_bag_know_nothing_of_ros_mcap_or_clocks(path):
    room = room_of(module_name(path))
    if floor_of(room) > HIGHEST_FLOOR_WITHOUT_ROS:
        return
    imported = top_level_imports([path])
    if room == ROOM_WITH_CLOCKS:
        imported -= {"time"}
    foreign = ros_packages(imported) | imported & {"mcap", "mcap_ros2", "time", "datetime"}
    assert foreign - {"ff_planner_ros"} == set()


def test_only_the_simulation_imports_the_engine_that_need_not_be_installed():
    importing = {
        room_of(module_name(path)) for path in MODULES if "mujoco" in top_level_imports([path])
    }
    assert importing == {"simulation"}


def test_both_packages_have_the_version_that_the_changelog_describes():
    ours, messages = (
        ElementTree.parse(SOURCE_TREE / file).findtext("version")
        for file in ("package.xml", "msg_defs/package.xml")
    )
    changelog = (SOURCE_TREE / "CHANGELOG.md").read_text(encoding="utf-8")
    assert ours == messages
    assert re.findall(r"^## \[(\d.*?)\]", changelog, re.MULTILINE)[0] == ours
    assert importlib.metadata.version("ff_planner_ros") == ours
    assert importlib.metadata.version("ff_planner_msgs") == ours


@pytest.mark.parametrize(
    ("tag", "importing", "declared_already"),
    [("exec_depend", MODULES, ()), ("test_depend", TESTS, MODULES)],
)
def test_package_xml_declares_exactly_the_ros_packages_that_are_imported(
    tag, importing, declared_already
):
    package_xml = ElementTree.parse(SOURCE_TREE / "package.xml")
    declared = ros_packages({element.text for element in package_xml.iter(tag)})
    needed = top_level_imports(importing) - top_level_imports(declared_already)
    assert declared == ros_packages(needed) - {"ff_planner_ros"}


def test_setup_py_declares_exactly_the_python_packages_that_are_imported():
    required = importlib.metadata.requires("ff_planner_ros")
    declared = {
        re.match(r"[\w-]+", line)[0]
        for line in required
        if "extra ==" not in line or re.search(r"extra == .(simulation|ros)\b", line)
    }
    foreign = top_level_imports(MODULES) - sys.stdlib_module_names - {"ff_planner_ros"}
    imported = {PIP_NAMES.get(name, name) for name in foreign - ros_packages(foreign)}
    from_ros = {"ff_planner_msgs", "ros-jazzy-common-interfaces", "ros-jazzy-rclpy"}
    assert declared == imported | from_ros


def test_status_codes_are_those_of_the_message():
    text = (SOURCE_TREE / "msg_defs/msg/PlanStatus.msg").read_text(encoding="utf-8")
    written = {
        name: int(value) for name, value in re.findall(r"^uint16 (\w+)=(\d+)", text, re.MULTILINE)
    }
    assert {status.name: status.value for status in errors.Status} == written
    assert {name: getattr(PlanStatus, name) for name in written} == written


def documented(*kinds):
    """Every definition of these kinds that has a docstring."""
    return [
        pytest.param(node, id=f"{path.relative_to(PACKAGE)}:{node.name}")
        for path in MODULES
        for node in ast.walk(TREES[path])
        if isinstance(node, kinds) and ast.get_docstring(node)
    ]


FUNCTIONS, CLASSES = documented(ast.FunctionDef, ast.AsyncFunctionDef), documented(ast.ClassDef)


def section(node, title):
    """Names described under a title of a docstring; None if there is no such title."""
    match = re.search(
        rf"^{title}:\n((?:[ ].*\n|\n)*)", ast.get_docstring(node) + "\n", re.MULTILINE
    )
    return match and re.findall(r"^    (\*{0,2}\w+):", match[1], re.MULTILINE)


def parameters(function):
    arguments = function.args
    names = [item.arg for item in arguments.posonlyargs + arguments.args]
    names += [f"*{arguments.vararg.arg}"] if arguments.vararg else []
    names += [item.arg for item in arguments.kwonlyargs]
    names += [f"**{arguments.kwarg.arg}"] if arguments.kwarg else []
    return [name for name in names if name not in ("self", "cls")]


def attributes(class_definition):
    """Fields of a dataclass, and what `__init__` stores."""
    names = [
        node.target.id
        for node in class_definition.body
        if isinstance(node, ast.AnnAssign) and not node.target.id.startswith("_")
    ]
    for function in class_definition.body:
        if isinstance(function, ast.FunctionDef) and function.name == "__init__":
            names += [
                node.attr
                for node in ast.walk(function)
                if isinstance(node, ast.Attribute)
                and isinstance(node.ctx, ast.Store)
                and not node.attr.startswith("_")
            ]
    return names


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_docstring_lists_only_arguments_of_the_signature_in_its_order(function):
    listed = section(function, "Args") or []
    assert listed == [name for name in parameters(function) if name in listed]


@pytest.mark.parametrize("class_definition", CLASSES)
def test_a_docstring_that_lists_attributes_lists_exactly_those_of_the_class(class_definition):
    listed = section(class_definition, "Attributes")
    assert listed is None or listed == attributes(class_definition)


@pytest.mark.parametrize("definition", FUNCTIONS + CLASSES)
def test_a_docstring_names_only_exceptions_that_exist(definition):
    for name in section(definition, "Raises") or []:
        exception = getattr(errors, name, getattr(builtins, name, None))
        assert isinstance(exception, type), f"{name} is neither in errors.py nor built in"
        assert issubclass(exception, Exception)
