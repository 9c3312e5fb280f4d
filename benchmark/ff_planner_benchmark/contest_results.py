"""Results of methods on the data set: their file and their tables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_benchmark.scorer.score import Score
from ff_planner_ros.analysis.json_file import json_text, read_json
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.shown import printable
from ff_planner_ros.errors import InvalidInput, Status

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


@dataclass(frozen=True)
class Result:
    """The result of a method on one scenario."""

    method: str
    kind: str
    index: int
    seconds: float  # processor time [s]
    score: Score


class Kept:
    """The file of results: written after each, so that a run which was stopped can go on."""

    def __init__(self, file: Path | None, dataset_hash: str, seconds: float) -> None:
        """Set the file, which need not exist yet (None: nothing is kept), and its conditions."""
        self.file = file
        self.of = {"dataset": dataset_hash, "seconds": seconds}

    def read(self) -> list[Result]:
        """Return the results in the file.

        Raises:
            InvalidInput: The file is malformed, or of another data set or processor time.
        """
        if self.file is None or not self.file.exists():
            return []
        allowed = f"it exists and does not hold answers with {self.of}; give another file"
        content = read_json(self.file)
        try:
            if {name: content[name] for name in self.of} != self.of:
                raise InvalidInput(Status.UNSUPPORTED, "--json", self.file, allowed)
            return [_from_json(one) for one in content["answers"]]
        except (KeyError, TypeError):
            raise InvalidInput(Status.UNSUPPORTED, "--json", self.file, allowed) from None

    def write(self, done: Sequence[Result]) -> None:
        """Replace the file by one with all results."""
        if self.file is not None:
            text = json_text(self.of | {"answers": [asdict(one) for one in done]}, indent=1)
            beside = self.file.with_name(f"{self.file.name}.part")
            beside.write_text(text + "\n", encoding="utf-8")
            beside.replace(self.file)


def _from_json(one: dict[str, Any]) -> Result:
    judged = one["score"] | {"faults": tuple(one["score"]["faults"])}
    return Result(**(one | {"score": Score(**judged)}))


def reasons(done: Sequence[Result], most: int) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `REASONS_HEADER`: why answers do not count, the most frequent first.

    Args:
        most: Largest number of reasons of a method.
    """
    for method in dict.fromkeys(one.method for one in done):
        found = dict[str, list[tuple[Result, str]]]()
        for one in done:
            for fault in one.score.faults if one.method == method else ():
                what = _NUMBER.sub("_", fault.partition(";")[0])  # details come after it
                found.setdefault(what, []).append((one, fault))
        by_frequency = sorted(found.values(), key=len, reverse=True)
        for those in by_frequency[:most]:
            first, fault = those[0]
            example = f"{first.kind}/{first.index:04d}"
            told = " ".join(fault.split())  # a method's own words may be among them
            yield method, f"{len(those)}", example, printable(told, len(told))
        if (more := len(by_frequency) - most) > 0:
            yield method, "", "", f"and {more} more, which --json FILE has"


REASONS_HEADER = ("method", "answers", "for example", "it does not count there because")

HEADER = (
    *("method", "class", "scenarios", "solved", "processor time, median [s]", "95 % [s]"),
    *("least clearance [mm]", "miss, median [mm]", "worst [mm]"),
    *("joint path / first", "attitude / first"),
)


def rows(done: Sequence[Result]) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `HEADER` for each method and class.

    The last two columns are medians of ratios to the first method, over what both solve. Clearance
    is the least of solved scenarios; the miss is that of every motion, solved or not.
    """
    first = {(r.kind, r.index): r.score for r in done if r.method == done[0].method}
    for method in dict.fromkeys(r.method for r in done):
        for kind in (*dict.fromkeys(r.kind for r in done), "all"):
            group = [r for r in done if r.method == method and kind in (r.kind, "all")]
            solved = [r for r in group if r.score.solved]
            times = [r.seconds for r in group if np.isfinite(r.seconds)]
            clear = [r.score.clearance for r in solved if r.score.clearance is not None]
            misses = [1e3 * r.score.miss for r in group if r.score.miss is not None]
            both = [(r.score, first[r.kind, r.index]) for r in solved]
            both = [(mine, other) for mine, other in both if other.solved]
            yield (
                *(method, kind, f"{len(group)}", percent(len(solved) / len(group))),
                f"{np.median(times):.2f}" if times else "-",
                f"{np.quantile(times, 0.95):.2f}" if times else "-",
                f"{1e3 * min(clear):.2f}" if clear else "-",
                *((f"{np.median(misses):.3f}", f"{max(misses):.3f}") if misses else "--"),
                *(_ratio(both, name) for name in ("joint_path", "attitude")),
            )


def _ratio(both: list[tuple[Score, Score]], name: str) -> str:
    pairs = [(getattr(mine, name), getattr(other, name)) for mine, other in both]
    return f"{np.median([mine / other for mine, other in pairs if other]):.2f}" if pairs else "-"
