"""The digest of a task: a hash that is equal for equal tasks."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    TargetBody,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.robot.collision.bodies import defining_numbers
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

_DIGITS = 16


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
    elif isinstance(value, str):
        text = value.encode(errors="surrogatepass")
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
            yield from canonical(item.name)
            yield from canonical(getattr(value, item.name))


def _parts_of_robot(robot: Robot) -> list[Any]:
    """Return the properties of a robot that plans depend on."""
    parts: list[Any] = [robot.urdf, robot.base_link, robot.tip_link, robot.base]
    parts += [robot.wheels, robot.joint_weights, robot.geometry]
    if robot.geometry is not Geometry.LINES:
        parts += [(body.name, body.joint, *defining_numbers(body)) for body in robot.bodies]
        parts.append(robot.pairs)
    return parts


def _is_absent(value: Any, name: str) -> bool:
    """Tell whether a field follows from others, or no plan depends on it."""
    if name == "notes" or (name == "chaser_goal" and np.isinf(value.chaser_goal.most)):
        return True
    match value:
        case Obstacle():
            return value.body is not None and name == "motion"
        case SystemState():
            return name == "ee_at_rest"
        case PlanningProblem():
            if name == "target":
                given = value.target_body, value.posture, value.path
                return any(one is not None for one in given)
            if name == "path":
                return value.path is None
            return name == "contact_distance" and not value.allowed_collisions
        case TargetBody():
            return name == "mass"  # a task that depends on the mass adds it
        case PlannerSettings():
            return name == "threads" or (name == "robust" and not value.robust.sigmas)
    return False
