"""Study files: what is varied, by which methods it is planned, and what is kept of the plans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ff_planner_ros.baselines import METHODS, OPTIMAL
from ff_planner_ros.campaign.sources import (
    BODIES,
    KINDS,
    Generated,
    Source,
    of_bag,
    require_robot,
    scenario_paths,
    written,
)
from ff_planner_ros.campaign.variations import DRAWN, GRID, SET_VALUES
from ff_planner_ros.common.declared import declare, declared
from ff_planner_ros.common.declared_parts import part, schema_of
from ff_planner_ros.common.forms import (
    DIALECT,
    TEXT,
    TRUTH,
    Schema,
    a_whole_number,
    a_word,
    each,
)
from ff_planner_ros.common.plain_values import text
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.changes import Change, Draw
from ff_planner_ros.planning.scenario.scenario import Defaults

_SOURCES = ("scenarios", "generated", "bag")
# Larger numbers are mistakes: they would take months, or all memory before the first plan. A
# million cases are 37 hours of a core, and their ids 0.3 GB.
_MOST, MOST_CASES = 10_000_000, 1_000_000
_KINDS_TURNED = ("ordinary", "cluttered")
_WITHOUT_BODIES = "off7"


def _robot(field: str, value: object) -> str:
    name = text(field, value)
    require_robot(field, name)
    return name


@dataclass(frozen=True)
class GeneratedSources:
    """Problems that are generated, by kind, robot and seed.

    Raises:
        InvalidInput: The kind has no turned frames, or a robot has no bodies.
    """

    kind: str = declare(a_word(KINDS), "kind of problem")
    robots: tuple[str, ...] = declare(
        each(replace(TEXT, read=_robot), least=1), "lemur, canadarm2, off7, or arm6, arm7, ..."
    )
    count: int = declare(a_whole_number(1, _MOST), "number of problems for each robot")
    first: int = declare(a_whole_number(0, _MOST), "seed of the first problem", default=0)
    turned: bool = declare(TRUTH, "whether the inertial frame is turned", default=False)

    def __post_init__(self) -> None:
        """Refuse combinations that no generator makes."""
        if self.turned and self.kind not in _KINDS_TURNED:
            allowed = f"there are no turned frames of kind {self.kind}"
            raise InvalidInput(Status.UNSUPPORTED, "generated.turned", self.turned, allowed)
        if self.kind == BODIES and _WITHOUT_BODIES in self.robots:
            allowed = "it has no bodies"
            raise InvalidInput(Status.UNSUPPORTED, "generated.robots", _WITHOUT_BODIES, allowed)

    def sources(self) -> Iterator[Source]:
        """Yield a source for each seed and robot."""
        for seed in range(self.first, self.first + self.count):
            for robot in self.robots:
                yield Generated(self.kind, robot, seed, self.turned)


@dataclass(frozen=True, eq=False)
class MethodOfStudy:
    """A method with settings of its own."""

    name: str = declare(TEXT, "name in the table of plans")
    method: str = declare(a_word(METHODS), "method that plans", default=OPTIMAL)
    changes: tuple[Change, ...] = declare(
        SET_VALUES,
        "values of the scenario, for this method alone",
        key="set",
        brief=True,
        default=(),
    )


@dataclass(frozen=True, eq=False)
class Randomly:
    """Random variations: each draw changes all of these values."""

    count: int = declare(a_whole_number(1, _MOST), "number of draws")
    seed: int = declare(a_whole_number(0, _MOST), "seed of the draws")
    # Of each: key, how, distribution, parameters
    values: tuple[tuple[str, str, str, tuple[Any, ...]], ...] = declare(
        DRAWN, "by key, uniform: [low, high], normal: [mean, deviation], or choice: [...]"
    )


@dataclass(frozen=True, eq=False)
class StudyFile:
    """The fields of a study file."""

    scenarios: tuple[str, ...] = declare(
        each(TEXT), "scenario files, relative to this file; * stands for any text", default=()
    )
    generated: GeneratedSources | None = declare(
        part(GeneratedSources),
        "problems of the benchmark, which are known to have a plan",
        default=None,
    )
    bag: str | None = declare(TEXT, "a bag, whose requests are planned again", default=None)
    parameters: str | None = declare(
        TEXT, "the node's parameters: they count where a scenario does not say", default=None
    )
    grid: tuple[tuple[Change, ...], ...] = declare(
        GRID,
        "by key, a list of values, or range: [low, high, count]",
        key="variations.grid",
        default=(),
    )
    random: Randomly = declare(
        part(Randomly),
        "values that are drawn at random",
        key="variations.random",
        default=Randomly(1, 0, ()),
    )
    methods: tuple[MethodOfStudy, ...] = declare(
        each(part(MethodOfStudy), least=1, unique="name"),
        "methods that are compared",
        default=(MethodOfStudy(OPTIMAL),),
    )
    trajectories: bool = declare(
        TRUTH, "whether every point of every plan is kept", key="keep.trajectories", default=False
    )


@dataclass(frozen=True, eq=False)
class Study:
    """A study with its sources read."""

    sources: tuple[Source, ...]
    defaults: Defaults  # of what scenarios leave out
    grid: tuple[tuple[Change, ...], ...]  # for each key one change a value
    random: Randomly
    methods: tuple[MethodOfStudy, ...]
    trajectories: bool  # whether trajectories are kept
    parameters: Path | None  # file of the defaults; None: the package's
    notes: tuple[str, ...]  # on requests of the bag that are left out


def study_schema() -> Schema:
    """Return the JSON Schema of a study file."""
    some = {"anyOf": [{"required": [name]} for name in _SOURCES]}
    return {"$schema": DIALECT, "title": "a study"} | schema_of(declared(StudyFile)) | some


def load_study(path: Path) -> Study:
    """Read a study file; the files that it names are relative to it.

    Raises:
        InvalidInput: The file cannot be read, names what does not exist, or a value is unknown,
            missing or of the wrong type; its `faults` are all that is wrong.
        BagError: The bag cannot be read.
    """
    document, directory = read_yaml(path), path.parent
    told: StudyFile = part(StudyFile).read("", document)
    if not any(name in document for name in _SOURCES):
        found, allowed = "missing", f"a study needs one or more of {', '.join(_SOURCES)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "scenarios", found, allowed)
    parameters = None
    paths = scenario_paths("scenarios", told.scenarios, directory)
    drawn = 0 if told.generated is None else told.generated.count * len(told.generated.robots)
    _require_few(told, len(paths) + drawn + (told.bag is not None))
    defaults = Defaults(load_parameters().planner)
    if told.parameters is not None:
        parameters = directory / told.parameters
        defaults = load_parameters(parameters).of_scenarios()
    sources: list[Source] = [written(one, one.stem, defaults) for one in paths]
    sources += [] if told.generated is None else told.generated.sources()
    notes: tuple[str, ...] = ()
    if told.bag is not None:
        of_requests, notes = of_bag(directory / told.bag, defaults)
        sources += of_requests
    if not sources:
        raise InvalidInput(Status.OUT_OF_RANGE, "scenarios", "empty", "there is nothing to plan")
    _require_few(told, len(sources))
    _require_one_change_a_key(told.grid, told.random, told.methods)
    kept = {name: getattr(told, name) for name in ("grid", "random", "methods", "trajectories")}
    return Study(
        sources=tuple(sources), defaults=defaults, parameters=parameters, notes=notes, **kept
    )


def _require_few(told: StudyFile, sources: int) -> None:
    """Refuse a study of too many cases, before they take memory."""
    count = sources * math.prod(map(len, told.grid)) * told.random.count * len(told.methods)
    if count > MOST_CASES:
        allowed = f"a campaign has {MOST_CASES} cases at most"
        raise InvalidInput(Status.OUT_OF_RANGE, "variations", f"{count} cases", allowed)


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


def random_changes(random: Randomly, draw: int) -> tuple[Change, ...]:
    """Return the changes of a draw, by its number; they do not depend on other variations."""
    return tuple(
        Change(key, how, Draw(distribution, parameters, random.seed, draw))
        for key, how, distribution, parameters in random.values
    )
