"""A free-floating robot, loaded from a URDF."""

from __future__ import annotations

import enum
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array, frozen
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.shapes import with_shapes
from ff_planner_ros.robot.urdf import checked_urdf
from ff_planner_ros.robot.urdf_xml import MAX_CHARACTERS


class Base(enum.StrEnum):
    """How the chaser can move."""

    FREE_FLYER = "free_flyer"
    PLANAR = "planar"  # on an air-bearing table: x, y and the turn about z, inertial axes


@dataclass(frozen=True, eq=False)
class Robot:
    """A chaser with one arm: a Pinocchio model whose root is a free-flyer, gravity zero."""

    model: pin.Model  # never changed after loading
    urdf: str  # the checked XML that the model was built from
    drawn_urdf: str  # the same with the shapes of its links, to hand on
    joint_names: tuple[str, ...]  # from base to tip
    base_link: str  # URDF link that carries the arm; its axes are the chaser's axes
    tip_link: str  # URDF link whose frame is the end effector
    tip_frame_id: int  # frame of the tip link
    # Centre of mass of base link and all that is fixed to it, in the frame of the free-flyer joint
    position_chaser_in_base: Array  # shape (3,) [m]
    rotation_chaser_to_base: Array  # axes of the base link in that frame; shape (3, 3)
    joint_axes: Array  # unit vectors in the frames of the joints; shape (joints, 3)
    lower_position_limits: Array  # shape (joints,) [rad]
    upper_position_limits: Array  # shape (joints,) [rad]
    velocity_limits: Array  # shape (joints,) [rad/s]
    # Infinite where the URDF says zero: exporters write so that a limit is not known
    effort_limits: Array  # shape (joints,) [N m]
    notes: tuple[str, ...] = ()  # what a user should know: joints that are held, say
    base: Base = Base.FREE_FLYER

    @property
    def joints(self) -> int:
        """Number of arm joints."""
        return len(self.joint_names)


def load_robot(urdf: Path, base_link: str, tip_link: str) -> Robot:
    """Load a robot from a URDF file.

    See `robot_from_urdf_text` for what it must hold.

    Raises:
        InvalidInput: The file cannot be read, or its content is refused.
    """
    return robot_from_urdf_text(read_urdf(urdf), base_link, tip_link)


def read_urdf(urdf: Path) -> str:
    """Return the text of a URDF file.

    Raises:
        InvalidInput: The file cannot be read.
    """
    try:
        if stat.S_ISREG(urdf.stat().st_mode):  # to open a pipe may last for ever
            with urdf.open("rb") as file:
                content = file.read(MAX_CHARACTERS + 1)
            if len(content) <= MAX_CHARACTERS:
                return content.decode("utf-8")
            reason = f"it has more than {MAX_CHARACTERS} bytes"
        else:
            reason = "Is a directory" if urdf.is_dir() else "it is no regular file"
    except UnicodeDecodeError:
        reason = "not UTF-8"
    except OSError as error:
        reason = str(error.strerror)
    raise InvalidInput(Status.BAD_ROBOT, "robot.urdf", urdf, f"it cannot be read: {reason}")


def robot_from_urdf_text(
    text: str, base_link: str | None = None, tip_link: str | None = None
) -> Robot:
    """Build a robot from a URDF.

    Args:
        text: The URDF's XML: one chain of revolute joints from base to tip, at least six, each
            with limits; every other joint fixed, but for those of a gripper at the tip.
        base_link: Link that carries the arm; it is the root or fixed to it. None: the root.
        tip_link: Link whose frame is the end effector. None: the only link that carries no other.

    Raises:
        InvalidInput: The URDF is something else, or a link's inertia is one that no body has.
    """
    checked = checked_urdf(text, base_link, tip_link)
    try:
        model = _pinocchio_model(checked.xml)
    except (ValueError, RuntimeError) as error:
        raise InvalidInput(
            Status.BAD_ROBOT, "robot.urdf", "unreadable", f"Pinocchio says: {str(error)[:200]}"
        ) from None
    model.gravity = pin.Motion.Zero()
    base_frame = model.frames[model.getFrameId(checked.base_link, pin.FrameType.BODY)]
    # The first two joints are Pinocchio's: the universe and the free-flyer.
    efforts = np.array(model.upperEffortLimit[6:])
    return Robot(
        model=model,
        urdf=checked.xml,
        drawn_urdf=with_shapes(checked.xml, text),
        joint_names=tuple(model.names)[2:],
        base_link=checked.base_link,
        tip_link=checked.tip_link,
        tip_frame_id=model.getFrameId(checked.tip_link, pin.FrameType.BODY),
        position_chaser_in_base=frozen(model.inertias[1].lever),
        rotation_chaser_to_base=frozen(base_frame.placement.rotation),
        joint_axes=frozen(_joint_axes(model)),
        lower_position_limits=frozen(model.lowerPositionLimit[7:]),
        upper_position_limits=frozen(model.upperPositionLimit[7:]),
        velocity_limits=frozen(model.upperVelocityLimit[6:]),
        effort_limits=frozen(np.where(efforts == 0.0, np.inf, efforts)),
        notes=checked.notes,
    )


def _pinocchio_model(xml: str) -> pin.Model:
    """Return the model on a free-flyer.

    Pinocchio merges joints of the same name without a word: the free-flyer with a joint of the
    URDF, and a fixed joint called `universe` with the inertial frame. Both get names of their own.
    """
    robot = ElementTree.fromstring(xml)
    names = {element.get("name") for element in robot}
    free_flyer = _unused_name("free_flyer", names)
    for joint in robot.findall("joint[@type='fixed'][@name='universe']"):
        joint.set("name", _unused_name("fixed", {*names, free_flyer}))
    renamed = ElementTree.tostring(robot, encoding="unicode")
    return pin.buildModelFromXML(renamed, pin.JointModelFreeFlyer(), free_flyer)


def _unused_name(name: str, used: Collection[str | None]) -> str:
    while name in used:
        name += "_"
    return name


def _joint_axes(model: pin.Model) -> Array:
    """Return the axes of the arm's joints in their own frames. Shape (joints, 3)."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    columns = [
        pin.getJointJacobian(model, data, joint, pin.LOCAL)[3:, model.idx_vs[joint]]
        for joint in range(2, model.njoints)
    ]
    return np.array(columns)
