"""A library of plans as a file, `library.npz` in a directory: numpy alone reads it."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.task.library import Library, StoredPlan

LIBRARY = "library.npz"
_UNFINISHED = ".unfinished"
# Raised when what the units of places mean changes.
_VERSION = 1


def save_library(plans: Iterable[StoredPlan], directory: Path) -> Path:
    """Write a library; what is there is replaced, as a whole. Return the path of its file.

    Raises:
        OSError: It cannot be written.
    """
    kept = list(plans)
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / LIBRARY
    unfinished = directory / f"{LIBRARY}{_UNFINISHED}"
    try:
        with unfinished.open("wb") as stream:
            arrays: dict[str, Any] = {"version": np.array(_VERSION)}
            arrays["kinds"] = np.array([one.kind for one in kept], dtype=np.str_)
            arrays |= _flat("places", [one.place for one in kept])
            arrays |= _flat("coefficients", [one.coefficients for one in kept])
            np.savez_compressed(stream, **arrays)
        unfinished.replace(path)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise
    return path


def load_library(path: Path, field: str = "library") -> Library:
    """Read a library.

    Args:
        path: Of the file, or of the directory that `library.npz` is in.
        field: That named it, for errors.

    Raises:
        InvalidInput: There is none, or it is damaged or of another version.
    """
    path = path / LIBRARY if path.is_dir() else path
    try:
        with path.open("rb") as stream, _arrays(stream) as arrays:
            if int(arrays["version"]) != _VERSION:
                raise ValueError(f"it is of version {int(arrays['version'])}, not {_VERSION}")
            kinds = [str(kind) for kind in arrays["kinds"].tolist()]
            rows = zip(
                kinds,
                _parts(arrays["places"], arrays["places_end"]),
                _parts(arrays["coefficients"], arrays["coefficients_end"]),
                strict=True,
            )
            return Library(tuple(StoredPlan(*row) for row in rows))
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        allowed = f"no library can be read there ({error}): `ff-planner campaign` writes one"
        raise InvalidInput(Status.OUT_OF_RANGE, field, path, allowed) from None


def _arrays(stream: BinaryIO) -> Any:
    if not zipfile.is_zipfile(stream):
        raise ValueError("it is no .npz file, or a part of one")
    stream.seek(0)
    return np.load(stream, allow_pickle=False)


def _flat(name: str, rows: list[Array]) -> dict[str, Array]:
    """Return rows of any lengths one after the other, and where each ends."""
    ends = np.cumsum([len(row) for row in rows], dtype=np.int64)
    return {name: np.concatenate([*rows, np.empty(0)]), f"{name}_end": ends}


def _parts(flat: Array, ends: Array) -> Iterator[Array]:
    if not np.isfinite(flat).all() or (ends[-1] if len(ends) else 0) != len(flat):
        raise ValueError("it is damaged")
    return iter(np.split(flat.astype(np.float64), ends[:-1]) if len(ends) else [])
