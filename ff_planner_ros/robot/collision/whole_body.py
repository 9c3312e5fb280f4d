"""The collision geometry of a robot: bodies, pairs that must not touch, and a URDF with both."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.bodies import Body, bodies_of, drop_points
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.pairs import Pairs, always_touching, neighbours, pairs_of
from ff_planner_ros.robot.shapes import with_shapes
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.srdf import ALWAYS, Links, MayTouch, read_srdf, write_pairs
from ff_planner_ros.robot.urdf.urdf_bodies import too_wide
from ff_planner_ros.robot.urdf.urdf_faults import LONGEST_NOTE, Faults, listed, shortened
from ff_planner_ros.robot.urdf.urdf_xml import read_shapes


class WholeBody(NamedTuple):
    """The fields of a `Robot` that describe its collision geometry, and notes for the user."""

    geometry: Geometry
    bodies: tuple[Body, ...]
    pairs: Pairs
    may_touch: tuple[MayTouch, ...]
    drawn_urdf: str
    notes: tuple[str, ...]


def whole_body(
    model: pin.Model,
    checked: str,
    text: str,
    geometry: Geometry | None,
    srdf: str | None,
    directory: Path | None,
) -> WholeBody:
    """Return the collision geometry of a robot.

    Args:
        checked: The URDF that the model was built from, without shapes.
        text: The URDF as given.
        geometry: None: shapes if the arm has any, else lines.
        srdf: SRDF of links that may touch. None: those that the URDF names, or else those that
            touch in nearly every posture.
        directory: Directory of the URDF; None: no mesh is read from a file.

    Raises:
        InvalidInput: A shape, a mesh or the SRDF is refused.
    """
    faults = Faults()
    solids = read_shapes(text, faults)
    drawn = with_shapes(checked, solids)
    drop_points(solids, faults)
    joints = _joints_with_solids(solids, model)
    on_arm = any(joint > 1 for joint in joints.values())
    if geometry is Geometry.SHAPES and not on_arm:
        allowed = "no link of the arm has a <collision>: it must be lines"
        raise InvalidInput(Status.BAD_ROBOT, "robot.geometry", Geometry.SHAPES, allowed)
    if geometry is Geometry.LINES or not on_arm:
        only_chaser = joints and not on_arm
        note = "no link of the arm has a <collision>: its centre lines are kept clear of obstacles"
        notes = [] if geometry is Geometry.LINES else faults.notes
        notes += [*_wide(ElementTree.fromstring(checked), model, ())]
        notes += [note] if only_chaser else []
        if srdf is not None:
            notes.append("robot.srdf is not read: robot.geometry is lines")
        return WholeBody(Geometry.LINES, (), (), (), drawn, tuple(notes))
    robot = ElementTree.fromstring(checked)
    meshes = Meshes(directory)
    bodies = bodies_of(solids, model, meshes, faults)
    links = [str(link.get("name")) for link in robot.findall("link")]
    name, told, enabled = read_srdf(text, links, faults, "robot.urdf")
    other = name
    if srdf is not None:
        other, more, also_enabled = read_srdf(srdf, links, faults)
        told, enabled = told + more, enabled | also_enabled
    faults.refuse_if_any()
    may_touch = neighbours(robot, bodies)
    apart = (enabled & {pair.links for pair in may_touch}) - {pair.links for pair in told}
    may_touch = [pair for pair in may_touch if pair.links not in apart]
    known = {pair.links for pair in (*may_touch, *told)}
    may_touch += told
    if srdf is None and not told and not apart:
        may_touch += always_touching(model, bodies, known)
    may_touch = _that_count(may_touch, joints)
    notes = [*faults.notes, *dict.fromkeys(meshes.notes)]
    notes += _notes(model, bodies, may_touch if srdf is None else [])
    notes += _wide(robot, model, bodies)
    if other != name:
        notes.append(f"robot.srdf is of robot {shortened(other)}, the URDF of {shortened(name)}")
    return WholeBody(
        geometry=Geometry.SHAPES,
        bodies=bodies,
        pairs=pairs_of(bodies, {pair.links for pair in may_touch}),
        may_touch=tuple(may_touch),
        drawn_urdf=_handed_on(drawn, solids, may_touch, apart),
        notes=tuple(notes),
    )


def _joints_with_solids(solids: Element, model: pin.Model) -> dict[str, int]:
    """Return the joint that carries each link with a `<collision>`, by the link's name."""
    links = [str(link.get("name")) for link in solids.findall("link[collision]")]
    frames = (model.frames[model.getFrameId(link, pin.FrameType.BODY)] for link in links)
    return {link: frame.parentJoint for link, frame in zip(links, frames, strict=True)}


