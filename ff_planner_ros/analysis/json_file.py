"""JSON: files from outside, bounded before they are read and refused by line; texts of ours."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

from ff_planner_ros.common.text_file import read_text
from ff_planner_ros.errors import InvalidInput, Status

# A plan of ten thousand points for fourteen joints has a million values in 18 MB. Whatever is
# larger would take seconds and hundreds of megabytes only to be refused.
_MOST_BYTES, _MOST_VALUES = 40_000_000, 1_200_000
_DEEPEST = 32  # lists and objects within each other; ours have four
# Strings, the last one perhaps without an end, and what begins and ends lists and objects.
_TOKEN = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+(?:"|\\?\Z)|[\[\]{},]', re.DOTALL)
_LONG_NUMBER = re.compile(r"(?<!\d)\d{400}")  # longer than any that Python writes
# An unpaired surrogate, which UTF-8 cannot encode, behind whole pairs of backslashes.
_HALF = re.compile(
    r"(?<!\\)((?:\\\\)*)(?:\\u[dD][89abAB]..(?!\\u[dD][c-fC-F])"
    r"|(?<!\\u[dD][89abAB]..)\\u[dD][c-fC-F]..)",
    re.DOTALL,
)


def read_json(path: Path) -> Any:
    """Return the document in a JSON file; an unpaired surrogate becomes a question mark.

    Raises:
        InvalidInput: The file cannot be read, is not JSON, or too large or too deep to be ours.
    """
    return json_document(read_text(path, _MOST_BYTES, status=Status.UNSUPPORTED), "file", path)


def json_document(text: str, field: str, value: object) -> Any:
    """Return the document in a JSON text; see `read_json`.

    Args:
        text: JSON.
        field: Name of the document in an error.
        value: Value that an error shows for it.

    Raises:
        InvalidInput: It is not JSON, or too large or too deep to be ours.
    """
    try:
        if len(text) > _MOST_BYTES:
            raise ValueError(f"it must not be longer than {_MOST_BYTES} characters")
        _require_moderate(text)
        return json.loads(_HALF.sub(r"\1?", text) if "\\u" in text else text)
    except json.JSONDecodeError as error:
        reason = f"it is not JSON: {error}"
    except ValueError as error:
        number = _LONG_NUMBER.search(text)
        reason = f"a number is too long, {_place(text, number.start())}" if number else str(error)
    raise InvalidInput(Status.UNSUPPORTED, field, value, reason)


def json_text(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON; a number that is not finite, which JSON does not know, is null."""
    try:
        return json.dumps(document, indent=indent, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(document), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _require_moderate(text: str) -> None:
    """Refuse a document that is too deep or has too many values, whether it is JSON or not.

    Raises:
        ValueError: The document is too deep or has too many values.
    """
    depth = values = 0
    for token in _TOKEN.finditer(text):
        first = text[token.start()]
        if first in "[{":
            depth += 1
        elif first in "]}":
            depth -= 1
        values += first in "[{,"
        if depth > _DEEPEST:
            place = _place(text, token.start())
            raise ValueError(f"its lists are deeper than {_DEEPEST}, {place}")
        if values > _MOST_VALUES:
            place = _place(text, token.start())
            raise ValueError(f"it holds more than {_MOST_VALUES} values, {place}")


def _place(text: str, at: int) -> str:
    line_start = text.rfind("\n", 0, at) + 1
    return f"in line {text.count(chr(10), 0, at) + 1}, column {at - line_start + 1}"
