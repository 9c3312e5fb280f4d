"""Whatever is in a file: a documented code, a short message that names the place, no traceback.

Within 5 s of a processor and 500 MB: `measured_commands.py` measures it.
"""

from __future__ import annotations

import io
import json
import os
import random
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from evil_bags import EVIL_BAGS
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from measured_commands import MEGABYTES, SECONDS, Done, Run, measured_commands
from mutants import bytes_mutated, document_mutated

from ff_planner_ros.cli import DEFECT, main
from ff_planner_ros.common.share import share_directory

CONFIG = share_directory() / "config"
CAPTURE = CONFIG / "scenarios" / "lemur_capture.yaml"
LEMUR = CONFIG / "robots" / "lemur" / "lemur.urdf"
SEED = 20261122
GIGABYTES = 1 << 42  # [bytes] of a file without contents


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    with measured_commands() as run:
        yield run


@pytest.fixture(scope="module")
def nightly(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("tier") == "nightly")


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A plan as `plan --json` writes it."""
    file = tmp_path_factory.mktemp("answer") / "answer.json"
    assert main(["plan", str(CAPTURE), "--objective", "length", "--json", str(file)]) == 0
    written: dict[str, Any] = json.loads(file.read_text())
    return written


@pytest.fixture(scope="module")
def scenario() -> Any:
    content = yaml.safe_load(CAPTURE.read_text())
    content["robot"]["urdf"] = str(LEMUR)
    return content


MOST_LINES = 21  # twenty faults, and how many there are more


def require_law(done: Done, of: object, is_timed: bool = True) -> None:
    """Documented code, no traceback, a short message for each of a screen of faults at most.

    Time and memory where they are counted.
    """
    told = [line for line in done.err.splitlines() if not line.startswith("ff-planner: note: ")]
    message = "\n".join(told)
    shown = f"{of}: {done.code} {done.err[:2000]}"
    assert done.code in (0, 1, 2, 3), shown
    assert "Traceback" not in done.err, shown
    assert DEFECT not in done.err, shown
    assert "Warning" not in done.err, shown
    assert len(told) <= MOST_LINES, shown
    assert all(len(line) <= 1_000 for line in told), shown
    assert (done.code == 2) == ("ff-planner: " in message) or done.code == 3, shown
    assert done.megabytes <= MEGABYTES, f"{done.megabytes:.0f} MB: {shown}"
    if is_timed:
        assert done.seconds <= SECONDS, f"{done.seconds:.1f} s: {shown}"


def on_scenario(file: Path) -> Iterator[Sequence[object]]:
    yield "plan", file, "--method", "straight", "--json", file.with_suffix(".out")


def on_parameters(file: Path) -> Iterator[Sequence[object]]:
    yield "plan", CAPTURE, "--method", "straight", "--parameters", file


def on_answer(file: Path) -> Iterator[Sequence[object]]:
    yield "verify", file
    yield "report", file, "--output", file.with_suffix(".html")


def on_bag(bag: Path) -> Iterator[Sequence[object]]:
    """Every command that reads a bag; what they write goes into new directories."""
    for number, command in enumerate(
        (
            ("info", bag),
            ("recover", bag, "--output", "new"),
            ("export", bag, "--csv", "new"),
            ("export", bag, "--npz", "new"),
            ("export", bag, "--scenarios", "new"),
            ("report", bag, "--output", "new"),
            ("verify", bag),
            ("replay", bag),
            ("replay", bag, "--set", "points=9"),
        )
    ):
        yield [bag.parent / f"new_{number}" if word == "new" else word for word in command]


YAML = {
    "empty": b"",
    "no mapping": b"- 1",
    "deep": b"a: " + b"[" * 100_000,
    "deep by blanks": b"\n".join(b" " * depth + b"a:" for depth in range(2_000)),
    "deep by keys": b"? " * 100_000,
    "an alias bomb": b"a: &a [x,x,x,x,x,x,x,x,x]\n"
    + b"\n".join(
        b"%c: &%c [%s]" % (c, c, b",".join([b"*%c" % (c - 1)] * 9)) for c in range(98, 123)
    ),
    "an alias to itself": b"a: &a [*a]",
    "a merge of itself": b"&a {<<: *a}",
    "an integer of 5000 digits": b"points: " + b"9" * 5_000,
    "an integer of a million hexadecimal digits": b"points: 0x" + b"f" * 1_000_000,
    "an integer to the base of sixty": b"points: 1" + b":59" * 300_000,
    "a key of 5000 digits": b"? " + b"9" * 900 + b"\n: 1",
    "a long key": b'? "' + b"k" * 1_000_000 + b'"\n: 1',
    "no date": b"points: 2026-13-40",
    "no truth": b"points: !!bool maybe",
    "half a character": b'robot: "\\ud800"',
    "a zero byte": b"robot: \0",
    "no UTF-8": b"robot: 1\nchaser: \xff",
    "a million values": b"a: [" + b"1," * 2_000_000 + b"1]",
    "too large": b"x" * 20_000_000,
    "an object of Python": b"a: !!python/object/apply:os.getcwd []",
    "two documents": b"a: 1\n---\nb: 2",
    "control characters": b'"\\e[31mred": 1',
}


@pytest.mark.sampled
@pytest.mark.parametrize("content", YAML.values(), ids=YAML)
def test_a_yaml_file_is_refused(tmp_path: Path, run: Run, content: bytes, nightly: bool) -> None:
    file = tmp_path / "file.yaml"
    file.write_bytes(content)
    commands = [*on_scenario(file), *on_parameters(file)]
    if nightly:
        commands += [("verify", file), ("compare", file, "--output", tmp_path / "pictures")]
    for command in commands:
        done = run(command)
        require_law(done, command, nightly)
        assert done.code == 2 or not content, done
        assert "\x1b" not in done.err


JSON = {
    "empty": b"",
    "deep lists": b"[" * 100_000,
    "deep objects": b'{"a":' * 100_000,
    "an integer of 5000 digits": b'{"status": ' + b"9" * 5_000 + b"}",
    "a million lists": b"[" + b"[]," * 2_000_000 + b"[]]",
    "an open string": b'\\"' * 2_000_000,
    "no UTF-8": b'{"a": "\xff"}',
    "too large": b" " * 50_000_000,
    "a zero byte": b"\0",
}


@pytest.mark.sampled
@pytest.mark.parametrize("content", JSON.values(), ids=JSON)
def test_a_json_file_is_refused(tmp_path: Path, run: Run, content: bytes, nightly: bool) -> None:
    file = tmp_path / "answer.json"
    file.write_bytes(content)
    for command in on_answer(file):
        done = run(command)
        require_law(done, command, nightly)
        assert done.code == 2, done
        assert "answer.json" in done.err


def scaled(rows: Any, factor: float) -> Any:
    return [scaled(row, factor) for row in rows] if isinstance(rows, list) else rows * factor


ANSWERS: dict[str, tuple[str, Callable[[dict[str, Any]], object]]] = {
    "sample times times 1e12": ("time", lambda a: a.update(time=scaled(a["time"], 1e12))),
    "sample times times 1e300": ("time", lambda a: a.update(time=scaled(a["time"], 1e300))),
    "rates times 1e12": (
        "time",
        lambda a: a.update(joint_velocities=scaled(a["joint_velocities"], 1e12)),
    ),
    "an id that is a list": ("obstacles", lambda a: a["obstacles"][0].update(id=[1, 2])),
    "obstacles that are numbers": ("obstacles", lambda a: a.update(obstacles=[1])),
    "a radius of 10^400": ("radius", lambda a: a["obstacles"][0].update(radius=10**400)),
    "a status that is a list": ("status", lambda a: a.update(status=[1])),
    "joint names that are one number": ("joint_names", lambda a: a.update(joint_names=7)),
    "a time of 10^400": ("time", lambda a: a["time"].__setitem__(-1, 10**400)),
    "times that are not numbers": ("time", lambda a: a.update(time=float("nan"))),
    "a robot that is text": ("robot.urdf", lambda a: a.update(robot="lemur")),
}


@pytest.mark.sampled
@pytest.mark.parametrize(("field", "change"), ANSWERS.values(), ids=ANSWERS)
def test_an_answer_is_refused_by_the_name_of_what_is_wrong(
    field: str,
    change: Callable[[dict[str, Any]], object],
    answer: dict[str, Any],
    tmp_path: Path,
    run: Run,
    nightly: bool,
) -> None:
    changed: dict[str, Any] = json.loads(json.dumps(answer))
    change(changed)
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(changed))
    codes = []
    for command in on_answer(file):
        done = run(command)
        require_law(done, command, nightly)
        codes.append(done.code)
        assert done.code != 2 or field in done.err
    assert 2 in codes


def test_peaks_that_are_one_number_are_refused_and_half_a_character_is_shown(
    answer: dict[str, Any], tmp_path: Path, run: Run
) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(answer | {"metrics": answer["metrics"] | {"peak_joint_torques": 1}}))
    done = run(["report", file, "--output", tmp_path / "report.html"])
    require_law(done, "peaks")
    assert "metrics.peak_joint_torques" in done.err
    file.write_text(r'{"status": "\ud800\\ud800\ud83d\ude00", "message": "no plan"}')
    done = run(["verify", file])
    require_law(done, "half a character")
    assert r"status is ?\ud800" in done.err
    assert "😀" in done.err


@pytest.mark.law("FILE-01")
@pytest.mark.parametrize("suffix", [".yaml", ".json", ".mcap"])
def test_what_is_no_file_is_refused_at_once(
    offline_bag: Path, tmp_path: Path, run: Run, suffix: str, nightly: bool
) -> None:
    """Nothing is opened that may block, and nothing is read that never ends."""
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"directory{suffix}").mkdir()
    (tmp_path / f"device{suffix}").symlink_to("/dev/zero")
    (tmp_path / f"nowhere{suffix}").symlink_to("gone")
    (tmp_path / f"circle{suffix}").symlink_to(f"circle{suffix}")
    # Says that it is empty, and lets who reads it wait for ever.
    (tmp_path / f"kernel{suffix}").symlink_to("/proc/kmsg")
    (tmp_path / f"sparse{suffix}").touch()
    os.truncate(tmp_path / f"sparse{suffix}", GIGABYTES)
    on = {".yaml": on_scenario, ".json": on_answer, ".mcap": on_bag}[suffix]
    for name in (
        "pipe",
        "directory",
        "device",
        "nowhere",
        "circle",
        "kernel",
        "sparse",
        "x" * 3_000,
        "\udcff",
    ):
        commands = list(on(tmp_path / f"{name}{suffix}"))
        for command in commands if nightly else commands[::4]:  # info, export, replay
            done = run(command)
            require_law(done, command)
            assert done.code == 2 or (done.code == 1 and command[0] == "recover"), (command, done)
    (tmp_path / "bag").mkdir()
    (tmp_path / f"pipe{suffix}").rename(tmp_path / "bag" / f"metadata{suffix}")
    shutil.copy(offline_bag / "offline_0.mcap", tmp_path / "bag" / "bag_0.mcap")
    done = run(["info", tmp_path / "bag"])
    require_law(done, "a pipe in a bag")
    assert done.code == 0


@pytest.mark.law("FILE-01")
@pytest.mark.sampled
@pytest.mark.parametrize("make", EVIL_BAGS.values(), ids=EVIL_BAGS)
def test_a_bag_does_not_fill_the_memory(
    make: Callable[[], bytes], tmp_path: Path, run: Run, nightly: bool
) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(make())
    commands = list(on_bag(file))
    for command in commands if nightly else commands[:1]:
        require_law(run(command), command, nightly)


@pytest.mark.parametrize("name", ["no mapping", "deep", "an alias bomb", "no UTF-8", "too large"])
def test_a_bag_is_read_whatever_its_metadata_says(
    name: str, offline_bag: Path, tmp_path: Path, run: Run, nightly: bool
) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    shutil.copy(offline_bag / "offline_0.mcap", bag / "bag_0.mcap")
    (bag / "metadata.yaml").write_bytes(YAML[name])
    commands = list(on_bag(bag))
    for command in commands if nightly else commands[:1]:
        done = run(command)
        require_law(done, command, nightly)
        assert done.code == 0 or command[0] == "replay", done


def with_documents(offline_bag: Path, content: bytes) -> bytes:
    """A bag with something else for each document in it."""
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start("ros2", "test")
    with (offline_bag / "offline_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        for name in ("parameters.yaml", "robot.urdf"):
            writer.add_attachment(0, 0, name, "text/plain", content)
        words = content.decode(errors="replace")
        writer.add_metadata("rosbag2", {"serialized_metadata": words})
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            described = {"offered_qos_profiles": words}
            number = writer.register_channel(channel.topic, "cdr", number, described)
            writer.add_message(number, message.log_time, message.data, message.publish_time)
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize("name", ["deep", "an alias bomb", "too large", "a million values"])
def test_documents_in_a_bag_are_bounded_like_files(
    name: str, offline_bag: Path, tmp_path: Path, run: Run, nightly: bool
) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(with_documents(offline_bag, YAML[name][:1_000_000]))
    commands = list(on_bag(file))
    for command in commands if nightly else commands[6:8]:
        done = run(command)
        require_law(done, command, nightly)
        if "--set" not in command:
            assert done.code == {"verify": 2, "replay": 3}.get(str(command[0]), done.code), done


@pytest.mark.parametrize(
    "setting", ["planner.starts=abc", "points=" + "9" * 5_000, "points=[" * 20_000, "duration=.nan"]
)
def test_a_setting_that_makes_no_sense_is_refused(
    offline_bag: Path, run: Run, setting: str
) -> None:
    done = run(["replay", offline_bag, "--set", setting])
    require_law(done, setting[:50])
    assert done.code in (0, 2), done  # a duration that is no number is answered so


@pytest.mark.law("FILE-01")
@pytest.mark.ci
def test_mutated_scenarios_are_planned_or_refused(
    scenario: Any, tmp_path: Path, run: Run, times: Callable[[int, int], int], nightly: bool
) -> None:
    chance, file = random.Random(SEED), tmp_path / "file.yaml"
    parameters = yaml.safe_load((CONFIG / "planner.yaml").read_text())
    codes = set()
    for number in range(times(25, 1_500)):
        document, on = [(scenario, on_scenario), (parameters, on_parameters)][number % 2]
        text = yaml.safe_dump(document_mutated(document, chance)).encode()
        file.write_bytes(bytes_mutated(text, chance) if number % 5 == 4 else text)
        for command in on(file):
            done = run(command)
            require_law(done, f"mutant {number} of seed {SEED}", nightly)
            codes.add(done.code)
    assert codes >= {2, 3}


@pytest.mark.nightly
def test_mutated_answers_are_taken_or_refused(
    answer: dict[str, Any],
    tmp_path: Path,
    run: Run,
    times: Callable[[int, int], int],
    nightly: bool,
) -> None:
    chance, file = random.Random(SEED), tmp_path / "answer.json"
    codes = set()
    for number in range(times(8, 1_000)):
        text = json.dumps(document_mutated(answer, chance)).encode()
        file.write_bytes(bytes_mutated(text, chance) if number % 5 == 4 else text)
        for command in on_answer(file):
            done = run(command)
            require_law(done, f"mutant {number} of seed {SEED}", nightly)
            codes.add(done.code)
    assert 2 in codes


@pytest.mark.nightly
def test_mutated_bags_are_read_or_refused(
    offline_bag: Path, tmp_path: Path, run: Run, times: Callable[[int, int], int], nightly: bool
) -> None:
    """Both files of a bag, through every command that takes one."""
    chance = random.Random(SEED)
    original = (offline_bag / "offline_0.mcap").read_bytes()
    metadata = yaml.safe_load((offline_bag / "metadata.yaml").read_text())
    for number in range(times(2, 200)):
        bag = tmp_path / str(number) / "bag"
        bag.mkdir(parents=True)
        cut = original[: chance.randrange(len(original))] if number % 3 == 2 else original
        (bag / "bag_0.mcap").write_bytes(bytes_mutated(cut, chance))
        (bag / "metadata.yaml").write_text(yaml.safe_dump(document_mutated(metadata, chance)))
        for command in on_bag(bag):
            require_law(run(command), f"mutant {number} of seed {SEED}: {command[0]}", nightly)
        shutil.rmtree(tmp_path / str(number))
