"""The tables of docs/ that the code declares. Run as a script, it writes them into the pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ff_planner_ros
from ff_planner_ros.declared import places_in
from ff_planner_ros.parameters import DECLARATIONS, Declaration, default_values
from ff_planner_ros.planning.problem import DurationRange, PlanningProblem, Sphere
from ff_planner_ros.planning.scenario import scenario_schema
from ff_planner_ros.planning.target_body import AttachedSphere, TargetBody
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.parameters import _AT_START, _PATHS, _WHILE_CONFIGURED

SOURCE_TREE = Path(__file__).resolve().parents[1]
DOCS = SOURCE_TREE / "docs"
MESSAGES = SOURCE_TREE / "msg_defs" / "msg"
BLOCK = re.compile(r"(<!-- (table|example): (\w+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def codes() -> Iterator[tuple[str, ...]]:
    yield "code", "name", "cause"
    text = (MESSAGES / "PlanStatus.msg").read_text(encoding="utf-8")
    for name, number, cause in re.findall(r"^uint16 (\w+)=(\d+) *(?:# (.*))?$", text, re.MULTILINE):
        yield number, f"`{name}`", cause


def metrics() -> Iterator[tuple[str, ...]]:
    yield "metric", "meaning"
    text = (MESSAGES / "PlanMetrics.msg").read_text(encoding="utf-8")
    for name, meaning in re.findall(
        r"^(?:float64(?:\[\])?|string) (\w+) *# (.*)$", text, re.MULTILINE
    ):
        yield f"`{name}`", meaning


def parameters() -> Iterator[tuple[str, ...]]:
    yield "parameter", "default", "range", "meaning"
    told: dict[str, str] = {}
    for name, declared in DECLARATIONS.items():
        value = default_values()[name]
        bounds = (("from", declared.minimum), ("to", declared.maximum))
        meaning = declared.description + (f" [{declared.unit}]" if declared.unit else "")
        first = told.setdefault(meaning, f"`{name}`")
        yield (
            f"`{name}`{_when(name, declared)}",
            f"`{str(value).lower() if isinstance(value, bool) else value}`",
            " ".join(f"{word} {bound:g}" for word, bound in bounds if bound is not None),
            meaning if first == f"`{name}`" else f"as {first}",
        )


def _when(name: str, declared: Declaration) -> str:
    """Return the mark that says when a parameter may change."""
    if name in (*_AT_START, *_PATHS):
        return " **"
    if name.startswith(_WHILE_CONFIGURED):
        return " *"
    return f" {declared.strictness.mark}" if declared.strictness else ""


def scenario() -> Iterator[tuple[str, ...]]:
    yield "key", "value", "in messages"
    places = {
        key: place
        for kind, block, place in (
            (SystemState, "", "start_state"),
            (PlanningProblem, "", ""),
            (PlanningTask, "", ""),
            (DurationRange, "duration", ""),
            (TargetBody, "target_body", "target_body"),
            (AttachedSphere, "target_body.obstacles[]", "target_body.obstacles[]"),
            (Sphere, "obstacles[]", "obstacles.spheres[]"),
        )
        for key, place, _ in places_in(kind, block, place)
    }
    for key, schema, required in _keys(scenario_schema()):
        words = re.sub(r"(\. Since version [\d.]+)?\.$", "", schema.get("description", ""))
        words += _choices(schema)
        if "default" in schema:
            usual = schema["default"]
            words += f"; default `{f'{usual:.4g}' if isinstance(usual, float) else usual}`"
        words += "; required" if required else ""
        place = places.get(key)
        yield f"`{key}`", words.lstrip("; "), f"`{place}`" if place else ""


def _keys(schema: Any, block: str = "") -> Iterator[tuple[str, Any, bool]]:
    """Yield every key of a scenario with its schema, and whether its block must have it."""
    for name, inner in schema["properties"].items():
        yield f"{block}{name}", inner, name in schema.get("required", ())
        for option in (inner, *inner.get("anyOf", ())):
            if "properties" in option and name != "planner":  # its keys are parameters
                yield from _keys(option, f"{block}{name}.")
            elif "properties" in option.get("items", {}):
                yield from _keys(option["items"], f"{block}{name}[].")


def _choices(schema: Any) -> str:
    """Return the words that a value may be, as they stand behind what it is."""
    if other := [option["const"] for option in schema.get("anyOf", ()) if "const" in option]:
        return f", or `{other[0]}`"
    words = ", ".join(f"`{word}`" for word in schema.get("enum", ()))
    return words and f": {words}"


def public() -> Iterator[tuple[str, ...]]:
    yield "name", "what it is"
    for name in ff_planner_ros.__all__:
        summary = (getattr(ff_planner_ros, name).__doc__ or "").partition("\n")[0]
        yield f"`{name}`", summary


def plan_in_python() -> str:
    example = (SOURCE_TREE / "examples" / "plan_in_python.py").read_text(encoding="utf-8")
    return f"```python\n{example.partition(chr(10) * 2)[2].lstrip()}```\n"


def markdown(rows: Iterator[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    columns = lines[0].count("|") - 1
    return "\n".join([lines[0], "|" + " --- |" * columns, *lines[1:]]) + "\n"


def expected(block: re.Match[str]) -> str:
    """Return a marked block as it must be."""
    made = globals()[block[3]]()
    return block[1] + (made if isinstance(made, str) else markdown(made)) + block[5]


if __name__ == "__main__":
    for page in DOCS.glob("*.md"):
        page.write_text(BLOCK.sub(expected, page.read_text("utf-8")), "utf-8")
