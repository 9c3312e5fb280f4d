"""The digest of a task: a hash that is equal for equal tasks, also across versions."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ff_planner_ros.common.declared import declared_by_name
from ff_planner_ros.planning.problem.problem import (
    ObstacleBody,
    PlanningProblem,
    Sphere,
    TargetBody,
)
from ff_planner_ros.planning.problem.settings import FORMER_ROUNDS, PlannerSettings, SearchDepth
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.robot.collision.bodies import defining_numbers
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.state import SystemState

_DIGITS = 16
# What fields were called until version 0.3: the digest of a task stays what it was.
_DIGESTED_AS = {
    "allowed_collisions": "allowed_at_goal",
    "half_angle": "cone",
    "search": "attitude_rounds",
}


def digest_of(value: Any) -> str:
    """Return the digest of a dataclass, array, number, text or sequence: 16 hexadecimal digits."""
    return hashlib.sha256(b"".join(canonical(value))).hexdigest()[:_DIGITS]


def canonical(value: Any) -> Iterator[bytes]:
    """Yield bytes that are the same for equal values, on every machine and in every process."""
    if isinstance(value, Robot):
        yield from canonical(_parts_of_robot(value))
    elif is_dataclass(value):
        yield from _canonical_fields(value)
    elif value is None or isinstance(value, bool):
        yield repr(value).encode()
    elif isinstance(value, SearchDepth):
        yield from canonical(FORMER_ROUNDS[value])
    elif isinstance(value, str):
        word = "as_planned" if value is EndBehaviour.NONE else str(value)
        text = word.encode(errors="surrogatepass")
        yield b"s%d:" % len(text) + text
    elif isinstance(value, np.ndarray):
        # Zeros are equal, whatever their sign.
        yield f"a{value.shape}".encode() + (value.astype("<f8") + 0.0).tobytes()
    elif isinstance(value, Sequence):
        yield b"l%d:" % len(value)
        for entry in value:
            yield from canonical(entry)
    else:
        yield b"d" + struct.pack("<d", value + 0.0)


def _canonical_fields(value: Any) -> Iterator[bytes]:
    if isinstance(value, Requirement):
        yield from canonical(value.name)
    for item in fields(value):
        if not _is_absent(value, item.name):
            yield from canonical(_DIGESTED_AS.get(item.name, item.name))
            yield from canonical(getattr(value, item.name))


def _parts_of_robot(robot: Robot) -> list[Any]:
    """Return the properties of a robot that plans depend on, without defaults that came later."""
    parts: list[Any] = [robot.urdf, robot.base_link, robot.tip_link]
    if robot.base is not Base.FREE_FLYER:
        parts.append(robot.base)
    if robot.wheels is not None:
        parts.append(robot.wheels)
    if robot.has_slides:
        parts.append(robot.joint_weights)
    if robot.geometry is not Geometry.LINES:
        bodies = [(body.name, body.joint, *defining_numbers(body)) for body in robot.bodies]
        parts += [robot.geometry, bodies, robot.pairs]
    return parts


def _is_absent(value: Any, name: str) -> bool:
    """Tell whether a field follows from others, or says what older versions took for granted."""
    kind: Any = type(value)
    given = getattr(value, name)
    if isinstance(value, Sphere | ObstacleBody) and value.body is not None:
        return name not in ("id", "radius", "shape")
    if isinstance(value, Solid | SystemState) and name in ("hull_added", "ee_at_rest"):
        return True
    if isinstance(value, PlanningProblem):
        if name in ("allowed_collisions", "contact_distance"):
            return not value.allowed_collisions
        if name == "target":
            return value.target_body is not None or value.posture is not None
    if isinstance(value, TargetBody) and name in ("mass", "notes"):
        return True  # a task that depends on the mass adds it
    if name == "then":
        return not given
    if isinstance(value, PlannerSettings) and name in ("threads", "robust"):
        return name == "threads" or not value.robust.sigmas  # no plan depends on threads
    said = declared_by_name(kind).get(name)
    if said is None:
        return given is None
    return said.late and bool(np.all(given == said.default))
