"""A result that belongs to the robot that it is computed of, as of a cached property."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

Owner = TypeVar("Owner")
Result = TypeVar("Result")


def kept_with_it(compute: Callable[[Owner], Result]) -> Callable[[Owner], Result]:
    """Return a function that computes its result once an object, and keeps it with the object.

    It is a cached property for what a room above the object's own computes. A copy by `replace` has
    none of the results.
    """
    name = f"{compute.__module__}.{compute.__qualname__}"

    @wraps(compute)
    def kept(owner: Owner) -> Result:
        results = vars(owner)
        if name not in results:
            results[name] = compute(owner)
        result: Result = results[name]
        return result

    return kept
