"""The benchmark's data set: what its files promise, and that seeds give them."""

import hashlib
import json
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from pages import PAGES, console
from scipy.interpolate import BPoly

from ff_planner_benchmark import dataset
from ff_planner_benchmark.cli import command_parser, main
from ff_planner_benchmark.entrants import planners
from ff_planner_benchmark.problems import still_goals, tumbling, tumbling_witness
from ff_planner_benchmark.scorer.score import score
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.problems import bodies, scenarios
from ff_planner_ros.problems.paths import roll_out

PROJECT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One scenario of each class of the public seeds."""
    directory = tmp_path_factory.mktemp("dataset") / "new"
    dataset.write_dataset(directory, dataset.SEEDS["public"], 1)
    return directory


# Of the first scenario of each class, as published.
HASHES = {
    "planar": "7eba21b8a118aaa8b02639a4503f1c0e383bce1f5a1767cbf458d53d7a0c62be",
    "ordinary": "88ff53d620495d098eacc6a0e9a3f2389cc16d87d4c272106e92617f8cc19267",
    "cluttered": "dbdf7119846337b55dc72e26d001839b6493cd865c041d33195007a36e48e728",
    "bodies": "1bf65cb7c7dd11fc3427f566f3765af66b52197d10d4f1cd4662622309114ce4",
    "tumbling": "2cc23afe8a1346354e571878ee0110c94e4c434388c4bfdfb31e100794b9c30f",
    "high_momentum": "b926e87cb766238253892849564bca9a1334fc8badca820562462ebd451c21a9",
}


@pytest.mark.law("FILE-08")
@pytest.mark.parametrize("kind", dataset.CLASSES)
def test_the_first_scenario_of_each_class_has_its_published_hash(small, kind):
    file = small / "scenarios" / kind / "0000.yaml"
    assert hashlib.sha256(file.read_bytes()).hexdigest() == HASHES[kind], file.read_text()


def test_there_are_a_thousand_scenarios_of_six_classes_and_five_robots_or_more():
    assert len(dataset.CLASSES) == 6
    assert sum(kind.scenarios for kind in dataset.CLASSES.values()) >= 1000
    robots = {
        *bodies.ROBOTS,
        *(name for kind in still_goals.KINDS.values() for name in kind.robots),
    }
    assert len(robots) >= 5


def test_no_number_of_a_scenario_has_more_decimals_than_promised(small):
    for file in small.rglob("*.yaml"):
        numbers = re.findall(r"-?\d+\.(\d+)", file.read_text())
        assert numbers
        assert max(map(len, numbers)) <= dataset.DECIMALS, file
        assert not re.search(r"-0\.0\b", file.read_text()), file


def test_a_scenario_is_a_scenario_file_that_the_planner_reads(small):
    for file in small.rglob("*.yaml"):
        problem, told = load_scenario(file), yaml.safe_load(file.read_text())
        assert problem.robot.joints == len(told["joints"]["position"])
        assert dataset.scenario_text(problem) == file.read_text(), file


def test_other_seeds_give_other_scenarios_of_the_same_kind():
    drawn = [
        dataset.scenario_text(dataset.CLASSES["planar"].problem(seed * 1_000_000))
        for seed in (*dataset.SEEDS.values(), 77)
    ]
    assert len(set(drawn)) == 3
    assert len({text.splitlines()[0] for text in drawn}) <= 3


def test_twice_as_many_steps_of_the_witness_give_the_same_scenarios(monkeypatch):
    which = [("planar", 0), ("planar", 4), ("high_momentum", 0), ("high_momentum", 2)]
    which += [("tumbling", 0), ("tumbling", 3)]
    before = [_drawn_anew(*one) for one in which]
    monkeypatch.setattr(tumbling_witness, "_FINER", 2 * tumbling_witness._FINER)
    for one, first in zip(which, before, strict=True):
        finer = _drawn_anew(*one)
        moved = np.linalg.norm(finer.target.position - first.target.position)
        assert 0.0 < moved < 1e-11, (one, moved)
        assert dataset.scenario_text(finer) == dataset.scenario_text(first), one


def _drawn_anew(kind, number):
    """Return a problem of a class, not the one that was kept."""
    if kind == "tumbling":
        return tumbling.drawn.__wrapped__(kind, number).problem
    return still_goals.drawn.__wrapped__(kind, number).problem


def test_the_witness_of_a_still_goal_solves_its_written_scenario(tmp_path):
    (tmp_path / "robots").mkdir()
    for kind, number in (("planar", 0), ("planar", 1), ("high_momentum", 1)):
        drawn = still_goals.drawn(kind, number)
        robot = drawn.problem.robot
        way, times, *_ = drawn.witness
        path = tmp_path / "scenarios" / f"{kind}{number}" / "0000.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(dataset.scenario_text(drawn.problem))
        urdf = tmp_path / "robots" / f"{dataset.robot_name(robot)}.urdf"
        urdf.write_text(robot.drawn_urdf)
        judged = score(path, _answer(times, way[:, 7:], drawn.problem.start.joint_velocities))
        assert not [fault for fault in judged.faults if "passes" not in fault], judged
        assert judged.clearance is None or judged.clearance > 0.015, judged


def test_the_witness_of_an_ordinary_scenario_solves_it_as_written(small):
    drawn = scenarios.scenario("ordinary", "lemur", 0, turned=False)
    motion = roll_out(drawn.problem, drawn.witness, 400)
    times = np.linspace(0.0, drawn.problem.duration, 400)
    answer = {
        "time": times.tolist(),
        "joint_positions": motion.q[:, 7:].tolist(),
        "joint_velocities": motion.v[:, 6:].tolist(),
    }
    judged = score(small / "scenarios" / "ordinary" / "0000.yaml", answer)
    assert judged.solved, judged
    assert judged.clearance > 0.019, judged


def _answer(times, angles, first):
    """Return samples of the joints as an answer, their rates by differences."""
    rates = np.gradient(angles, times, axis=0, edge_order=2)
    rates[0] = first
    motion = BPoly.from_derivatives(times, np.stack([angles, rates], axis=1))
    return {
        "time": times.tolist(),
        "joint_positions": motion(times).tolist(),
        "joint_velocities": rates.tolist(),
    }


def test_a_directory_that_holds_something_is_not_written_over(tmp_path):
    (tmp_path / "note").write_text("mine")
    with pytest.raises(InvalidInput, match="new or an empty directory"):
        dataset.write_dataset(tmp_path, 0, 1)
    assert (tmp_path / "note").read_text() == "mine"


KILLED = """
import multiprocessing, os, signal, time
from ff_planner_benchmark.dataset import end_with_parent

