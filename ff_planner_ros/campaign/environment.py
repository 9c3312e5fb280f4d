"""Versions that the bits of a plan depend on beside its task: package, libraries and machine."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from functools import cache
from pathlib import Path

from ff_planner_ros.common.share import PACKAGE, share_directory

_LIBRARIES = ("numpy", "pin", "scipy")
_DIGITS = 8  # of the sources' hash


@cache
def environment() -> dict[str, str]:
    """Return versions by name; that of this package with a hash of its sources and parameters."""
    return {
        PACKAGE: f"{_version(PACKAGE)} (sources {_sources()})",
        "python": ".".join(platform.python_version_tuple()[:2]),
        "machine": platform.machine(),
    } | {name: _version(name) for name in _LIBRARIES}


def difference(expected: dict[str, str]) -> str:
    """Return how the versions here differ from expected ones, in words; empty: they do not."""
    here = environment()
    return ", ".join(
        f"{name} is {here.get(name, 'missing')}, not {version}"
        for name, version in expected.items()
        if here.get(name) != version
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "of unknown version"


def _sources() -> str:
    root = Path(__file__).resolve().parents[1]
    files = sorted(path for path in root.rglob("*") if path.suffix in (".py", ".cpp", ".hpp"))
    files += sorted((share_directory() / "config").glob("*.yaml"))
    found = hashlib.sha256()
    for path in files:
        found.update(f"{path.name}\0".encode() + path.read_bytes())
    return found.hexdigest()[:_DIGITS]
