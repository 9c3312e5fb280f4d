"""Sources of a study's cases: scenario files, requests in a bag, problems drawn from seeds."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import yaml

from ff_planner_ros.common.yaml_file import located, read_yaml
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import described_problem, write_scenario
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems import bodies, scenarios
from ff_planner_ros.robot.collision.geometry import Geometry

BODIES = "bodies"
KINDS = (*scenarios.KINDS, BODIES)

# Arms with fewer joints cannot reach a pose, those with more are for nobody.
_ROBOT = re.compile(r"lemur|canadarm2|off7|arm([6-9]|[12][0-9]|30)")
# Blocks of a scenario that may name files, and the keys that do.
_IN_THE_WAY, _OF_FILES = ("obstacles", "target_body"), frozenset({"file", "urdf"})
_MOST_FILES = 10_000  # that a pattern stands for
# How a scenario and its URDF are called in a directory of their own.
SCENARIO, URDF = "scenario.yaml", "scenario.urdf"


@dataclass(frozen=True, eq=False)
class Written:
    """A scenario file and all files that it names, read into memory."""

    name: str
    document: dict[str, Any]  # its robot's URDF is `URDF`
    urdf: str
    digest: str  # of the task

    @property
    def key(self) -> str:
        """The source's part of a case's id."""
        return f"{self.name} {self.digest}"


@dataclass(frozen=True)
class Generated:
    """A problem of the benchmark, drawn where it is planned; it is known to have a plan."""

    kind: str  # of `KINDS`
    robot: str  # as `bench_robot` knows it
    number: int  # its seed
    turned: bool  # whether it is the twin in a rotated inertial frame; see `problems.scenarios`

    @property
    def name(self) -> str:
        """Kind, robot and number."""
        return f"{self.kind}/{self.robot}/{self.number}" + ("/turned" if self.turned else "")

    @property
    def key(self) -> str:
        """The source's part of a case's id."""
        return self.name


Source: TypeAlias = Written | Generated


def generated_by_name(name: str) -> Generated:
    """Return the generated problem of a name.

    Raises:
        InvalidInput: No generated problem has this name.
    """
    kind, robot, number, turned = (*name.split("/"), "", "", "", "")[:4]
    if kind not in KINDS or not number.isdecimal() or turned not in ("", "turned"):
        allowed = "what the campaign kept of its scenarios is not there any more"
        raise InvalidInput(Status.OUT_OF_RANGE, "scenario", name, allowed)
    return Generated(kind, robot, int(number), bool(turned))


def content(source: Source, defaults: Defaults) -> tuple[dict[str, Any], str]:
    """Return the scenario of a source, as in YAML, and its URDF.

    Raises:
        InvalidInput: No problem that was drawn for the robot has a plan.
    """
    if isinstance(source, Written):
        return source.document, source.urdf
    return _drawn(source, defaults)


def written(path: Path, name: str, defaults: Defaults) -> Written:
    """Return a scenario file as a source.

    Raises:
        InvalidInput: The scenario is refused, or its robot needs more than its URDF.
    """
    try:
        task = load_task(path, defaults)
    except InvalidInput as error:
        raise located(path, error) from None
    robot, document = task.problem.robot, read_yaml(path)
    entry = {
        key: document["robot"][key]
        for key in ("base", "base_link", "tip_link")
        if key in document["robot"]
    }
    # What is handed on of the URDF says itself which joints are held and which links may touch;
    # with lines it has no bodies, which then is the default.
    document["robot"] = {"urdf": URDF, **entry}
    if robot.geometry is Geometry.SHAPES:
        document["robot"]["geometry"] = robot.geometry.value
    told = described_problem(task.problem)
    document |= {key: told[key] for key in _IN_THE_WAY if _names_files(document.get(key))}
    digest = task.digest
    if task_of(document, robot.drawn_urdf, defaults).digest != digest:
        allowed = "its URDF alone must describe its robot"
        raise InvalidInput(Status.UNSUPPORTED, f"{path}: robot", "of another kind", allowed)
    return Written(name, document, robot.drawn_urdf, digest)


def names_files(document: dict[str, Any]) -> bool:
    """Tell whether a scenario that a campaign kept names another file than its URDF."""
    robot = {name: of for name, of in document["robot"].items() if (name, of) != ("urdf", URDF)}
    return "srdf" in robot or _names_files(document | {"robot": robot})


def _names_files(value: Any) -> bool:
    """Tell whether a block of a scenario names a mesh or a URDF, which no worker has."""
    if isinstance(value, dict):
        return not _OF_FILES.isdisjoint(value) or any(map(_names_files, value.values()))
    return isinstance(value, list) and any(map(_names_files, value))


def scenario_paths(field: str, names: Sequence[str], directory: Path) -> list[Path]:
    """Return the scenario files that names or patterns stand for; no file is read.

    Raises:
        InvalidInput: A name stands for no file, or for too many; two files have one stem.
    """
    found = [
        path
        for place, named in enumerate(names)
        for path in _paths(f"{field}[{place}]", named, directory)
    ]
    require_unique(path.stem for path in found)
    return found


def _paths(field: str, named: str, directory: Path) -> list[Path]:
    """Return the scenario files that a name stands for.

    Raises:
        InvalidInput: It stands for none, or for more than a study may have.
    """
    reason, paths = "there is no such file", [directory / named]
    try:
        if "**" in named:
            paths, reason = [], "* stands for any text of one name, and ** for nothing"
        elif "*" in named:
            root = Path(named).anchor
            found = (Path(root) if root else directory).glob(named.removeprefix(root))
            paths = sorted(islice(found, _MOST_FILES + 1))
        if len(paths) > _MOST_FILES:
            paths, reason = [], f"it stands for more than {_MOST_FILES} files"
        if paths and all(path.is_file() for path in paths):
            return paths
    except (OSError, ValueError, NotImplementedError, RecursionError) as error:
        reason = f"it stands for no file: {error}"  # no pattern, or a name that no file can have
    raise InvalidInput(Status.OUT_OF_RANGE, field, named, reason)


def require_unique(names: Iterable[str]) -> None:
    """Refuse sources of equal names, whose rows could not be told apart.

    Raises:
        InvalidInput: Two have the same name.
    """
    name, count = max(Counter(names).items(), key=itemgetter(1), default=("", 0))
    if count > 1:
        allowed = "each scenario must have a name of its own"
        raise InvalidInput(Status.OUT_OF_RANGE, "scenarios", name, allowed)


def task_of(document: dict[str, Any], urdf: str, defaults: Defaults) -> PlanningTask:
    """Return the task of a scenario, read from a file as every command reads it.

    Raises:
        InvalidInput: The scenario is refused.
    """
    with TemporaryDirectory(prefix="ff_planner_") as directory:
        return load_task(write(document, urdf, Path(directory)), defaults)


def write(document: dict[str, Any], urdf: str, directory: Path) -> Path:
    """Write a scenario and its URDF to a directory, and return the path of the scenario.

    Raises:
        OSError: They cannot be written.
    """
    (directory / URDF).write_text(urdf, encoding="utf-8", newline="")
    path = directory / SCENARIO
    text = yaml.safe_dump(document, default_flow_style=None, sort_keys=False, allow_unicode=True)
    path.write_text(text, encoding="utf-8")
    return path


def of_bag(bag: Path, defaults: Defaults) -> tuple[list[Written], tuple[str, ...]]:
    """Return the requests in a bag as sources, and notes on what is left out. This needs ROS.

    Raises:
        BagError: It cannot be read, or holds no request.
        InvalidInput: The URDF in it is refused.
    """
    from ff_planner_ros.runs.export_scenarios import export_scenarios

    with TemporaryDirectory(prefix="ff_planner_") as directory:
        place = Path(directory, "requests")
        notes = export_scenarios(bag, place)
        return [
            written(p, f"{bag.name}/{p.stem}", defaults) for p in sorted(place.glob("*.yaml"))
        ], notes


def require_robot(field: str, name: str) -> None:
    """Refuse a robot for which no problems are generated.

    Raises:
        InvalidInput: The name is of no such robot.
    """
    if not _ROBOT.fullmatch(name):
        allowed = "it must be lemur, canadarm2, off7, or an arm by its joints: arm6 to arm30"
        raise InvalidInput(Status.OUT_OF_RANGE, field, name, allowed)


@cache
def _drawn(source: Generated, defaults: Defaults) -> tuple[dict[str, Any], str]:
    """Draw a problem; the cases that vary it share it."""
    if source.kind == BODIES:
        problem = bodies.problem(source.robot, source.number).problem
    else:
        drawn = scenarios.scenario(source.kind, source.robot, source.number, turned=source.turned)
        problem = drawn.problem
    with TemporaryDirectory(prefix="ff_planner_") as directory:
        path = Path(directory, SCENARIO)
        write_scenario(PlanningTask(problem, defaults.settings), path)
        return read_yaml(path), path.with_suffix(".urdf").read_text(encoding="utf-8")
