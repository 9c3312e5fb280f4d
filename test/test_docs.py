"""README.md and docs/: the commands, links and tables of each page against what there is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from doc_figures import FIGURES
from doc_reference import DEFINITIONS, SUFFIXES
from doc_tables import BLOCK, expected
from pages import DOCS, PAGES, README, SOURCE_TREE, console, text_of
from shown_results import near

from ff_planner_ros.cli import main
from ff_planner_ros.commands.parser import command_parser
from ff_planner_ros.common.declared import declared
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import ChaserGoal
from ff_planner_ros.planning.scenario.scenario import load_task, scenario_schema

BENCHMARK = DOCS / "explanation" / "benchmark.md"
# Figures in sentences that the benchmark does not measure, with the word before each, and why.
NO_MEASUREMENT = {
    "has 0 %": "no plan can be in such a class",
    "for 1000 times": "how densely a plan is looked at",
    **dict.fromkeys(["and 70 %", "from 70 %", "from 10 %"], "how problems are drawn"),
}
REFERENCE = DOCS / "reference"
SCENARIO, JSON, MESSAGES = (
    REFERENCE / f"{name}.md" for name in ("scenario", "plan_json", "messages")
)
CAPTURE = SOURCE_TREE / "config" / "scenarios" / "lemur_capture.yaml"

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def test_the_readme_is_short() -> None:
    assert len(text_of(README).splitlines()) <= 150


@pytest.mark.parametrize("page", [README, BENCHMARK], ids=lambda page: page.stem)
def test_a_figure_in_a_sentence_is_of_the_benchmarks_file(page: Path) -> None:
    found = [figure for figure in figures_by_hand(text_of(page)) if figure not in NO_MEASUREMENT]
    assert not found, f"write it in doc_figures.py, or NO_MEASUREMENT says why not: {found}"


def test_every_figure_that_is_no_measurement_is_on_a_page() -> None:
    assert set(NO_MEASUREMENT) <= {*figures_by_hand(text_of(README) + text_of(BENCHMARK))}


def test_the_figures_are_of_a_run_that_was_not_quick_and_of_committed_sources() -> None:
    assert not re.search("dirty|unknown", FIGURES["machine"]["commit"]), "run make figures"
    measured = [f"{one['size']}" for one in FIGURES["scaling"] if one["of"] == "spheres"]
    (shown,) = (table["rows"] for table in FIGURES["tables"] if table["header"][0] == "spheres")
    assert "1000" in measured
    assert [row[0] for row in shown] == measured


@pytest.mark.parametrize("figure", ["0.05 s", "20 ms", "50x", "40.8\ntimes", "2 %", "100%"])
def test_a_figure_is_found_in_a_sentence_but_not_where_it_is_made_or_shown(figure: str) -> None:
    sentence = f"It takes {figure}, at 5 m/s and 3 mm."
    written = f"takes {figure}".replace("\n", " ")
    assert [*figures_by_hand(sentence)] == [written]
    assert [*figures_by_hand(sentence.replace("takes ", "takes\n("))] == [written]
    assert not [*figures_by_hand(f"<!-- figures: a_name -->{sentence}<!-- end -->")]
    assert not [*figures_by_hand(f"```\n{sentence}\n```\n")]


def figures_by_hand(text: str) -> Iterator[str]:
    """Yield each figure with a unit of the benchmark in the sentences, with the word before it."""
    sentences = re.sub(r"^ *```.*?^ *```$", "", BLOCK.sub("", text), flags=re.DOTALL | re.MULTILINE)
    unit = r"(?:\s(?:s|ms|times|%)|[x%])(?![\w/])"
    for found in re.finditer(rf"(\S+)\s\(?(\d[\d.]*{unit})", sentences):
        yield " ".join([found[1], *found[2].split()])


@every_page
def test_every_ff_planner_command_is_one_that_the_parser_takes(page: Path) -> None:
    for line in console(page):
        if line.options is not None:
            try:
                _options, rest = command_parser().parse_known_args(line.options)
            except SystemExit:
                pytest.fail(f"{page.name}: {line.text}")
            assert not rest, f"{page.name}: {line.text}: {rest}"


@every_page
def test_every_make_target_exists(page: Path) -> None:
    makefile = text_of(SOURCE_TREE / "Makefile")
    targets = set(re.findall(r"^([\w-]+):", makefile, re.MULTILINE))
    named = {line.words[1] for line in console(page) if line.words[0] == "make"}
    named |= set(re.findall(r"(?<=[`])make ([\w-]+)", text_of(page)))
    assert named <= targets


@every_page
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", text_of(page)):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{page.name}: {target}"


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_that_sources_and_settings_name_exists() -> None:
    directories = ("ff_planner_ros", "benchmark", "config", "launch", "examples")
    named = {
        (str(path.relative_to(SOURCE_TREE)), page)
        for directory in directories
        for path in (SOURCE_TREE / directory).rglob("*")
        if path.suffix in {".py", ".yaml"}
        for page in re.findall(r"docs/[\w./]+\.md", path.read_text("utf-8"))
    }
    assert len(named) > 5
    assert {(path, page) for path, page in named if not (SOURCE_TREE / page).is_file()} == set()


def test_every_page_of_docs_can_be_reached_from_the_readme() -> None:
    assert "(docs/index.md)" in text_of(README)
    index = text_of(DOCS / "index.md")
    for page in set(PAGES) - {README, DOCS / "index.md"}:
        place = page.relative_to(DOCS) if page.is_relative_to(DOCS) else f"../{page.name}"
        assert f"({place})" in index or page.name in ("contributing.md", "changelog.md")


@every_page
def test_every_generated_table_is_what_the_code_declares(page: Path) -> None:
    for block in BLOCK.finditer(text_of(page)):
        allowed = "run .venv/bin/python tools/doc_tables.py"
        assert block[0] == expected(block), f"{page.name}: {block[3]} is old: {allowed}"


def rows_of(page: Path, section: str = "") -> list[str]:
    """First column of the table of a page, or under one of its headings."""
    text = text_of(page)
    if section:
        text = text.partition(f"## {section}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)
    assert len(rows) == len(set(rows)), rows
    return rows


def required_in(schema: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Keys without which a mapping is refused."""
    for key, inner in schema.get("properties", {}).items():
        if key in schema.get("required", ()):
            yield prefix + key
        yield from required_in(inner, f"{prefix}{key}.")
    for inner in schema.get("anyOf", ()):
        yield from required_in(inner, prefix)
    if "items" in schema:
        block = f"{prefix.removesuffix('.')}[]."
        kinds = [set(required_in(kind, block)) for kind in schema["items"].get("anyOf", ())]
        if kinds:  # each has keys of its own
            yield from set.intersection(*kinds)
        else:
            yield from required_in(schema["items"], block)


