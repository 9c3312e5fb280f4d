"""Study files: what is varied, by which methods it is planned, and what is kept of the plans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ff_planner_ros.campaign.changes import (
    CHOICE,
    NORMAL,
    PLUS,
    SET,
    TIMES,
    UNIFORM,
    Change,
    Draw,
    require_key,
)
from ff_planner_ros.campaign.methods import METHODS, OPTIMAL
from ff_planner_ros.campaign.sources import (
    KINDS,
    Generated,
    Source,
    of_bag,
    require_robot,
    written,
)
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario import Defaults
from ff_planner_ros.planning.yaml_file import (
    boolean,
    integer,
    mapping,
    number,
    read_yaml,
    sequence,
    text,
)
from ff_planner_ros.shown import quoted

_SOURCES = ("scenarios", "generated", "bag")
_DISTRIBUTIONS = (UNIFORM, NORMAL, CHOICE)
# Larger numbers are mistakes: they would take months, or all memory before the first plan.
_MOST = 10_000_000


@dataclass(frozen=True, eq=False)
class MethodOfStudy:
    """A method with settings of its own."""

    name: str  # in the table of plans
    method: str  # of `METHODS`
    changes: tuple[Change, ...]  # of the scenario, for this method alone


@dataclass(frozen=True, eq=False)
class Randomly:
    """What is drawn at random: each draw changes all of these values."""

    count: int  # draws
    seed: int
    values: tuple[tuple[str, str, str, tuple[Any, ...]], ...]  # key, how, distribution, parameters


@dataclass(frozen=True, eq=False)
class Study:
    """What a study file says."""

    sources: tuple[Source, ...]
    defaults: Defaults  # of what scenarios leave out
    grid: tuple[tuple[Change, ...], ...]  # for each key one change a value
    random: Randomly
    methods: tuple[MethodOfStudy, ...]
    trajectories: bool  # whether they are kept
    parameters: Path | None  # where the defaults are from; None: the parameters that come along
    notes: tuple[str, ...]  # on what is left out


def load_study(path: Path) -> Study:
    """Read a study file; the files that it names are relative to it.

    Raises:
        InvalidInput: It cannot be read, names what does not exist, or a value is unknown, missing
            or of the wrong type.
        BagError: Its bag cannot be read.
    """
    optional = (*_SOURCES, "parameters", "variations", "methods", "keep")
    study = mapping("", read_yaml(path), (), optional=optional)
    if not any(name in study for name in _SOURCES):
        found, allowed = "missing", f"a study needs one or more of {', '.join(_SOURCES)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "scenarios", found, allowed)
    directory, parameters = path.parent, None
    defaults = Defaults(load_parameters().planner)
    if "parameters" in study:
        parameters = directory / text("parameters", study["parameters"])
        defaults = load_parameters(parameters).of_scenarios()
    variations = mapping("variations", study.get("variations", {}), (), ("grid", "random"))
    keep = mapping("keep", study.get("keep", {}), (), ("trajectories",))
    sources = list(_scenarios(study.get("scenarios", []), directory, defaults))
    sources += _generated(study["generated"]) if "generated" in study else []
    notes: tuple[str, ...] = ()
    if "bag" in study:
        of_requests, notes = of_bag(directory / text("bag", study["bag"]), defaults)
        sources += of_requests
    if not sources:
        raise InvalidInput(Status.OUT_OF_RANGE, "scenarios", "empty", "there is nothing to plan")
    grid, random = _grid(variations.get("grid", {})), _random(variations.get("random"))
    methods = _methods(study.get("methods", [{"name": OPTIMAL}]))
    _require_one_change_a_key(grid, random, methods)
    points = math.prod(map(len, grid))
    if (count := len(sources) * points * random.count * len(methods)) > _MOST:
        allowed = f"a campaign has {_MOST} cases at most"
        raise InvalidInput(Status.OUT_OF_RANGE, "variations", f"{count} cases", allowed)
    return Study(
        sources=tuple(sources),
        defaults=defaults,
        grid=grid,
        random=random,
        methods=methods,
        trajectories=boolean("keep.trajectories", keep.get("trajectories", False)),
        parameters=parameters,
        notes=notes,
    )


def _scenarios(value: object, directory: Path, defaults: Defaults) -> Iterator[Source]:
    for place, entry in enumerate(sequence("scenarios", value)):
        field = f"scenarios[{place}]"
        named = text(field, entry)
        paths = [directory / named]
        if "*" in named:
            root = Path(named).anchor
            paths = sorted((Path(root) if root else directory).glob(named.removeprefix(root)))
        if not paths or not all(path.is_file() for path in paths):
            raise InvalidInput(Status.OUT_OF_RANGE, field, named, "there is no such file")
        for path in paths:
            yield written(path, path.stem, defaults)


def _generated(value: object) -> Iterator[Source]:
    optional = ("first", "turned")
    entry = mapping("generated", value, ("kind", "robots", "count"), optional)
    kind = text("generated.kind", entry["kind"])
    if kind not in KINDS:
        allowed = f"it must be {', '.join(KINDS)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "generated.kind", kind, allowed)
    robots = [text("generated.robots", name) for name in _list("generated.robots", entry["robots"])]
    for name in robots:
        require_robot(name)
    first = _whole("generated.first", entry.get("first", 0), 0)
    count = _whole("generated.count", entry["count"], 1)
    turned = boolean("generated.turned", entry.get("turned", False))
    if turned and kind not in ("ordinary", "cluttered"):
        allowed = f"there are no turned frames of kind {kind}"
        raise InvalidInput(Status.UNSUPPORTED, "generated.turned", turned, allowed)
    for seed in range(first, first + count):
        for robot in robots:
            yield Generated(kind, robot, seed, turned)


def _grid(value: object) -> tuple[tuple[Change, ...], ...]:
    axes = []
    for key, given in _by_key("variations.grid", value):
        field = f"variations.grid.{key}"
        how, values = _how(field, given)
        axes.append(tuple(Change(key, how, one) for one in _list(field, values)))
    return tuple(axes)


def _random(value: object) -> Randomly:
    field = "variations.random"
    if value is None:
        return Randomly(1, 0, ())
    entry = mapping(field, value, ("count", "seed", "values"))
    values = []
    for key, given in _by_key(f"{field}.values", entry["values"]):
        of_key = f"{field}.values.{key}"
        how, drawn = _how(of_key, given)
        values.append((key, how, *_distribution(of_key, drawn)))
    count = _whole(f"{field}.count", entry["count"], 1)
    return Randomly(count, _whole(f"{field}.seed", entry["seed"], 0), tuple(values))


def _how(field: str, given: object) -> tuple[str, Any]:
    """Return whether values replace, multiply or add to what is there, and the values."""
    if isinstance(given, dict) and len(given) == 1 and {TIMES, PLUS} & given.keys():
        return next(iter(given.items()))
    if isinstance(given, dict) and not set(_DISTRIBUTIONS) & given.keys():
        mapping(field, given, (), (TIMES, PLUS, *_DISTRIBUTIONS))
    return SET, given


def _distribution(field: str, value: object) -> tuple[str, tuple[Any, ...]]:
    entry = mapping(field, value, (), _DISTRIBUTIONS)
    if len(entry) != 1:
        allowed = f"it must be one of {', '.join(_DISTRIBUTIONS)}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    ((name, given),) = entry.items()
    parameters = _list(f"{field}.{name}", given)
    if name == CHOICE:
        return name, tuple(parameters)
    numbers = [number(f"{field}.{name}", one) for one in parameters]
    allowed = {
        UNIFORM: "it must be a lower bound and a higher one",
        NORMAL: "it must be a mean and a standard deviation, which is not negative",
    }[name]
    low, high = numbers if len(numbers) == 2 else (0.0, -1.0)
    if not (-1e12 < low < 1e12) or not (low if name == UNIFORM else 0.0) <= high < 1e12:
        raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.{name}", quoted(given), allowed)
    return name, (low, high)


def _methods(value: object) -> tuple[MethodOfStudy, ...]:
    methods: dict[str, MethodOfStudy] = {}
    for place, given in enumerate(_list("methods", value)):
        field = f"methods[{place}]"
        entry = mapping(field, given, ("name",), ("method", "set"))
        name = text(f"{field}.name", entry["name"])
        method = text(f"{field}.method", entry.get("method", OPTIMAL))
        if method not in METHODS:
            allowed = f"it must be {', '.join(METHODS)}"
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.method", method, allowed)
        if name in methods:
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.name", name, "it must be unique")
        changes = tuple(
            Change(key, SET, one) for key, one in _by_key(f"{field}.set", entry.get("set", {}))
        )
        methods[name] = MethodOfStudy(name, method, changes)
    return tuple(methods.values())


def _require_one_change_a_key(
    grid: tuple[tuple[Change, ...], ...], random: Randomly, methods: tuple[MethodOfStudy, ...]
) -> None:
    """Refuse a key that is varied twice, or that a method sets, too: only the last would count."""
    varied = [axis[0].key for axis in grid] + [value[0] for value in random.values]
    for method in methods:
        for key in (*varied, *(change.key for change in method.changes)):
            if [*varied, *(change.key for change in method.changes)].count(key) > 1:
                allowed = "it must be in one of grid, random and what a method sets"
                raise InvalidInput(Status.OUT_OF_RANGE, key, "varied twice", allowed)


def _by_key(field: str, value: object) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict):
        allowed = "it must hold values by keys of a scenario, such as planner.starts"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    for key, given in value.items():
        yield require_key(field, key), given


def _list(field: str, value: object) -> list[Any]:
    if not (found := sequence(field, value)):
        raise InvalidInput(Status.WRONG_SIZE, field, "empty", "it must have one entry or more")
    return found


def _whole(field: str, value: object, least: int) -> int:
    found = integer(field, value)
    if not least <= found <= _MOST:
        allowed = f"it must be from {least} to {_MOST}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, found, allowed)
    return found


def random_changes(random: Randomly, draw: int) -> tuple[Change, ...]:
    """Return what one draw changes: whatever else is varied, it is the same."""
    return tuple(
        Change(key, how, Draw(distribution, parameters, random.seed, draw))
        for key, how, distribution, parameters in random.values
    )
