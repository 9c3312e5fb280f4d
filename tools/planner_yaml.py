"""The parameters file of the node, from the declarations. Run as a script, it writes the file."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from ff_planner_ros.parameters import DECLARATIONS, load_parameters
from ff_planner_ros.parameters.values import GROUPS, document_of

FILE = Path(__file__).resolve().parents[1] / "config" / "planner.yaml"
HEADER = """\
# Every parameter of the node and of `ff-planner plan --parameters`, with its default: written by
# tools/planner_yaml.py from where the parameters are declared.
/**:
  ros__parameters:
"""
WIDTH = 100


def planner_yaml() -> str:
    """Return the file: above each parameter what it means, above each group what it is for."""
    return HEADER + "\n".join(_lines(document_of(load_parameters()), "", " " * 4)) + "\n"


def _lines(block: dict[str, Any], prefix: str, indent: str) -> Iterator[str]:
    # A group within a group comes last.
    for name, value in sorted(
        block.items(), key=lambda item: bool(prefix) and type(item[1]) is dict
    ):
        full = f"{prefix}{name}"
        if isinstance(value, dict):
            words = (GROUPS[full].__doc__ or "").partition("\n")[0].removesuffix(".")
            yield from _comment(words, indent)
            yield f"{indent}{name}:"
            yield from _lines(value, f"{full}.", indent + "  ")
        else:
            one = DECLARATIONS[full]
            yield from _comment(one.sentence + (f" [{one.unit}]" if one.unit else ""), indent)
            plain = yaml.safe_dump(value, default_flow_style=True, width=10_000)
            yield f"{indent}{name}: {plain.removesuffix('...' + chr(10)).strip()}"


def _comment(words: str, indent: str) -> list[str]:
    head = f"{indent}# "
    return textwrap.wrap(words, WIDTH, initial_indent=head, subsequent_indent=head)


if __name__ == "__main__":
    FILE.write_text(planner_yaml(), encoding="utf-8")
