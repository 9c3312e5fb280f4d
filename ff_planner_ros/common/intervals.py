"""Observed rates and their confidence intervals, the same in every report."""

from __future__ import annotations

_CONFIDENCE = 0.95


def exact_interval(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % Clopper-Pearson interval of the rate of `count` events in `total` trials.

    Its coverage is at least that for every true rate. Wilson's interval is narrower and
    right on average, but covers less for some rates near 0 and 1: those of violations and of
    successes, on which a mission relies.
    """
    from scipy.special import betaincinv  # slow to load, and most readers of bags need no rate

    outside = (1.0 - _CONFIDENCE) / 2
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, outside))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - outside))
    return low, high


def percent(share: float, digits: int = 1) -> str:
    """Return a share in percent; only none is 0 %, and only all is 100 %."""
    least = 10.0 ** -(digits + 2)
    within = min(max(share, least), 1.0 - least) if 0.0 < share < 1.0 else share
    return f"{within:.{digits}%}"
