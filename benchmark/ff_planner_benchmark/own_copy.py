"""Scenarios as the judge has read them before any method ran; a method gets copies."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ff_planner_benchmark.scorer.files import text_of, yaml_of
from ff_planner_benchmark.scorer.score import load


@dataclass(frozen=True)
class OwnCopy:
    """A scenario and its robot's files, in memory."""

    kind: str
    index: int
    texts: Mapping[str, str]  # by their paths in the data set; empty: they cannot be read

    @property
    def name(self) -> str:
        """The path of the scenario in the data set."""
        return scenario_name(self.kind, self.index)

    @contextmanager
    def written(self) -> Iterator[Path]:
        """Yield the path of the scenario in a directory of its own, which is gone afterwards."""
        with tempfile.TemporaryDirectory(prefix="contest_", ignore_cleanup_errors=True) as place:
            for name, text in self.texts.items():
                path = Path(place, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8", newline="")
            yield Path(place, self.name)

    def loaded(self) -> tuple[dict[str, Any], Any, list[list[str]]]:
        """Return what `load` does for the scorer.

        Raises:
            ValueError: It is no scenario of the data set.
            OSError: It could not be read.
            LookupError: It lacks a value.
            TypeError: It has a value of another type.
            AttributeError: Likewise.
        """
        with self.written() as scenario:
            return load(scenario)


def scenario_name(kind: str, index: int) -> str:
    """Return the path of a scenario in a data set."""
    return f"scenarios/{kind}/{index:04d}.yaml"


def own_copy(directory: Path, kind: str, index: int) -> OwnCopy:
    """Read a scenario of a data set and its robot; on failure the copy is empty."""
    name = scenario_name(kind, index)
    try:
        scenario = text_of(directory / name)
        urdf = (directory / name).parent / yaml_of(scenario)["robot"]["urdf"]
        robot = urdf.resolve().relative_to(directory.resolve())
        texts = {name: scenario}
        for file in (robot, robot.with_suffix(".json")):
            if (directory / file).exists():
                texts[str(file)] = text_of(directory / file)
    except (OSError, ValueError, LookupError, TypeError):
        texts = {}
    return OwnCopy(kind, index, texts)
