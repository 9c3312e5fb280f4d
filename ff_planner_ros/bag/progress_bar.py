"""The progress of work that takes long, on stderr: a bar on a terminal, else lines."""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PATIENCE, _PERIOD = 2.0, 0.1  # [s] before the bar appears; between its pictures
_LINES = 60.0  # [s] between two lines where nobody watches, as in a log
_WIDTH = 40  # [characters]


@contextmanager
def progress_bar(
    doing: str, total: int, unit: str = "MB", per_unit: float = 1e6
) -> Iterator[Callable[[int], None]]:
    """Yield a function to call with every amount of work done.

    Args:
        doing: Text in front of the bar.
        total: Amount of all work, such as bytes.
        unit: Unit in which the bar shows amounts.
        per_unit: Amount that makes one unit.
    """
    on_terminal = sys.stderr.isatty()
    # Bars of several processes would write over each other.
    is_alone = multiprocessing.parent_process() is None
    begun = time.monotonic()
    done, due, shown = 0, begun + (_PATIENCE if on_terminal else _LINES), False

    def advance(more: int) -> None:
        nonlocal done, due, shown
        done += more
        now = time.monotonic()
        if not is_alone or now < due:
            return
        shown, due = True, now + (_PERIOD if on_terminal else _LINES)
        words = f"{done / per_unit:.0f} of {total / per_unit:.0f} {unit}{left(now)}"
        if on_terminal:
            filled = round(_WIDTH * min(1.0, done / max(total, 1)))
            bar = "#" * filled + "." * (_WIDTH - filled)
            print(f"\r\033[K{doing} [{bar}] {words}", end="", file=sys.stderr, flush=True)
        else:
            print(f"{doing} {words}", file=sys.stderr, flush=True)

    def left(now: float) -> str:
        if not done:
            return ""
        minutes, seconds = divmod(round((total - done) * (now - begun) / done), 60)
        return f", {minutes} min {seconds:02d} s left"

    try:
        yield advance
    finally:
        if shown and on_terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
