"""What holds for the package as a whole: order of imports, versions, docstrings, declarations."""

import ast
import builtins
import functools
import importlib.metadata
import re
import sys
import tomllib
from collections import Counter
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from ff_planner_msgs.msg import PlanStatus

from ff_planner_ros import errors
from ff_planner_ros.common.share import installation_prefixes

SOURCE_TREE = Path(__file__).resolve().parents[1]
PACKAGE = SOURCE_TREE / "ff_planner_ros"
MODULES = sorted(PACKAGE.rglob("*.py"))
# Experiments, a distribution of its own that imports the package, never the reverse.
BENCHMARK = SOURCE_TREE / "benchmark"
OF_BENCHMARK = sorted((BENCHMARK / "ff_planner_benchmark").rglob("*.py"))
TESTS = sorted((SOURCE_TREE / "test").glob("*.py"))

# Rooms, the lowest floor first. A room may import itself and every room of a lower floor.
FLOORS = (
    {"", "common", "errors"},  # "" is __init__.py
    {"robot"},
    {"planning"},  # planning/__init__.py
    {"planning.problem"},
    {"core"},
    {"planning.motion"},
    {"planning.distance"},
    {"planning.paths"},
    {"planning.requirements"},
    {"planning.check"},
    {"planning.robust"},
    {"planning.optimisation"},
    {"planning.search"},
    {"planning.task"},
    {"planning.scenario"},
    {"parameters", "messages"},
    {"baselines", "simulation", "analysis"},
    {"problems"},
    {"bag", "time_budget"},
    # "ros" is ros/__init__.py
    {"ros", "ros.process"},
    {"ros.messages"},
    {"ros.topics"},
    {"ros.qos"},
    {"ros.client", "ros.inputs"},
    {"ros.parameters"},
    {"ros.recorder"},
    {"ros.outputs"},
    {"ros.requests"},
    {"ros.session"},
    {"ros.planner_node"},
    {"ros.node"},
    {"runs"},
    {"campaign"},
    {"report"},
    {"demo"},
    {"console"},
    {"commands"},
    {"cli"},
)
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
SHARED_FLOOR, HIGHEST_FLOOR_WITHOUT_ROS = 0, FLOOR_OF["problems"]
# Rooms and modules that talk to ROS; the others run where no ROS is installed.
WITH_ROS = ("ros", "runs.measured", "runs.offline_bag", "demo", "console.live")
ROS_IN_BAG = "rosidl_parser"  # reads the definitions that a bag carries
# Subjects of a room, without __init__.py, and lines of a file.
MOST_FILES, MOST_LINES = 15, 350
# Import name to name for pip, where the two differ.
PIP_NAMES = {
    "Basilisk": "bsk",
    "coal": "pin",  # which is built on it and brings it
    "dask": "distributed",  # which is built on it and brings it
    "mcap_ros2": "mcap-ros2-support",
    "mpl_toolkits": "matplotlib",
    "mujoco": "mujoco-core",
    "pinocchio": "pin",
    "pydrake": "drake",
    "websockets": "viser",  # which is built on it and brings it
    "yaml": "pyyaml",
}


