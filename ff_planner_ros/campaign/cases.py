"""The cases of a study: every source, at every point of the grid, by every draw and method."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from ff_planner_ros.campaign.sources import Generated, Source, content, task_of
from ff_planner_ros.campaign.study import MethodOfStudy, Study, random_changes
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.scenario.changes import Change, Draw, changed
from ff_planner_ros.planning.scenario.scenario import Defaults

_DIGITS = 16  # of an id
# If none of so many draws can be read, the study is refused: that is hardly chance.
_DRAWS_TRIED = 10


@dataclass(frozen=True, eq=False)
class Case:
    """One plan to be made, with all that a worker needs for it."""

    number: int  # in the study
    source: Source
    defaults: Defaults
    changes: tuple[Change, ...]
    method: MethodOfStudy
    trajectory: bool  # whether the plan's trajectory is kept

    @property
    def id(self) -> str:
        """A hash of source, changes and method: equal cases have equal ids, in every study."""
        method = self.method
        described = [
            self.source.key,
            repr(self.defaults),
            [change.described() for change in self.changes],
            [method.name, method.method, [change.described() for change in method.changes]],
        ]
        text = json.dumps(described, sort_keys=True, default=str)
        return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:_DIGITS]

    @property
    def is_drawn(self) -> bool:
        """Whether the case is random: a success rate of such cases has a confidence interval."""
        drawn = any(isinstance(change.value, Draw) for change in self.changes)
        return drawn or isinstance(self.source, Generated)

    def scenario(self) -> tuple[dict[str, Any], str, dict[str, Any]]:
        """Return scenario and URDF of the case, and the values that it varies, by key.

        Raises:
            InvalidInput: A change does not fit the scenario or the URDF; see `changed`.
        """
        document, urdf = content(self.source, self.defaults)
        document, urdf, values = changed(document, urdf, self.changes)
        document, urdf, _ = changed(document, urdf, self.method.changes)
        return document, urdf, values


def cases(study: Study) -> Iterator[Case]:
    """Yield every case once, always in the same order."""
    seen: set[str] = set()
    number = 0
    for source in study.sources:
        for point in itertools.product(*study.grid):
            for draw in range(study.random.count):
                changes = (*point, *random_changes(study.random, draw))
                for method in study.methods:
                    case = Case(number, source, study.defaults, changes, method, study.trajectories)
                    number += 1
                    if case.id not in seen:
                        seen.add(case.id)
                        yield case


def require_sound(study: Study) -> None:
    """Refuse a study if the first cases of a source and method cannot be read.

    Later cases that cannot be read are rows of the table, as every refusal is.

    Raises:
        InvalidInput: They cannot; the error names the source.
    """
    for source in _one_of_each(study):
        for method in study.methods:
            point = tuple(axis[0] for axis in study.grid)
            _require_task(Case(0, source, study.defaults, point, method, False))
            if study.random.values:
                _require_a_draw(study, source, point, method)


def _one_of_each(study: Study) -> Collection[Source]:
    """Return the sources; of drawn problems, which have the same keys, one of a kind and robot."""
    return {
        getattr(s, "digest", (getattr(s, "kind", ""), getattr(s, "robot", ""))): s
        for s in study.sources
    }.values()


def _require_a_draw(
    study: Study, source: Source, point: tuple[Change, ...], method: MethodOfStudy
) -> None:
    for draw in range(_DRAWS_TRIED):
        changes = (*point, *random_changes(study.random, draw))
        try:
            _require_task(Case(0, source, study.defaults, changes, method, False))
        except InvalidInput as error:
            refused = error
        else:
            return
    raise refused


def _require_task(case: Case) -> None:
    try:
        document, urdf, _ = case.scenario()
        task_of(document, urdf, case.defaults)
    except InvalidInput as error:
        field = f"{case.source.name}, varied: {error.field}"
        raise InvalidInput(error.status, field, error.value, error.allowed) from None


def kinds_of_values(study: Study) -> dict[str, str]:
    """Return the type of each varied key's values: `number`, `numbers` or `text`."""
    explicit: dict[str, set[str]] = {}
    for axis in study.grid:
        explicit[axis[0].key] = {kind_of(c.value) for c in axis if c.how == "set"}
    for change in random_changes(study.random, 0):
        drawn = change.value
        if isinstance(drawn, Draw) and drawn.distribution == "choice" and change.how == "set":
            explicit[change.key] = {kind_of(one) for one in drawn.parameters}
        else:
            explicit[change.key] = set()
    open_keys = {key for key, kinds in explicit.items() if not kinds}
    point = tuple(axis[0] for axis in study.grid)
    for source in _one_of_each(study):
        changes = (*point, *random_changes(study.random, 0))
        case = Case(0, source, study.defaults, changes, study.methods[0], False)
        for key, value in case.scenario()[2].items():
            if key in open_keys:
                explicit[key].add(kind_of(value))
    return {key: kinds.pop() if len(kinds) == 1 else "text" for key, kinds in explicit.items()}


def kind_of(value: Any) -> str:
    """Return the type of a value: `number`, `numbers` or `text`."""
    if isinstance(value, bool):
        return "text"
    if isinstance(value, int | float):
        return "number"
    if isinstance(value, list) and all(kind_of(one) == "number" for one in value):
        return "numbers"
    return "text"
