"""Joint names and joint goals in messages, which may list joints in any order."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ff_planner_ros.common.arrays import finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.robot.model import Robot

if TYPE_CHECKING:
    from ff_planner_msgs.msg import Goal
    from sensor_msgs.msg import JointState

# Most names of joints in an error: more than any arm has would bury the message.
_NAMES_SHOWN = 20
# Fields of a joint goal in messages, by those of a scenario.
GOAL_JOINTS = {
    f"target.joints.{ours}": f"goal.joints.{theirs}"
    for ours, theirs in (("position", "position"), ("velocity", "velocity"))
}


def names_a_joint_of(robot: Robot) -> Callable[[JointState | bytes], bool]:
    """Return a function that tells if a JointState, serialised or not, names a planned joint.

    Any other one, for example of a gripper, is not for the planner.
    """
    planned = frozenset(robot.joint_names)
    # As serialised, in either order of bytes: its length, the zero at its end counted, and it.
    in_bytes = [
        struct.pack(f"{order}I", len(name.encode()) + 1) + name.encode() + b"\0"
        for name in robot.joint_names
        for order in "<>"
    ]

    def names_one(message: JointState | bytes) -> bool:
        if isinstance(message, bytes):
            return any(name in message for name in in_bytes)
        return not planned.isdisjoint(message.name)

    return names_one


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
    field: str, found: Sequence[str], wanted: Sequence[str], others_allowed: bool = False
) -> list[int]:
    """Return the index in `found` of each wanted joint.

    Args:
        field: Field of the names found, which the error names.
        others_allowed: Whether `found` may name further joints.

    Raises:
        InvalidInput: A joint is unknown, missing or named twice.
    """
    known = set(wanted)
    counts = Counter(name for name in found if name in known) if others_allowed else Counter(found)
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


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:_NAMES_SHOWN])
    rest = len(names) - _NAMES_SHOWN
    return f"{shown} and {rest} more" if rest > 0 else shown
