"""What a page shows of a command beside what the command printed."""

from __future__ import annotations

import re
from collections.abc import Sequence

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]\d+)?(?![\w.]*\.\d)(?!\w)")
_MEASURED = re.compile(r"\btimes?\b|\[m?s\]")  # header of a column
_OF_THE_MACHINE = re.compile(r"(machine|threads|versions) ")
_LAST_DIGITS, _DECADE = 2.0, 10.0
# Of its many optima within a few percent, the processor's rounding decides which one is found.
_MANY_OPTIMA, _OTHER_OPTIMUM = "min(Theta)", 0.05


def differences(shown: Sequence[str], printed: Sequence[str]) -> list[tuple[str, str]]:
    """Return the lines shown that differ from those printed, each with the latter.

    The lines shown must follow one another in what was printed. Words must be the same. Of
    numbers:

    - in a table, the first column is what a row is about and must be the same. The last printed
      digit of the others may differ by 2, since other processors round differently;
    - in a sentence, so do numbers with decimals; whole numbers must be the same;
    - numbers with an exponent are rounding errors and where a solver stops: a decade either way;
    - those of a row that names `min(Theta)` may differ by 5 %: on another processor its search
      ends in another optimum;
    - times are not compared: columns whose header says "time", "[s]" or "[ms]". Nor are the lines
      `machine`, `threads` and `versions`.
    """
    headers = [_header(shown, number) for number in range(len(shown))]
    found = [
        [
            (one, other)
            for one, other, header in zip(shown, printed[first:], headers, strict=False)
            if not _agree(one, other, header)
        ]
        for first in range(len(printed) - len(shown) + 1)
    ]
    return min(found, key=len, default=[(line, "") for line in shown])


def _header(lines: Sequence[str], number: int) -> list[str]:
    """Return the cells of the nearest line above a row, itself included, that has no number."""
    for line in reversed(lines[: number + 1]):
        cells = _cells(line)
        if len(cells) > 1 and not any(_NUMBER.fullmatch(cell) for cell in cells):
            return cells
    return []


def _cells(line: str) -> list[str]:
    return re.split(r" {2,}", line.strip())


def _agree(shown: str, printed: str, header: list[str]) -> bool:
    if _OF_THE_MACHINE.match(shown):
        return shown.split()[0] == (printed.split() or [""])[0]
    cells, others = _cells(shown), _cells(printed)
    if len(cells) != len(others):
        return False
    if len(cells) == 1 or cells == header:
        return _same_words(shown, printed)
    # Numbers stand at the right under their header; the first column may have none.
    titles = [""] * (len(cells) - len(header)) + header[-len(cells) :]
    return cells[0] == others[0] and all(
        _same_cell(cell, other, title, _MANY_OPTIMA in cells[0])
        for cell, other, title in zip(cells[1:], others[1:], titles[1:], strict=True)
    )


def _same_cell(shown: str, printed: str, title: str, many_optima: bool) -> bool:
    if _NUMBER.fullmatch(shown) and _NUMBER.fullmatch(printed):
        another = many_optima and abs(float(shown) - float(printed)) <= abs(
            _OTHER_OPTIMUM * float(shown)
        )
        return bool(_MEASURED.search(title)) or near(shown, printed) or another
    return _same_words(shown, printed)


def _same_words(shown: str, printed: str) -> bool:
    shown, printed = (" ".join(text.split()) for text in (shown, printed))
    if _NUMBER.sub("0", shown) != _NUMBER.sub("0", printed):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(one == other or ("." in one and near(one, other)) for one, other in pairs)


def near(shown: str, printed: str) -> bool:
    """Say whether a number is the same but for rounding, as in `differences`."""
    one, other = float(shown), float(printed)
    if "e" in shown:
        return abs(one) <= _DECADE * abs(other) and abs(other) <= _DECADE * abs(one)
    unit = 10.0 ** -len(shown.partition(".")[2])
    return abs(one - other) <= (_LAST_DIGITS + 1e-6) * unit
