"""A published number beside ours."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Compared:
    """A number as printed, and ours of the same motion."""

    what: str
    unit: str
    printed: str  # with the digits that are printed
    ours: float
    by: str = "published"  # or "recomputed": by others' codes, from published files
    remark: str = ""  # why it does not agree, or what was open
    # Largest difference in units of the last printed digit: half of one is rounding
    within: float = 0.5

    @property
    def unit_of_last_digit(self) -> float:
        """What one in the last printed digit is worth."""
        return float(10.0 ** -len(self.printed.partition(".")[2]))

    @property
    def rounds(self) -> bool:
        """Whether ours rounds to the printed number."""
        return self._off <= 0.5 + 1e-6

    @property
    def agrees(self) -> bool:
        """Whether it does, or is as near as `within` says."""
        return self.rounds or self._off <= self.within

    @property
    def _off(self) -> float:
        """The difference in units of the last printed digit."""
        return abs(self.ours - float(self.printed)) / self.unit_of_last_digit