def test_required_keys_of_a_scenario_are_marked_and_no_others() -> None:
    rows = set(rows_of(SCENARIO))
    marked = re.findall(r"^\| `([^`]+)` \|.*\brequired \|", text_of(SCENARIO), re.MULTILINE)
    assert set(marked) == rows & set(required_in(scenario_schema()))
    assert "robot.urdf" in marked
    assert "obstacles[].id" in marked


@pytest.fixture
def scenario(tmp_path: Path) -> Any:
    """Loads the capture with one key more, and returns what is allowed in its place."""
    content = yaml.safe_load(text_of(CAPTURE))
    content["robot"]["urdf"] = str((CAPTURE.parent / content["robot"]["urdf"]).resolve())
    body = yaml.safe_load(text_of(CAPTURE.with_name("lemur_tumbling.yaml")))["target_body"]
    held = yaml.safe_load(text_of(CAPTURE.with_name("lemur_payload.yaml")))["robot"]["payload"]

    def allowed(*place: Any) -> set[str]:
        if place[-2:] == ("obstacles", 0):  # a sphere or a body
            return keys_with("no_such_key", *place) | keys_with("shape", *place)
        if place == ("target",):  # of the end effector, of its path or of the joints
            of_chaser = {key.partition(".")[2] for key in declared(ChaserGoal)}
            every = (keys_with(key, *place) for key in ("no_such_key", "path", "circle", "at_rest"))
            return of_chaser.union(*every)
        return keys_with("no_such_key", *place)

    def keys_with(key: str, *place: Any) -> set[str]:
        changed = json.loads(json.dumps(content))
        if place[:1] == ("target_body",):
            del changed["target"]
            changed["target_body"] = json.loads(json.dumps(body))
        if place[:2] == ("robot", "payload"):
            changed["robot"]["payload"] = json.loads(json.dumps(held))
        for around, block in (
            (("duration",), {"min": 9.0, "max": 10.0}),
            (("target", "joints"), {}),
            (("target", "path"), {"path": [{}]}),
            (("target", "circle"), {"circle": {}}),
        ):
            if place[: len(around)] == around:
                changed[around[0]] = block
        block = changed
        for name in place:
            block = block[name] if isinstance(name, int) else block.setdefault(name, {})
        block |= {"no_such_key": 1, key: 1}
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump(changed), encoding="utf-8")
        with pytest.raises(InvalidInput, match="is unknown: known are ") as refused:
            load_task(path, load_parameters().of_scenarios())
        return set(re.findall(r"[a-z]\w+", refused.value.allowed.partition("are ")[2]))

    return allowed