def work():
    end_with_parent()
    time.sleep(600)

multiprocessing.get_context("fork").Process(target=work).start()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_worker_ends_when_the_run_that_started_it_was_killed():
    # The worker has the other end of the pipe, which is read until nobody can write any more
    done = subprocess.run([sys.executable, "-c", KILLED], capture_output=True, timeout=120)
    assert done.returncode == -signal.SIGKILL, done.stderr


def test_a_changed_file_of_a_data_set_is_told_by_its_name(small):
    file = small / "scenarios" / "planar" / "0000.yaml"
    kept = file.read_text()
    try:
        file.write_text(kept.replace("duration: ", "duration: 1"))
        with pytest.raises(InvalidInput, match=r"planar/0000\.yaml is missing, new or changed"):
            dataset.checked(small)
    finally:
        file.write_text(kept)
    dataset.checked(small)


@pytest.mark.parametrize("word", ["secret", "-1", "1.5", "", "²"])
def test_seeds_are_two_names_or_a_whole_number(word):
    with pytest.raises(InvalidInput, match="public, hidden or a whole number"):
        dataset.seed_of(word)


# Verb and options, by the reason that is told.
REFUSED = {
    "--scenarios is 0": "dataset --scenarios 0",
    "--workers is 0": "dataset --workers 0",
    "--seeds is x": "dataset --seeds x",
    "was written with other seeds": "dataset --seeds 4711",
    "--scenarios is -1": "contest --method ours --scenarios -1",
    "no planar/0001: it was written with fewer": "contest --method ours",
    "--scenarios is 10001": "contest --method ours --scenarios 10001",
    "--workers is -1": "contest --method ours --workers -1",
    "--seconds is -1": "contest --method ours --seconds -1",
    "--seconds is nan": "contest --method ours --seconds nan",
    "--method is nobody": "contest --scenarios 1 --method ours --method nobody",
    "there is no program nobody": "contest --scenarios 1 --method 'nobody {scenario} {answer}'",
    "No closing quotation": """contest --scenarios 1 --method "sh '{scenario} {answer}" """,
}


