"""Files from outside: what is no regular file is refused unread, and the size is limited."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import TypeAlias

from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import InvalidInput, Status

AnyPath: TypeAlias = str | os.PathLike[str]


def path_of(field: str, value: AnyPath) -> Path:
    """Return a path that a caller gives; `~` in it is the home directory.

    Raises:
        InvalidInput: It is no path, or there is no such user.
    """
    try:
        return Path(value).expanduser()
    except TypeError:
        allowed = "it must be a path: text, or an os.PathLike of text"
    except RuntimeError as error:
        allowed = f"it is no path: {error}"
    raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)


def read_text(
    path: Path, most_bytes: int, field: str = "file", status: Status = Status.OUT_OF_RANGE
) -> str:
    """Return the text in a file.

    Args:
        most_bytes: A larger file is refused.
        field: Name of the file's field in errors.
        status: Status of errors.

    Raises:
        InvalidInput: There is no such file, it is too large or not UTF-8, or it cannot be read.
    """
    data = read_bytes(path, most_bytes, field, status)
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        line = len(re.findall(rb"\r\n?|\n", data[: error.start])) + 1
        reason = f"it is not UTF-8: {error.reason}, byte {error.start} in line {line}"
    raise InvalidInput(status, field, path, reason)


def read_bytes(
    path: Path, most_bytes: int, field: str = "file", status: Status = Status.OUT_OF_RANGE
) -> bytes:
    """Return the bytes in a file; arguments as of `read_text`.

    Raises:
        InvalidInput: There is no such file, it is too large, or it cannot be read.
    """
    try:
        # A pipe or a device may let a reader wait for ever, or never end.
        reason = not_a_file(path)
        if reason is None:
            with path.open("rb") as stream:
                data = stream.read(most_bytes + 1)
            if len(data) <= most_bytes:
                return data
            reason = f"it must not be larger than {most_bytes / 1e6:g} MB"
    except (OSError, ValueError) as error:  # the latter: a character that no path can have
        reason = f"it cannot be read: {getattr(error, 'strerror', None) or error}"
    raise InvalidInput(status, field, path, reason)


def not_a_file(path: Path) -> str | None:
    """Return why a path, links followed, is no regular file with content; None: it is one.

    Raises:
        OSError: The path does not exist, or its status cannot be read.
        ValueError: It has a character that no path can have.
    """
    found = path.stat()
    if stat.S_ISREG(found.st_mode):
        # Some files of the kernel's say so, too, and let a reader wait for ever.
        return None if found.st_size else "it is empty"
    if stat.S_ISDIR(found.st_mode):
        return "it is a directory, not a file"
    return "it is a pipe or a device, not a file"
