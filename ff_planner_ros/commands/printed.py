"""Output of commands: notes beside a result, names and values, JSON."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.common.shown import in_log, printable


def print_notes(notes: Sequence[str]) -> None:
    """Print notes beside a result, on stderr."""
    for note in notes:
        print(f"ff-planner: note: {in_log(note)}", file=sys.stderr)


def print_table(rows: Sequence[tuple[str, str]], columns: int | None = None) -> None:
    """Print names and values in two columns.

    Args:
        columns: Longer lines are wrapped, but for words that are longer. None: none is.
    """
    names = [printable(name, len(name)) for name, _ in rows]
    width = max(map(len, names))
    if columns is not None:
        width = min(width, columns // 4)
    for name, (_, value) in zip(names, rows, strict=True):
        told = printable(value, len(value))
        lines = [told] if columns is None else _wrapped(told, columns - width - 2)
        first = [name] if len(name) > width else [f"{name:{width}}  {lines.pop(0)}"]
        print("\n".join([*first, *(f"{'':{width}}  {line}" for line in lines)]))


def _wrapped(text: str, columns: int) -> list[str]:
    return wrap(text, columns, break_long_words=False, break_on_hyphens=False) or [""]


def write_json(file: Path | None, answer: dict[str, Any]) -> None:
    """Write an answer as JSON, if a file is named."""
    if file is not None:
        file.write_text(json_text(answer) + "\n", encoding="utf-8")
