"""A body that a link holds, as one more link of the robot, so that the same equations hold."""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen, no_turn, zero_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import INERTIA, QUATERNION, TEXT, a_number, a_vector, each
from ff_planner_ros.common.shown import in_a_line, quoted
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import (
    MESH,
    MeshFile,
    Shaped,
    by_name,
)
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.meshes import EMBEDDED, Meshes
from ff_planner_ros.robot.urdf.srdf import MayTouch, write_pairs

if TYPE_CHECKING:
    from pathlib import Path

# Name of the link.
PAYLOAD = "payload"
_JOINT = f"{PAYLOAD}_on_"  # prefix of the joint's name, before that of the link
# Reason by which links may touch it.
GRASPED = "Grasped"
FIELD = "robot.payload"


@dataclass(frozen=True, eq=False)
class HeldShape(Shaped):
    """A collision solid that is fixed to a payload, or to another body in a subclass.

    Raises:
        InvalidInput: Wrong size, not finite, or a quaternion not of unit length.
    """

    PLACE: ClassVar[str] = f"{FIELD}.shapes"

    position: Array = declare(
        a_vector(),
        "of the shape's frame",
        unit="m",
        frame="in the frame of the link or body",
        message="pose.position",
    )
    quaternion_xyzw: Array = declare(
        QUATERNION,
        "axes of the shape to those of the link or body",
        default_factory=no_turn,
        message="pose.orientation",
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, f"{self.PLACE}[{self.id}]")
        if self.is_sphere:
            object.__setattr__(self, "quaternion_xyzw", frozen(no_turn()))


@dataclass(frozen=True, eq=False)
class Payload:
    """A body that a link holds from the start on.

    Raises:
        InvalidInput: Wrong size, not finite, a mass that is not positive, or two shapes with one
            id.
    """

    link: str = declare(TEXT, "link of the arm that it is fixed to", message="link")
    mass: float = declare(a_number(above=0.0), "of the body", unit="kg", message="inertia.m")
    inertia: Array = declare(  # shape (3, 3)
        INERTIA,
        "elements of the inertia tensor about the centre of mass, as in a URDF",
        unit="kg m2",
        frame="axes of the link",
        message="inertia",
    )
    center_of_mass: Array = declare(
        a_vector(),
        "of the body",
        key="com",
        unit="m",
        frame="in the link's frame",
        default_factory=zero_vector,
        message="inertia.com",
    )
    shapes: tuple[HeldShape, ...] = declare(
        each(part(HeldShape)),
        "its collision geometry, kept apart from all but what it is fixed to",
        default=(),
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, FIELD)
        names = [shape.id for shape in self.shapes]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            told, allowed = f"{FIELD}.shapes", "ids must be unique"
            raise InvalidInput(Status.OUT_OF_RANGE, told, quoted(twice), allowed)

    def loaded(self, directory: Path | None) -> Payload:
        """Return the payload with its mesh files, relative to a directory, read.

        Raises:
            InvalidInput: A mesh cannot be read, or has no hull.
        """
        meshes = Meshes(directory)
        read = [one.with_mesh_read(f"{one.PLACE}[{one.id}]", meshes) for one in self.shapes]
        return replace(self, shapes=tuple(read))


def with_payload(robot: Robot, payload: Payload, touching: Sequence[str] = ()) -> Robot:
    """Return the robot with a body fixed to one of its links.

    Args:
        touching: Links that may touch the body, beside the one that it is fixed to.

    Raises:
        InvalidInput: The arm does not move the link, the robot holds a payload already, the
            inertia is impossible, or shapes are given for a robot of lines.
    """
    _require_moved_link(robot, payload.link)
    if payload.shapes and robot.geometry is Geometry.LINES:
        allowed = "with robot.geometry lines nothing but the arm's lines is kept clear"
        raise InvalidInput(Status.UNSUPPORTED, f"{FIELD}.shapes", "given", allowed)
    urdf = _urdf_with(robot.drawn_urdf, payload, touching)
    try:
        held = robot_from_urdf_text(
            urdf,
            robot.base_link,
            robot.tip_link,
            robot.base,
            geometry=robot.geometry,
            wheels=robot.wheels,
            slide_weight=robot.slide_weight,
        )
    except InvalidInput as error:
        fault = error.faults[0]
        told = fault.field.rpartition(f"'{PAYLOAD}' ")[2]
        allowed = fault.allowed.partition(" (line ")[0]  # of a text that nobody has seen
        raise InvalidInput(Status.OUT_OF_RANGE, f"{FIELD}.{told}", fault.value, allowed) from None
    note = f"link {payload.link} holds a payload of {payload.mass:g} kg"
    changed = [one for one in held.notes if " inertia is of " in one and one not in robot.notes]
    meshes = (one for shape in payload.shapes for one in shape.solid.notes)
    notes = dict.fromkeys((*robot.notes, note, *changed, *meshes))
    return replace(held, notes=tuple(notes), payload=payload)


