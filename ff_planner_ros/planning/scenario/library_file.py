"""A library of plans as a file, `library.npz` in a directory: numpy alone reads it."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import LARGEST, Array
from ff_planner_ros.common.shown import LONGEST_VALUE, shortened, shown
from ff_planner_ros.common.text_file import read_bytes
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.task.library import Library, StoredPlan

LIBRARY = "library.npz"
_UNFINISHED = ".unfinished"
# Increased when the meaning of `StoredPlan.place` changes.
_VERSION = 1
# Ten thousand plans of an arm of seven joints are 10 MB. A library that is larger by far would take
# all memory, and its nearest plan would be looked for longer than a search takes.
_MOST_BYTES, _MOST_INFLATED, _MOST_PLANS = 100_000_000, 100_000_000, 100_000
_ROWS = ("places", "coefficients")
_NAMES = ("version", "kinds", *(name for row in _ROWS for name in (row, f"{row}_end")))


def save_library(plans: Iterable[StoredPlan], directory: Path) -> Path:
    """Write a library, replacing one that is there atomically, and return the path of its file.

    Raises:
        OSError: The file cannot be written.
    """
    kept = list(plans)
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / LIBRARY
    unfinished = directory / f"{LIBRARY}{_UNFINISHED}"
    try:
        unfinished.unlink(missing_ok=True)  # which may be a link to anywhere
        with unfinished.open("xb") as stream:
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
        path: Path of the file, or of the directory that holds `library.npz`.
        field: Field that holds the path, for errors.

    Raises:
        InvalidInput: There is no library, or it is too large, damaged or of another version.
    """
    path = path / LIBRARY if path.is_dir() else path
    try:
        return Library(tuple(_plans(_arrays(read_bytes(path, _MOST_BYTES, field)))))
    except InvalidInput as error:
        reason = error.allowed
    except Exception as error:  # whatever zipfile and numpy trip over in a damaged file
        reason = str(error) or type(error).__name__
    reason = shortened(reason.partition("\n")[0], LONGEST_VALUE)
    allowed = f"no library can be read there ({reason}): `ff-planner campaign` writes one"
    raise InvalidInput(Status.OUT_OF_RANGE, field, path, allowed)


def _arrays(data: bytes) -> Mapping[str, Any]:
    """Return the arrays in a file; nothing is inflated before its size is known."""
    stream = io.BytesIO(data)
    if not zipfile.is_zipfile(stream):
        raise ValueError("it is no .npz file, or a part of one")
    with zipfile.ZipFile(stream) as archive:
        parts = archive.infolist()
        if sum(part.file_size for part in parts) > _MOST_INFLATED:
            raise ValueError(f"it holds more than {_MOST_INFLATED / 1e6:g} MB")
        if {part.compress_type for part in parts} - {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise ValueError("it is compressed in another way than numpy does it")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in _NAMES if name in arrays}


def _plans(arrays: Mapping[str, Any]) -> Iterator[StoredPlan]:
    """Yield the plans of a file, each checked."""
    version = arrays["version"].tolist() if "version" in arrays else "unknown"
    if version != _VERSION:
        raise ValueError(f"it is of version {shown(version)}, not {_VERSION}")
    if missing := [name for name in _NAMES if name not in arrays]:
        raise ValueError(f"it has no {missing[0]}")
    kinds = arrays["kinds"]
    if kinds.dtype.kind != "U" or kinds.ndim != 1:
        raise ValueError("its kinds are no list of texts")
    if len(kinds) > _MOST_PLANS:
        raise ValueError(f"it holds {len(kinds)} plans, more than {_MOST_PLANS}")
    rows = [_parts(name, arrays[name], arrays[f"{name}_end"], len(kinds)) for name in _ROWS]
    for kind, *both in zip(kinds.tolist(), *rows, strict=True):
        yield StoredPlan(kind, *both)


def _flat(name: str, rows: list[Array]) -> dict[str, Array]:
    """Return rows of any lengths one after the other, and where each ends."""
    ends = np.cumsum([len(row) for row in rows], dtype=np.int64)
    return {name: np.concatenate([*rows, np.empty(0)]), f"{name}_end": ends}


def _parts(name: str, flat: Array, ends: Array, count: int) -> list[Array]:
    """Return rows that `_flat` has written one after the other."""
    is_list = flat.dtype.kind in "fiu" and flat.ndim == 1
    if not is_list or not np.abs(flat).max(initial=0.0) <= LARGEST:
        raise ValueError(f"its {name} are no list of numbers up to {LARGEST:g}")
    if ends.dtype.kind not in "iu" or ends.shape != (count,):
        raise ValueError(f"its {name} are not those of {count} plans")
    ends = ends.astype(np.int64)
    if (np.diff(ends, prepend=0) < 0).any() or (ends[-1] if count else 0) != len(flat):
        raise ValueError(f"where its {name} end makes no sense")
    return np.split(flat.astype(np.float64), ends[:-1]) if count else []
