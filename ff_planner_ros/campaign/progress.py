"""The progress of a campaign on stderr: plans, rate and time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_WIDTH = 30  # [characters]
# [s] between two pictures on a terminal, and between two lines where nobody watches, as in a log
_PERIOD, _LINES = 0.5, 60.0


@contextmanager
def progress(total: int) -> Iterator[Callable[[int], None]]:
    """Yield a function to call with the number of new plans; it prints the progress."""
    on_terminal = sys.stderr.isatty()
    period = _PERIOD if on_terminal else _LINES
    begun = time.monotonic()
    done, due = 0, begun + period

    def advance(more: int) -> None:
        nonlocal done, due
        done += more
        now = time.monotonic()
        if now < due:
            return
        due = now + period
        words = told(done, total, now - begun)
        if on_terminal:
            filled = _WIDTH * done // max(total, 1)
            bar = "#" * filled + "." * (_WIDTH - filled)
            print(f"\r\033[K[{bar}] {words}", end="", file=sys.stderr, flush=True)
        else:
            print(words, file=sys.stderr, flush=True)

    try:
        yield advance
    finally:
        if on_terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def told(done: int, total: int, seconds: float) -> str:
    """Return the number of plans, the rate and the time left, in words."""
    words = f"{done} of {total} plans"
    if not done or seconds <= 0.0:
        return words
    left = round((total - done) * seconds / done)
    hours, minutes = left // 3600, left % 3600 // 60
    clock = f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {left % 60:02d} s"
    return f"{words}, {done / seconds:.1f} a second, {clock} left"
