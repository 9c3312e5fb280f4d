"""What a study may ask for, told in words before anything is made of it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import pytest
from campaigns import study_file
from measured_commands import MEGABYTES, Done, Run, measured_commands

from ff_planner_ros.campaign.study import MOST_CASES
from ff_planner_ros.cli import main

# [s] of a processor: a second, and what a busy machine and the libraries add
SOON = 6.0


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    with measured_commands() as run:
        yield run


def generated(**changes: Any) -> dict[str, Any]:
    return {
        "scenarios": [],
        "generated": {"kind": "ordinary", "robots": ["lemur"], "count": 1} | changes,
    }


def random(count: int, **values: Any) -> dict[str, Any]:
    return {"count": count, "seed": 1, "values": values or {"duration": {"uniform": [1.0, 2.0]}}}


def grid(*lengths: int) -> dict[str, Any]:
    keys = ("duration", "points", "planner.starts", "chaser.position[0]", "chaser.position[1]")
    return {key: [1.0] * length for key, length in zip(keys, lengths, strict=False)}


# Of each: what is asked for, and how many cases that are.
TOO_MANY: dict[str, tuple[dict[str, Any], int]] = {
    "draws": ({"variations": {"random": random(10_000_000)}}, 20_000_000),
    "generated problems": (
        {**generated(count=10_000_000), "methods": [{"name": "ours"}]},
        10_000_000 * 6,
    ),
    "a grid": ({"variations": {"grid": grid(100, 100, 10, 10, 10)}}, 20_000_000),
    "a grid and draws": ({"variations": {"grid": grid(1000), "random": random(5000)}}, 10_000_000),
    "methods": (
        {
            "variations": {"random": random(10_000)},
            "methods": [{"name": f"m{number}"} for number in range(1000)],
        },
        10_000_000,
    ),
    "numbers without end": (
        {"variations": {"grid": grid(100, 100, 100, 100, 100), "random": random(9_999_999)}},
        10**10 * 9_999_999 * 2,
    ),
}


@pytest.mark.sampled
@pytest.mark.parametrize("verb", ["campaign", "check"])
@pytest.mark.parametrize("kind", TOO_MANY)
def test_a_study_of_too_many_cases_says_its_number_and_its_limit_at_once(
    verb: str, kind: str, tmp_path: Path, run: Run
) -> None:
    changes, count = TOO_MANY[kind]
    path = study_file(tmp_path, **changes)
    out = ["--out", tmp_path / "out"] if verb == "campaign" else []
    done = run([verb, path, *out])
    assert done.code == 2, done
    assert f"{count} cases: a campaign has {MOST_CASES} cases at most" in done.out + done.err, done
    require_soon(done)
    assert not (tmp_path / "out").exists()


def varied(keys: int) -> dict[str, Any]:
    return {f"k{number}.x[0]": [1, 2] for number in range(keys)}


ENDLESS: dict[str, tuple[dict[str, Any], str]] = {
    "values": ({"variations": {"grid": varied(30_000)}}, "30000 keys: a study varies 500 at most"),
    "values whose cases nobody counts": (
        {"variations": {"grid": varied(500)}},
        f"8752 cases: a campaign has {MOST_CASES} cases at most",
    ),
    "values of a method": (
        {"methods": [{"name": "ours", "set": varied(30_000)}]},
        "methods[0].set is 30000 keys",
    ),
    "one scenario": (
        {"scenarios": ["quick_capture.yaml"] * 10_000},
        "scenarios is quick_capture: each scenario must have a name of its own",
    ),
    "factors": (
        {"variations": {"grid": {"duration": {"times": [10**390]}}}},
        "no computer calculates with numbers of this size",
    ),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ENDLESS)
def test_a_study_without_end_is_refused_in_words(kind: str, tmp_path: Path, run: Run) -> None:
    changes, words = ENDLESS[kind]
    done = run(["campaign", study_file(tmp_path, **changes), "--out", tmp_path / "out"])
    assert done.code == 2, done
    assert words in done.out + done.err, done
    require_soon(done)


def require_soon(done: Done) -> None:
    assert done.seconds < SOON, done
    assert done.megabytes < MEGABYTES, done


SCENARIOS = {
    "/**/*.yaml": "** for nothing",
    "**": "** for nothing",
    "*": "there is no such file",  # a directory among them
    "*.none": "there is no such file",
    "": "it must be text",
    "a\0*": "there is no such file",
    "a\0": "there is no such file",
    "x" * 5000 + "*": "there is no such file",
    "x" * 5000: "it stands for no file",
    "../*/../*/none*": "there is no such file",
    "many/*": "it stands for more than 10000 files",
}


@pytest.mark.sampled
@pytest.mark.parametrize("named", SCENARIOS)
def test_a_pattern_that_stands_for_no_scenarios_is_refused_in_words(
    named: str, tmp_path: Path, run: Run
) -> None:
    studies = tmp_path / "few" / "studies"  # beside nothing else: patterns may go up
    (studies / "directory").mkdir(parents=True)
    if named.startswith("many"):
        (studies / "many").mkdir()
        for number in range(10_001):
            (studies / "many" / f"{number}.yaml").touch()
    path = study_file(studies, scenarios=[named])
    done = run(["campaign", path, "--out", tmp_path / "out"])
    assert done.code == 2, done
    assert "scenarios[0] is " in done.err
    assert SCENARIOS[named] in done.err, done
    assert done.err.count("\n") == 1, done
    require_soon(done)


ROBOTS = ["", "arm", "arm5", "arm0", "arm06", "arm-6", "arm 6", " arm6", "arm6\n", "arm1000000"]
ROBOTS += ["arm\u0666", "arm31", "planar3", "planar", "r2", "../lemur", "Lemur", "\0", "a" * 5000]


@pytest.mark.sampled
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_that_no_generator_knows_is_refused_by_name(
    robot: str, tmp_path: Path, run: Run
) -> None:
    done = run(["check", study_file(tmp_path, **generated(robots=["lemur", robot]))])
    assert done.code == 2, done
    assert "generated.robots[1] is" in done.out
    assert ("arm6 to arm30" if robot else "it must be text") in done.out
    require_soon(done)


EMPTY: dict[str, dict[str, Any]] = {
    "nothing to plan": {"scenarios": []},
    "generated.robots is ": generated(robots=[]),
    "methods is ": {"methods": []},
    "duration is empty": {"variations": {"grid": {"duration": []}}},
    "duration.times is ": {"variations": {"random": random(1, duration={"times": {}})}},
    "duration.choice is empty": {"variations": {"random": random(1, duration={"choice": []})}},
    "duration.uniform is ": {"variations": {"random": random(1, duration={"uniform": []})}},
    "variations.grid.duration is ": {"variations": {"grid": {"duration": {"plus": []}}}},
    "scenarios[0] is ": {"scenarios": [[]]},
    "off7: it has no bodies": generated(kind="bodies", robots=["off7"]),
}


@pytest.mark.parametrize("said", EMPTY)
def test_what_is_empty_is_refused_in_words(
    said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(study_file(tmp_path, **EMPTY[said]))]) == 2
    told = capsys.readouterr()
    words = told.out + told.err
    assert said in words or said.replace(".times", "") in words, words
    assert "defect" not in words


TLS: dict[str, tuple[dict[str, Any], str]] = {
    "tls://127.0.0.1:8786": ({}, "TLS needs certificates"),
    "tls://nobody": (
        dict.fromkeys(("ca-file", "client.cert", "client.key"), "none.pem"),
        "No such file",
    ),
    "tls://127.0.0.1:1": ({"ca-file": "-----BEGIN\nnone"}, "TLS needs certificates"),
}


@pytest.mark.parametrize("address", TLS)
def test_tls_without_certificates_is_refused_in_words(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, said = TLS[address]
    told = {f"distributed.comm.tls.{name}": value for name, value in files.items()}
    words = ["campaign", str(study_file(tmp_path)), "--out", str(tmp_path / "out")]
    with dask.config.set(told):
        assert main([*words, "--scheduler", address]) == 2
    err = capsys.readouterr().err
    assert f"--scheduler is {address}: " in err
    assert said in err
    assert err.count("\n") == 1


def test_an_address_without_tls_is_refused_where_encryption_is_required(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["campaign", str(study_file(tmp_path)), "--out", str(tmp_path / "out")]
    with dask.config.set({"distributed.comm.require-encryption": True}):
        assert main([*words, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "requires encryption: the address must be tls://" in capsys.readouterr().err