@pytest.mark.parametrize("reason", REFUSED)
def test_a_wrong_option_is_refused_in_one_line(small, capfd, reason):
    verb, *options = shlex.split(REFUSED[reason])
    assert main([verb, str(small), *options]) == 2
    said = capfd.readouterr().err
    assert reason in said
    assert said.startswith("ff-planner-benchmark: ")
    assert said.count("\n") == 1, said


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("bench --scenarios 0", "--scenarios is 0"),
        ("engines --scenarios 10001", "--scenarios is 10001"),
        ("bench --only nothing", "--only is nothing: it must be one of methods, scaling, "),
    ],
)
def test_an_experiment_that_is_not_there_or_of_no_size_is_refused(capfd, options, reason):
    assert main(options.split()) == 2
    said = capfd.readouterr().err
    assert reason in said
    assert said.count("\n") == 1, said


def test_where_there_is_no_data_set_the_command_that_writes_one_is_told(tmp_path, capfd):
    assert main(["contest", str(tmp_path), "--method", "ours"]) == 2
    assert f"`ff-planner-benchmark dataset {tmp_path}`" in capfd.readouterr().err


def test_a_whole_set_that_is_not_the_published_one_is_refused(small, capfd, monkeypatch):
    monkeypatch.setattr(dataset, "is_whole", lambda _: True)
    assert main(["dataset", str(small), "--seeds", "public"]) == 2
    assert f"that of the public seeds is {dataset.PUBLISHED['public']}" in capfd.readouterr().err


@pytest.mark.law("FILE-08")
@pytest.mark.nightly
@pytest.mark.parametrize("name", dataset.PUBLISHED)
def test_the_whole_set_that_the_command_writes_is_the_published_one(tmp_path, capfd, name):
    assert main(["dataset", str(tmp_path / "set"), "--seeds", name]) == 0
    said = capfd.readouterr().out
    assert f"{dataset.PUBLISHED[name]}  as published: {name}, version {dataset.VERSION}" in said


def test_the_page_has_the_published_hashes_and_their_version():
    page = (PROJECT / "docs" / "how_to" / "dataset.md").read_text()
    for name, found in dataset.PUBLISHED.items():
        assert f"| {dataset.VERSION} | `{name}` | `{found}` |" in page


def test_a_hidden_set_has_a_seed_that_is_drawn_when_it_is_written(tmp_path, capfd):
    seeds = set()
    for number in range(2):
        directory = tmp_path / str(number)
        assert main(["dataset", str(directory), "--seeds", "hidden", "--scenarios", "1"]) == 0
        (seed,) = re.findall(r"^seed (\d+), drawn now", capfd.readouterr().out, re.MULTILINE)
        assert dataset.is_of(directory, int(seed))
        seeds.add(seed)
    assert len(seeds) == 2
    assert not seeds & {str(seed) for seed in dataset.SEEDS.values()}
    assert main(["dataset", str(directory), "--seeds", "hidden"]) == 2
    assert "was written with other seeds" in capfd.readouterr().err


def test_every_command_of_the_pages_is_one_that_the_parser_takes():
    commands = [one for page in PAGES for one in console(page)]
    typed = [one.words for one in commands if one.words[0].endswith("ff-planner-benchmark")]
    assert {words[1] for words in typed} == {"bench", "engines", "dataset", "contest", "score"}
    for words in typed:
        command_parser().parse_args(words[1:])


def test_an_answer_of_the_planner_is_judged_by_the_command(small, tmp_path, capfd):
    scenario, answer = small / "scenarios" / "planar" / "0000.yaml", tmp_path / "answer.json"
    answer.write_text(json.dumps(planners.answer("ours", scenario, 1.0)))
    assert main(["score", str(scenario), str(answer)]) == 0
    assert json.loads(capfd.readouterr().out)["solved"]
    answer.write_text("{}")
    assert main(["score", str(scenario), str(answer)]) == 3
    assert main(["score", str(answer), str(answer)]) == 2
    assert "it must be a scenario of the data set" in capfd.readouterr().err


@pytest.mark.nightly
def test_a_contest_shows_what_methods_did_and_goes_on_with_what_its_file_has(
    small, tmp_path, capfd
):
    (tmp_path / "lost.py").write_text("def answer(*_):\n    return {'status': 'lost'}\n")
    command = ["contest", str(small), "--scenarios", "1", "--method", str(tmp_path / "lost.py")]
    command += ["--json", str(tmp_path / "answers.json")]
    assert main([*command, "--method", "ours"]) == 0
    shown = capfd.readouterr().out
    assert re.search(r"^ours +all +6 +100\.0%", shown, re.MULTILINE)
    assert re.search(r"lost\.py +6 +planar/0000 +no plan: lost$", shown, re.MULTILINE)
    assert "\n12 answers in " in shown
    assert main([*command, "--method", "ours"]) == 0
    assert "12 answers are there" in (again := capfd.readouterr().out)
    assert "\n0 answers in " in again
