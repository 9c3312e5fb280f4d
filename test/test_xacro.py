"""A file that ends in .xacro is expanded by the command `xacro`, within bounds, or refused."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from robots import LEMUR_URDF

from ff_planner_ros import cli
from ff_planner_ros.common import text_file
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.robot import xacro_arguments_of
from ff_planner_ros.planning.scenario.robot_file import _XACRO_ARGUMENTS, RobotFile
from ff_planner_ros.robot.model import read_urdf, robot_from_urdf_text

LEMUR = LEMUR_URDF.read_text()
ARGUMENT = '<xacro:arg name="side" default="left"/>'
XACRO = LEMUR.replace("end_effector", "$(arg side)_hand").replace(
    "<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1
)
XACRO = XACRO.replace("<link ", f"{ARGUMENT}<link ", 1)
# Does with our file what the command does, and what it is told to by the file's first line
STAND_IN = f"""#!{sys.executable}
import os, sys, time
text = open(sys.argv[1]).read()
if text.startswith("!"):
    exec(text[1:])
    sys.exit()
given = dict(word.split(":=", 1) for word in sys.argv[2:])
sys.stdout.write(text.replace({ARGUMENT!r}, "").replace("$(arg side)", given.get("side", "left")))
"""
REAL = shutil.which("xacro")


@pytest.fixture(autouse=True)
def no_coverage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no measurement of coverage write where nothing may be written."""
    for name in ("COVERAGE_PROCESS_START", "COVERAGE_PROCESS_CONFIG"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(params=["stand-in", "real"])
def command(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Return a directory beside a command `xacro` on the path."""
    if request.param == "real":
        if REAL is None:
            pytest.skip("xacro is not installed")
        return tmp_path
    return stand_in(tmp_path, monkeypatch)


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory beside a command `xacro` that does what a file tells it."""
    return stand_in(tmp_path, monkeypatch)


def stand_in(directory: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    program = directory / "bin/xacro"
    program.parent.mkdir()
    program.write_text(STAND_IN)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    return directory


def refusal_of(file: Path, **more: str) -> str:
    with pytest.raises(InvalidInput) as refused:
        read_urdf(file, xacro_arguments=more)
    assert refused.value.status is Status.BAD_ROBOT
    assert len(str(refused.value)) <= 950
    return str(refused.value)


def test_a_xacro_file_is_the_robot_that_xacro_makes_of_it(command: Path) -> None:
    (command / "arm.urdf.xacro").write_text(XACRO)
    for side, arguments in (("left", None), ("right", {"side": "right"})):
        robot = RobotFile("arm.urdf.xacro", "chaser", f"{side}_hand", xacro_arguments=arguments)
        expected = LEMUR.replace("end_effector", f"{side}_hand")
        expected = robot_from_urdf_text(expected, "chaser", f"{side}_hand")
        assert robot.load(command).urdf == expected.urdf
    parameters = load_parameters().robot
    parameters = replace(parameters, xacro_arguments="side:=right", tip_link="right_hand")
    text = parameters.description(command / "arm.urdf.xacro")
    assert parameters.load(text).tip_link == "right_hand"


def test_the_page_of_a_robot_takes_arguments(
    command: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (command / "arm.xacro").write_text(XACRO)
    order = ["robot", str(command / "arm.xacro"), "--xacro-arguments", "side:=right"]
    assert cli.main([*order, "--tip-link", "right_hand"]) == 0
    assert "right_hand" in capsys.readouterr().out


def test_without_xacro_the_refusal_has_the_command_to_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(text_file, "find_spec", lambda _: None)
    file = tmp_path / "my arm.urdf.xacro"
    file.write_text(XACRO)
    told = refusal_of(file, side="right")
    assert f"run xacro '{file}' side:=right > 'my arm.urdf', and give that file" in told
    assert "pip install xacro" in told


def test_what_xacro_says_last_is_the_refusal(command: Path) -> None:
    file = command / "arm.xacro"
    file.write_text(XACRO.replace("$(arg side)", "$(arg hand)", 1))
    if (command / "bin").exists():
        file.write_text("!sys.exit('x' * 100_000 + ' Undefined substitution argument hand')")
    told = refusal_of(file)
    assert told.startswith(f"robot.urdf is {file}: xacro says: ")
    assert "hand" in told


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("!time.sleep(100)", "xacro must expand it within 1 s"),
        ("!while True: pass", "xacro must expand it within 1 s"),
        ("!if os.fork(): time.sleep(100)\ntime.sleep(100)", "xacro must expand it within 1 s"),
        ("!while True: print('<a/>' * 10_000)", "it must not be larger than 4 MB when xacro has"),
        ("!while True: sys.stderr.write('no' * 10_000)", "xacro must expand it within 1 s"),
        ("!'x' * 10**10", "MemoryError"),
        ("!with open('left_behind', 'w') as f: f.write('x')", "File too large"),
        ("!os.kill(os.getpid(), 15)", "xacro says: it ended with -15"),
    ],
)
def test_an_expansion_has_bounds_and_writes_nothing(
    made: Path, monkeypatch: pytest.MonkeyPatch, program: str, words: str
) -> None:
    monkeypatch.setattr(text_file, "_EXPANSION_TIME", 1)
    (made / "arm.xacro").write_text(program)
    begun = time.monotonic()
    assert words in refusal_of(made / "arm.xacro")
    assert time.monotonic() - begun < 60.0
    assert (made / "left_behind").exists() is ("left_behind" in program)
    assert not any(file.stat().st_size for file in made.glob("left_behind"))


def test_what_is_expanded_is_read_like_any_urdf(made: Path) -> None:
    file = made / "arm.xacro"
    file.write_text(XACRO.replace('xyz="1.5 0.1626 0.0"', 'xyz="1.5"'))
    with pytest.raises(
        InvalidInput, match=r"joint 'joint_5' origin xyz is '1.5': it must be three"
    ):
        robot_from_urdf_text(read_urdf(file), "chaser", "left_hand")
    with pytest.raises(InvalidInput, match="xacro_arguments is 'x y': an argument's name has lett"):
        read_urdf(file, xacro_arguments={"x y": "1"})


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("", {}),
        ("prefix:=left_ gripper:=false", {"prefix": "left_", "gripper": "false"}),
        ("name:='two words' empty:=", {"name": "two words", "empty": ""}),
    ],
)
def test_a_parameter_has_arguments_as_the_command_line_of_xacro(
    text: str, arguments: dict[str, str]
) -> None:
    assert xacro_arguments_of(text) == arguments


@pytest.mark.parametrize("text", ["left", "a=b", "1:=2", "'a:=b", ":=b"])
def test_other_words_are_no_arguments(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"robot\.xacro_arguments is .*it must be as in"):
        xacro_arguments_of(text)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("side:=left", "robot.xacro_arguments is 'side:=left': it must hold names and values"),
        ({"side": ["a"]}, "robot.xacro_arguments.side is"),
        ({1: "a"}, "robot.xacro_arguments.1 is"),
    ],
)
def test_arguments_in_a_scenario_are_names_with_values(value: object, words: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        _XACRO_ARGUMENTS.read("robot.xacro_arguments", value)
    assert str(refused.value).startswith(words)
    read = _XACRO_ARGUMENTS.read("f", {"a": True, "b": 0.5, "c": 3, "d": "x"})
    assert read == {"a": "true", "b": "0.5", "c": "3", "d": "x"}
