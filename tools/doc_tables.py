"""What the code declares and the benchmark measured, as README.md and docs/ have it.

Run as a script, it writes the tables and sentences into the pages, between their marks.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import doc_figures
import doc_reference
from doc_reference import MESSAGES
from pages import DOCS, PAGES, text_of

import ff_planner_ros
from ff_planner_ros.common.declared_messages import places_in
from ff_planner_ros.errors import Retry
from ff_planner_ros.parameters import DECLARATIONS
from ff_planner_ros.parameters.controller import KEEPS_PLANS
from ff_planner_ros.planning.problem.obstacles import SphereEntry
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Obstacle,
    PlanningProblem,
)
from ff_planner_ros.planning.problem.target_body import (
    AttachedObstacle,
    AttachedSphereEntry,
    TargetBody,
)
from ff_planner_ros.planning.scenario.phases_file import KEY as PHASES_KEY
from ff_planner_ros.planning.scenario.scenario import scenario_schema
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.payload import HeldShape, Payload
from ff_planner_ros.robot.urdf.sdf_model import SDF
from ff_planner_ros.robot.urdf.urdf_xml import SRDF, URDF
from ff_planner_ros.robot.urdf.xml_reader import Format
from ff_planner_ros.ros.parameters import _AT_START, _PATHS

SOURCE_TREE = Path(__file__).resolve().parents[1]
STUDY_SCHEMA = SOURCE_TREE / "config" / "schemas" / "study.json"
BLOCK = re.compile(
    r"(<!-- (table|example|figures|bench): ([\w, ]+) -->\n?)(.*?)(<!-- end -->)", re.DOTALL
)


def controller_settings() -> Iterator[tuple[str, ...]]:
    yield "setting", "value", "why"
    for one in KEEPS_PLANS:
        yield f"`{one.name}`", f"`{json.dumps(one.value)}`", one.why


def retries() -> Iterator[tuple[str, ...]]:
    yield "retry", "constant", "meaning"
    text = (MESSAGES / "PlanStatus.msg").read_text(encoding="utf-8")
    for name, number, meaning in re.findall(r"^uint8 (\w+)=(\d+) *# (.*)$", text, re.MULTILINE):
        assert name.removeprefix("RETRY_") == Retry(int(number)).name
        yield number, f"`{name}`", meaning


def parameters() -> Iterator[tuple[str, ...]]:
    yield "parameter", "default", "range", "meaning"
    told: dict[str, str] = {}
    for name, one in DECLARATIONS.items():
        value = one.form.written(one.default)
        schema = one.form.schema()
        bounds = (("from", schema.get("minimum")), ("to", schema.get("maximum")))
        meaning = one.sentence + (f" [{one.unit}]" if one.unit else "")
        first = told.setdefault(meaning, f"`{name}`")
        yield (
            f"`{name}`{_when(name)}",
            f"`{_shown(value)}`",
            " ".join(f"{word} {bound:g}" for word, bound in bounds if bound is not None),
            meaning if first == f"`{name}`" else f"as {first}",
        )


def _shown(value: Any) -> str:
    """Return a default as YAML has it."""
    return str(value).lower() if isinstance(value, bool) else f"{value}" or '""'


def _when(name: str) -> str:
    """Return the mark of parameters that are those of the process's start."""
    return " *" if name in (*_AT_START, *_PATHS) else ""


def scenario() -> Iterator[tuple[str, ...]]:
    yield "key", "value", "in `PlanRequest`"
    places = {
        key: place
        for kind, block, place in (
            (SystemState, "", "start_state[0]"),
            (PlanningProblem, "", ""),
            (PlanningTask, "", ""),
            (DurationRange, "duration", ""),
            (TargetBody, "target_body", "target_body[0]"),
            (AttachedObstacle, "target_body.obstacles[]", "target_body[0].bodies[]"),
            (AttachedSphereEntry, "target_body.obstacles[]", "target_body[0].obstacles[]"),
            (Obstacle, "obstacles[]", "scene[0].bodies[]"),
            (SphereEntry, "obstacles[]", "scene[0].spheres[]"),
            (Payload, "robot.payload", "payload[0]"),
            (HeldShape, "robot.payload.shapes[]", "payload[0].bodies[]"),
        )
        for key, place, _ in places_in(kind, block, place)
    }
    places["robot.wheels.stored"] = "start_state[0].wheel_momenta"
    for key, schema, required in _keys(scenario_schema()):
        words = schema.get("description", "").removesuffix(".")
        words += _choices(schema)
        if "default" in schema:
            usual = schema["default"]
            words += f"; default `{f'{usual:.4g}' if isinstance(usual, float) else usual}`"
        words += _OF_EITHER.get(key.rpartition("obstacles[]")[2], "; required" if required else "")
        place = places.get(key)
        yield f"`{key}`", words.lstrip("; "), f"`{place}`" if place else ""


def study() -> Iterator[tuple[str, ...]]:
    yield "key", "value"
    for key, schema, required in _keys(json.loads(STUDY_SCHEMA.read_text(encoding="utf-8"))):
        words = schema.get("description", "").removesuffix(".")
        words += _choices(schema)
        words += f"; default `{json.dumps(schema['default'])}`" if "default" in schema else ""
        yield f"`{key}`", (words + ("; required" if required else "")).lstrip("; ")


# Of obstacles, which are spheres or bodies.
_OF_EITHER = {
    **dict.fromkeys((".center", ".radius"), "; required without `shape`"),
    ".shape": "; instead of `center` and `radius`",
    ".position": "; required with `shape`",
}


