"""What commands print: notes beside a result, names and values."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def print_notes(notes: Sequence[str]) -> None:
    """Print what a user should know beside the result."""
    for note in notes:
        print(f"ff-planner: note: {note}", file=sys.stderr)


def print_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value}")
