"""What a table, a bag or a directory says is data: it names no file, no command and no line."""

import csv
import html
import os
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet
import pytest
from campaigns import study

from ff_planner_ros.bag.export import _write
from ff_planner_ros.campaign import run
from ff_planner_ros.campaign.cases import cases
from ff_planner_ros.campaign.run import run_campaign
from ff_planner_ros.campaign.study import Study
from ff_planner_ros.campaign.table import Writer, locked, plan_schema
from ff_planner_ros.campaign.work import Outcome, run_case
from ff_planner_ros.cli import main
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.common.shown import in_log
from ff_planner_ros.common.text_table import table_lines
from ff_planner_ros.errors import InvalidInput

SCHEMA = plan_schema({"duration": "number"})
FORGED = "\n[INFO] [1] [ff_planner]: SOLVED\rff-planner: done\x1b[2J\u2028[WARN] none"


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Study:
    grid = {"duration": [2.0, -1.0]}
    methods = [{"name": "ours"}, {"name": "line", "method": "straight"}]
    directory = tmp_path_factory.mktemp("study")
    return study(directory, variations={"grid": grid}, methods=methods)


@pytest.fixture(scope="module")
def rows(asked: Study) -> list[dict[str, Any]]:
    return [run_case(case).row for case in cases(asked)]


@pytest.fixture
def campaign(asked: Study, rows: list[dict[str, Any]], tmp_path: Path) -> Callable[..., Path]:
    """What makes a campaign's directory, some values of its rows changed."""

    def make(**changes: Any) -> Path:
        directory = tmp_path / "campaign"
        directory.mkdir()
        run._keep_sources(asked, directory)
        writer = Writer(directory, SCHEMA)
        writer.add([Outcome(row, []) for row in rows])
        writer.flush()
        (path,) = (directory / "plans").iterdir()
        table = pyarrow.parquet.read_table(path)
        for name, value in changes.items():
            column = pyarrow.array([value] * len(table), table.schema.field(name).type)
            table = table.set_column(table.column_names.index(name), name, column)
        pyarrow.parquet.write_table(table, path)
        return directory

    return make


def report(directory: Path) -> int:
    """Write a report; that a case is planned again for its page is another test's."""
    return main(["campaign", "report", str(directory), "--plans", "0"])


