"""A URDF or SDF as one rigid body: the solids of its links, and their total mass and inertia.

All joints are locked, as those of a robot that do not belong to its arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.errors import InvalidInput, InvalidInputs, Status
from ff_planner_ros.robot.collision.bodies import drop_points, solids_of
from ff_planner_ros.robot.collision.solids import Solid, solid_of
from ff_planner_ros.robot.urdf.locked_joints import (
    NOTHING_HELD,
    lock,
    locked_and_driven,
    told_position,
    without_mimicked,
)
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.urdf_bodies import (
    SMALLEST,
    joint_weight,
    placement,
    too_wide,
)
from ff_planner_ros.robot.urdf.urdf_faults import LONGEST_NOTE, Faults, InertiaChoice, listed
from ff_planner_ros.robot.urdf.urdf_tree import Tree, link_of, tree_of
from ff_planner_ros.robot.urdf.urdf_xml import (
    inertia_choice,
    read_elements,
    read_shapes,
)

LOCKED_JOINTS = "locked_joints"  # key of their positions, beside that of the URDF


@dataclass(frozen=True, eq=False)
class PlacedSolid:
    """A solid of a body."""

    name: str  # of its link; `link#2` for a link's second solid
    solid: Solid
    place: pin.SE3  # in the frame at the body's centre of mass with axes of the root link


@dataclass(frozen=True, eq=False)
class UrdfBody:
    """One rigid body from a URDF."""

    solids: tuple[PlacedSolid, ...]
    inertia: Array  # about its centre of mass, axes of the root link; shape (3, 3) [kg m2]
    mass: float  # [kg]
    notes: tuple[str, ...]  # for the user: joints that are locked, say


def urdf_body(
    text: str,
    told: str,
    directory: Path | None = None,
    locked_joints: Mapping[str, float] = NOTHING_HELD,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> UrdfBody:
    """Return the rigid body that the links of a URDF form together.

    Args:
        told: Name of the URDF in errors and notes.
        directory: Directory of its file, from which the paths of its meshes start. None: no file
            is read.
        locked_joints: Positions of its joints [rad, m]. Others are at zero, or at the limit nearest
            to zero.
        inertia: What happens to inertias that no body has. `AS_GIVEN`: those of links count.

    Raises:
        InvalidInput: The text is no URDF, its links have no mass, a joint cannot be locked, or a
            solid cannot be read.
    """
    try:
        body = _read(text, directory, locked_joints, inertia)
    except InvalidInput as error:
        faults = [_of(told, one) for one in error.faults]
        raise (faults[0] if len(faults) == 1 else InvalidInputs(faults)) from None
    return replace(body, notes=tuple(f"{told}: {note}" for note in body.notes))


def _of(told: str, error: InvalidInput) -> InvalidInput:
    """Return an error of a robot's URDF, renamed to that of a body's."""
    inside = error.field.removeprefix("robot.urdf").strip()
    field = f"{told} {inside}" if inside else told
    if inside.startswith(LOCKED_JOINTS):  # a key beside that of the URDF
        field = told.removesuffix("urdf") + inside
    return InvalidInput(Status.OUT_OF_RANGE, field, error.value, error.allowed)


def _read(
    text: str,
    directory: Path | None,
    locked_joints: Mapping[str, float],
    inertia: InertiaChoice,
) -> UrdfBody:
    faults = Faults()
    robot = read_elements(text, faults)
    tree = tree_of(robot, faults)
    if len(tree.roots) > 1:
        allowed = f"all links must hang on one: {listed(tree.roots)} hang on none"
        faults.add("robot.urdf", "", "", "more than one body", allowed)
    places, notes = _places(tree, locked_joints, faults)
    choice = inertia_choice(robot, inertia, faults)
    weight = joint_weight(tree, places, faults, choice, notes)
    faults.refuse_if_any()
    if weight.mass < SMALLEST:
        allowed = "it must have a mass: positions are from its centre"
        raise InvalidInput(Status.BAD_ROBOT, "robot.urdf", f"of {weight.mass:g} kg", allowed)
    solids = list[PlacedSolid]()
    center, meshes = pin.SE3(np.eye(3), -weight.center), Meshes(directory)
    shapes = read_shapes(text, faults)
    drop_points(shapes, faults)
    for name, link, geometry, place in solids_of(shapes, meshes, faults):
        solids.append(PlacedSolid(name, solid_of(geometry), center * places[link] * place))
    faults.refuse_if_any()
    reaches = [
        np.linalg.norm(one.place.act(one.solid.center)) + one.solid.radius for one in solids
    ] or [np.linalg.norm((center * place).translation) for place in places.values()]
    if size := 2.0 * float(max(reaches)):
        notes += [note for link in tree.links.values() for note in too_wide(link, size)]
    notes = [*faults.notes, *dict.fromkeys(meshes.notes), *notes]
    return UrdfBody(tuple(solids), frozen(weight.inertia), float(weight.mass), tuple(notes))


def _places(
    tree: Tree, locked_joints: Mapping[str, float], faults: Faults
) -> tuple[dict[str, pin.SE3], list[str]]:
    """Return the placement of each link in the frame of the root, and notes on locked joints."""
    joints = {joint.get("name", ""): joint for joint in tree.above.values()}
    where, _ = locked_and_driven(joints, (), locked_joints, LOCKED_JOINTS, faults)
    places, told = dict[str, pin.SE3](), list[str]()
    for link in tree.order:
        joint = tree.above.get(link)
        if joint is None:
            places[link] = pin.SE3.Identity()
            continue
        name, origin = joint.get("name", ""), joint.find("origin")
        place = placement(origin) if faults.vectors("joint", name, "origin", origin) else None
        if joint.get("type") != "fixed":
            at = where.get(name, 0.0)
            told.append(told_position(joint, at))
            place = lock(joint, at, place, faults)
        carrier = places[link_of(joint, "parent")]
        places[link] = carrier if place is None else carrier * place
    notes = [f"its joints are locked: {listed(told, LONGEST_NOTE)}"] if told else []
    return places, [*notes, *without_mimicked(joints)]
