"""The program that reads mesh files in a process of its own, with limits of time and memory.

Some files crash Coal and Assimp or take all memory. A line of standard input names a file, a line
of standard output holds its hull or the fault; both are JSON.
"""

from __future__ import annotations

import base64
import json
import math
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.parsers import expat

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.urdf.convex_hull import (
    LARGEST_SIZE,
    NoSolid,
    convex_solid,
    once,
)

# Processor time [s] and additional memory for one file: a million triangles take half of either.
MAX_SECONDS, MAX_BYTES = 10, 2_000_000_000
# Wall-clock time [s]: on a busy machine the above takes longer, and a pipe may never end.
MAX_WAIT = 60
TOO_LARGE = f"to read it takes more than {MAX_BYTES / 1e9:g} GB of memory"

_STL_HEAD = 84  # [bytes] a text of any kind, and the number of triangles
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def main() -> None:
    """Answer the requests on standard input until it is closed."""
    answers = os.fdopen(os.dup(1), "w")
    nothing = os.open(os.devnull, os.O_RDWR)
    for said in (1, 2):  # Assimp prints to both
        os.dup2(nothing, said)
    for what in (resource.RLIMIT_CORE, resource.RLIMIT_FSIZE):
        _at_most(what, 0)
    for ends in (signal.SIGALRM, signal.SIGXCPU):
        signal.signal(ends, signal.SIG_DFL)
    files: dict[str, tuple[Array, float]] = {}
    for line in sys.stdin:
        _limit()
        answers.write(json.dumps(_answer(json.loads(line), files)) + "\n")
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        answers.flush()


def _limit() -> None:
    """Let the kernel end this process if the next file exceeds the limits."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    _at_most(resource.RLIMIT_CPU, math.ceil(used.ru_utime + used.ru_stime) + MAX_SECONDS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    _at_most(resource.RLIMIT_AS, pages * resource.getpagesize() + MAX_BYTES)
    signal.setitimer(signal.ITIMER_REAL, MAX_WAIT)


def _at_most(what: int, limit: int) -> None:
    _, hard = resource.getrlimit(what)  # this process may be under limits already
    lower = hard if resource.RLIM_INFINITY != hard < limit else limit
    resource.setrlimit(what, (lower, hard))


def _answer(asked: dict[str, Any], files: dict[str, tuple[Array, float]]) -> dict[str, Any]:
    """Return the answer to a request: the corners of a file's convex hull, or its fault."""
    try:
        path, scale = asked["path"], np.array(asked["scale"])
        if path not in files:
            files[path] = _vertices(Path(path))
        points, unit = files[path]
        corners, _, growth = convex_solid(points, scale)
    except NoSolid as fault:
        return {"fault": str(fault)}
    except MemoryError:
        return {"fault": TOO_LARGE}
    except (RuntimeError, ValueError, OSError):  # of Coal, say
        return {"fault": "it cannot be read"}
    text = base64.b64encode(corners.astype("<f4").tobytes()).decode()
    return {"corners": text, "growth": growth, "vertices": len(points), "unit": unit}


def _vertices(path: Path) -> tuple[Array, float]:
    """Return the vertices of a file [m], and its unit [m].

    Vertices are rounded to single precision, as in a recorded URDF.
    """
    suffix, unit = path.suffix.lower(), 1.0
    if suffix == ".stl" and (triangles := _binary_stl(path)) is not None:
        return once(triangles.reshape(-1, 3).astype(float)), unit
    if suffix == ".dae":
        unit = _unit(path)
    try:
        found = coal.MeshLoader(coal.BV_AABB).load(str(path), np.ones(3))
        points = (unit * np.array(found.vertices(), float)).astype(np.float32).astype(float)
        return points, unit
    except MemoryError:
        raise
    except Exception as error:  # whatever Coal and Assimp throw
        if "bad_alloc" in str(error):
            raise MemoryError from None
        raise NoSolid(f"it cannot be read: {_reason(error)}") from None


def _binary_stl(path: Path) -> Array | None:
    """Return the triangles of a binary STL file, shape (triangles, 3, 3); None: it is no such file.

    Assimp takes several times as long.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[_STL_HEAD - 4 : _STL_HEAD], "little")
    if len(data) != _STL_HEAD + count * _STL_TRIANGLE.itemsize:
        return None
    corners = np.frombuffer(data, _STL_TRIANGLE, offset=_STL_HEAD)["corners"]
    turned = corners[:, [1, 2, 0]]
    solid: Array = corners[(corners != turned).any(axis=2).all(axis=1)]
    if not len(solid):
        raise NoSolid("it cannot be read: there is no mesh in it")
    return solid


def _unit(path: Path) -> float:
    """Return the unit of a Collada file's lengths [m], which Coal ignores."""
    said: list[str] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag == "unit" and not said:
            said.append(attributes.get("meter", "1"))

    def document_type(*_: Any) -> None:
        # An entity of a few bytes may stand for gigabytes.
        raise NoSolid("it has a <!DOCTYPE>, which no Collada file needs")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.StartDoctypeDeclHandler = start, document_type
    with path.open("rb") as file, suppress(expat.ExpatError):  # Assimp may read it all the same
        parser.ParseFile(file)
    try:
        unit = float(said[0]) if said else 1.0
    except ValueError:
        unit = math.nan
    if not 1.0 / LARGEST_SIZE <= unit <= LARGEST_SIZE:
        raise NoSolid("its <unit> is no number of metres that a mesh can be in")
    return unit


def _reason(error: Exception) -> str:
    """Return the message of a Coal error, without its place in Coal's code."""
    words = str(error).partition("message: ")[2].split("\n")[0].strip()
    return "there is no mesh in it" if not words or words.startswith("Could not load") else words


if __name__ == "__main__":
    main()
