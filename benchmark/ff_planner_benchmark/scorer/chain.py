"""Kinematics of a chaser and its arm from a URDF, without any code of the planner.

Everything is in the frame of the base link unless a name says otherwise, for many postures at once:
the first axis of every array is time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.scorer.files import xml_of

Array = NDArray[np.float64]
_MOST_LINKS = 200  # the robots of the data set have 20 at most


class Placement(NamedTuple):
    """The pose of a frame in another frame."""

    rotation: Array  # shape (..., 3, 3)
    position: Array  # shape (..., 3) [m]

    def then(self, other: Placement) -> Placement:
        """Return the pose of a frame that is given in this one: the composition of both."""
        moved = (self.rotation @ other.position[..., None])[..., 0]
        return Placement(self.rotation @ other.rotation, moved + self.position)


@dataclass(frozen=True, eq=False)
class Solid:
    """A collision shape of a link."""

    link: int  # index
    at: Placement  # in the link
    kind: str  # box, cylinder or sphere
    sizes: tuple[float, ...]  # edges; radius and length; radius [m]


@dataclass(frozen=True, eq=False)
class Link:
    """A link and the joint that carries it."""

    name: str
    parent: int  # index; -1: the base link's
    at: Placement  # of the joint's frame in the parent's
    axis: Array  # of the joint, unit length; zero: fixed
    mass: float  # [kg]
    center: Array  # of mass, in the link; shape (3,) [m]
    inertia: Array  # about the centre of mass, axes of the link; shape (3, 3) [kg m2]


class Posture(NamedTuple):
    """Poses and Jacobians of all links in the base link's frame, at many times."""

    links: list[Placement]  # of each link; a row per time
    # Of each link's centre of mass and of its rotation; each of shape (times, 3, joints)
    jacobians: list[tuple[Array, Array]]


