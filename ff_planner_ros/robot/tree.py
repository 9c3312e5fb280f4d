"""What carries each joint of a robot, and what moves it.

Joints that mimic a planned one, in the arm or beside it, move along with it. What depends on joints
is found for each by itself first, then for those that are planned. Joint k carries body k + 1; the
base is body 0. What a body carries comes next after it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices, frozen
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.robot.urdf.locked_joints import Drive

# Before all names of joints in their order.
_FIRST = "!"


@dataclass(frozen=True, eq=False)
class Tree:
    """All joints that move, in Pinocchio's order, and how they follow from the planned ones."""

    model: pin.Model  # in which each joint moves by itself
    before: Indices  # the body that carries each joint; shape (all,)
    planned: Indices  # the planned joint that each moves with; shape (all,)
    multipliers: Array  # its position per position of that; shape (all,)
    offsets: Array  # its position where that is at zero; shape (all,) [rad, m]
    # Unit vectors in the frames of the joints, shape (all, 3): axes of revolute joints, zero for
    # prismatic ones; and directions of prismatic joints, zero for revolute ones
    axes: Array
    slides: Array
    tip: int  # the body that the end effector is on

    FACTS = ("joints", "tip")
    __repr__ = in_a_line

    @property
    def joints(self) -> int:
        """Number of all joints."""
        return len(self.before)

    @cached_property
    def is_chain(self) -> bool:
        """Whether each joint is planned; then it carries the next one."""
        return bool(self.joints == self.planned.max() + 1)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """Whether each joint moves each body. Shape (all, all + 1)."""
        found = np.zeros((self.joints, self.joints + 1), np.bool_)
        for k, before in enumerate(self.before):
            found[:, k + 1] = found[:, before]
            found[k, k + 1] = True
        return found

    @cached_property
    def to_tip(self) -> list[int]:
        """The joints from base to tip, in order."""
        return np.flatnonzero(self.moves[:, self.tip]).tolist()

    def positions(self, planned: Array) -> Array:
        """Return the positions of all joints at those of the planned ones. Shape (..., all)."""
        return planned if self.is_chain else self.rates(planned) + self.offsets

    def rates(self, planned: Array) -> Array:
        """Return velocities, or accelerations, likewise."""
        return planned if self.is_chain else planned[..., self.planned] * self.multipliers

    def sizes(self, planned: Array) -> Array:
        """Return moduli of velocities, or accelerations, by those of the planned joints."""
        return planned if self.is_chain else planned[..., self.planned] * np.abs(self.multipliers)

    def by_planned(self, by_each: Array) -> Array:
        """Return derivatives by the planned joints, of those by each. Shape (..., joints)."""
        return by_each if self.is_chain else by_each @ self._matrix

    @cached_property
    def _matrix(self) -> Array:
        matrix = np.zeros((self.joints, self.planned.max() + 1))
        matrix[np.arange(self.joints), self.planned] = self.multipliers
        return matrix


def pinocchio_models(
    xml: str, driven: Collection[str], path: Collection[str]
) -> tuple[pin.Model, pin.Model]:
    """Return the model on a free-flyer, and the same without mimics.

    Pinocchio silently merges joints of the same name: the free-flyer with a joint of the URDF, and
    a fixed joint called `universe` with the inertial frame. Both get names of their own.

    A mimic must come after the joint that it mimics, and siblings come in the order of their names:
    before all others those on the way to the tip, as long as Pinocchio reads.

    Args:
        driven: Names of joints that mimic others.
        path: Names of the joints from the root to the tip.
    """
    robot = ElementTree.fromstring(xml)
    names = {element.get("name") for element in robot}
    free_flyer = _unused_name("free_flyer", names)
    for joint in robot.findall("joint[@type='fixed'][@name='universe']"):
        joint.set("name", _unused_name("fixed", {*names, free_flyer}))
    for element in robot.iter("joint" if driven else "none"):
        if element.get("name") in path:
            element.set("name", f"{_FIRST}{element.get('name')}")
    for mimic in robot.iter("mimic"):
        mimic.set("joint", f"{_FIRST}{mimic.get('joint')}")
    renamed = ElementTree.tostring(robot, encoding="unicode")
    model = pin.buildModelFromXML(renamed, pin.JointModelFreeFlyer(), free_flyer)
    if not driven:
        return model, model
    coupled = pin.buildModelFromXML(renamed, pin.JointModelFreeFlyer(), free_flyer, True)
    for one in (coupled, model):
        for k, name in enumerate(one.names):
            one.names[k] = name.removeprefix(_FIRST)
        for frame in one.frames:
            frame.name = frame.name.removeprefix(_FIRST)
    return coupled, model


def _unused_name(name: str, used: Collection[str | None]) -> str:
    while name in used:
        name += "_"
    return name


def tree_of(coupled: pin.Model, model: pin.Model, driven: Mapping[str, Drive], tip: int) -> Tree:
    """Return the tree of a model on a free-flyer.

    Args:
        coupled: Has the mimics.
        model: The same, in which they move by themselves.
        driven: The mimics, by name.
        tip: Pinocchio's number of the joint that moves the end effector.
    """
    names = list(model.names)[2:]
    drives = [driven.get(name, Drive(name, 1.0, 0.0)) for name in names]
    axes, slides = _axes(model)
    return Tree(
        model=model,
        # The first two joints are Pinocchio's: the universe and the free-flyer, which has the base.
        before=np.array(list(model.parents)[2:], np.intp) - 1,
        planned=np.array(list(coupled.idx_vs)[2:], np.intp) - 6,
        multipliers=frozen([one.multiplier for one in drives]),
        offsets=frozen([one.offset for one in drives]),
        axes=frozen(axes),
        slides=frozen(slides),
        tip=tip - 1,
    )


def _axes(model: pin.Model) -> tuple[Array, Array]:
    """Return axes of revolute and directions of prismatic joints; see `Tree`."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    columns = [
        pin.getJointJacobian(model, data, joint, pin.LOCAL)[:, model.idx_vs[joint]]
        for joint in range(2, model.njoints)
    ]
    slides, axes = np.split(np.array(columns), 2, axis=1)
    return axes, slides