def scenario_keys() -> Iterator[tuple[tuple[Any, ...], set[str]]]:
    """Each block of a scenario file with the keys that the table lists for it."""
    keys = [key.replace("[]", ".0").split(".") for key in rows_of(SCENARIO)]
    blocks = {tuple(key[:depth]) for key in keys for depth in range(len(key))}
    for block in sorted(blocks):
        below = {key[len(block)] for key in keys if tuple(key[: len(block)]) == block != tuple(key)}
        if below != {"0"}:
            yield tuple(int(name) if name.isdigit() else name for name in block), below


def test_the_table_of_scenario_keys_lists_exactly_those_that_a_file_may_have(scenario: Any) -> None:
    for block, keys in scenario_keys():
        assert scenario(*block) == keys, block


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The JSON of the paper's capture."""
    file = tmp_path_factory.mktemp("plan") / "plan.json"
    assert main(["plan", str(CAPTURE), "--json", str(file)]) == 0
    return dict(json.loads(text_of(file)))


def test_the_answer_in_the_readme_is_that_to_the_papers_capture(written: dict[str, Any]) -> None:
    for block in ("metrics", "solver"):
        response = re.search(
            rf"^{block}: \[?\{{(.*?)\.\.\.\}}\]?$", text_of(README), re.MULTILINE | re.DOTALL
        )
        assert response
        told = dict(re.findall(r"(\w+): (\S+),", response[1]))
        told.pop("solve_time", None)
        assert told
        for name, value in told.items():
            assert near(value, str(written[block][name])), name


def test_the_table_of_json_fields_lists_exactly_those_of_a_plan(written: dict[str, Any]) -> None:
    assert set(rows_of(JSON)) == set(written)
    assert set(rows_of(MESSAGES, "PlanMetrics")) >= set(written["metrics"])
    solver = re.search(r"^\| `solver` \| (.*) \|$", text_of(JSON), re.MULTILINE)
    assert solver
    assert set(re.findall(r"`(\w+)`", solver[1])) == set(written["solver"])


def test_the_page_of_messages_has_every_field_of_every_message() -> None:
    text = text_of(MESSAGES)
    for path in DEFINITIONS.glob("*/*.*"):
        if path.suffix in SUFFIXES and path.parent.name in ("msg", "srv", "action"):
            title = path.stem + ("" if path.suffix == ".msg" else path.suffix)
            section = text.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
            parts = interface_of(path)
            fields = {name for part in parts for name in part.get_fields_and_field_types()}
            assert set(re.findall(r"^\| `([a-z_]+)` \| \[?`", section, re.MULTILINE)) == fields, (
                title
            )


def interface_of(path: Path) -> list[Any]:
    """Return the messages that a file is compiled to: of a service two, of an action three."""
    kind = getattr(import_module(f"ff_planner_msgs.{path.parent.name}"), path.stem)
    parts = ("Request", "Response", "Goal", "Result", "Feedback")
    return [getattr(kind, part) for part in parts if hasattr(kind, part)] or [kind]
