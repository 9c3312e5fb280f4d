"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ff_planner_ros.common.shown import printable


class Table(NamedTuple):
    """A title, the cells of a header, and those of each row."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print aligned columns: words to the left, numbers to the right."""
    print()
    for line in table_lines(title, header, rows):
        print(line)


def table_lines(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table: the title, the header and the rows.

    Line breaks and control characters in cells are replaced: names come from outside.
    """
    table = [[printable(cell, len(cell)) for cell in row] for row in (header, *rows)]
    columns = list(zip(*table, strict=True))
    widths = [max(map(len, column)) for column in columns]
    numeric = [not any(cell.strip("+-.%0123456789e") for cell in column[1:]) for column in columns]
    yield title
    for row in table:
        cells = [
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(row, widths, numeric, strict=True)
        ]
        yield "  ".join(cells).rstrip()
