"""`compiled.pyi` against the module: pybind11 3 writes the signatures into docstrings."""

from __future__ import annotations

import ast
from pathlib import Path
from types import ModuleType

from ff_planner_ros.core import compiled

# How the stub names the types of arguments.
NAMES = {
    "typing.Annotated[numpy.typing.ArrayLike, numpy.float64]": "Array",
    "typing.Annotated[numpy.typing.ArrayLike, numpy.int64]": "Indices",
    "numpy.typing.NDArray[numpy.float64]": "Array",
    "typing.SupportsFloat | typing.SupportsIndex": "float",
    "typing.SupportsInt | typing.SupportsIndex": "int",
    "collections.abc.": "",
    "ff_planner_ros.core.compiled.": "",
}


def offered(where: type | ModuleType) -> dict[str, str]:
    """Every public name, and the constructor, with its arguments or its kind."""
    found: dict[str, str] = {}
    for name, value in vars(where).items():
        if isinstance(value, type):
            found |= {f"{name}.{inside}": what for inside, what in offered(value).items()}
        elif name == "__init__" and not value.__doc__.startswith(name):
            pass  # only the core makes one
        elif name == "__init__" or (callable(value) and not name.startswith("_")):
            found[name] = arguments(function(value.__doc__))
        elif not name.startswith("_"):
            found[name] = "property" if isinstance(value, property) else type(value).__name__
    return found


def declared(body: list[ast.stmt]) -> dict[str, str]:
    """The same of the stub."""
    found: dict[str, str] = {}
    for node in body:
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{name}": what for name, what in declared(node.body).items()}
        elif isinstance(node, ast.FunctionDef) and node.name.strip("_") not in ("enter", "exit"):
            found[node.name] = "property" if node.decorator_list else arguments(node)
        elif isinstance(node, ast.AnnAssign):
            found[ast.unparse(node.target)] = ast.unparse(node.annotation)
    return found


def function(docstring: str) -> ast.FunctionDef:
    """Parse the first line of pybind11's docstring."""
    line = docstring.splitlines()[0]
    for name, short in NAMES.items():
        line = line.replace(name, short)
    (parsed,) = ast.parse(f"def {line}: ...").body
    assert isinstance(parsed, ast.FunctionDef)
    return parsed


def arguments(of: ast.FunctionDef) -> str:
    """Names, types, and which of them have a default."""
    given = [one for one in of.args.args if one.arg != "self"]
    required = len(given) - len(of.args.defaults)
    return ", ".join(
        f"{one.arg}: {one.annotation and ast.unparse(one.annotation)}" + " = ..." * (k >= required)
        for k, one in enumerate(given)
    )


def test_the_stub_declares_what_the_module_offers() -> None:
    stub = Path(compiled.__file__).parent / "compiled.pyi"
    assert declared(ast.parse(stub.read_text(encoding="utf-8")).body) == offered(compiled)
