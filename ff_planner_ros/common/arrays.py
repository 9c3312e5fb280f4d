"""Arrays that cross between packages: checked, copied, read-only; errors name the field."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ff_planner_ros.errors import InvalidInput, Status

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]

# A message carries unit quaternions in double precision; what is further off than this
# was never normalised, and normalising it silently would hide the fault.
QUATERNION_NORM_TOLERANCE = 1e-3
# Larger numbers are refused: the square of a length would soon be infinite.
LARGEST = 1e100
# A shorter vector is a rounded zero; one that is of unit length within the second stays as it is.
SHORTEST_DIRECTION, _UNIT = 1e-6, 1e-12
# Of opposite elements of a symmetric tensor, as a part of its largest one.
_ASYMMETRY = 1e-6
# Of the search for what a quaternion was normalised from: relative steps, and how many.
_SCALES = ((2.0**-48, 4096), (2.0**-27, 60_000))


def zero_vector() -> Array:
    """Return the zero vector. Shape (3,)."""
    return np.zeros(3)


def no_turn() -> Array:
    """Return the quaternion of no rotation, (x, y, z, w). Shape (4,)."""
    return np.array([0.0, 0.0, 0.0, 1.0])


def frozen(values: ArrayLike) -> Array:
    """Return a read-only copy of `values` as an array of floats.

    Raises:
        TypeError, ValueError, OverflowError: They are no numbers: text, truth values and complex
            numbers are none.
    """
    if _has_words(values):
        raise TypeError("text, truth values and complex values are no numbers here")
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _has_words(values: object) -> bool:
    """Tell whether there is text or a truth value among values, which numpy would convert."""
    if isinstance(values, np.ndarray):
        return values.dtype.kind in "bcSU" or (
            values.dtype == object and _has_words(values.tolist())
        )
    if isinstance(values, list | tuple):
        return any(map(_has_words, values))
    return isinstance(values, str | bytes | bool | np.bool_)


def finite_vector(field: str, values: ArrayLike, size: int) -> Array:
    """Return a read-only copy of `values`, shape (size,), checked.

    Raises:
        InvalidInput: Not a list of numbers, wrong size, NaN, infinity, or larger than 1e100.
    """
    try:
        vector = frozen(values)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(Status.WRONG_SIZE, field, values, f"it must be {size} numbers") from None
    if vector.shape != (size,):
        found = vector.size if vector.ndim == 1 else f"the shape {vector.shape}"
        allowed = f"it must have {size} entries, not {found}"
        raise InvalidInput(Status.WRONG_SIZE, field, values, allowed)
    if not np.abs(vector).max(initial=0.0) <= LARGEST:
        if not np.isfinite(vector).all():
            raise InvalidInput(Status.NOT_FINITE, field, values, "every entry must be finite")
        allowed = f"no entry may be larger than {LARGEST:g}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, values, allowed)
    return vector


def finite_rows(field: str, values: ArrayLike, size: int) -> Array:
    """Return a read-only copy of `values`, shape (rows, size), checked.

    Raises:
        InvalidInput: Not rows of `size` numbers, NaN, infinity, or larger than 1e100.
    """
    try:
        rows = frozen(values)
    except (TypeError, ValueError, OverflowError):
        rows = frozen(())
    if rows.ndim != 2 or rows.shape[1] != size:
        allowed = f"it must be rows of {size} numbers each"
        raise InvalidInput(Status.WRONG_SIZE, field, values, allowed)
    finite_vector(field, rows.ravel(), rows.size)
    return rows


def finite_number(field: str, value: float, *, above: float | None = None) -> float:
    """Return `value` as a float, checked.

    Raises:
        InvalidInput: Not a number, NaN, infinity, larger than 1e100, or not greater than `above`.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInput(Status.NOT_FINITE, field, value, "it must be finite")
    is_sound = isinstance(value, float) and abs(value) <= LARGEST
    number = float(value if is_sound else finite_vector(field, [value], 1)[0])
    if above is not None and number <= above:
        raise InvalidInput(Status.OUT_OF_RANGE, field, number, f"it must be greater than {above:g}")
    return number


def unit_quaternion(field: str, values: ArrayLike) -> Array:
    """Return `values` as a read-only quaternion (x, y, z, w), checked and normalised.

    Raises:
        InvalidInput: Wrong size, not finite, or the norm differs from 1 by more than 1e-3.
    """
    quaternion = finite_vector(field, values, 4)
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE:
        raise InvalidInput(
            Status.BAD_QUATERNION,
            field,
            quaternion.tolist(),
            f"its norm must be 1 within {QUATERNION_NORM_TOLERANCE:g}, not {norm:.6g}",
        )
    return frozen(quaternion / norm)


def unit_vector(field: str, values: ArrayLike) -> Array:
    """Return `values`, shape (3,), as a read-only vector of unit length, checked.

    Raises:
        InvalidInput: Wrong size, not finite, or no entry reaches 1e-6: no direction.
    """
    vector = finite_vector(field, values, 3)
    # First by its largest entry: the square of a length may be zero or infinite.
    largest = float(np.abs(vector).max())
    if not largest >= SHORTEST_DIRECTION:
        allowed = f"it must be longer than {SHORTEST_DIRECTION:g}: it has no direction"
        raise InvalidInput(Status.OUT_OF_RANGE, field, vector.tolist(), allowed)
    length = float(np.linalg.norm(vector / largest))
    # One of unit length stays as it is, to the last bit, however often it is checked.
    return vector if abs(length * largest - 1.0) <= _UNIT else frozen(vector / largest / length)


def symmetric_tensor(field: str, values: ArrayLike) -> Array:
    """Return `values`, shape (3, 3), as a read-only tensor, checked.

    Raises:
        InvalidInput: Wrong size, not finite, or not symmetric within 1e-6 of its largest element.
    """
    tensor = finite_vector(field, np.ravel(np.array(values, object)), 9).reshape(3, 3)
    if not np.abs(tensor - tensor.T).max() <= _ASYMMETRY * np.abs(tensor).max():
        allowed = "it must be symmetric"
        raise InvalidInput(Status.OUT_OF_RANGE, field, tensor.tolist(), allowed)
    return tensor


def normalising_to(quaternion_xyzw: Array) -> Array:
    """Return numbers that `unit_quaternion` turns into this unit quaternion, to the last bit.

    Normalised once more, a unit quaternion may change by rounding. Numbers a little longer or
    shorter do not; nearly always some that differ by less than 1e-9 are found.
    """
    if (unit_quaternion("", quaternion_xyzw) == quaternion_xyzw).all():
        return quaternion_xyzw
    for step, steps in _SCALES:
        away = step * np.arange(steps)
        for candidate in np.outer(np.column_stack([1.0 + away, 1.0 - away]), quaternion_xyzw):
            ratios = candidate / math.sqrt(candidate @ candidate)
            if not (ratios == quaternion_xyzw).all():
                continue
            if (unit_quaternion("", candidate) == quaternion_xyzw).all():
                return frozen(candidate)
    return quaternion_xyzw
