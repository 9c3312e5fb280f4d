"""The contest judges by its own copy: whatever a method does or answers, it alone loses."""

import json
import os
import signal
import subprocess
import sys
import textwrap

import psutil
import pytest

from ff_planner_benchmark import cli, contest, contest_results, dataset, watched
from ff_planner_benchmark.entrants import planners
from ff_planner_benchmark.own_copy import own_copy
from ff_planner_benchmark.scorer.score import MOST_POINTS, Score, judged, load
from ff_planner_ros.errors import InvalidInput

pytestmark = pytest.mark.ci

SECONDS = 5.0


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One scenario of each class of the public seeds."""
    directory = tmp_path_factory.mktemp("fair") / "new"
    dataset.write_dataset(directory, dataset.SEEDS["public"], 1)
    return directory


@pytest.fixture
def method(tmp_path):
    """What writes a method's file, and returns its name."""

    def write(text, name="method.py"):
        (tmp_path / name).write_text(textwrap.dedent(text))
        return str(tmp_path / name)

    return write


def asked(small, method, kinds=("planar",), seconds=SECONDS):
    copies = [own_copy(small, kind, 0) for kind in kinds]
    return contest._judged_in_turn(seconds, (method, copies))


STILL = """
    import yaml

    def still(told):
        begin, rates = told["joints"]["position"], told["joints"]["velocity"]
        return {"time": [0.0, told["duration"]], "joint_positions": [begin, begin],
                "joint_velocities": [rates, [0.0] * len(rates)]}
"""
REWRITES = (
    STILL
    + """
    from pathlib import Path

    def answer(scenario, seconds):
        told = yaml.safe_load(scenario.read_text())
        answer = still(told)
        for file in (scenario, *Path(SET).glob("scenarios/*/*.yaml")):
            told = yaml.safe_load(file.read_text())
            told["duration"] = 0.1
            told["obstacles"], told["limits"] = [], {}
            file.write_text(yaml.safe_dump(told))
        for file in Path(SET).glob("robots/*"):
            file.unlink()
        return answer
"""
)


@pytest.mark.nightly
@pytest.mark.law("FILE-07")
def test_a_method_that_rewrites_the_scenarios_gains_nothing_and_spoils_nothing(
    small, method, tmp_path
):
    own = tmp_path / "set"
    dataset.write_dataset(own, dataset.SEEDS["public"], 1)
    file = own / "scenarios" / "planar" / "0000.yaml"
    kept = tmp_path / "kept.json"
    kept.write_text(json.dumps(planners.answer("ours", file, SECONDS)))
    evil = method(REWRITES.replace("SET", repr(str(own))), "evil.py")
    good = method(
        f"""
        import json
        def answer(scenario, seconds):
            if scenario.parent.name != "planar":
                return {{"status": "no_plan"}}
            assert "0.1" != scenario.read_text().partition("duration: ")[2].split()[0]
            return json.loads(open({str(kept)!r}).read())
        """,
        "good.py",
    )
    found = list(contest.results([evil, good], own, 1, SECONDS, 1))
    of = {(one.method, one.kind): one.score for one in found}
    assert len(of) == 2 * len(dataset.CLASSES)
    for kind in dataset.CLASSES:
        assert not of[evil, kind].solved
        assert any("the end effector" in fault for fault in of[evil, kind].faults), of[evil, kind]
    assert of[good, "planar"].solved
    assert "duration: 0.1" in file.read_text()  # it did what it could
    assert "duration: 0.1" not in (small / "scenarios" / "planar" / "0000.yaml").read_text()


INTO_PIPES = """
    import os, pickle, threading

    class Evil:
        def __reduce__(self):
            return os.system, ("touch {canary}",)

    def answer(scenario, seconds):
        lines = [pickle.dumps(Evil()), pickle.dumps((0.0, {{"answer": 1}})), {line!r}]
        for number in range(3, 30):
            for line in lines:
                try:
                    os.write(number, line + b"\\n")
                except OSError:
                    pass
        return {{"status": "no_plan"}}
"""


@pytest.mark.parametrize(
    "line", [b'{"solved": true}', b'{"question": "0", "answer": 1}', b"[1]", b"[" * 100_000, b""]
)
def test_what_a_method_writes_into_its_pipes_is_no_more_than_bytes(small, method, tmp_path, line):
    canary = tmp_path / "canary"
    (one,) = asked(small, method(INTO_PIPES.format(canary=canary, line=line)))
    assert not one.score.solved
    assert not canary.exists()