def room_of(module):
    """`ff_planner_ros.robot.model` lies in `robot`; in planning/ and ros/ each room is one."""
    parts = module.split(".")[1:]
    room = ".".join(parts[: 2 if parts[:1] in (["planning"], ["ros"]) else 1])
    assert room in FLOOR_OF, f"{room} has no floor in FLOORS of this test yet"
    return room


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path):
    root = BENCHMARK if BENCHMARK in path.parents else SOURCE_TREE
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def names_imported(nodes):
    """Dotted names of everything that these statements import."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports here are absolute"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


@functools.cache
def imports_at_run_time(tree):
    """What a module imports, without what only the type checker sees."""
    return names_imported(nodes_at_run_time(tree))


@functools.cache
def imports_when_loaded(tree):
    """What a module imports when it is imported itself: not what its functions do later."""
    return names_imported(nodes_at_run_time(tree, functions=False))


BLOCKS = (ast.stmt, ast.ExceptHandler, ast.match_case)  # an expression imports nothing


def nodes_at_run_time(tree, functions=True):
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, BLOCKS):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if not functions and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        yield node
        yield from nodes_at_run_time(node, functions)


PATH_OF = {module_name(path): path for path in MODULES}
EVERY_PATH_OF = PATH_OF | {module_name(path): path for path in OF_BENCHMARK}


def own_modules(names):
    """Our modules among names that are imported, or whose content is."""
    both = (module for name in names for module in (name, name.rpartition(".")[0]))
    return {module for module in both if module in EVERY_PATH_OF}


def top_level_imports(paths):
    return {name.split(".")[0] for path in paths for name in imports_at_run_time(tree_of(path))}


def talks_to_ros(module):
    return any(f"{module}.".startswith(f"ff_planner_ros.{name}.") for name in WITH_ROS)


def ros_packages(names):
    indexes = [
        prefix / "share/ament_index/resource_index/packages" for prefix in installation_prefixes()
    ]
    return {name for name in names if any((index / name).is_file() for index in indexes)}


def test_no_room_has_more_files_and_no_file_more_lines_than_one_finds_a_way_in():
    sources = [
        path.relative_to(PACKAGE)
        for path in PACKAGE.rglob("*")
        if path.suffix in {".py", ".hpp", ".cpp"} and path.name != "__init__.py"
    ]
    # A header of the core and the source beside it are one subject.
    rooms = Counter(str(subject.parent) for subject in {path.with_suffix("") for path in sources})
    lines = {str(path): (PACKAGE / path).read_text("utf-8").count("\n") for path in sources}
    assert {r: n for r, n in rooms.items() if n > MOST_FILES} == {}
    assert {f: n for f, n in lines.items() if n > MOST_LINES} == {}


def test_imports_run_one_way():
    violations = []
    for module, path in PATH_OF.items():
        here = room_of(module)
        for name in imports_at_run_time(tree_of(path)):
            if name.split(".")[0] != "ff_planner_ros":
                continue
            there = room_of(name if name in PATH_OF else name.rpartition(".")[0])
            both_shared = FLOOR_OF[there] == FLOOR_OF[here] == SHARED_FLOOR
            if there == here or both_shared or FLOOR_OF[there] < FLOOR_OF[here]:
                continue
            violations.append(f"{module} must not import {name}")
    assert violations == []


def test_no_module_imports_itself_by_way_of_others():
    waiting = {
        m: own_modules(imports_at_run_time(tree_of(p))) - {m} for m, p in EVERY_PATH_OF.items()
    }
    while free := {module for module, imported in waiting.items() if not imported}:
        waiting = {m: imported - free for m, imported in waiting.items() if m not in free}
    assert waiting == {}, "each of these imports one of the others"


def test_rooms_below_bag_know_nothing_of_ros_mcap_or_clocks():
    violations = []
    for module, path in PATH_OF.items():
        room = room_of(module)
        if FLOOR_OF[room] > HIGHEST_FLOOR_WITHOUT_ROS:
            continue
        imported = top_level_imports([path])
        foreign = ros_packages(imported) | imported & {"mcap", "mcap_ros2", "time", "datetime"}
        violations += [f"{module} imports {name}" for name in foreign - {"ff_planner_ros"}]
    assert violations == []


def test_without_ros_everything_loads_but_what_talks_to_it():
    violations = []
    for module, path in PATH_OF.items():
        if talks_to_ros(module):
            continue
        names = imports_when_loaded(tree_of(path))
        foreign = ros_packages({name.split(".")[0] for name in names}) - {"ff_planner_ros"}
        foreign -= {ROS_IN_BAG} if room_of(module) == "bag" else set()
        talking = set(filter(talks_to_ros, own_modules(names)))
        violations += [f"{module} imports {name}" for name in foreign | talking]
    assert violations == []


def test_only_the_simulation_imports_the_engine_that_need_not_be_installed():
    importing = {
        room_of(module_name(path)) for path in MODULES if "mujoco" in top_level_imports([path])
    }
    assert importing == {"simulation"}


def test_only_the_console_imports_the_page_that_need_not_be_installed():
    importing = {
        room_of(module_name(path)) for path in MODULES if "viser" in top_level_imports([path])
    }
    assert importing == {"console"}


def test_only_campaigns_import_the_cluster_that_need_not_be_installed():
    optional = {"dask", "distributed", "pyarrow"}
    importing = {
        room_of(module_name(path)) for path in MODULES if optional & top_level_imports([path])
    }
    assert importing == {"campaign", "report", "commands"}
    at_once = {
        room_of(module_name(path))
        for path in MODULES
        if optional & {name.split(".")[0] for name in imports_when_loaded(tree_of(path))}
    }
    assert at_once == {"campaign", "report"}


def test_all_packages_have_the_version_that_the_changelog_describes():
    ours, messages = (
        ElementTree.parse(SOURCE_TREE / file).findtext("version")
        for file in ("package.xml", "msg_defs/package.xml")
    )
    changelog = (SOURCE_TREE / "CHANGELOG.md").read_text(encoding="utf-8")
    assert ours == messages
    assert re.findall(r"^## \[(\d.*?)\]", changelog, re.MULTILINE)[0] == ours
    assert importlib.metadata.version("ff_planner_ros") == ours
    assert importlib.metadata.version("ff_planner_msgs") == ours
    assert importlib.metadata.version("ff_planner_benchmark") == ours
    assert f"ff_planner_ros=={ours}" in importlib.metadata.requires("ff_planner_benchmark")
    citation = yaml.safe_load((SOURCE_TREE / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == ours
    released = f"## [{ours}] - {citation['date-released']}\n"
    assert released in changelog, "run `make version VERSION=...`"
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()


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
        if "extra ==" not in line
        or re.search(r"extra == .(campaign|console|simulation|ros)\b", line)
    }
    foreign = top_level_imports(MODULES) - sys.stdlib_module_names - {"ff_planner_ros"}
    imported = {PIP_NAMES.get(name, name) for name in foreign - ros_packages(foreign)}
    from_ros = {"ff_planner_msgs", "ros-jazzy-common-interfaces", "ros-jazzy-rclpy"}
    for_readers = {"pandas"}  # of the tables that a campaign writes, as the docs do it
    assert declared - for_readers == imported | from_ros


def test_the_benchmark_declares_exactly_the_packages_that_it_imports_and_none_of_ros():
    project = tomllib.loads((BENCHMARK / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    declared = {re.match(r"[\w-]+", line)[0] for line in required}
    foreign = top_level_imports(OF_BENCHMARK) - sys.stdlib_module_names - {"ff_planner_benchmark"}
    assert {PIP_NAMES.get(name, name) for name in foreign} == declared
    names = {name for path in OF_BENCHMARK for name in imports_at_run_time(tree_of(path))}
    assert not set(filter(talks_to_ros, own_modules(names)))


def test_status_codes_are_those_of_the_message():
    text = (SOURCE_TREE / "msg_defs/msg/PlanStatus.msg").read_text(encoding="utf-8")
    written = {
        name: int(value) for name, value in re.findall(r"^uint16 (\w+)=(\d+)", text, re.MULTILINE)
    }
    assert {status.name: status.value for status in errors.Status} == written
    assert {name: getattr(PlanStatus, name) for name in written} == written


@functools.cache
def documented(*kinds):
    """Every definition of these kinds that has a docstring, by where it is."""
    return {
        f"{path.relative_to(SOURCE_TREE)}:{node.lineno} {node.name}": node
        for path in (*MODULES, *OF_BENCHMARK)
        for node in ast.walk(tree_of(path))
        if isinstance(node, kinds) and ast.get_docstring(node)
    }


FUNCTIONS, CLASSES = (ast.FunctionDef, ast.AsyncFunctionDef), (ast.ClassDef,)


def entries(node, title):
    """Each name under a title of a docstring with what is said of it; None without the title."""
    match = re.search(
        rf"^{title}:\n((?:[ ].*\n|\n)*)", ast.get_docstring(node) + "\n", re.MULTILINE
    )
    return match and re.findall(r"^    (\*{0,2}\w+):(.*)", match[1], re.MULTILINE)


def section(node, title):
    """Names described under a title of a docstring; None if there is no such title."""
    found = entries(node, title)
    return found and [name for name, _ in found]


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


def test_a_docstring_lists_only_arguments_of_the_signature_in_its_order():
    violations = []
    for where, function in documented(*FUNCTIONS).items():
        listed = section(function, "Args") or []
        if listed != [name for name in parameters(function) if name in listed]:
            violations.append(f"{where}: {listed}")
    assert violations == []


def test_a_docstring_that_lists_attributes_lists_exactly_those_of_the_class():
    violations = []
    for where, class_definition in documented(*CLASSES).items():
        listed = section(class_definition, "Attributes")
        if listed not in (None, attributes(class_definition)):
            violations.append(f"{where}: {listed}")
    assert violations == []


def test_a_docstring_names_only_exceptions_that_exist():
    violations = []
    for where, definition in documented(*FUNCTIONS, *CLASSES).items():
        for name in section(definition, "Raises") or []:
            exception = getattr(errors, name, getattr(builtins, name, None))
            if not isinstance(exception, type) or not issubclass(exception, BaseException):
                violations.append(f"{where}: {name} is neither in errors.py nor built in")
    assert violations == []


def test_no_argument_is_described_by_its_name_alone():
    violations = []
    for where, function in documented(*FUNCTIONS).items():
        for name, text in entries(function, "Args") or []:
            words = re.sub(r"^(the|an?) ", "", text.strip().lower())
            if re.sub(r"\W+", " ", words).strip() == name.strip("*").replace("_", " "):
                violations.append(f"{where}: {name}:{text}")
    assert violations == []
