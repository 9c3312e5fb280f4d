"""The confidence interval of a rate that was seen, the same wherever a rate is told."""

from __future__ import annotations

CONFIDENCE = 0.95


def exact_interval(count: int, total: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson for a rate, by the beta distribution.

    It holds the true rate at least as often as `confidence` says, whatever that rate is. Wilson's
    is narrower and right on average, but holds less than it says for some rates near 0 and 1:
    those of violations and of successes, on which a mission relies.
    """
    from scipy.special import betaincinv  # slow to load, and most readers of bags tell no rate

    outside = (1.0 - confidence) / 2
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, outside))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - outside))
    return low, high