# Answers in Python, `told` the scenario and `still` one that stays where it is.
ANSWERS = {
    "joints 50 rad away": "{**still, 'joint_positions': [[50.0] * n, [-50.0] * n]}",
    "joints 9e5 rad away": "{**still, 'joint_positions': [[9e5] * n, [-9e5] * n]}",
    "rates of 9e5 rad/s": "{**still, 'joint_velocities': [[9e5] * n, [-9e5] * n]}",
    "accelerations": "{**still, 'joint_accelerations': [[9e5] * n, [-9e5] * n]}",
    "times a microsecond apart": "{**still, 'time': [0.0, 1e-6, T], "
    "'joint_positions': [p, [9e5] * n, p], 'joint_velocities': [v, v, v]}",
    "many points": "{'time': [T * k / 99999 for k in range(100000)], "
    "'joint_positions': [p] * 100000, 'joint_velocities': [v] * 100000}",
    "many numbers": "{**still, 'more': [0.0] * 3000000}",
    "30 MB of text": "{**still, 'message': 'x' * 30000000}",
    "deep lists": "__import__('functools').reduce(lambda a, _: [a], range(500), [])",
    "not a number": "{**still, 'time': [0.0, float('nan')]}",
    "an infinite time": "{**still, 'time': [0.0, float('inf')]}",
    "numbers of many digits": "{**still, 'time': [0, 10 ** 4000]}",
    "no mapping": "[still]",
    "times that are a mapping": "{**still, 'time': {'a': 1}}",
    "times that are none": "{**still, 'time': None}",
    "names that are a number": "{**still, 'joint_names': 3}",
    "a status that is a list": "{'status': ['solved']}",
    "bytes": "b'answer'",
    "a set": "{1, 2}",
}
ANSWERING = (
    STILL
    + """
    def answer(scenario, seconds):
        told = yaml.safe_load(scenario.read_text())
        still_, p, v = still(told), told["joints"]["position"], told["joints"]["velocity"]
        n, T = len(p), told["duration"]
        return (lambda still: {answer})(still_)
"""
)


@pytest.mark.sampled
@pytest.mark.law("FILE-07")
@pytest.mark.parametrize("kind", ANSWERS)
def test_whatever_a_method_answers_it_alone_loses(small, method, kind):
    evil = method(ANSWERING.replace("{answer}", ANSWERS[kind]))
    found = asked(small, evil, ("planar", "bodies"), seconds=20.0)
    assert [one.score.solved for one in found] == [False, False]
    assert all(one.score.faults for one in found)
    if kind == "many points":
        assert f"more than {MOST_POINTS}" in found[0].score.faults[0]


def test_as_many_points_as_are_allowed_are_judged(small):
    file = small / "scenarios" / "planar" / "0000.yaml"
    content, *rest = load(file)
    begin, rates = content["joints"]["position"], content["joints"]["velocity"]
    answer = {
        "time": [content["duration"] * k / (MOST_POINTS - 1) for k in range(MOST_POINTS)],
        "joint_positions": [begin] * MOST_POINTS,
        "joint_velocities": [rates] * MOST_POINTS,
    }
    assert "points" not in judged(content, *rest, answer).faults[0]


BURNS = """
    import os, sys, time

    def burn(seconds):
        until = time.process_time() + seconds
        while time.process_time() < until:
            pass
"""
HIDES_TIME = {
    "a pool that is kept": """
    import multiprocessing
    POOL = None

    def answer(scenario, seconds):
        global POOL
        POOL = POOL or multiprocessing.get_context("fork").Pool(1)
        POOL.apply(burn, (1.0,))
        return {"status": "no_plan"}
""",
    "a child that nobody waits for": """
    import signal

    def answer(scenario, seconds):
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        here, there = os.pipe()
        if os.fork() == 0:
            burn(1.0)
            os.write(there, b"x")
            time.sleep(0.3)
            os._exit(0)
        os.read(here, 1)
        return {"status": "no_plan"}
""",
    "a process in a session of its own": """
    def answer(scenario, seconds):
        here, there = os.pipe()
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                burn(1.0)
                os.write(there, b"x")
                time.sleep(1000)
            os._exit(0)
        os.wait()
        os.read(here, 1)
        return {"status": "no_plan"}
""",
    "itself": """
    def answer(scenario, seconds):
        burn(1.0)
        return {"status": "no_plan"}
""",
}


@pytest.mark.law("FILE-07")
@pytest.mark.parametrize("kind", HIDES_TIME)
def test_time_is_that_of_all_processes_and_these_end_with_the_method(small, method, kind):
    evil = method(BURNS + HIDES_TIME[kind])
    found = asked(small, evil, ("planar", "ordinary"))
    assert all(0.8 < one.seconds < 3.0 for one in found), found
    for process in psutil.process_iter(["cmdline"]):
        assert evil not in (process.info["cmdline"] or []), process


LEAVES = """
    import os, time
    from pathlib import Path

    def answer(scenario, seconds):
        if os.fork() == 0:
            os.setsid()
            for _ in range(5):
                if os.fork() == 0:
                    while True:
                        Path({left!r}, str(os.getpid())).touch()
                        time.sleep(0.01)
            os._exit(0)
        while len(list(Path({left!r}).iterdir())) < 5:
            time.sleep(0.01)
        os._exit(1)
"""


