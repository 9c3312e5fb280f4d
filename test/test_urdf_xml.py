"""URDFs that want to harm: they are refused in words, in little time and memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from robots import LEMUR_URDF

from ff_planner_ros import cli
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.robot.urdf.urdf_xml import MAX_CHARACTERS, MAX_LINKS

LEMUR = LEMUR_URDF.read_text()
ENTITIES = '<!ENTITY a "ha">' + "".join(
    f"<!ENTITY {name} '{10 * f'&{of};'}'>" for of, name in zip("abcdefgh", "bcdefghi", strict=True)
)


def chain_at_the_tip(links: int) -> str:
    """Links one after the other, each fixed to the one before."""
    parts = []
    for number in range(links):
        parent = f"f{number - 1}" if number else "end_effector"
        parts.append(
            f'<link name="f{number}"/><joint name="g{number}" type="fixed">'
            f'<parent link="{parent}"/><child link="f{number}"/></joint>'
        )
    return LEMUR.replace("</robot>", "".join(parts) + "</robot>")


def loop_of(links: int) -> str:
    parts = (
        f'<link name="f{number}"/><joint name="g{number}" type="fixed"><parent link="f{number}"/>'
        f'<child link="f{(number + 1) % links}"/></joint>'
        for number in range(links)
    )
    return LEMUR.replace("</robot>", "".join(parts) + "</robot>")


# What is written and how its refusal begins; empty: it is no fault.
LINE_OF_LINK_5 = 1 + LEMUR[: LEMUR.index('"link_5"')].count("\n")
HARMFUL: dict[str, tuple[Callable[[], str], str]] = {
    "nested deep": (lambda: "<robot>" * 400_000, "robot.urdf is not XML: no element found"),
    "nested deep in a shape": (
        lambda: LEMUR.replace("<visual>", f"<visual>{'<a>' * 200_000}{'</a>' * 200_000}", 1),
        "",
    ),
    "bomb of entities": (
        lambda: f'<!DOCTYPE r [{ENTITIES}]><robot name="&i;"/>',
        "robot.urdf is with declarations in its <!DOCTYPE>",
    ),
    "entity of a file": (
        lambda: '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot>&x;</robot>',
        "robot.urdf is with declarations in its <!DOCTYPE>",
    ),
    "bomb of attributes": (
        lambda: '<!DOCTYPE r [<!ATTLIST link a CDATA "x">]><robot><link/></robot>',
        "robot.urdf is with declarations in its <!DOCTYPE>",
    ),
    "too many characters": (
        lambda: LEMUR + " " * MAX_CHARACTERS,
        f"robot.urdf is {len(LEMUR) + MAX_CHARACTERS} characters long: it must be at most",
    ),
    "30,000 fixed links": (
        lambda: chain_at_the_tip(30_000),
        f"robot.urdf is too large: it must have at most {MAX_LINKS} links",
    ),
    "as many fixed links as may be": (lambda: chain_at_the_tip(MAX_LINKS - 9), ""),
    "one link more": (
        lambda: chain_at_the_tip(MAX_LINKS - 8),
        "robot.urdf is too large: it must have at most 1000 links",
    ),
    "a long loop": (
        lambda: loop_of(900),
        "robot.urdf is at fault in 900 places: link 'f0' is in a loop of joints, or hangs on one",
    ),
    "a loop of one": (
        lambda: LEMUR.replace('<parent link="link_1"/>', '<parent link="link_2"/>'),
        "robot.urdf is at fault in 7 places: link 'end_effector' is in a loop of joints, or ",
    ),
    "all ends unknown": (
        lambda: chain_at_the_tip(900).replace('link="f', 'link="x'),
        "robot.urdf is at fault in 1",
    ),
    "many attributes": (
        lambda: "<robot><link " + " ".join(map("a{}=''".format, range(150_000))) + "/></robot>",
        "robot.urdf is at fault in 2 places: link number 1 is nameless: it must have a name",
    ),
    "a name of a megabyte": (
        lambda: LEMUR.replace("link_5", "n" * 1_000_000),
        "robot.urdf is at fault in 3 places: link 'nnnnn",
    ),
    "a number of a megabyte": (
        lambda: LEMUR.replace('<mass value="3.9"/>', f"<mass value='{'9' * 1_000_000}'/>"),
        "link 'link_7' mass is '" + 40 * "9",
    ),
    "a half of a pair": (lambda: LEMUR.replace("link_5", "\ud800"), "robot.urdf is not XML: 'utf"),
    "a zero byte": (lambda: LEMUR.replace("link_5", "\0"), "robot.urdf is not XML: not well-form"),
    "a terminal's command": (
        lambda: LEMUR.replace('"link_5"', '"&#27;[2J"'),
        f"robot.urdf is not XML: reference to invalid character number: line {LINE_OF_LINK_5}",
    ),
    "nothing": (lambda: "", "robot.urdf is not XML: no element found: line 1, column 0"),
    "a robot of nothing": (lambda: "<robot/>", "robot.urdf is without links: it must have links;"),
    "a xacro file": (
        lambda: '<robot xmlns:xacro="x"><xacro:arm/></robot>',
        "robot.urdf is with <xacro:arm>, which is not expanded: run xacro first: xacro FILE ",
    ),
    "unknown elements alone": (
        lambda: LEMUR.replace("<visual>", f"{'<mass/>' * 500_000}<visual>", 1),
        "robot.urdf is at fault in 10000 places: link 'chaser' is with an unknown <mass>: it may h",
    ),
    "unknown elements of many names": (
        lambda: LEMUR.replace(
            "<visual>", f"{''.join(f'<a{n}/>' for n in range(300_000))}<visual>", 1
        ),
        "robot.urdf is at fault in 10000 places: link 'chaser' is with an unknown <a1000>: it may ",
    ),
    "a pose as quaternion": (
        lambda: LEMUR.replace('xyz="1.5 0.1626', 'quat_xyzw="0 0 1 0" xyz="1.5 0.1626'),
        "joint 'joint_5' origin is a quaternion: write it as rpy",
    ),
}


@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("name", HARMFUL)
def test_a_urdf_that_wants_to_harm_is_refused_in_words(name: str) -> None:
    written, message = HARMFUL[name]
    text = written()
    if not message:
        assert robot_from_urdf_text(text, "chaser", "end_effector").joints == 7
        return
    with pytest.raises(InvalidInput) as refusal:
        robot_from_urdf_text(text, "chaser", "end_effector")
    told = str(refusal.value)
    assert told.startswith(message), told
    assert len(told) <= 950
    assert "\n" not in told


def test_what_is_no_text_file_is_refused_without_waiting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"{name}.urdf" for name in ("pipe", "loop", "latin", "utf16", "big")}
    os.mkfifo(files["pipe"])
    files["loop"].symlink_to(files["loop"])
    files["latin"].write_bytes(LEMUR.replace("link_5", "gelenk_ö").encode("latin-1"))
    files["utf16"].write_bytes(LEMUR.encode("utf-16"))
    with files["big"].open("wb") as file:
        file.truncate(10**12)  # all zeros, not on the disk
    others = (tmp_path, tmp_path / "gone.urdf", Path("/dev/zero"), Path("x" * 5000))
    reasons = "it cannot be read: ", "it is not UTF-8: ", "it is a ", "it must not be larger than "
    for path in (*files.values(), *others):
        assert cli.main(["robot", str(path)]) == 2
        told = capsys.readouterr().err
        assert told.startswith("ff-planner: robot.urdf is "), told
        assert any(f": {reason}" in told for reason in reasons), told
        assert len(told) <= 1000


def test_a_mark_of_the_byte_order_and_old_declarations_do_not_matter() -> None:
    plain = robot_from_urdf_text(LEMUR)
    for text in (
        "\ufeff" + LEMUR,
        LEMUR.replace("\n", "\r\n"),
        LEMUR.replace("<robot ", '<!DOCTYPE robot SYSTEM "urdf.dtd"><robot xmlns="x" version="2" '),
    ):
        assert text != LEMUR
        assert robot_from_urdf_text(text).urdf == plain.urdf


@pytest.mark.ci
def test_the_worst_of_them_take_less_than_500_mb(tmp_path: Path) -> None:
    for name in ("nested deep", "nested deep in a shape", "30,000 fixed links", "many attributes"):
        (tmp_path / f"{name}.urdf").write_text(HARMFUL[name][0](), "utf-8")
    code = (
        "import sys, pathlib\n"
        "from ff_planner_ros import cli\n"
        "for file in pathlib.Path(sys.argv[1]).iterdir():\n"
        "    assert cli.main(['robot', str(file), '--tip-link', 'end_effector']) in (0, 2)\n"
        # Unlike getrusage's, this peak leaves out the process that this one was forked from.
        "status = pathlib.Path('/proc/self/status').read_text()\n"
        "print('peak', status.partition('VmHWM:')[2].split()[0])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.rpartition("peak")[2]) * 1024 < 500e6
