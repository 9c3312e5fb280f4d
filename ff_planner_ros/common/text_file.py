"""Files from outside: what is no regular file is refused unread, and the size is limited.

A file that ends in .xacro is read as what `xacro` makes of it.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import IO, TypeAlias

from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import InvalidInput, Status

AnyPath: TypeAlias = str | os.PathLike[str]

XACRO = ".xacro"
NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})
# It writes no file, and takes at most 2 GB and 10 s.
_EXPANSION_TIME = 10
_BOUNDED = f'ulimit -f 0; ulimit -v 2000000; ulimit -t {_EXPANSION_TIME}; exec "$@"'
_LAST_WORDS = 500  # characters
_INSTALL = "`pip install xacro` or `sudo apt install ros-jazzy-xacro` lets the planner do so"


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


def expanded_by_xacro(
    path: Path,
    most_bytes: int,
    arguments: Mapping[str, str] = NO_ARGUMENTS,
    field: str = "file",
    status: Status = Status.OUT_OF_RANGE,
) -> str:
    """Return what the command or the Python package `xacro` makes of a file.

    Args:
        most_bytes: More than that is refused.
        arguments: Values of the file's `<xacro:arg>` elements, by name.
        field: Name of the file's field in errors.
        status: Status of errors.

    Raises:
        InvalidInput: xacro is not installed, fails, takes too long or makes too much.
    """
    for name in arguments:
        if not name.isidentifier():
            allowed = "an argument's name has letters, digits and _, and begins with no digit"
            raise InvalidInput(status, f"{field} xacro_arguments", quoted(name), allowed)
    words = [str(path), *(f"{name}:={value}" for name, value in arguments.items())]
    command = shutil.which("xacro")
    call = [command] if command else [sys.executable, "-c", "import xacro; xacro.main()"]
    if command is None and find_spec("xacro") is None:
        target = shlex.quote(path.name.removesuffix(XACRO))
        allowed = f"run {shlex.join(['xacro', *words])} > {target}, and give that file; {_INSTALL}"
        raise InvalidInput(status, field, path.name, allowed)
    made, said, is_over = _output_of([*call, *words], path.parent, most_bytes)
    if is_over:
        reason = f"xacro must expand it within {_EXPANSION_TIME} s"
    elif len(made) > most_bytes:
        reason = f"it must not be larger than {most_bytes / 1e6:g} MB when xacro has expanded it"
    elif said is not None:
        reason = f"xacro says: {said}"
    else:
        return made.decode(errors="replace")
    raise InvalidInput(status, field, path, reason)


def _output_of(call: list[str], directory: Path, most_bytes: int) -> tuple[bytes, str | None, bool]:
    """Return what a command prints, its last words if it fails, and whether it took too long."""
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    over, words = threading.Event(), list[bytes]()
    with subprocess.Popen(
        ["/bin/sh", "-c", _BOUNDED, "sh", *call],
        cwd=directory,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:

        def end() -> None:
            over.set()
            os.killpg(process.pid, signal.SIGKILL)

        clock = threading.Timer(_EXPANSION_TIME, end)
        listener = threading.Thread(target=_keep_last, args=(process.stderr, words))
        clock.start()
        listener.start()
        made = process.stdout.read(most_bytes + 1) if process.stdout is not None else b""
        if len(made) > most_bytes:
            os.killpg(process.pid, signal.SIGKILL)
        code = process.wait()
        clock.cancel()
        listener.join()
    if not code:
        return made, None, False
    said = " ".join(b"".join(words).decode(errors="replace").split())[-_LAST_WORDS:]
    by_clock = over.is_set() or -code in (signal.SIGXCPU, signal.SIGKILL)
    return made, said or f"it ended with {code}", by_clock and len(made) <= most_bytes


def _keep_last(stream: IO[bytes], words: list[bytes]) -> None:
    """Keep the last words of a stream, and read it to its end."""
    while piece := stream.read(4096):
        words[:] = [b"".join(words)[-_LAST_WORDS:] + piece]
