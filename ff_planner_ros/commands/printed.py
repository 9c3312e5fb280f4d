"""Output of commands: notes beside a result, names and values, JSON."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ff_planner_ros.analysis.json_file import json_text
from ff_planner_ros.common.shown import in_log, printable


def print_notes(notes: Sequence[str]) -> None:
    """Print notes beside a result, on stderr."""
    for note in notes:
        print(f"ff-planner: note: {in_log(note)}", file=sys.stderr)


def print_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {printable(value, len(value))}")


def write_json(file: Path | None, answer: dict[str, Any]) -> None:
    """Write an answer as JSON, if a file is named."""
    if file is not None:
        file.write_text(json_text(answer) + "\n", encoding="utf-8")