def _keys(schema: Any, block: str = "") -> Iterator[tuple[str, Any, bool]]:
    """Yield every key of a scenario once, its schema, and whether its block must have it."""
    told = set[str]()  # of one of several kinds
    for key, inner, required in _keys_of_all_kinds(schema, block):
        if key not in told:
            yield key, inner, required
        told.add(key)


def _keys_of_all_kinds(schema: Any, block: str) -> Iterator[tuple[str, Any, bool]]:
    for name, inner in schema["properties"].items():
        yield f"{block}{name}", inner, name in schema.get("required", ())
        for option in (inner, *inner.get("anyOf", ())):
            # The keys of `planner` are parameters, those of a phase are told on a page.
            if "properties" in option and name != "planner":
                yield from _keys(option, f"{block}{name}.")
            elif "properties" in option.get("items", {}) and name != PHASES_KEY:
                yield from _keys(option["items"], f"{block}{name}[].")
        for option in inner.get("items", {}).get("anyOf", ()):
            yield from _keys(option, f"{block}{name}[].")


def _choices(schema: Any) -> str:
    """Return the words that a value may be, as they stand behind what it is."""
    if other := [option["const"] for option in schema.get("anyOf", ()) if "const" in option]:
        return f", or `{other[0]}`"
    words = ", ".join(f"`{word}`" for word in schema.get("enum", ()))
    return words and f": {words}"


def urdf_elements() -> Iterator[tuple[str, ...]]:
    yield from _elements(URDF)


def srdf_elements() -> Iterator[tuple[str, ...]]:
    yield from _elements(SRDF)


def sdf_elements() -> Iterator[tuple[str, ...]]:
    yield from _elements(SDF)


def _elements(form: Format) -> Iterator[tuple[str, ...]]:
    """Yield each element that a reader knows; what is passed over is told where it is first."""
    yield "element", "read of it", "not read, and what that means"
    told = set[str]()
    for path, row in form.tag.within(form.root):
        if path.endswith("/locked") or "/world/model" in path:  # of records; as outside a world
            continue
        names = [f"`{one}`" for one in row.attributes if one != "quat_xyzw"]
        names += ["its text"] if row.has_text else []
        reasons = dict[str, list[str]]()
        for one, reason in (*row.unread.items(), *row.noted.items()):
            if not (one in told and form is SDF):
                noted = " (with a note)" if one in row.noted else ""
                reasons.setdefault(reason + noted, []).append(f"`{one.removeprefix('@')}`")
        told |= row.unread.keys()
        unread = [f"{', '.join(given)}: {reason}" for reason, given in reasons.items()]
        shown = f"`{path.removeprefix(f'{form.root}/')}`"
        first = "; ".join(filter(None, (", ".join(names), row.means)))
        yield shown, first, "; ".join(unread)


def public() -> Iterator[tuple[str, ...]]:
    yield "name", "what it is"
    for name in ff_planner_ros.__all__:
        summary = (getattr(ff_planner_ros, name).__doc__ or "").partition("\n")[0]
        yield f"`{name}`", summary


def packages() -> Iterator[tuple[str, ...]]:
    yield "package", "content"
    root = Path(ff_planner_ros.__file__).parent
    for file in sorted(root.rglob("__init__.py")):
        if file.parent != root:
            name = file.parent.relative_to(root).as_posix()
            text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            yield f"`{name}`", text.partition("\n")[0].removesuffix(".")


def tutorials() -> Iterator[tuple[str, ...]]:
    yield from _contents("tutorials", tutorials_in_order())


def how_to() -> Iterator[tuple[str, ...]]:
    yield from _contents("how_to")


def reference() -> Iterator[tuple[str, ...]]:
    yield from _contents("reference")


def explanation() -> Iterator[tuple[str, ...]]:
    yield from _contents("explanation")


def tutorials_in_order() -> list[str]:
    """Return the names of the tutorials, as the menu of the site has them."""
    return re.findall(r"^tutorials/(\w+)$", text_of(DOCS / "index.md"), re.MULTILINE)


def _contents(folder: str, order: list[str] | None = None) -> Iterator[tuple[str, ...]]:
    """Yield the pages of a folder, each with the first sentence below its title."""
    yield "page", "its question"
    for name in order or sorted(path.stem for path in (DOCS / folder).glob("*.md")):
        found = re.match(
            r"# ([^\n]*)\n\n(.*?[.?:])(?=\s)", text_of(DOCS / folder / f"{name}.md"), re.DOTALL
        )
        assert found, f"{name} does not begin with a title and a sentence"
        sentence = re.sub(r"\[(.*?)\]\(.*?\)", r"\1", " ".join(found[2].split()))
        yield f"[{found[1]}]({folder}/{name}.md)", sentence


def plan_in_python() -> str:
    example = (SOURCE_TREE / "examples" / "plan_in_python.py").read_text(encoding="utf-8")
    return f"```python\n{example.partition(chr(10) * 2)[2].lstrip()}```\n"


def markdown(rows: Iterator[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    columns = lines[0].count("|") - 1
    return "\n".join([lines[0], "|" + " --- |" * columns, *lines[1:]]) + "\n"


def expected(block: re.Match[str]) -> str:
    """Return a marked block as it must be."""
    if block[2] == "bench":
        made = doc_figures.tables(block[3])
    elif block[2] == "figures":
        made = getattr(doc_figures, block[3])()
    else:
        made = (globals().get(block[3]) or getattr(doc_reference, block[3]))()
    return block[1] + (made if isinstance(made, str) else markdown(made)) + block[5]


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(BLOCK.sub(expected, page.read_text("utf-8")), "utf-8")
