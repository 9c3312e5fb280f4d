"""How far a search goes beyond the first plan that it finds."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from ff_planner_ros.common.forms import Form, a_word


class SearchDepth(StrEnum):
    """How far to look for a better attitude, where it has a weight."""

    QUICK = "quick"
    NORMAL = "normal"
    THOROUGH = "thorough"


# Rounds of search that `attitude_rounds` counted until version 0.3, and how far they went.
FORMER_ROUNDS = {SearchDepth.QUICK: 0, SearchDepth.NORMAL: 3, SearchDepth.THOROUGH: 9}


def a_search_depth() -> Form:
    """Return the form of a depth; a number of rounds is read as the depth that goes as far."""
    word = a_word(SearchDepth)

    def read(field: str, value: object) -> SearchDepth:
        if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
            enough = (depth for depth, rounds in FORMER_ROUNDS.items() if value <= rounds)
            return next(enough, SearchDepth.THOROUGH)
        return SearchDepth(word.read(field, value))

    schema = {"type": "string", "enum": [str(depth) for depth in SearchDepth]}
    return replace(word, read=read, schema=lambda: schema, checked=read, from_message=read)
