"""The robots of the benchmark: two from files, and generated arms with any number of joints."""

from __future__ import annotations

import re
from functools import cache

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, Robot, load_robot, robot_from_urdf_text

# Robots of the scenarios. The second has no joint to spare and couples more strongly to its
# chaser.
ROBOTS = ("lemur", "arm6")

# All generated arms have this length from the first pitch joint to the tip [m], this mass [kg]
# and this chaser.
_ARM_LENGTH, _ARM_MASS, _CHASER_MASS = 2.8, 21.0, 200.0
# Those on a table have this length [m], this mass [kg] and this chaser.
_TABLE_ARM, _TABLE_ARM_MASS, _TABLE_MASS = 1.2, 7.0, 60.0
# Each pitch joint sits beside the one before [m], so that no wrist is spherical.
_SIDEWAYS = 0.08

# What the arms with bodies look like [m]: a chaser with two panels, tubes that end beside the
# joints, a ball in a joint between two others, a tool.
_CHASER_BOX, _PANEL, _PANEL_AT = (1.0, 1.0, 0.8), (0.8, 2.0, 0.04), 1.7
_TUBE, _BALL, _BESIDE, _TOOL = 0.05, 0.06, 0.1, 0.12

# A rail under an arm: mass of its carriage [kg], how far it slides either way [m], how fast [m/s]
# and by which force [N].
_CARRIAGE, _RAIL, _RAIL_SPEED, _RAIL_FORCE = 8.0, 0.4, 0.1, 150.0

_GENERATED = re.compile(r"(arm|rail|planar)[1-9][0-9]?")  # by their number of joints that turn
# Robots that are read from the share directory, by name.
_BASE_LINKS = {"lemur": "chaser", "canadarm2": "station"}
# Where the chaser of `off7` has its centre of mass and axes.
_OFF_THE_BASE = '<origin xyz="0.3 -0.2 0.25" rpy="0.3 -0.2 0.5"/>'


@cache
def bench_robot(name: str, geometry: Geometry = Geometry.LINES) -> Robot:
    """Return `lemur`, `canadarm2`, or a generated arm by its number of joints: `arm6` has six.

    `rail6` has a prismatic joint along its chaser before six revolute ones. `planar3` has three
    joints on a planar base. `off7` has seven, and its chaser's centre of mass is off the base
    link's frame. The last two have no collision bodies.

    Raises:
        ValueError: There is no robot of this name.
    """
    if name in _BASE_LINKS:
        urdf = share_directory() / "config" / "robots" / name / f"{name}.urdf"
        return load_robot(urdf, _BASE_LINKS[name], "end_effector", geometry=geometry)
    if name == "off7":
        moved = arm_urdf(7).replace('<origin xyz="0 0 0.0"/>', _OFF_THE_BASE, 1)
        return robot_from_urdf_text(moved, "chaser", "end_effector")
    generated = _GENERATED.fullmatch(name)
    if generated is None:
        raise ValueError(f"there is no robot {name!r} in the benchmark")
    if name.startswith("planar"):
        text = planar_urdf(int(name.removeprefix("planar")))
        return robot_from_urdf_text(text, "chaser", "end_effector", Base.PLANAR)
    shapes, rail = geometry is Geometry.SHAPES, name.startswith("rail")
    text = arm_urdf(int(re.sub(r"\D", "", name)), with_bodies=shapes, on_rail=rail)
    return robot_from_urdf_text(text, "chaser", "end_effector")


def planar_urdf(joints: int) -> str:
    """Return the URDF of a planar chaser with an arm whose joints rotate about z."""
    parts = [_link("chaser", _TABLE_MASS, (2.0, 2.0, 3.0), 0.0)]
    parent, offset, length = "chaser", "0.25 0.05 0", _TABLE_ARM / joints
    for number in range(1, joints + 1):
        mass = _TABLE_ARM_MASS / joints
        thin = mass * (0.002 + length**2 / 12)
        link = _link(f"link_{number}", mass, (mass * 0.002, thin, thin), 0.0)
        parts.append(link.replace('xyz="0 0 0.0"', f'xyz="{length / 2} 0 0"', 1))
        parts.append(_joint(f"joint_{number}", "revolute", parent, f"link_{number}", offset, "z"))
        parent, offset = f"link_{number}", f"{length} 0 0"
    parts.append('<link name="end_effector"/>')
    parts.append(_joint("hand", "fixed", parent, "end_effector", offset))
    return f'<robot name="planar{joints}">{"".join(parts)}</robot>'