@kept_with_it
def payload_frame(robot: Robot) -> int | None:
    """Return the index of the frame of a payload's fixed joint; None: the robot holds none."""
    for number, one in enumerate(robot.model.frames):
        if one.type is pin.FrameType.FIXED_JOINT and one.name.startswith(_JOINT):
            return number
    return None


def _require_moved_link(robot: Robot, link: str) -> None:
    """Refuse a link that does not exist or that no joint of the arm moves, and a second payload."""
    frames = [one for one in robot.model.frames if one.type is pin.FrameType.BODY]
    moved = [one.name for one in frames if one.parentJoint > 1]
    if PAYLOAD in moved:
        told, allowed = f"{FIELD}.link", "the robot holds a payload already"
        raise InvalidInput(Status.UNSUPPORTED, told, quoted(link), allowed)
    if link not in moved:
        allowed = f"it must be a link that the arm moves: {', '.join(moved)}"
        raise InvalidInput(Status.OUT_OF_RANGE, f"{FIELD}.link", quoted(link), allowed)


def _urdf_with(urdf: str, payload: Payload, touching: Sequence[str]) -> str:
    """Return a URDF with the payload as a link that is fixed to another."""
    robot = ElementTree.fromstring(urdf)
    if payload.shapes:
        pairs = (MayTouch(link, PAYLOAD, GRASPED) for link in dict.fromkeys(touching))
        write_pairs(robot, pairs)
    link = SubElement(robot, "link", name=PAYLOAD)
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=_words(payload.center_of_mass))
    SubElement(inertial, "mass", value=repr(payload.mass))
    rows, columns = np.triu_indices(3)
    elements = {
        f"i{'xyz'[row]}{'xyz'[column]}": repr(float(payload.inertia[row, column]))
        for row, column in zip(rows, columns, strict=True)
    }
    SubElement(inertial, "inertia", elements)
    for shape in payload.shapes:
        link.append(_collision(shape))
    joint = SubElement(robot, "joint", name=_JOINT + payload.link, type="fixed")
    SubElement(joint, "parent", link=payload.link)
    SubElement(joint, "child", link=PAYLOAD)
    return ElementTree.tostring(robot, encoding="unicode")


def _collision(shape: HeldShape) -> Element:
    """Return the `<collision>` of a solid.

    Raises:
        InvalidInput: Its mesh file has not been read.
    """
    solid = shape.shape
    if isinstance(solid, MeshFile):
        told, allowed = f"{FIELD}.shapes[{shape.id}].shape", "give the mesh of it"
        raise InvalidInput(Status.UNSUPPORTED, told, solid.file, allowed)
    collision = Element("collision")
    turn = pin.Quaternion(shape.quaternion_xyzw).toRotationMatrix()
    angles = _words(pin.rpy.matrixToRpy(turn))
    SubElement(collision, "origin", xyz=_words(shape.position), rpy=angles)
    geometry = SubElement(collision, "geometry")
    if solid.kind == MESH:
        points = base64.b64encode(solid.corners.astype("<f4").tobytes()).decode()
        SubElement(geometry, MESH, filename=EMBEDDED + points)
        return collision
    SubElement(geometry, solid.kind, {word: _words(n) for word, n in by_name(solid).items()})
    return collision


def _words(numbers: Sequence[float] | Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
