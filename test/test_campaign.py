"""Campaigns on a cluster of two workers: killed workers, going on, and what is refused."""

from __future__ import annotations

import errno
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import distributed
import pyarrow.parquet
import pytest
from campaigns import study, study_file

from ff_planner_ros.campaign import cluster, run
from ff_planner_ros.campaign.cases import cases
from ff_planner_ros.campaign.run import run_campaign
from ff_planner_ros.campaign.table import (
    Writer,
    digest_of,
    locked,
    part_files,
    plan_schema,
    read_plans,
)
from ff_planner_ros.campaign.work import run_case
from ff_planner_ros.cli import main
from ff_planner_ros.commands import campaigns
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.report.study import page as study_page

ROWS = 2 * 3 * 2  # of the small study


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with two workers."""
    with cluster.local_cluster(2, dashboard=False) as address:
        yield address


@pytest.fixture(scope="module")
def on_two(scheduler: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a whole campaign that two workers planned, trajectories kept."""
    directory = tmp_path_factory.mktemp("on_two")
    asked = study(directory, keep={"trajectories": True})
    done = run_campaign(asked, directory / "out", scheduler, workers=2)
    assert (done.cases, done.rows, done.other_rows, done.given_up) == (ROWS, ROWS, 0, ())
    return directory / "out"


def without_times(directory: Path) -> list[dict[str, Any]]:
    return read_plans(directory).drop_columns(["solve_time"]).to_pylist()


def ids(directory: Path) -> list[str]:
    """The ids in the files, read without our code."""
    found: list[str] = []
    for path in (directory / "plans").glob("*.parquet"):
        found += pyarrow.parquet.read_table(path).column("id").to_pylist()
    return found


@pytest.mark.ci
@pytest.mark.law("FILE-06")
def test_two_workers_write_the_rows_that_one_process_computes(on_two: Path, tmp_path: Path) -> None:
    expected = {case.id: run_case(case).row for case in cases(study(tmp_path))}
    rows = {row["id"]: row for row in read_plans(on_two).to_pylist()}
    assert rows.keys() == expected.keys()
    for key, row in expected.items():
        known = {name: value for name, value in rows[key].items() if value is not None}
        wanted = {name: value for name, value in row.items() if value is not None}
        assert known | {"solve_time": 0} == wanted | {"solve_time": 0}
    assert {row["solved"] for row in rows.values() if row["method"] == "ours"} == {True}


