"""A progress bar for work that takes long, if standard error is a terminal."""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PATIENCE, _PERIOD = 2.0, 0.1  # [s] before it appears; between its pictures
_WIDTH = 40  # [characters]


@contextmanager
def progress_bar(
    doing: str, total: int, unit: str = "MB", per_unit: float = 1e6
) -> Iterator[Callable[[int], None]]:
    """Yield a function to call with every amount of work done; the bar is on standard error.

    Args:
        doing: Text in front of the bar.
        total: Amount of all work, such as bytes.
        unit: Unit in which the bar shows amounts.
        per_unit: Amount that makes one unit.
    """
    done = 0
    shown = False
    due = time.monotonic() + _PATIENCE

    def advance(more: int) -> None:
        nonlocal done, shown, due
        done += more
        # Bars of several processes would write over each other.
        is_alone = multiprocessing.parent_process() is None
        if is_alone and sys.stderr.isatty() and time.monotonic() >= due:
            shown, due = True, time.monotonic() + _PERIOD
            filled = round(_WIDTH * min(1.0, done / max(total, 1)))
            bar = "#" * filled + "." * (_WIDTH - filled)
            words = f"{doing} [{bar}] {done / per_unit:.0f} of {total / per_unit:.0f} {unit}"
            print(f"\r{words}", end="", file=sys.stderr, flush=True)

    try:
        yield advance
    finally:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
