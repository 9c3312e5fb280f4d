"""Files with something wrong in them, by a seed."""

from __future__ import annotations

import copy
import random
from typing import Any

# What stands where something else is expected.
EVIL: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 0.5, 2**63, 10**400, -(10**4000), 1e12, 1e300, -1e308, 1e-300),
    *(float("nan"), float("inf"), "", "abc", "1e-3", "none", "x" * 5_000, "\0", "\x1b[31m"),
    *("\u202e", "../../etc/passwd", "/dev/zero", "file:///etc/passwd", [], {}, [[]], [{}]),
    *([None], [[[[[1.0]]]]], {"a": {"b": {"c": 1}}}, [1.0] * 1_000, [1e300] * 3, [1e300] * 4),
    *([1e300] * 7, [float("nan")] * 3, [0.0] * 4, [0.0, 0.0, 0.0, 1.0], ["a", "b", "c"]),
)


def bytes_mutated(data: bytes, chance: random.Random) -> bytes:
    mutated = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5))):
        place, other = (chance.randrange(len(mutated)) for _ in range(2))
        length = chance.choice((1, 2, 4, 8, 40, 400))
        match chance.randrange(6):
            case 0:
                mutated[place] = chance.randrange(256)
            case 1:
                mutated[place] ^= 1 << chance.randrange(8)
            case 2:
                del mutated[place : place + length]
            case 3:
                mutated[place : place + length] = bytes(length)
            case 4:
                mutated[place:place] = chance.randbytes(length)
            case 5:
                mutated[place:place] = mutated[other : other + length]
        mutated = mutated or bytearray(b"?")
    return bytes(mutated)


def document_mutated(document: Any, chance: random.Random) -> Any:
    """A document with one or two of its values replaced, taken away, scaled or put elsewhere."""
    mutated = copy.deepcopy(document)
    for _ in range(chance.choice((1, 1, 2))):
        places = [(holder, key) for holder, key in _places(mutated) if holder]
        holder, key = chance.choice(places)
        match chance.randrange(6):
            case 0 | 1 | 2:
                holder[key] = chance.choice(EVIL)
            case 3:
                del holder[key]
            case 4:
                holder[key] = _scaled(holder[key], chance.choice((1e12, -1.0, 1e-12, 1e200)))
            case 5:
                other, its_key = chance.choice(places)
                holder[key] = copy.deepcopy(other[its_key]) if its_key in _keys(other) else None
        if not _places(mutated):
            return mutated
    return mutated


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Each holder with each of its keys; of a long list only the first and the last."""
    found: list[tuple[Any, Any]] = []
    for key in _keys(value):
        found.append((value, key))
        found += _places(value[key])
    return found


def _keys(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value)
    if isinstance(value, list):
        return sorted({*range(min(len(value), 2)), len(value) - 1} - {-1})
    return []


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_scaled(entry, factor) for entry in value]
    return value * factor if isinstance(value, float) else value