def test_processes_that_a_method_leaves_behind_are_ended(small, method, tmp_path):
    left = tmp_path / "left"
    left.mkdir()
    (one,) = asked(small, method(LEAVES.format(left=str(left))))
    assert one.score.faults == ("the process ended: exit code 1",)
    pids = [int(path.name) for path in left.iterdir()]
    assert len(pids) >= 5
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_method_that_burns_more_than_twice_its_time_in_another_process_is_ended(small, method):
    text = """
    def answer(scenario, seconds):
        if os.fork() == 0:
            burn(1000.0)
        os.wait()
    """
    (one,) = asked(small, method(BURNS + text), seconds=0.5)
    assert not one.score.solved
    assert one.seconds >= 1.0


def test_a_command_that_never_ends_is_ended(small, monkeypatch):
    monkeypatch.setattr(watched, "_MORE_PATIENCE", 0.0)
    (one,) = asked(small, "sh -c 'sleep 1000' {scenario} {answer}", seconds=0.1)
    assert one.score.faults == ("no answer in time",)


LOADS = """
    burn({seconds})

    def answer(scenario, seconds):
        return {{"status": "no_plan"}}
"""


def test_what_loading_takes_beyond_libraries_counts_with_the_first_answer(
    small, method, monkeypatch
):
    monkeypatch.setattr(watched, "_FREE_TO_LOAD", 2.0)
    evil = method(BURNS + LOADS.format(seconds=3.5))
    first, second = asked(small, evil, ("planar", "ordinary"))
    assert 1.5 < first.seconds < 4.0
    assert second.seconds < 0.5


SHORT_LIVED = """
    import signal

    def answer(scenario, seconds):
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        for _ in range(40):
            here, there = os.pipe()
            if os.fork() == 0:
                burn(0.03)
                os._exit(0)
            os.close(there)
            os.read(here, 1)
        return {"status": "lost"}
"""


def test_a_method_whose_processes_cannot_be_timed_loses_its_answer(small, method):
    (one,) = asked(small, method(BURNS + SHORT_LIVED))
    assert one.score.faults == ("it ignores SIGCHLD: the time of its processes is lost",)
    (one,) = asked(small, method(BURNS + SHORT_LIVED.replace("SIG_IGN", "SIG_DFL")))
    assert one.score.faults == ("no plan: lost",)


LINGERS = """
    import os, signal, time
    from pathlib import Path

    def answer(scenario, seconds):
        for kind in ("child", "grandchild"):
            if os.fork() == 0:
                if kind == "grandchild":
                    os.setsid()
                    if os.fork():
                        os._exit(0)
                Path({there!r}, str(os.getpid())).touch()
                time.sleep(1000)
        Path({there!r}, str(os.getpid())).touch()
        {then}
        time.sleep(1000)
"""


def waiting(there, count=3):
    """The processes that a method has left, once they are all there."""
    while len(list(there.iterdir())) < count:
        pass
    return [psutil.Process(int(path.name)) for path in there.iterdir()]


@pytest.mark.nightly
@pytest.mark.parametrize("end", ["SIGTERM", "SIGINT", "SIGKILL"])
def test_nothing_of_a_method_outlives_a_contest_that_is_ended(small, method, tmp_path, end):
    there = tmp_path / "there"
    there.mkdir()
    evil = method(LINGERS.format(there=str(there), then=""))
    command = [sys.executable, "-m", cli.__name__, "contest", str(small), "--scenarios", "1"]
    # Tests that run in the background have inherited that SIGINT is ignored, and so would the run.
    command = ["env", "--default-signal=INT", *command, "--method", evil]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as run:
        left = waiting(there)
        run.send_signal(getattr(signal, end))
        try:
            run.wait(30)
        finally:
            run.kill()
    _, alive = psutil.wait_procs(left, timeout=30)
    assert alive == []


def test_a_method_that_ends_its_judge_is_told_in_words(small, method, tmp_path):
    there = tmp_path / "there"
    there.mkdir()
    then = "os.kill(os.getppid(), signal.SIGKILL)"
    evil = method(LINGERS.format(there=str(there), then=then))
    with pytest.raises(InvalidInput, match="a judge was ended from outside, by one of them or"):
        list(contest.results([evil], small, 1, SECONDS, 1))
    left = [int(path.name) for path in there.iterdir()]
    assert left
    assert not [pid for pid in left if psutil.pid_exists(pid)]


def test_what_a_method_says_cannot_be_taken_for_the_tables():
    said = Score(False, ("no plan: \x1b[2J\x07\nours  all  6  100.0%\u202e",))
    ((_, _, _, told),) = contest_results.reasons(
        [contest_results.Result("evil.py", "planar", 0, 0.1, said)], 3
    )
    assert told == "no plan: ?[2J? ours all 6 100.0%?"