class Chain:
    """A robot of revolute and fixed joints."""

    def __init__(self, urdf: str, base_link: str, tip_link: str) -> None:
        """Read the text of a URDF.

        Raises:
            ValueError: It is not XML, has too many links or ones that do not hang on the base link,
                or a joint is neither revolute nor fixed.
            LookupError: Something is missing in it.
        """
        tree = xml_of(urdf)
        elements = {link.attrib["name"]: link for link in tree.findall("link")}
        above = {joint.find("child").attrib["link"]: joint for joint in tree.findall("joint")}  # type: ignore[union-attr]
        if len(elements) > _MOST_LINKS:
            raise ValueError(f"it has {len(elements)} links, more than {_MOST_LINKS}")
        order = [base_link]
        while len(order) < len(elements):
            more = [
                child
                for child, joint in above.items()
                if child not in order and joint.find("parent").attrib["link"] in order  # type: ignore[union-attr]
            ]
            if not more:
                raise ValueError(f"not all of its links hang on {base_link}")
            order += more
        self.names = order
        self.links = [_link(elements[name], above.get(name), order) for name in order]
        self.solids = [
            solid for i, name in enumerate(order) for solid in _solids(elements[name], i)
        ]
        path, index = list[int](), order.index(tip_link)
        while index >= 0:
            path.insert(0, index)
            index = self.links[index].parent
        # Links that a joint moves, from the base to the tip, and all after the base's.
        self.moved = [i for i in path if self.links[i].axis.any()]
        self.tip = path[-1]
        limits: list[Any] = [above[order[i]].find("limit") for i in self.moved]
        kinds = [above[order[i]].attrib["type"] for i in self.moved]
        self.lower, self.upper = (
            np.array(
                [
                    infinite if kind == "continuous" else float(limit.attrib[name])
                    for kind, limit in zip(kinds, limits, strict=True)
                ]
            )
            for name, infinite in (("lower", -np.inf), ("upper", np.inf))
        )
        self.fastest, self.strongest = (
            np.array([float(limit.attrib[name]) for limit in limits])
            for name in ("velocity", "effort")
        )
        self.joint_names = [above[order[i]].attrib["name"] for i in self.moved]
        self.center = self._chaser_center()
        # No point of the arm is further from the base, however the joints turn [m].
        self.reach = sum(float(np.linalg.norm(link.at.position)) for link in self.links)
        self.reach += max((_furthest(solid) for solid in self.solids), default=0.0)

    @property
    def joints(self) -> int:
        """Number of joints from the base to the tip."""
        return len(self.moved)

    def posture(self, angles: Array) -> Posture:
        """Return poses and Jacobians of all links.

        Args:
            angles: Joint positions. Shape (times, joints) [rad].
        """
        count, joints = len(angles), self.joints
        places, jacobians = list[Placement](), list[tuple[Array, Array]]()
        axes, origins = np.zeros((2, count, joints, 3))
        carried = dict[int, list[int]]()
        here = Placement(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        for index, link in enumerate(self.links):
            above = places[link.parent] if link.parent >= 0 else here
            place = above.then(link.at) if index else here
            moving = list(carried.get(link.parent, ()))
            if index in self.moved:
                joint = self.moved.index(index)
                axes[:, joint], origins[:, joint] = place.rotation @ link.axis, place.position
                turn = Rotation.from_rotvec(angles[:, joint, None] * link.axis).as_matrix()
                place = Placement(place.rotation @ turn, place.position)
                moving.append(joint)
            carried[index] = moving
            places.append(place)
            turning, linear = np.zeros((count, 3, joints)), np.zeros((count, 3, joints))
            center = place.then(Placement(np.eye(3), link.center)).position
            for joint in moving:
                turning[:, :, joint] = axes[:, joint]
                linear[:, :, joint] = np.cross(axes[:, joint], center - origins[:, joint])
            jacobians.append((linear, turning))
        return Posture(places, jacobians)

    def points(self, posture: Posture) -> Array:
        """Return the arm's centre line: joints from base to tip, and tip, (times, points, 3)."""
        return np.stack([posture.links[i].position for i in (*self.moved, self.tip)], axis=1)

    def _chaser_center(self) -> Array:
        """Return the centre of mass of the base link and what is fixed to it."""
        rest = self.posture(np.zeros((1, self.joints)))
        mass, moment = 0.0, np.zeros(3)
        for link, place, (_, turning) in zip(self.links, rest.links, rest.jacobians, strict=True):
            if not turning.any():
                mass += link.mass
                moment += link.mass * (place.rotation[0] @ link.center + place.position[0])
        return moment / mass


def _link(element: Any, joint: Any, order: list[str]) -> Link:
    inertial = element.find("inertial")
    mass, center, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        at = _origin(inertial)
        xx, xy, xz, yy, yz, zz = (
            float(inertial.find("inertia").attrib[name])
            for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        mass, center = float(inertial.find("mass").attrib["value"]), at.position
        inertia = at.rotation @ own @ at.rotation.T
    axis, parent, place = np.zeros(3), -1, Placement(np.eye(3), np.zeros(3))
    if joint is not None:
        parent, place = order.index(joint.find("parent").attrib["link"]), _origin(joint)
        if joint.attrib["type"] in ("revolute", "continuous"):
            drawn = joint.find("axis")
            axis = np.array([1.0, 0.0, 0.0] if drawn is None else _three(drawn.attrib["xyz"]))
            axis /= np.linalg.norm(axis)
        elif joint.attrib["type"] != "fixed":
            raise ValueError(f"{joint.attrib['name']}: joints must be revolute or fixed")
    return Link(element.attrib["name"], parent, place, axis, mass, center, inertia)


def _solids(element: Any, link: int) -> list[Solid]:
    found = []
    for collision in element.findall("collision"):
        shape = collision.find("geometry")[0]
        names = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}
        sizes = [v for name in names[shape.tag] for v in _three(shape.attrib[name])]
        found.append(Solid(link, _origin(collision), shape.tag, tuple(sizes)))
    return found


def _furthest(solid: Solid) -> float:
    return float(np.linalg.norm(solid.at.position)) + sum(solid.sizes)


def _origin(element: Any) -> Placement:
    origin = element.find("origin")
    told = {} if origin is None else origin.attrib
    turn = Rotation.from_euler("xyz", _three(told.get("rpy", "0 0 0"))).as_matrix()
    return Placement(turn, np.array(_three(told.get("xyz", "0 0 0"))))


def _three(text: str) -> list[float]:
    return [float(part) for part in text.split()]