def arm_urdf(joints: int, *, with_bodies: bool = False, on_rail: bool = False) -> str:
    """Return the URDF of a chaser with an arm of roll and pitch joints, along z at zero angles.

    Args:
        joints: Number of revolute joints, six or more; even: without the upper arm's roll.
        with_bodies: Whether chaser and links have collision shapes.
        on_rail: Whether a prismatic joint along x of the chaser comes first.
    """
    axes = ["z", *("yz" * joints)[:joints]]
    if joints % 2 == 0:
        del axes[2]
    axes = axes[:joints]
    pitches = axes.count("y")
    parts = [_link("chaser", _CHASER_MASS, (11.0, 9.0, 15.0), 0.0)]
    if with_bodies:
        parts[0] = _filled(parts[0], _box(_CHASER_BOX))
        for side, place in (("left", _PANEL_AT), ("right", -_PANEL_AT)):
            parts.append(_filled(f'<link name="panel_{side}"></link>', _box(_PANEL)))
            at = f"0 {place} 0"
            parts.append(_joint(f"hinge_{side}", "fixed", "chaser", f"panel_{side}", at))
    parent, offset = "chaser", "0.2 0.1 0.4"
    if on_rail:
        parts.append(_link("carriage", _CARRIAGE, (0.05, 0.05, 0.05), 0.0))
        limits = f'lower="{-_RAIL}" upper="{_RAIL}" velocity="{_RAIL_SPEED}" effort="{_RAIL_FORCE}"'
        rail = _joint("rail", "prismatic", parent, "carriage", "0 0.1 0.4", "x")
        parts.append(re.sub("<limit .*/></joint>", f"<limit {limits}/></joint>", rail))
        parent, offset = "carriage", "0 0 0"
    for number, axis in enumerate(axes, 1):
        # A roll joint sits with the pitch joint below it; the length lies between pitch joints.
        ends = axis == "z" or axes[number : number + 1] == ["y"] or number == joints
        length = 0.2 if number == 1 else _ARM_LENGTH / pitches if ends else 0.0
        mass = _ARM_MASS / joints
        thin, thick = mass * (0.005 + length**2 / 12), mass * 0.003
        parts.append(_link(f"link_{number}", mass, (thin, thin, thick), length / 2))
        if with_bodies:
            parts[-1] = _filled(parts[-1], _tube(0.0 if number == 1 else _BESIDE, length))
        parts.append(_joint(f"joint_{number}", "revolute", parent, f"link_{number}", offset, axis))
        parent = f"link_{number}"
        offset = f"0 {_SIDEWAYS if number > 1 and length else 0.0} {length}"
    tool = _box((_TOOL, _TOOL, _TOOL), -_TOOL / 2) if with_bodies else ""
    parts.append(_filled('<link name="end_effector"></link>', tool))
    parts.append(_joint("hand", "fixed", parent, "end_effector", offset))
    return f'<robot name="arm{joints}">{"".join(parts)}</robot>'


def _link(name: str, mass: float, moments: tuple[float, float, float], center: float) -> str:
    ixx, iyy, izz = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {center}"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, kind: str, parent: str, child: str, offset: str, axis: str = "") -> str:
    moves = (
        f'<axis xyz="{" ".join("1" if axis == a else "0" for a in "xyz")}"/>'
        '<limit lower="-2.97" upper="2.97" velocity="0.5" effort="80"/>'
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{offset}"/>{moves if axis else ""}</joint>'
    )


def _filled(link: str, solid: str) -> str:
    """Return a link with a collision element added."""
    return link.replace("</link>", f"{solid}</link>") if solid else link


def _tube(begin: float, length: float) -> str:
    """Return the collision element of a link along z: a tube, or a ball if the link is short."""
    end = length - _BESIDE
    if end <= begin:
        return _collision(f'<sphere radius="{_BALL}"/>', 0.0)
    tube = f'<cylinder radius="{_TUBE}" length="{end - begin}"/>'
    return _collision(tube, (begin + end) / 2)


def _box(edges: tuple[float, float, float], height: float = 0.0) -> str:
    return _collision(f'<box size="{" ".join(map(str, edges))}"/>', height)


def _collision(solid: str, height: float) -> str:
    return f'<collision><origin xyz="0 0 {height}"/><geometry>{solid}</geometry></collision>'
