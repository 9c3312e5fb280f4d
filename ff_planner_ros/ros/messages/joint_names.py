"""Joint names and joint goals in messages, which may list joints in any order."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.robot.model import Robot

if TYPE_CHECKING:
    from ff_planner_msgs.msg import Goal

# Most names of joints in an error: more than any arm has would bury the message.
_NAMES_SHOWN = 20


def joints_named(wanted: Sequence[str]) -> Callable[[bytes], Iterator[str]]:
    """Return a function that yields the joints named in the bytes of a JointState or ChaserState.

    Of the joints wanted; the message is not deserialised.
    """
    # In either order of bytes: the name's length, the zero at its end counted, and the name.
    in_bytes = {
        name: [
            struct.pack(f"{order}I", len(name.encode()) + 1) + name.encode() + b"\0"
            for order in "<>"
        ]
        for name in wanted
    }

    def named(cdr: bytes) -> Iterator[str]:
        return (name for name, forms in in_bytes.items() if any(one in cdr for one in forms))

    return named


def posture_in(goal: Goal, robot: Robot) -> Posture | None:
    """Return the joint goal, or the goal at rest; None: the goal is one of the end effector.

    Raises:
        InvalidInput: A joint is unknown, missing or named twice, or lacks a finite position or
            velocity.
    """
    if goal.kind == GoalKind.AT_REST:
        return Posture(at_rest=True)
    if goal.kind != GoalKind.JOINTS:
        return None
    told = goal.joints
    order = joint_order("goal.joints.name", told.name, robot.joint_names)
    positions = finite_vector("goal.joints.position", told.position, robot.joints)[order]
    if not len(told.velocity):
        return Posture(positions)
    velocities = finite_vector("goal.joints.velocity", told.velocity, robot.joints)[order]
    return Posture(positions, velocities)


def joint_order(
    field: str,
    found: Sequence[str],
    wanted: Sequence[str],
    others_allowed: bool = False,
    beside: Collection[str] = (),
) -> list[int]:
    """Return the index in `found` of each wanted joint.

    Args:
        field: Field of the names found, which the error names.
        others_allowed: Whether `found` may name further joints.
        beside: Further joints that `found` may name.

    Raises:
        InvalidInput: A joint is unknown, missing or named twice.
    """
    known = set(wanted)
    counts = Counter(
        name for name in found if name in known or (not others_allowed and name not in beside)
    )
    faults = [
        f"{fault}: {_listed(names)}"
        for fault, names in (
            ("unknown", sorted(counts.keys() - known)),
            ("missing", sorted(known - counts.keys())),
            ("more than once", sorted(name for name, times in counts.items() if times > 1)),
        )
        if names
    ]
    if faults:
        raise InvalidInput(
            Status.UNKNOWN_JOINT,
            field,
            list(found),
            f"it must name each of {', '.join(wanted)} once ({'; '.join(faults)})",
        )
    return [found.index(name) for name in wanted]


def of_joints_in(field: str, values: object, order: Sequence[int], size: int) -> Array:
    """Return the values of some joints in a message, which may even be NaN of others.

    Args:
        order: Their indices.
        size: Number of joints in the message.

    Raises:
        InvalidInput: The values are too few, too many, or not finite.
    """
    vector = np.array(values)
    if vector.size != size:
        return finite_vector(field, vector.tolist(), size)  # says what is wrong
    return finite_vector(field, vector[list(order)].tolist(), len(order))


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:_NAMES_SHOWN])
    rest = len(names) - _NAMES_SHOWN
    return f"{shown} and {rest} more" if rest > 0 else shown
