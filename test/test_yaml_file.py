"""Strict reading of YAML."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ff_planner_ros.common.plain_values import integer, mapping, number, numbers, sequence, text
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import InvalidInput


def written(directory: Path, content: bytes) -> Path:
    """A YAML file with this content."""
    path = directory / "file.yaml"
    path.write_bytes(content)
    return path


def test_a_document_is_read(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, b"a: [1, 2.5]\nb: {c: d}")) == {
        "a": [1, 2.5],
        "b": {"c": "d"},
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a: [1, 2", "it is not YAML: while parsing"),
        (b"\xff\xfe\xff", "it is not UTF-8: "),
        (b"a: 2026-13-40", "it is not YAML: month must be in 1..12"),
        (b"a: !!python/object/apply:os.getcwd []", "it is not YAML: could not determine"),
        (b"a: 1\nb: 2\na: 3", "it is not YAML: key 'a' is there twice"),
        (b"a: {b: 1, b: 1}", "it is not YAML: key 'b' is there twice"),
        (b"? [a, b]\n: 1", "it is not YAML: while constructing a mapping"),
    ],
)
def test_what_is_not_one_clear_document_is_refused(
    tmp_path: Path, content: bytes, message: str
) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InvalidInput) as refusal:
        read_yaml(path)
    assert str(refusal.value).startswith(f"file is {path}: {message}")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"gone\.yaml: it cannot be read: No such file"):
        read_yaml(tmp_path / "gone.yaml")


def test_a_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="it is a directory"):
        read_yaml(tmp_path)


def test_a_mapping_with_the_right_keys_passes() -> None:
    assert mapping("a", {"b": 1}, required=("b",), optional=("c",)) == {"b": 1}


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("a", [1], r"a is \[1\]: it must hold b, c"),
        ("", None, "file is None: it must hold b, c"),
        ("a", {"b": 1, "x": 2}, "a.x is unknown: known are b, c"),
        ("", {"b": 1, 5: 2}, "5 is unknown: known are b, c"),
        ("a", {"c": 1}, "a.b is missing: it must be given"),
        ("", {}, "b is missing: it must be given"),
    ],
)
def test_a_mapping_with_other_keys_is_refused_by_their_dotted_name(
    field: str, value: object, message: str
) -> None:
    with pytest.raises(InvalidInput, match=f"^{message}$"):
        mapping(field, value, required=("b",), optional=("c",))


def test_values_of_the_right_type_pass() -> None:
    assert sequence("a", [1, "b"]) == [1, "b"]
    np.testing.assert_array_equal(numbers("a", [1, -2.5]), [1.0, -2.5])
    assert number("a", 3) == 3.0
    assert integer("a", 3) == 3
    assert text("a", "b") == "b"


@pytest.mark.parametrize(
    ("reader", "value", "message"),
    [
        (sequence, {"b": 1}, "a is {'b': 1}: it must be a list"),
        (numbers, 1.0, "a is 1.0: it must be a list"),
        (numbers, [0.0, "x"], "a[1] is 'x': it must be a number, such as 1.0e-3"),
        (numbers, [[0.0]], "a[0] is [0.0]: it must be a number"),
        (number, "1e-3", "a is '1e-3': it must be a number, such as 1.0e-3"),
        (number, True, "a is True: it must be a number"),
        (number, None, "a is None: it must be a number"),
        pytest.param(number, 10**400, "a is 1000", id="beyond floats"),
        (integer, 50.0, "a is 50.0: it must be a whole number"),
        (integer, True, "a is True: it must be a whole number"),
        (integer, "50", "a is '50': it must be a whole number"),
        (text, 7, "a is 7: it must be text"),
        (text, "", "a is '': it must be text, and not empty"),
    ],
)
def test_values_of_another_type_are_refused(reader, value: object, message: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        reader("a", value)
    assert str(refusal.value).startswith(message)