def files_below(directory: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def commands(page: Path) -> Iterator[list[str]]:
    for found in re.findall(r"<code>(.*?)</code>", page.read_text(encoding="utf-8"), re.DOTALL):
        yield shlex.split(html.unescape(found))


@pytest.mark.law("FILE-05")
@pytest.mark.parametrize(
    "id_", ["../../outside", "/outside", "..", ".", "", "a/b", "0123456789abcdeF", "0" * 17]
)
def test_a_report_takes_no_id_that_is_no_hash(
    id_: str, campaign: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory = campaign(id=id_)
    before = files_below(tmp_path)
    assert report(directory) == 2
    assert "is not a hash of a case" in capsys.readouterr().err
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("planned_by", ["rm -rf ~ #", "optimal; rm", "straight\nrm", "--help", ""])
def test_a_report_shows_no_method_that_is_none_of_ours(
    planned_by: str, campaign: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(campaign(planned_by=planned_by)) == 2
    said = capsys.readouterr().err
    assert "is not a method" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("source", ["../secret", "{here}/secret", "..", "a/../../../secret", "\0"])
def test_a_report_reads_no_source_outside_of_its_scenarios(
    source: str, campaign: Any, tmp_path: Path
) -> None:
    directory = campaign(source=source.format(here=tmp_path))
    for place in (tmp_path / "secret", directory / "secret"):
        place.mkdir()
        kept = directory / "scenarios" / "quick_capture"
        for name in ("scenario.yaml", "scenario.urdf"):
            (place / name).write_bytes((kept / name).read_bytes())
    assert report(directory) == 0
    assert not list(commands(directory / "report.html"))
    assert not (directory / "cases").exists()


LINKS = ["report.html", "cases", "scenarios", "scenarios/quick_capture/scenario.yaml"]
LINKS += ["scenarios/quick_capture/scenario.urdf", "parameters.yaml"]


@pytest.mark.parametrize("name", LINKS)
def test_a_report_follows_no_link_out_of_its_directory(
    name: str, campaign: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory, outside = campaign(), tmp_path / "outside"
    place = directory / name
    if place.exists():
        place.rename(outside)
    elif name == "cases":
        outside.mkdir()
    else:
        outside.write_text("mine")
    place.symlink_to(outside)
    before = files_below(outside.parent) if outside.is_dir() else {outside: outside.read_bytes()}
    code = report(directory)
    assert code == (2 if name == "report.html" else 0), capsys.readouterr()
    for path, content in before.items():
        if outside in (path, *path.parents):
            assert path.read_bytes() == content
    if code == 0:
        assert not list(commands(directory / "report.html"))
        assert list(outside.rglob("*")) in ([], [p for p in before if outside in p.parents]) or (
            name == "scenarios"
        )


def test_the_files_of_a_worst_case_replace_no_link(campaign: Any, tmp_path: Path) -> None:
    directory = campaign()
    assert report(directory) == 0
    (tmp_path / "mine").write_text("mine")
    for path in (directory / "cases").glob("*/scenario.yaml"):
        path.unlink()
        path.symlink_to(tmp_path / "mine")
    assert report(directory) == 0
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize(
    "changes", ["[" * 1000, "3", "no JSON", '{"robot.urdf": "/etc/passwd"}', '{"": 1}', "null"]
)
@pytest.mark.parametrize("column", ["changes", "settings"])
@pytest.mark.sampled
def test_changes_that_are_none_give_no_command(changes: str, column: str, campaign: Any) -> None:
    directory = campaign(**{column: changes})
    assert report(directory) == 0
    assert not list(commands(directory / "report.html"))


def test_commands_to_copy_are_quoted(campaign: Any, tmp_path: Path) -> None:
    odd = tmp_path / "a $(touch x) 'b\n; rm"
    campaign().rename(odd)
    assert report(odd) == 0
    found = list(commands(odd / "report.html"))
    assert found
    for words in found:
        assert words[:2] == ["ff-planner", "plan"]
        assert Path(words[2]).parent.parent == odd / "cases"
        assert words[3:] in ([], ["--method", "straight"])


@pytest.mark.parametrize("kind", ["a link", "a link to nothing", "a pipe", "a directory"])
def test_a_lock_that_is_no_file_is_not_taken(kind: str, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "out").mkdir()
    lock = tmp_path / "out" / "lock"
    if kind == "a pipe":
        os.mkfifo(lock)
    elif kind == "a directory":
        lock.mkdir()
    else:
        lock.symlink_to(tmp_path / ("mine" if kind == "a link" else "none"))
    with (
        pytest.raises(InvalidInput, match=r"lock is .*it must be a file"),
        locked(tmp_path / "out"),
    ):
        pass
    assert (tmp_path / "mine").read_text() == "mine"
    assert not (tmp_path / "none").exists()


@pytest.mark.law("FILE-05")
def test_a_campaign_writes_through_no_link(asked: Study, tmp_path: Path) -> None:
    out, outside = tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.mkdir()
    (out / "versions.json").write_text("{}")
    (out / "scenarios").symlink_to(outside)
    with pytest.raises(InvalidInput):
        run_campaign(asked, out, "tcp://127.0.0.1:1")
    with pytest.raises(InvalidInput, match="links are not followed"):
        run._keep_sources(asked, out)
    assert list(outside.iterdir()) == []


# A text, and whether a spreadsheet would compute it.
CELLS = {
    "=1+1": True,
    "+cmd|' /C calc'!A0": True,
    "-2+3": True,
    "@SUM(A1)": True,
    "  =1": True,
    "\t=1": True,
    "\r=1": True,
    "\uff1d1": True,
    "-": True,
    "-1.5e-3": False,
    "+2": False,
    "-inf": False,
    "nan": False,
    "plain": False,
    "a=b": False,
    "": False,
}


@pytest.mark.law("FILE-05")
def test_a_cell_of_a_csv_file_is_no_formula_and_numbers_stay_numbers(tmp_path: Path) -> None:
    numbers = [-1.5, -3, 0.1, None, True, float("-inf")]
    _write(tmp_path / "table.csv", [*CELLS], [[*CELLS], numbers])
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as stream:
        head, row, values = csv.reader(stream)
    wanted = [f"'{text}" if computed else text for text, computed in CELLS.items()]
    assert head == row == wanted
    assert values == ["-1.5", "-3", "0.1", "", "True", "-inf"]


def test_a_name_from_outside_forges_no_line_of_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for line in in_log(f"obstacle {FORGED} is unknown").splitlines()[1:]:
        assert line.startswith("    ")
        assert line.isprintable()
    assert main(["plan", str(tmp_path / f"no{FORGED}.yaml")]) == 2
    print_notes([f"link {FORGED} has no shape"])
    for line in capsys.readouterr().err.split("\n"):
        assert line.startswith(("ff-planner: ", "    ")) or not line
        assert "\x1b" not in line
        assert "done" not in line or line.startswith("    ")


def test_a_name_of_a_cell_is_one_line_without_a_terminal_s_commands() -> None:
    name = "c1\n[ERROR] forged\r\x1b[31m"
    lines = list(table_lines("nearest", ("body", "distance [m]"), [(name, "1.0")]))
    assert len(lines) == 3
    assert lines[2].split("  ")[0] == "c1?[ERROR] forged??[31m"


def test_a_text_with_another_separator_stays_one_cell(tmp_path: Path) -> None:
    """Where a comma is the decimal point, spreadsheets split at semicolons."""
    _write(tmp_path / "table.csv", ["plan;=1"], [["a;=1+1"], ["b\t=2"], [-1.5]])
    assert (tmp_path / "table.csv").read_bytes() == b'"plan;=1"\r\n"a;=1+1"\r\n"b\t=2"\r\n-1.5\r\n'
