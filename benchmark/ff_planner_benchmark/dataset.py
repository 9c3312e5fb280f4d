"""The data set of the benchmark: a thousand scenarios that have a plan, written from seeds.

Numbers are rounded to six decimals before they are written, so that machines whose last bits differ
write the same text. The hash over all files tells whether it is the published data set.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import os
import secrets
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from ff_planner_benchmark.problems import still_goals, tumbling
from ff_planner_ros.common.text_file import read_text
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario_writer import described_problem
from ff_planner_ros.problems import bodies, scenarios
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, Robot

# Digits behind the decimal point: 1 um, 1 urad. The witnesses keep 10 mm from everything.
DECIMALS = 6
# The names of seeds that have a published hash; every other number is somebody's own set. `HIDDEN`
# is a number that nobody has seen before the set is written: witnesses follow from seeds.
SEEDS, HIDDEN = {"second": 1, "public": 0}, "hidden"
_MOST_DIGITS = 12  # of a seed
# Difference of the problems' numbers in a class between two sets.
_APART = 1_000_000
# Hashes over `SHA256SUMS`, which has the hash of every file. A published set stays as it is. Where
# the generators change what they draw, there is a new version, and docs/how_to/dataset.md keeps the
# old hashes with the commits that make them.
VERSION = 1
PUBLISHED = {
    "public": "90dbf5d6037a6dee9f20634e77aeffd578aea32d4fd7e2c318995d3ff20d551a",
    "second": "34b75011325d102c4e056d93acf14b3bf0549045de114872fb8ac680db2d8c0c",
}
SUMS = "SHA256SUMS"
_MOST_BYTES = 10_000_000  # of a text that is read back; our hashes are 100 kB
_OF_THREE = ("lemur", "arm6", "arm7")


def _drawn_around(kind: str, number: int) -> PlanningProblem:
    """Return a scenario of spheres and centre lines, every other one in a rotated frame."""
    robot = _OF_THREE[number % len(_OF_THREE)]
    return scenarios.scenario(kind, robot, number, turned=bool(number % 2)).problem


def _of_bodies(number: int) -> PlanningProblem:
    return bodies.problem(bodies.ROBOTS[number % len(bodies.ROBOTS)], number).problem


def _still(kind: str, number: int) -> PlanningProblem:
    return still_goals.drawn(kind, number).problem


@dataclass(frozen=True)
class SetClass:
    """A class of the data set."""

    scenarios: int  # number in the published set
    problem: Callable[[int], PlanningProblem]  # returns the problem of a number


CLASSES = {
    "planar": SetClass(150, partial(_still, "planar")),
    "ordinary": SetClass(200, partial(_drawn_around, "ordinary")),
    "cluttered": SetClass(200, partial(_drawn_around, "cluttered")),
    "bodies": SetClass(150, _of_bodies),
    "tumbling": SetClass(150, partial(tumbling.problem, "tumbling")),
    "high_momentum": SetClass(150, partial(_still, "high_momentum")),
}


def seed_of(word: str) -> int:
    """Return the seed of a name or a number; that of a hidden set is drawn.

    Raises:
        InvalidInput: The word is neither a name nor a number.
    """
    if word == HIDDEN:
        return secrets.randbelow(10**_MOST_DIGITS)
    if word in SEEDS:
        return SEEDS[word]
    if word.isascii() and word.isdigit() and len(word) <= _MOST_DIGITS:
        return int(word)
    names = ", ".join((*SEEDS, HIDDEN))
    allowed = f"it must be {names} or a whole number of {_MOST_DIGITS} digits at most"
    raise InvalidInput(Status.OUT_OF_RANGE, "--seeds", word, allowed)


def names(each: int | None = None) -> Iterator[tuple[str, int]]:
    """Yield class and index of the scenarios, the first `each` of each class; None: all."""
    for kind, of_class in CLASSES.items():
        for index in range(min(of_class.scenarios, each or of_class.scenarios)):
            yield kind, index


def write_dataset(directory: Path, seed: int, each: int | None = None, workers: int = 1) -> str:
    """Write a data set into a new or empty directory, and return its hash.

    Args:
        each: Number of scenarios of each class; None: as many as are published.

    Raises:
        InvalidInput: The directory is not empty.
        OSError: A file cannot be written.
    """
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        allowed = f"it must be a new or an empty directory, or a data set with {SUMS}"
        raise InvalidInput(Status.UNSUPPORTED, "DIR", directory, allowed)
    try:
        return _written(directory, seed, each, workers)
    except BaseException:  # half a data set would look like a whole one
        shutil.rmtree(directory, ignore_errors=True)
        raise


def _written(directory: Path, seed: int, each: int | None, workers: int) -> str:
    write = partial(_write, directory, seed)
    wanted = list(names(each))
    for kind in CLASSES:
        (directory / "scenarios" / kind).mkdir(parents=True, exist_ok=True)
    (directory / "robots").mkdir(exist_ok=True)
    if workers > 1:
        # A fork of a process with threads, or with objects of ROS, may die at any moment.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context, end_with_parent) as pool:
            robots = dict(made for made in pool.map(write, wanted, chunksize=5))
    else:
        robots = dict(write(one) for one in wanted)
    for name, (urdf, pairs) in robots.items():
        (directory / "robots" / f"{name}.urdf").write_text(urdf, encoding="utf-8", newline="\n")
        told = json.dumps({"must_not_touch": pairs}, indent=1) + "\n"
        (directory / "robots" / f"{name}.json").write_text(told, encoding="utf-8", newline="\n")
    return write_sums(directory)


def end_with_parent(last: Callable[[], object] = bool) -> None:
    """Let this process end as soon as its parent has ended, in whatever way.

    Args:
        last: Called before this process ends.
    """
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            last()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def write_sums(directory: Path) -> str:
    """Write the hash of every file into `SHA256SUMS`, and return the hash of that file."""
    text = sums(directory)
    (directory / SUMS).write_text(text, encoding="ascii", newline="\n")
    return hashlib.sha256(text.encode()).hexdigest()


def sums(directory: Path) -> str:
    """Return a line for each file, as `sha256sum` writes it, by path."""
    files = sorted(file for part in ("robots", "scenarios") for file in _files(directory / part))
    return "".join(f"{_hash(file)}  {file.relative_to(directory)}\n" for file in files)


def _hash(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def checked(directory: Path) -> str:
    """Return the hash of a data set, after a comparison of every file with `SHA256SUMS`.

    Raises:
        InvalidInput: A file is missing, new or changed.
    """
    if not (directory / SUMS).is_file():
        allowed = f"it has no {SUMS}: `ff-planner-benchmark dataset {directory}` writes a data set"
        raise InvalidInput(Status.UNSUPPORTED, "DIR", directory, allowed)
    text, now = read_text(directory / SUMS, _MOST_BYTES), sums(directory)
    if text != now:
        lines = sorted(set(text.splitlines()) ^ set(now.splitlines()))
        name = lines[0].partition("  ")[2] if lines else SUMS
        allowed = f"{directory / name} is missing, new or changed; write the data set anew"
        raise InvalidInput(Status.UNSUPPORTED, "DIR", directory, allowed)
    return hashlib.sha256(text.encode()).hexdigest()


def is_of(directory: Path, seed: int) -> bool:
    """Tell whether a data set was written from a seed, by its first scenario."""
    kind, index = next(names())
    file = directory / "scenarios" / kind / f"{index:04d}.yaml"
    return read_text(file, _MOST_BYTES) == scenario_text(
        CLASSES[kind].problem(seed * _APART + index)
    )


def is_whole(directory: Path) -> bool:
    """Tell whether a data set has as many scenarios as are published."""
    here = sum(1 for _ in (directory / "scenarios").glob("*/*.yaml"))
    return here == sum(kind.scenarios for kind in CLASSES.values())


def _files(directory: Path) -> Iterator[Path]:
    return (path for path in directory.rglob("*") if path.is_file())


def _write(
    directory: Path, seed: int, which: tuple[str, int]
) -> tuple[str, tuple[str, list[list[str]]]]:
    """Write a scenario; return its robot's name, URDF, and pairs of links that must not touch."""
    kind, index = which
    problem = CLASSES[kind].problem(seed * _APART + index)
    robot = problem.robot
    name = robot_name(robot)
    file = directory / "scenarios" / kind / f"{index:04d}.yaml"
    file.write_text(scenario_text(problem), encoding="utf-8", newline="\n")
    links = [sorted((robot.bodies[a].link, robot.bodies[b].link)) for a, b in robot.pairs]
    pairs = [list(pair) for pair in sorted({tuple(pair) for pair in links})]
    return name, (robot.drawn_urdf, pairs)


def robot_name(robot: Robot) -> str:
    """Return the name of a robot's files in the data set."""
    shapes = robot.geometry is Geometry.SHAPES
    return f"{robot.model.name}_bodies" if shapes else str(robot.model.name)


def scenario_text(problem: PlanningProblem) -> str:
    """Return a problem as the text of a scenario file, rounded."""
    content: dict[str, Any] = {
        "robot": {
            "urdf": f"../../robots/{robot_name(problem.robot)}.urdf",
            "base_link": problem.robot.base_link,
            "tip_link": problem.robot.tip_link,
            "geometry": problem.robot.geometry.value,
        }
        | ({"base": Base.PLANAR.value} if problem.robot.base is Base.PLANAR else {}),
        **described_problem(problem),
    }
    del content["parametrisation"]  # a way of planning, not of the problem
    document: str = yaml.safe_dump(
        _rounded(content), default_flow_style=None, sort_keys=False, width=math.inf
    )
    return document


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DECIMALS) + 0.0  # no negative zero, which depends on the last bits
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value
