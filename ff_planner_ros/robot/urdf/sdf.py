"""Conversion of SDFormat models to URDFs: inertias and solids of links, and joints between them.

SDFormat gives the poses of links in the model or in any of its frames; a URDF those of joints, each
in the link that carries it. Parts that a URDF cannot express are refused.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import NoReturn
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.sdf_frames import Frames, named, words_of
from ff_planner_ros.robot.urdf.sdf_xml import read_model
from ff_planner_ros.robot.urdf.urdf import NO_VELOCITY_LIMIT
from ff_planner_ros.robot.urdf.urdf_faults import finite_numbers, listed, shortened

# Both formats have these, by the same words, and the same primitives.
_JOINTS = ("fixed", "revolute", "continuous", "prismatic")
_ENTRIES = {"ixx": None, "iyy": None, "izz": None, "ixy": "0", "ixz": "0", "iyz": "0"}
# Larger limits are none: the format uses 1e16.
_NO_LIMIT = 1e15
# How a URDF says so.
_NONE = {"velocity": repr(NO_VELOCITY_LIMIT), "effort": "0"}
# Rounding error of products of poses.
_SAME_PLACE = 1e-9
# Schemes of files: a model's is resolved like a package's.
_MODEL_SCHEME, _PACKAGE_SCHEME = "model://", "package://"


def urdf_of(text: str) -> str:
    """Return the URDF of a model in SDFormat; any other text is returned unchanged.

    Raises:
        InvalidInput: The version is not supported, or the model has parts that a URDF cannot
            express.
    """
    model = read_model(text)
    if model is None:
        return text
    frames = Frames(model)
    robot = Element("robot", name=model.get("name") or "model")
    for link in model.findall("link"):
        _add_link(robot, link, frames)
    links = {named(link) for link in model.findall("link")}
    used = {*links, *map(named, model.findall("joint"))}
    for joint in model.findall("joint"):
        _add_joint(robot, joint, frames, links, used)
    return ElementTree.tostring(robot, encoding="unicode")


def _add_link(robot: Element, link: Element, frames: Frames) -> None:
    name = named(link)
    made = SubElement(robot, "link", name=name)
    told, inertial = f"link {shortened(name)!r}", link.find("inertial")
    if inertial is None:
        # The format's default is 1 kg and 1 kg m2.
        _refuse(f"{told} inertial", "missing", "every link must have one")
    if inertial.get("auto", "false").strip().lower() not in ("false", "0"):
        _refuse(f"{told} inertial auto", "true", "write mass and inertia")
    written = SubElement(made, "inertial")
    _add_origin(written, frames.pose_in(inertial, name))
    SubElement(written, "mass", value=_text(inertial, "mass", told))
    entries, inertia = dict[str, str](), inertial.find("inertia")
    for key, default in _ENTRIES.items():
        entries[key] = _text(inertia, key, f"{told} inertia", default)
    SubElement(written, "inertia", entries)
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")
        shapes = [] if geometry is None else list(geometry)
        if len(shapes) != 1:
            allowed = f"it must be one of {listed((*sorted(PRIMITIVES), 'mesh', 'empty'))}"
            value = f"{len(shapes)} shapes"
            _refuse(f"{told} collision geometry", value, allowed)
        if shapes[0].tag == "empty":
            continue
        solid = SubElement(made, "collision")
        _add_origin(solid, frames.pose_in(collision, name))
        _add_shape(SubElement(solid, "geometry"), shapes[0], told)


def _add_shape(geometry: Element, shape: Element, told: str) -> None:
    if shape.tag != "mesh":
        sizes = {size.tag: (size.text or "").strip() for size in shape}
        SubElement(geometry, shape.tag, sizes)  # missing ones are refused by their reader
        return
    uri = _text(shape, "uri", f"{told} collision mesh")
    if uri.startswith(_MODEL_SCHEME):
        uri = _PACKAGE_SCHEME + uri.removeprefix(_MODEL_SCHEME)
    SubElement(geometry, "mesh", filename=uri, scale=_text(shape, "scale", told, "1 1 1"))


def _add_joint(
    robot: Element, joint: Element, frames: Frames, links: set[str], used: set[str]
) -> None:
    name, kind = named(joint), joint.get("type", "")
    told = f"joint {shortened(name)!r}"
    if kind not in _JOINTS:
        _refuse(told, shortened(kind) or "of no type", f"it must be one of {listed(_JOINTS)}")
    parent, child = (_text(joint, end, told) for end in ("parent", "child"))
    for end, link in (("parent", parent), ("child", child)):
        if link not in links:
            allowed = f"it must be one of the model's links: {listed(sorted(links))}"
            _refuse(f"{told} {end}", shortened(link), allowed)
    here = frames.place(name)
    placed, carried = frames.place(parent).inverse() * here, here.inverse() * frames.place(child)
    lower_end = child
    if not carried.isIdentity(_SAME_PLACE):
        # A URDF's link begins at the joint above it: a link without mass is put between.
        lower_end = _unused(f"{name}_frame", used)
        SubElement(robot, "link", name=lower_end)
        fixed = SubElement(robot, "joint", name=_unused(f"{name}_fixed", used), type="fixed")
        _add_ends(fixed, lower_end, child, carried)
    made = SubElement(robot, "joint", name=name, type=kind)
    _add_ends(made, parent, lower_end, placed)
    if kind != "fixed":
        _add_axis(made, joint, frames, told)


def _add_axis(made: Element, joint: Element, frames: Frames, told: str) -> None:
    """Add axis and limits of a joint that moves."""
    axis, name = joint.find("axis"), named(joint)
    if axis is None:
        _refuse(f"{told} axis", "missing", "a joint that moves must have one")
    if _text(axis, "use_parent_model_frame", told, "0").lower() not in ("0", "false"):
        allowed = "write the axis in the frame of the joint, or with expressed_in"
        _refuse(f"{told} axis use_parent_model_frame", "true", allowed)
    xyz, of_joint = axis.find("xyz"), frames.place(name).rotation
    text = _text(axis, "xyz", f"{told} axis", "0 0 1")
    numbers = finite_numbers(text)
    if len(numbers) != 3:
        value, allowed = repr(shortened(text)), "it must be three finite numbers"
        _refuse(f"{told} axis xyz", value, allowed)
    seen_from = "" if xyz is None else xyz.get("expressed_in", "")
    if seen_from:
        numbers = (of_joint.T @ frames.place(seen_from, told).rotation @ numbers).tolist()
    SubElement(made, "axis", xyz=" ".join(map(repr, numbers)))
    if (dynamics := axis.find("dynamics")) is not None:
        # A URDF has no springs: for the note that they do not count
        resists = {one.tag.removeprefix("spring_"): words_of(one) or "" for one in dynamics}
        SubElement(made, "dynamics", resists)
    limit = axis.find("limit")
    found = {} if limit is None else {one.tag: words_of(one) for one in limit}
    free = {key for key in ("lower", "upper", *_NONE) if _is_none(key, found.get(key, ""))}
    if made.get("type") == "revolute" and {"lower", "upper"} <= free:
        made.set("type", "continuous")
    SubElement(made, "limit", found | {key: text for key, text in _NONE.items() if key in free})


def _is_none(key: str, text: str) -> bool:
    """Tell whether a limit is none: absent, infinite, or -1 of what cannot be negative."""
    numbers = finite_numbers(text)
    return (
        not text
        or text.lstrip("+-").lower().startswith("inf")
        or (len(numbers) == 1 and abs(numbers[0]) >= _NO_LIMIT)
        or (numbers == [-1.0] and key in _NONE)
    )


def _add_ends(made: Element, parent: str, child: str, place: pin.SE3) -> None:
    SubElement(made, "parent", link=parent)
    SubElement(made, "child", link=child)
    _add_origin(made, place)


def _add_origin(owner: Element, place: pin.SE3) -> None:
    if not place.isIdentity(0.0):
        turn = pin.rpy.matrixToRpy(place.rotation)
        SubElement(owner, "origin", xyz=_written(place.translation), rpy=_written(turn))


def _written(vector: Array) -> str:
    return " ".join(repr(float(number)) for number in np.asarray(vector))


def _text(owner: Element | None, tag: str, told: str, default: str | None = None) -> str:
    """Return the text of an element's part."""
    part = None if owner is None else owner.find(tag)
    text = words_of(part) or default
    if text is None:
        _refuse(f"{told} {tag}", "missing", "it must be given")
    return text


def _unused(name: str, used: set[str]) -> str:
    while name in used:
        name += "_"
    used.add(name)
    return name


def _refuse(field: str, value: str, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, field, value, allowed)
