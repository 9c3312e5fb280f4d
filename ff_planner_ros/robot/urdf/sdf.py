"""Conversion of SDFormat models to URDFs: inertias and solids of links, and joints between them.

SDFormat gives the poses of links in the model or in any of its frames; a URDF those of joints, each
in the link that carries it. Parts that a URDF cannot express are refused.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.sdf_model import MODEL, SDF, Frames, words_of
from ff_planner_ros.robot.urdf.urdf_faults import (
    LARGEST,
    Faults,
    finite_numbers,
    line_of,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.xml_reader import Format, PlacedElement, Tag, read_xml

# Versions of the format: in those before axes and poses mean something else.
_OLDEST, _NEWEST = (1, 5), (1, 99)
_ENTRIES = {"ixx": "", "iyy": "", "izz": "", "ixy": "0", "ixz": "0", "iyz": "0"}
# Larger limits are none: the format uses 1e16.
_NO_LIMIT = 1e15
# How a URDF says so.
_NONE = {"velocity": repr(LARGEST), "effort": "0"}
# Rounding error of products of poses.
_SAME_PLACE = 1e-9
# Schemes of files: a model's is resolved like a package's.
_MODEL_SCHEME, _PACKAGE_SCHEME = "model://", "package://"
# Any URDF: its own reader says what is wrong with it.
_URDF = Format("robot", Tag(), 0, "")


def urdf_of(text: str) -> str:
    """Return the URDF of a model in SDFormat; any other text is returned unchanged.

    Raises:
        InvalidInput: The version is not supported, or the model has parts that a URDF cannot
            express.
    """
    if "<sdf" not in text:
        return text
    faults = Faults()
    read = read_xml(text, {"robot": _URDF, "sdf": SDF}, faults)
    if read.tag != "sdf":
        return text
    return ElementTree.tostring(robot_of(read, faults), encoding="unicode")


def robot_of(sdf: Element, faults: Faults) -> Element:
    """Return the `<robot>` of an `<sdf>`.

    Args:
        faults: Those found so far; what a URDF's reader finds as well is left to it.

    Raises:
        InvalidInput: There are faults.
    """
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if not (models or sdf.get("version")):
        faults.add("robot.urdf", "", "", "a <sdf>", "its outermost tag must be <robot>")
        faults.refuse_if_any()
    _check_version(sdf, faults)
    if len(models) != 1:
        allowed = f"an SDF must hold one <model>, not {listed(map(_name, models)) or 'none'}"
        faults.add("robot.urdf", "", "", f"{len(models)} models", allowed)
        faults.refuse_if_any()
    (model,) = models
    frames = Frames(model, faults)
    robot = Element("robot", name=model.get("name") or "model")
    for link in model.findall("link"):
        _add_link(robot, link, frames, faults)
    links = {link.get("name", "") for link in model.findall("link")}
    used = {*links, *(joint.get("name", "") for joint in model.findall("joint"))}
    for joint in model.findall("joint"):
        _add_joint(robot, joint, frames, links, used, faults)
    faults.refuse_if_any()
    return robot


def _name(element: Element) -> str:
    return element.get("name", "")


def _check_version(sdf: Element, faults: Faults) -> None:
    text = sdf.get("version", "")
    try:
        major, minor = (int(part) for part in text.split("."))
    except ValueError:
        major, minor = 0, 0
    if not _OLDEST <= (major, minor) <= _NEWEST:
        allowed = f"it must be from {_OLDEST[0]}.{_OLDEST[1]} on, and below 2"
        faults.add("sdf version", "", "", repr(shortened(text)), allowed, sdf)


def _add_link(robot: Element, link: Element, frames: Frames, faults: Faults) -> None:
    name, inertial = link.get("name", ""), link.find("inertial")
    made = SubElement(robot, "link", name=name)
    if inertial is None:
        # The format's default is 1 kg and 1 kg m2.
        faults.add("link", name, "inertial", "missing", "every link must have one")
    elif inertial.get("auto", "false").strip().lower() not in ("false", "0"):
        faults.add("link", name, "inertial auto", "true", "write mass and inertia")
    else:
        written = SubElement(made, "inertial")
        _add_origin(written, frames.pose_in(inertial, link))
        SubElement(written, "mass", _given(inertial, {"mass": ""}, value="mass"))
        SubElement(written, "inertia", _given(inertial.find("inertia"), _ENTRIES))
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")
        shapes = [] if geometry is None else list(geometry)
        if len(shapes) != 1:
            allowed = f"it must be one of {listed((*sorted(PRIMITIVES), 'mesh', 'empty'))}"
            value = f"{len(shapes)} shapes"
            faults.add("link", name, "collision geometry", value, allowed, collision)
        elif shapes[0].tag != "empty":
            solid = SubElement(made, "collision")
            _add_origin(solid, frames.pose_in(collision, link))
            _add_shape(SubElement(solid, "geometry"), shapes[0], name, faults)


def _given(owner: Element | None, defaults: dict[str, str], **names: str) -> dict[str, str]:
    """Return the texts of an element's parts, by the names of a URDF's attributes.

    What is missing and has no default is left out: the URDF's reader tells it.
    """
    found = {} if owner is None else {one.tag: words_of(one) for one in owner}
    keys = names or {key: key for key in defaults}
    told = {name: found.get(tag) or defaults[tag] for name, tag in keys.items()}
    return {name: text for name, text in told.items() if text}


def _add_shape(geometry: Element, shape: Element, link: str, faults: Faults) -> None:
    sizes = {size.tag: words_of(size) for size in shape}
    made = PlacedElement(shape.tag)
    made.line = line_of(shape)
    geometry.append(made)
    if shape.tag != "mesh":
        made.attrib.update(sizes)  # missing ones are refused by their reader
        return
    uri = sizes.get("uri", "")
    if not uri:
        faults.add("link", link, "collision mesh uri", "missing", "it must be given", shape)
    if uri.startswith(_MODEL_SCHEME):
        uri = _PACKAGE_SCHEME + uri.removeprefix(_MODEL_SCHEME)
    made.attrib.update(filename=uri, scale=sizes.get("scale") or "1 1 1")


def _add_joint(
    robot: Element,
    joint: Element,
    frames: Frames,
    links: set[str],
    used: set[str],
    faults: Faults,
) -> None:
    name, kind = joint.get("name", ""), joint.get("type", "")
    parent, child = (words_of(joint.find(end)) for end in ("parent", "child"))
    placed = carried = pin.SE3.Identity()
    if {parent, child} <= links:
        here = frames.place(name)
        placed = frames.place(parent).inverse() * here
        carried = here.inverse() * frames.place(child)
    lower_end = child
    if not carried.isIdentity(_SAME_PLACE):
        # A URDF's link begins at the joint above it: a link without mass is put between.
        lower_end = _unused(f"{name}_frame", used)
        SubElement(robot, "link", name=lower_end)
        fixed = SubElement(robot, "joint", name=_unused(f"{name}_fixed", used), type="fixed")
        _add_ends(fixed, lower_end, child, carried)
    made = SubElement(robot, "joint", name=name, type=kind)
    _add_ends(made, parent, lower_end, placed)
    if kind in ("revolute", "continuous", "prismatic"):
        _add_axis(made, joint, frames, faults)


def _add_axis(made: Element, joint: Element, frames: Frames, faults: Faults) -> None:
    """Add axis and limits of a joint that moves."""
    axis, name = joint.find("axis"), joint.get("name", "")
    if axis is None:
        faults.add("joint", name, "axis", "missing", "a joint that moves must have one")
        return
    xyz = axis.find("xyz")
    text = words_of(xyz) or "0 0 1"
    numbers = finite_numbers(text)
    seen_from = "" if xyz is None else xyz.get("expressed_in", "")
    if words_of(axis.find("use_parent_model_frame")).lower() not in ("", "0", "false"):
        seen_from = MODEL  # as versions before 1.7 say it
    if len(numbers) != 3:
        value, allowed = repr(shortened(text)), "it must be three finite numbers"
        faults.add("joint", name, "axis xyz", value, allowed)
    elif seen_from:
        turn = frames.place(name).rotation.T @ frames.place(seen_from, joint).rotation
        numbers = (turn @ numbers).tolist()
    SubElement(made, "axis", xyz=" ".join(map(repr, numbers)))
    if (dynamics := axis.find("dynamics")) is not None:
        # A URDF has no springs: for the note that they do not count
        resists = {one.tag.removeprefix("spring_"): words_of(one) for one in dynamics}
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


def _unused(name: str, used: set[str]) -> str:
    while name in used:
        name += "_"
    used.add(name)
    return name
