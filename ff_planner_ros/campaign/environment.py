"""Versions that the bits of a plan depend on beside its task: package, libraries and machine."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import platform
import re
from functools import cache
from pathlib import Path

from ff_planner_ros.common.share import PACKAGE, share_directory
from ff_planner_ros.common.yaml_file import read_yaml

_LIBRARIES = ("numpy", "pin", "scipy")
_DIGITS = 8  # of the sources' hash
# In C++; a text in quotes may hold what looks like one.
_COMMENT = re.compile(r'(?P<text>"(\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', re.DOTALL)


@cache
def environment() -> dict[str, str]:
    """Return versions by name; that of this package with a hash of its code and parameters."""
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
        found.update(f"{path.name}\0{meaning_of(path)}\0".encode())
    return found.hexdigest()[:_DIGITS]


def meaning_of(path: Path) -> str:
    """Return a file of the sources as text without comments and docstrings, which plan nothing."""
    if path.suffix == ".yaml":
        return repr(read_yaml(path))
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return _COMMENT.sub(lambda found: found["text"] or " ", text)
    tree = ast.parse(text)
    for node in ast.walk(tree):
        documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return ast.dump(tree)
