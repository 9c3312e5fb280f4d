"""Opens the files of a bag."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ff_planner_ros.bag.mcap.mcap_file import McapFile
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.common.shown import printable, shown
from ff_planner_ros.common.text_file import not_a_file
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import BagError, InvalidInput

_COMPRESSED = "compressed by rosbag2: `ros2 bag convert` it to plain mcap first"
_FOREIGN = {
    ".db3": "is of the storage sqlite3: `ros2 bag convert` it to mcap first",
    ".zstd": f"is {_COMPRESSED}",
    ".bag": "is of ROS 1: convert it to a ROS 2 bag of the storage mcap first",
}
_DIGITS = re.compile(r"(\d+)")
_NUMBER = re.compile(r"_\d+$")  # behind the name of a bag, of each of its files
_MOST_NAMES = 10  # of files, in a message
_MOST_LOOKED_INTO = 1000  # directories, where bags are looked for


@contextmanager
def open_files(path: Path) -> Iterator[tuple[list[McapFile], list[str]]]:
    """Open the files of a bag; yield those that can be read, and what is wrong with the rest.

    A bag is a directory with one file or several, or one MCAP file.

    Raises:
        BagError: There is no bag, or nothing of it can be read.
    """
    with ExitStack() as stack:
        files: list[McapFile] = []
        refusals: list[BagError] = []
        paths, notes = _mcap_files(path)
        with progress_bar("reading", sum(map(_size, paths))) as progress:
            for one in paths:
                try:
                    if reason := not_a_file(one):
                        raise BagError(f"bag {one}: {reason}")
                    files.append(McapFile(one, stack.enter_context(one.open("rb")), progress))
                except (OSError, ValueError) as error:  # a character that no path can have
                    refusals.append(_unreadable(one, error))
                except BagError as error:
                    refusals.append(error)
        if not files:
            raise refusals[0]
        _note_several(files)
        yield files, [*notes, *map(str, refusals)]


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _mcap_files(path: Path) -> tuple[list[Path], list[str]]:
    """Return the MCAP files of a bag, in order, and notes on those that are missing."""
    if not path.is_dir():
        if path.suffix in _FOREIGN:
            raise BagError(f"bag {path} {_FOREIGN[path.suffix]}")
        return [path], []
    try:
        found = sorted(path.iterdir(), key=_natural)
    except OSError as error:
        raise _unreadable(path, error) from None
    files = [file for file in found if file.suffix == ".mcap"]
    foreign = [file for file in found if file.suffix in _FOREIGN]
    if not files and foreign:
        raise BagError(f"bag {path}: {foreign[0].name} {_FOREIGN[foreign[0].suffix]}")
    if not files and (bags := _bags_in(found)):
        kind = "a bag" if len(bags) == 1 else f"{len(bags)} bags"
        raise BagError(f"{path} is a directory with {kind}, {_some(bags)}: name a bag itself")
    if not files:
        raise BagError(f"bag {path} must hold .mcap files; found: {_some(found) or 'nothing'}")
    return files, _missing(path, files)


def _bags_in(found: list[Path]) -> list[Path]:
    """Return the directories that hold bags, of whatever storage."""
    suffixes = {".mcap", *_FOREIGN}
    directories = [one for one in found if one.is_dir()][:_MOST_LOOKED_INTO]
    bags = []
    for directory in directories:
        with suppress(OSError):
            if any(file.suffix in suffixes for file in directory.iterdir()):
                bags.append(directory)
    return bags


def _note_several(files: list[McapFile]) -> None:
    """Note where the files have names of several bags; nothing is lost by that."""
    stems = dict.fromkeys(_NUMBER.sub("", file.path.stem) for file in files)
    if len(stems) > 1:
        names = _some([Path(stem) for stem in stems])
        files[0].note(
            f"by their names it and those beside it are files of {len(stems)} bags, {names}: they "
            "are read as one"
        )


def _unreadable(path: Path, error: OSError | ValueError) -> BagError:
    return BagError(f"bag {path} cannot be read: {getattr(error, 'strerror', None) or error}")


def _some(paths: list[Path]) -> str:
    more = f" and {len(paths) - _MOST_NAMES} more" if len(paths) > _MOST_NAMES else ""
    return ", ".join(printable(path.name) for path in paths[:_MOST_NAMES]) + more


def _natural(file: Path) -> list[tuple[int, str]]:
    """Return a key by which run_10 comes after run_9."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part) for part in _DIGITS.split(file.name)
    ]


def _missing(directory: Path, files: list[Path]) -> list[str]:
    """Return a note for each file that the bag's metadata lists and that is not there."""
    path = directory / "metadata.yaml"
    try:
        content = read_yaml(path)["rosbag2_bagfile_information"]
        listed = [Path(shown(name)).name for name in content["relative_file_paths"]]
        compression = str(content.get("compression_mode", "")).lower()
    except (InvalidInput, ValueError, LookupError, TypeError, AttributeError):
        return []  # the files hold all that matters
    if compression == "message":
        raise BagError(f"bag {directory} holds messages that are {_COMPRESSED}")
    there = {file.name for file in files}
    missing = [name for name in dict.fromkeys(listed) if name not in there]
    names = [printable(name) for name in missing[:_MOST_NAMES]]
    if len(missing) > len(names):
        names.append(f"{len(missing) - len(names)} more")
    return [f"metadata.yaml lists {name}, which is not there" for name in names]
