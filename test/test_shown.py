"""Values and texts in messages: what is too long loses its middle, and no name or number a part."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ff_planner_ros.common.shown import LONGEST_VALUE, printable, shortened, shown
from ff_planner_ros.common.text_file import read_text
from ff_planner_ros.errors import InvalidInput, Status

LONG = {
    "numbers": ", ".join(f"{0.123456 + k:.6f}" for k in range(200)),
    "names": " and ".join(f"honey_top_aft_arm_proximal_link_{k}" for k in range(40)),
    "files": "/".join(f"directory_of_meshes_{k}" for k in range(60)) + "/link_7.dae",
}


@pytest.mark.parametrize("longest", [90, 333, 950])
@pytest.mark.parametrize("text", LONG.values(), ids=LONG)
def test_what_is_shown_of_a_long_text_are_its_ends_in_whole_words(text: str, longest: int) -> None:
    for short in (printable(text, longest), shortened(text, longest).rpartition(" (")[0]):
        head, tail = short.split("...")
        assert text.startswith(head)
        assert text.endswith(tail)
        assert len(head) + len(tail) <= longest
        whole = set(re.split(r"[\s,;/]+", text))
        assert set(re.split(r"[\s,;/]+", f"{head} {tail}")) - {""} <= whole
    assert shortened(text, longest).endswith(f" ({len(text)} characters)")
    assert shortened(text, len(text)) == printable(text, len(text)) == text


def test_one_word_that_is_too_long_is_cut_all_the_same() -> None:
    assert printable("x" * 1000, 90) == f"{'x' * 45}...{'x' * 45}"
    assert printable("a\x1b[31m\n" * 100, 12).isprintable()


def test_a_path_in_a_refusal_keeps_the_name_of_its_file_and_what_is_allowed() -> None:
    path = Path("/", *(f"directory_of_meshes_{k}" for k in range(60)), "link_7.dae")
    assert len(shown(path)) < LONGEST_VALUE + 30
    said = str(InvalidInput(Status.OUT_OF_RANGE, "file", path, "it is empty"))
    assert "/link_7.dae (" in said
    assert said.endswith(": it is empty")
    many = ", ".join(f"name_{k}" for k in range(1000))
    said = str(InvalidInput(Status.OUT_OF_RANGE, "key", many, f"known are {many} and the_last"))
    assert "and the_last (" in said


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"])
def test_a_fault_in_a_file_has_its_line_however_lines_end(line_end: bytes, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(line_end.join([b"one", b"", b"three", b"f\xff"]))
    with pytest.raises(InvalidInput, match=r"byte \d+ in line 4$"):
        read_text(path, 1000)
