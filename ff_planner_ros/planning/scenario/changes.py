"""Changes of a scenario: its values, rotations of frames, masses and inertias of its URDF."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import InvalidInput, Status

SET, TIMES, PLUS = "set", "times", "plus"
UNIFORM, NORMAL, CHOICE = "uniform", "normal", "choice"

_IN_URDF = re.compile(r"urdf\.(?P<link>.+)\.(?P<part>mass|inertia(\.i(xx|xy|xz|yy|yz|zz))?)")
# Rotation of a block's attitude about an axis of its own [deg].
_TURN = re.compile(r"turn\.(?P<block>.+)\.(?P<axis>[xyz])")
_QUATERNION, _EULER = "quaternion_xyzw", "euler_xyz_deg"
# What a scenario reads from files: workers have none.
_FILES = ("robot.urdf", "robot.srdf")
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
_PATH = re.compile(r"[^.\[\]]+(\.[^.\[\]]+|\[\d+\])*")


@dataclass(frozen=True)
class Draw:
    """A random value, determined by key, seed and number."""

    distribution: str  # `uniform`, `normal` or `choice`
    # Lower and upper bound, mean and standard deviation, or what to choose from
    parameters: tuple[Any, ...]
    seed: int
    number: int  # of the draw

    def value(self, key: str, size: int | None) -> Any:
        """Return the value: the same for a key, whatever else is varied.

        Args:
            key: Key that is varied.
            size: Number of entries of a vector, which are independent; None: one number.
        """
        rng = np.random.default_rng([*key.encode(), self.seed, self.number])
        if self.distribution == CHOICE:
            return self.parameters[int(rng.integers(len(self.parameters)))]
        draw: Any = rng.uniform if self.distribution == UNIFORM else rng.normal
        return np.asarray(draw(*self.parameters, size)).tolist()


@dataclass(frozen=True)
class Change:
    """One value of a scenario that a case changes."""

    # `target.position[0]`, `obstacles.c1.radius`, `planner.starts`, `urdf.LINK.mass`,
    # `turn.target_body.grasp.y`
    key: str
    how: str  # `set` replaces the value that is there, `times` multiplies it, `plus` adds to it
    value: Any  # as in YAML, or a `Draw`

    def described(self) -> dict[str, Any]:
        """Return the change as a dictionary; changes are equal if these are."""
        return asdict(self)


def changed(
    document: dict[str, Any], urdf: str, changes: Sequence[Change]
) -> tuple[dict[str, Any], str, dict[str, Any]]:
    """Return a scenario and its URDF with changes applied, and the new values by key.

    Frames are rotated last, in the order of their keys, as rotations do not commute. The value of
    such a key is the angle [deg], that of a whole inertia the factor.

    Raises:
        InvalidInput: A key does not exist, or a value does not fit it.
    """
    document, values = deepcopy(document), {}
    for change in sorted(changes, key=lambda one: one.key if _TURN.fullmatch(one.key) else ""):
        if in_urdf := _IN_URDF.fullmatch(change.key):
            urdf, values[change.key] = _changed_urdf(urdf, in_urdf, change)
        elif turn := _TURN.fullmatch(change.key):
            values[change.key] = _turn(document, turn, change)
        else:
            values[change.key] = _change_document(document, change)
    return document, urdf, values


def require_key(field: str, key: object) -> str:
    """Return a key if it has the form of one of a scenario or a URDF.

    Raises:
        InvalidInput: It has not, or names a file of the robot.
    """
    if isinstance(key, str):
        if key.startswith(_FILES):
            allowed = "a robot of another file is another scenario: name it under scenarios"
            raise InvalidInput(Status.UNSUPPORTED, field, quoted(key), allowed)
        if key.startswith("urdf.") and not _IN_URDF.fullmatch(key):
            allowed = "of a URDF, urdf.LINK.mass, urdf.LINK.inertia or urdf.LINK.inertia.ixx"
            raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(key), allowed)
        if key.startswith("turn.") and not _TURN.fullmatch(key):
            allowed = "to turn a frame about an axis of its own [deg], such as turn.target.z"
            raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(key), allowed)
        if key.startswith("urdf.") or _PATH.fullmatch(key):
            return key
    allowed = "it must be a key such as target.position[0] or planner.starts"
    raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(key), allowed)


def is_inertia(key: str) -> bool:
    """Tell whether a key means the whole inertia of a link, which can only be multiplied."""
    found = _IN_URDF.fullmatch(key)
    return found is not None and found["part"] == "inertia"


def _turn(document: dict[str, Any], turn: re.Match[str], change: Change) -> float:
    """Rotate the frame of a block about one of its own axes, and return the angle [deg]."""
    block: Any = document
    for step in _steps(turn["block"]):
        block = _below(block, step, change)
    if not isinstance(block, dict) or not {_QUATERNION, _EULER} & block.keys():
        allowed = f"the scenario has no {_QUATERNION} there"
        raise InvalidInput(Status.OUT_OF_RANGE, change.key, "unknown", allowed)
    angle = finite_number(change.key, _new_value(0.0, change))
    try:
        if _QUATERNION in block:
            present = Rotation.from_quat(block[_QUATERNION])
        else:  # R = Rz Ry Rx
            present = Rotation.from_euler("xyz", block.pop(_EULER), degrees=True)
    except (TypeError, ValueError):
        raise InvalidInput(
            Status.OUT_OF_RANGE, change.key, "no attitude", f"{_QUATERNION} must be one"
        ) from None
    turned = present * Rotation.from_euler(turn["axis"], angle, degrees=True)
    block[_QUATERNION] = turned.as_quat().tolist()
    return angle


def _steps(path: str) -> list[str | int]:
    return [name or int(index) for name, index in _STEP.findall(path)]


def _change_document(document: dict[str, Any], change: Change) -> Any:
    """Put a value in its place, and return it."""
    steps = _steps(change.key)
    block: Any = document
    for step in steps[:-1]:
        block = _below(block, step, change)
    last = steps[-1]
    if isinstance(block, list):
        last = _index(block, last, change)
        present = block[last]
    elif isinstance(block, dict) and isinstance(last, str):
        present = block.get(last)
    else:
        raise _not_there(change)
    block[last] = _new_value(present, change)
    return block[last]


def _below(block: Any, step: str | int, change: Change) -> Any:
    if isinstance(block, list):
        return block[_index(block, step, change)]
    if isinstance(block, dict) and isinstance(step, str):
        return block.setdefault(step, {})  # a block of which the scenario says nothing
    raise _not_there(change)


def _index(entries: list[Any], step: str | int, change: Change) -> int:
    """Return the place of an entry: by its number, or by its `id`."""
    if isinstance(step, int):
        if step < len(entries):
            return step
        raise _not_there(change)
    for place, entry in enumerate(entries):
        if isinstance(entry, dict) and entry.get("id") == step:
            return place
    raise _not_there(change)


def _not_there(change: Change) -> InvalidInput:
    allowed = "the scenario has no such value"
    return InvalidInput(Status.OUT_OF_RANGE, change.key, "unknown", allowed)


def _new_value(present: Any, change: Change) -> Any:
    if change.how != SET and not _is_numeric(present):
        allowed = f"`{change.how}` needs a number, or a list of numbers, in the scenario"
        raise InvalidInput(Status.OUT_OF_RANGE, change.key, quoted(present), allowed)
    given = change.value
    if isinstance(given, Draw):
        given = given.value(change.key, len(present) if isinstance(present, list) else None)
    if change.how == SET:
        return given
    if not _is_numeric(given) or (
        isinstance(given, list) and not (isinstance(present, list) and len(given) == len(present))
    ):
        allowed = "it must be a number, or a list of as many numbers as there are"
        raise InvalidInput(Status.WRONG_SIZE, change.key, quoted(given), allowed)
    try:
        new = np.multiply(present, given) if change.how == TIMES else np.add(present, given)
        return new.tolist()
    except (OverflowError, TypeError):  # whole numbers may be of any size
        allowed = "no computer calculates with numbers of this size"
        raise InvalidInput(Status.OUT_OF_RANGE, change.key, quoted(given), allowed) from None


def _is_numeric(value: Any) -> bool:
    entries = value if isinstance(value, list) else [value]
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in entries)


def _changed_urdf(urdf: str, place: re.Match[str], change: Change) -> tuple[str, Any]:
    """Change a mass or an inertia, and return the URDF and the new value."""
    tree = ElementTree.fromstring(urdf)
    links = {link.get("name"): link.find("inertial") for link in tree.iter("link")}
    inertial = links.get(place["link"])
    if inertial is None:
        having = ", ".join(str(name) for name, found in links.items() if found is not None)
        allowed = f"links with a mass are {having}"
        raise InvalidInput(Status.OUT_OF_RANGE, change.key, "unknown", allowed)
    what, _, component = place["part"].partition(".")
    element = inertial.find(what)
    if element is None:
        raise _not_there(change)
    if what == "mass" or component:
        name = component or "value"
        new = _new_value(float(element.get(name, "0")), change)
        element.set(name, json.dumps(new))
        return ElementTree.tostring(tree, encoding="unicode"), new
    # One factor for the whole tensor: factors of its own for each element make no body.
    if change.how != TIMES:
        allowed = "an inertia as a whole can be changed by `times` alone"
        raise InvalidInput(Status.UNSUPPORTED, change.key, change.how, allowed)
    factor = _new_value(1.0, change)
    for name, value in element.attrib.items():
        element.set(name, repr(float(value) * factor))
    return ElementTree.tostring(tree, encoding="unicode"), factor