@pytest.mark.nightly
@pytest.mark.law("FILE-06")
def test_any_number_of_workers_of_a_cluster_of_its_own_writes_the_same_bits(
    on_two: Path, tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    for workers in (1, 4)[: times(1, 2)]:
        out = tmp_path / str(workers)
        assert run_campaign(study(tmp_path), out, workers=workers).rows == ROWS
        assert digest_of(read_plans(out)) == digest_of(read_plans(on_two))


@pytest.mark.law("FILE-06")
@pytest.mark.ci
def test_a_worker_that_is_killed_costs_and_doubles_no_row(
    scheduler: str, on_two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with distributed.Client(scheduler, set_as_default=False) as client:
        victim = next(iter(client.run(os.getpid).values()))
    killed: list[int] = []
    add = Writer.add

    def add_and_kill(self: Writer, outcomes: Any) -> int:
        if not killed:  # the first result is there, others are on their way
            os.kill(victim, signal.SIGKILL)
            killed.append(victim)
        return add(self, outcomes)

    monkeypatch.setattr(Writer, "add", add_and_kill)
    run_campaign(study(tmp_path), tmp_path / "out", scheduler)
    assert killed
    assert not Path(f"/proc/{victim}").exists() or "Z" in Path(f"/proc/{victim}/stat").read_text()
    assert sorted(ids(tmp_path / "out")) == sorted(case.id for case in cases(study(tmp_path)))
    assert without_times(tmp_path / "out") == without_times(on_two)


# Scheduler and worker in one process: both are gone at once.
CLUSTER = """
import sys, distributed
cluster = distributed.LocalCluster(
    n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1",
    scheduler_port=int(sys.argv[1]), dashboard_address=None,
)
print(cluster.scheduler_address, flush=True)
sys.stdin.read()
"""


def started_cluster(port: int) -> tuple[subprocess.Popen[str], str]:
    """Start a scheduler, at any port for 0; return its process and its address."""
    words = [sys.executable, "-c", CLUSTER, str(port)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline().strip()


def end(server: subprocess.Popen[str]) -> None:
    server.kill()
    server.communicate()


@pytest.mark.nightly
def test_a_scheduler_that_is_killed_and_started_again_costs_and_doubles_no_row(
    on_two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, address = started_cluster(0)
    servers = [first]
    add = Writer.add

    def add_and_kill(self: Writer, outcomes: Any) -> int:
        if len(servers) == 1:  # the first result is there, others are on their way
            end(first)
            servers.append(started_cluster(int(address.rpartition(":")[2]))[0])
        new = add(self, outcomes)
        if len(self.done) == ROWS:  # with nothing left to do, nobody waits for another one
            end(servers[1])
        return new

    monkeypatch.setattr(Writer, "add", add_and_kill)
    try:
        done = run_campaign(study(tmp_path), tmp_path / "out", address)
    finally:
        for server in servers:
            end(server)
    assert len(servers) == 2
    assert done.rows == ROWS
    assert sorted(ids(tmp_path / "out")) == sorted(case.id for case in cases(study(tmp_path)))
    assert without_times(tmp_path / "out") == without_times(on_two)


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("fails", ["nthreads", "submit", "result"])
def test_a_scheduler_that_goes_away_in_between_costs_no_case(
    fails: str, scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = distributed.Future if fails == "result" else distributed.Client
    works, failed = getattr(of, fails), list[str]()

    def fail_once(*arguments: Any, **more: Any) -> Any:
        if not failed:
            failed.append(fails)
            raise distributed.comm.CommClosedError("in the middle of it")
        return works(*arguments, **more)

    monkeypatch.setattr(of, fails, fail_once)
    few = list(cases(study(tmp_path)))[:3]
    found = [one for part in cluster.outcomes(scheduler, iter(few), 3) for one in part]
    assert failed == [fails]
    assert sorted(one.row["id"] for one in found) == sorted(case.id for case in few)


def test_a_campaign_that_is_stopped_is_taken_up_where_it_was(
    scheduler: str, on_two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, out = study(tmp_path), tmp_path / "out"
    seen: list[str] = []
    add = Writer.add

    def add_and_stop(self: Writer, outcomes: Any) -> int:
        new = add(self, outcomes)
        seen.extend(outcome.row["id"] for outcome in outcomes)
        if len(seen) >= 3:
            os.kill(os.getpid(), signal.SIGTERM)
        return new

    with monkeypatch.context() as patch:
        patch.setattr(Writer, "add", add_and_stop)
        done = run_campaign(asked, out, scheduler)
    assert sorted(ids(out)) == sorted(seen)
    assert 3 <= done.rows < ROWS
    before = {path: path.read_bytes() for path in part_files(out)}

    planned: list[str] = []

    def add_and_note(self: Writer, outcomes: Any) -> int:
        planned.extend(outcome.row["id"] for outcome in outcomes)
        return add(self, outcomes)

    monkeypatch.setattr(Writer, "add", add_and_note)
    again = run_campaign(asked, out, scheduler)
    assert again.rows == ROWS
    assert sorted(planned) == sorted({case.id for case in cases(asked)} - set(seen))
    assert {path: path.read_bytes() for path in before} == before, "what is there stays"
    assert without_times(out) == without_times(on_two)


def test_a_campaign_that_is_whole_needs_no_cluster(on_two: Path, tmp_path: Path) -> None:
    done = run_campaign(study(tmp_path), on_two, scheduler="tcp://127.0.0.1:1")
    assert done.rows == ROWS


def test_trajectories_are_those_whose_digest_the_row_has(on_two: Path) -> None:
    points = pyarrow.parquet.read_table(on_two / "trajectories").to_pylist()
    rows = {row["id"]: row for row in read_plans(on_two).to_pylist()}
    solved = {key for key, row in rows.items() if row["solved"]}
    assert {point["id"] for point in points} == solved
    for key in solved:
        path = [point for point in points if point["id"] == key]
        assert [point["point"] for point in path] == list(range(len(path)))
        assert path[-1]["time"] == pytest.approx(rows[key]["change.duration"], abs=1e-12)


def test_the_commands_of_the_report_plan_the_cases_of_their_rows(
    on_two: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "report", str(on_two), "--plans", "0"]) == 0
    page = Path(capsys.readouterr().out.strip())
    text = page.read_text(encoding="utf-8")
    rows = {row["id"]: row for row in read_plans(on_two).to_pylist()}
    commands = {
        shlex.split(found)[1:].__str__(): shlex.split(found)[1:]
        for found in re.findall(r"<code>(ff-planner [^<]*)</code>", text)
    }
    assert commands
    defaults = Defaults(load_parameters().planner)
    for words in commands.values():
        row = rows[Path(words[1]).parent.name]
        assert load_task(Path(words[1]), defaults).digest == row["digest"]
        assert ("--method" in words) == (row["method"] == "straight")
    assert digest_of(read_plans(on_two)) in text
    assert text.count("<table") >= 3


def test_a_disk_that_is_full_keeps_the_rows_that_were_written(tmp_path: Path) -> None:
    all_of_them = [run_case(case) for case in list(cases(study(tmp_path)))[:4]]
    schema = plan_schema({"duration": "number"})
    writer = Writer(tmp_path, schema)
    writer.add(all_of_them[:2])
    writer.flush()
    writer.add(all_of_them[2:])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # bytes: nothing more can be written
    try:
        with pytest.raises(OSError, match=r"rows of .*plans written before are kept"):
            writer.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.name for path in (tmp_path / "plans").iterdir()] == ["part-000000.parquet"]
    again = Writer(tmp_path, schema)
    assert again.done == {outcome.row["id"] for outcome in all_of_them[:2]}
    assert again.add(all_of_them) == 2


def test_where_the_system_names_no_file_a_full_disk_is_still_told_clearly(
    on_two: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(study_page, "save_campaign_page", full)
    assert main(["campaign", "report", str(on_two)]) == 2
    said = capsys.readouterr().err
    assert f"the report could not be written; the plans in {on_two} are kept" in said
    assert said.count("\n") == 1


def test_trajectories_without_their_plans_and_unfinished_files_are_removed(tmp_path: Path) -> None:
    for name in ("plans/part-000000.parquet.unfinished", "trajectories/part-000000.parquet"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(b"half a file")
    assert Writer(tmp_path, plan_schema({})).done == set()
    assert list((tmp_path / "plans").iterdir()) == []
    assert list((tmp_path / "trajectories").iterdir()) == []


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "part-000000.parquet").write_bytes(b"no Parquet")
    with pytest.raises(InvalidInput, match=r"part-000000.parquet: it is damaged"):
        Writer(tmp_path, plan_schema({}))


def test_a_key_that_is_now_varied_by_words_needs_another_directory(
    on_two: Path, tmp_path: Path
) -> None:
    words = {"random": {"count": 1, "seed": 1, "values": {"duration": {"choice": [2.0, "long"]}}}}
    with pytest.raises(InvalidInput, match=r"another kind \(.*change.duration"):
        run_campaign(study(tmp_path, variations=words), on_two, "tcp://127.0.0.1:1")


def test_a_scheduler_that_does_not_answer_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "_CONNECT", 0.2)
    words = ["campaign", str(study_file(tmp_path)), "--out", str(tmp_path / "out")]
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "127.0.0.1:no_port"):
        assert main([*words, "--scheduler", address]) == 2
        assert f"--scheduler is {address}: no scheduler answers" in capsys.readouterr().err


@pytest.mark.ci
def test_a_worker_of_another_version_is_named(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = cluster.environment()
    monkeypatch.setattr(cluster, "environment", lambda: here | {"scipy": "0.0.1"})
    with pytest.raises(InvalidInput, match=r"worker is tls://.*: scipy is .*, not 0.0.1"):
        run_campaign(study(tmp_path), tmp_path / "out", scheduler)
    assert ids(tmp_path / "out") == []


@pytest.mark.ci
def test_a_worker_of_another_version_that_comes_later_is_named(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = cluster.environment()
    monkeypatch.setattr(cluster, "_require_same_software", lambda *_: None)
    monkeypatch.setattr(cluster, "environment", lambda: here | {"scipy": "0.0.1"})
    with pytest.raises(InvalidInput, match=r"worker is tls://.*: scipy is .*, not 0.0.1"):
        run_campaign(study(tmp_path), tmp_path / "out", scheduler)


def test_a_directory_of_another_version_or_another_thing_or_another_campaign_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, out = study(tmp_path), tmp_path / "out"
    with pytest.raises(InvalidInput, match="holds something else"):
        run_campaign(asked, tmp_path, "tcp://127.0.0.1:1")
    with monkeypatch.context() as patch:
        patch.setattr(run, "environment", lambda: {"ff_planner_ros": "0.1"})
        patch.setattr(run, "outcomes", lambda *_: iter(()))
        run_campaign(asked, out, "tcp://127.0.0.1:1")
    with pytest.raises(InvalidInput, match=r"its plans are of ff_planner_ros 0\.1; this is"):
        run_campaign(asked, out, "tcp://127.0.0.1:1")
    (out / "versions.json").unlink()
    for path in out.rglob("*"):
        if path.is_file():
            path.unlink()
    with (
        locked(out),
        pytest.raises(InvalidInput, match="another campaign is writing"),
        locked(out),
    ):
        pass


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["study.yaml"], "--out is missing"),
        (["study.yaml", "more", "--out", "x"], "argument is more"),
        (["study.yaml", "--out", "x", "--workers", "0"], "--workers is 0: it must be from 1"),
        (["study.yaml", "--out", "x", "--dashboard"], "--dashboard is asked for: it needs bokeh"),
        (["report", "none"], "there is no campaign"),
        (["none.yaml", "--out", "x"], "none.yaml: it cannot be read"),
    ],
)
def test_what_the_command_lacks_is_named(
    arguments: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(campaigns, "find_spec", lambda _name: None)  # as where there is no bokeh
    assert main(["campaign", *arguments]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("linked", ["plans", "trajectories", "plans/part-000001.parquet"])
def test_a_table_that_is_a_link_is_neither_read_nor_written_nor_emptied(
    linked: str, tmp_path: Path
) -> None:
    """Or else whoever hands on a campaign has files removed that lie elsewhere."""
    elsewhere, place = tmp_path / "elsewhere", tmp_path / "campaign" / linked
    elsewhere.mkdir()
    theirs = [elsewhere / "part-000001.parquet", elsewhere / "notes.unfinished"]
    for file in theirs:
        file.touch()
    place.parent.mkdir(parents=True)
    place.symlink_to(theirs[0] if place.suffix else elsewhere)
    with pytest.raises(InvalidInput, match="links are not followed here"):
        Writer(tmp_path / "campaign", plan_schema({}))
    assert all(file.exists() for file in theirs)