def _that_count(may_touch: list[MayTouch], joints: dict[str, int]) -> list[MayTouch]:
    """Return each pair of links once, without those that have no solids or do not move."""
    found: dict[frozenset[str], MayTouch] = {}
    for pair in may_touch:
        if pair.links <= joints.keys() and joints[pair.link1] != joints[pair.link2]:
            found.setdefault(pair.links, pair)
    return list(found.values())


def _notes(model: pin.Model, bodies: tuple[Body, ...], may_touch: list[MayTouch]) -> list[str]:
    always = [f"{pair.link1} and {pair.link2}" for pair in may_touch if pair.reason == ALWAYS]
    bare = {*range(2, model.njoints)} - {body.joint for body in bodies}
    # A link without length needs none: the next joint is at the same point.
    bare -= {
        model.parents[j]
        for j in range(3, model.njoints)
        if not model.jointPlacements[j].translation.any()
    }
    found = []
    if always:
        pairs = listed(always, LONGEST_NOTE)
        found.append(
            f"not kept apart, because they touch in nearly every posture: {pairs}; a robot.srdf "
            "can say otherwise"
        )
    if bare:
        names = listed((model.names[joint] for joint in sorted(bare)), LONGEST_NOTE)
        found.append(f"without a <collision>, and kept clear of nothing: what {names} moves")
    return found


def _wide(robot: Element, model: pin.Model, bodies: tuple[Body, ...]) -> list[str]:
    """Return notes on links with a radius of gyration larger than their body is.

    Of a link without a solid, which may be of any size: larger than the robot is.
    """
    places = [place.translation for place in model.jointPlacements]
    fixed = max(np.linalg.norm(frame.placement.translation) for frame in model.frames)
    widest = max((2.0 * body.radius for body in bodies), default=0.0)
    whole = float(sum(map(np.linalg.norm, places[2:])) + fixed + widest)
    sizes = dict[int, float]()  # by joint, of bodies that have solids
    for body in bodies:
        middle = model.inertias[body.joint].lever
        ends = [np.zeros(3), *(places[child] for child in model.children[body.joint])]
        reach = np.linalg.norm(body.center_in_joint - middle) + body.radius
        reach = max(reach, *(np.linalg.norm(end - middle) for end in ends))
        sizes[body.joint] = max(sizes.get(body.joint, 0.0), 2.0 * float(reach))
    found, known = [], {body.link: sizes[body.joint] for body in bodies}
    for link in robot.findall("link[inertial]"):
        if size := known.get(str(link.get("name")), whole):  # zero: of no size that is known
            found += too_wide(link, size)
    return found


def _handed_on(
    drawn: str, solids: Element, may_touch: list[MayTouch], apart: Collection[Links]
) -> str:
    """Return a drawn URDF with collision solids, and the links that may touch."""
    robot = ElementTree.fromstring(drawn)
    given = {link.get("name"): link.findall("collision") for link in solids.findall("link")}
    for link in robot.findall("link"):
        link.extend(given[link.get("name")])
    write_pairs(robot, may_touch, apart)
    return ElementTree.tostring(robot, encoding="unicode")
