"""A free-floating robot, loaded from a URDF."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.common.forms import a_number, a_word, by_name, or_none
from ff_planner_ros.common.plain_values import an_object, any_text
from ff_planner_ros.common.shown import in_a_line, shown
from ff_planner_ros.common.text_file import (
    NO_ARGUMENTS,
    XACRO,
    AnyPath,
    expanded_by_xacro,
    path_of,
    read_text,
)
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.whole_body import whole_body
from ff_planner_ros.robot.plane import require_planar
from ff_planner_ros.robot.tree import Tree, pinocchio_models, tree_of
from ff_planner_ros.robot.urdf.locked_joints import NOTHING_HELD, LockedJoint, with_locked
from ff_planner_ros.robot.urdf.srdf import MayTouch
from ff_planner_ros.robot.urdf.urdf import NO_VELOCITY_LIMIT, checked_urdf
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice
from ff_planner_ros.robot.urdf.urdf_tree import as_revolute
from ff_planner_ros.robot.urdf.urdf_xml import MAX_CHARACTERS
from ff_planner_ros.robot.wheels import Wheels

if TYPE_CHECKING:
    from ff_planner_ros.robot.urdf.payload import Payload


class Base(enum.StrEnum):
    """How the chaser can move."""

    FREE_FLYER = "free_flyer"
    PLANAR = "planar"  # on an air-bearing table: x, y and rotation about z, inertial axes
    ATTITUDE_HELD = "attitude_held"  # reaction wheels hold its attitude; it drifts

    @property
    def rows(self) -> list[int]:
        """Indices into a twist, linear first, in which the chaser moves freely.

        They are the same in base axes and in inertial axes: on a table both have z in common.
        """
        if self is Base.ATTITUDE_HELD:
            return [0, 1, 2]
        return self.tip_rows

    @property
    def tip_rows(self) -> list[int]:
        """Indices into a twist, linear first, in which the end effector can move."""
        return [0, 1, 5] if self is Base.PLANAR else [0, 1, 2, 3, 4, 5]


# Default weight of prismatic joints in the joint path [rad/m]: 1 rad of a revolute joint and 1 m of
# a prismatic one move a point 1 m beyond the joint equally far.
SLIDE_WEIGHT = 1.0
# Smallest and largest: others leave no digits to revolute, or to prismatic, joints.
SLIDE_WEIGHTS = (1e-3, 1e3)

_ROBOT = "robot.urdf"


@dataclass(frozen=True, eq=False)
class Robot:
    """A chaser with one arm: a Pinocchio model whose root is a free-flyer, gravity zero."""

    model: pin.Model  # never changed after loading; has the mimics of the arm's joints
    tree: Tree  # of all joints that move
    urdf: str  # the checked XML that the model was built from
    # As recorded: the same with shapes of links, hulls of meshes, and links that may touch
    drawn_urdf: str
    joint_names: tuple[str, ...]  # of those that are planned, from base to tip
    base_link: str  # URDF link that carries the arm; its axes are the chaser's axes
    tip_link: str  # URDF link whose frame is the end effector
    tip_frame_id: int  # frame of the tip link
    # Centre of mass of base link and all that is fixed to it, in the frame of the free-flyer joint
    position_chaser_in_base: Array  # shape (3,) [m]
    rotation_chaser_to_base: Array  # axes of the base link in that frame; shape (3, 3)
    # Unit vectors in the frames of the joints, shape (joints, 3): axes of revolute joints, zero for
    # prismatic ones; and directions of prismatic joints, zero for revolute ones
    joint_axes: Array
    joint_slides: Array
    # Limits of a prismatic joint are in m, m/s and N
    lower_position_limits: Array  # shape (joints,) [rad]
    upper_position_limits: Array  # shape (joints,) [rad]
    # Joints that turn without end: positions a turn apart are one, and the limits are the planner's
    continuous: tuple[bool, ...]
    # Infinite where a continuous joint has none
    velocity_limits: Array  # shape (joints,) [rad/s]
    # Infinite where the URDF says zero: exporters write zero for an unknown limit
    effort_limits: Array  # shape (joints,) [N m]
    # Weights in the joint path, and in metrics over all joints; shape (joints,)
    joint_weights: Array  # 1, or rad/m for prismatic joints
    notes: tuple[str, ...] = ()  # for the user: joints that are locked, say
    locked_joints: tuple[LockedJoint, ...] = ()  # all that move no more, where the model has them
    base: Base = Base.FREE_FLYER
    wheels: Wheels | None = None  # None: nothing holds the chaser's attitude
    geometry: Geometry = Geometry.LINES
    bodies: tuple[Body, ...] = ()  # empty with lines
    # Indices of bodies that must not touch each other, the smaller one first; empty with lines
    pairs: tuple[tuple[int, int], ...] = ()
    may_touch: tuple[MayTouch, ...] = ()  # links whose bodies are not among the pairs, and why
    payload: Payload | None = None  # also a link of the URDF; None: there is none, or not known

    FACTS = ("joints", "base_link", "tip_link", "base", "geometry", "wheels", "payload")
    __repr__ = in_a_line

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields: a pickle has no results that are kept with the robot."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def joints(self) -> int:
        """Number of arm joints."""
        return len(self.joint_names)

    def slides(self, joint: int) -> bool:
        """Tell whether a joint is prismatic; else it is revolute."""
        return self._sliding[joint]

    @cached_property
    def _sliding(self) -> list[bool]:
        return [bool(one.any()) for one in self.joint_slides]

    @property
    def slide_weight(self) -> float:
        """Weight of prismatic joints in the joint path [rad/m]; the default if there are none."""
        return float(self.joint_weights[self._sliding].max(initial=0.0)) or SLIDE_WEIGHT

    @property
    def has_slides(self) -> bool:
        """Whether any joint is prismatic."""
        return any(self._sliding)

    @property
    def furthest_slides(self) -> Array:
        """Largest distance of each joint from zero if it slides, else zero. Shape (all,) [m]."""
        ends = np.array([self.lower_position_limits, self.upper_position_limits])
        furthest = np.abs(self.tree.positions(ends)).max(axis=0)
        return np.where(self.tree.slides.any(axis=1), furthest, 0.0)

    def unit(self, joint: int) -> str:
        """Return the unit of a joint's position."""
        return "m" if self.slides(joint) else "rad"

    def effort_unit(self, joint: int) -> str:
        """Return the unit of a joint's effort: of a torque, or of a force."""
        return "N" if self.slides(joint) else "N m"


def load_robot(
    urdf: AnyPath,
    base_link: str,
    tip_link: str,
    base: Base = Base.FREE_FLYER,
    held_at: Mapping[str, float] = NOTHING_HELD,
    geometry: Geometry | None = None,
    srdf: AnyPath | None = None,
    wheels: Wheels | None = None,
    slide_weight: float = SLIDE_WEIGHT,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> Robot:
    """Load a robot from a URDF file.

    See `robot_from_urdf_text` for the other arguments and for what the file must hold.

    Args:
        srdf: SRDF file of links that may touch. None: as of `robot_from_urdf_text`.

    Raises:
        InvalidInput: A file cannot be read, its content is refused, or an argument is of another
            kind.
    """
    links = any_text("robot.base_link", base_link), any_text("robot.tip_link", tip_link)
    base = a_word(Base).checked("robot.base", base)
    held_at = by_name("a joint").checked("robot.locked_joints", held_at)
    geometry = or_none(a_word(Geometry)).checked("robot.geometry", geometry)
    if wheels is not None:
        an_object("robot.wheels", wheels, Wheels)
    weight = a_number().checked("robot.slide_weight", slide_weight)
    choice = a_word(InertiaChoice).checked("robot.inertia", inertia)
    pairs = None if srdf is None else read_urdf(path_of("robot.srdf", srdf), "robot.srdf")
    file = path_of(_ROBOT, urdf)
    text, place = read_urdf(file), file.resolve().parent
    return robot_from_urdf_text(
        text, *links, base, held_at, geometry, pairs, place, wheels, weight, choice
    )


def read_urdf(
    urdf: Path, field: str = _ROBOT, xacro_arguments: Mapping[str, str] = NO_ARGUMENTS
) -> str:
    """Return the text of a URDF, SDF or SRDF file; xacro expands one that ends in .xacro.

    Args:
        field: Field that names the file, for errors.
        xacro_arguments: Values of its `<xacro:arg>` elements, by name.

    Raises:
        InvalidInput: The file cannot be read or expanded.
    """
    text = read_text(urdf, MAX_CHARACTERS, field, Status.BAD_ROBOT)
    if urdf.suffix != XACRO:
        return text
    bounds = MAX_CHARACTERS, xacro_arguments, field, Status.BAD_ROBOT
    return expanded_by_xacro(urdf.resolve(), *bounds)


def robot_from_urdf_text(
    text: str,
    base_link: str | None = None,
    tip_link: str | None = None,
    base: Base = Base.FREE_FLYER,
    held_at: Mapping[str, float] = NOTHING_HELD,
    geometry: Geometry | None = None,
    srdf: str | None = None,
    directory: Path | None = None,
    wheels: Wheels | None = None,
    slide_weight: float = SLIDE_WEIGHT,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> Robot:
    """Build a robot from a URDF.

    Args:
        text: The XML of a URDF or SDF, with a chain of revolute and prismatic joints from base to
            tip. Joints that mimic one of these move along; all others are locked.
        base_link: Link that carries the arm; it is the root or fixed to it. None: the root.
        tip_link: Link whose frame is the end effector. None: the only link that moves and
            carries no other.
        held_at: Positions of movable joints that are locked [rad, m].
        geometry: None: shapes if the arm has any `<collision>`, else lines.
        srdf: SRDF of links that may touch beside neighbours. None: those of a recorded URDF, or
            links that touch in nearly every posture.
        directory: Directory of the URDF, from which the paths of its meshes start. None: no file
            is read.
        wheels: Wheels that hold the chaser's attitude. None: on a base that is held, one along each
            of its axes, without limits.
        slide_weight: Weight of prismatic joints in the joint path [rad/m]; 0: they are locked.
        inertia: What happens to inertias that no body has; a recorded URDF says it itself.

    Raises:
        InvalidInput: The text is no URDF of such a robot, an inertia is impossible, an arm on a
            planar base does not move in the plane, wheels are given for another base, or
            `slide_weight` is out of range.
    """
    wheels = wheels_of(base, wheels)
    if slide_weight and not SLIDE_WEIGHTS[0] <= slide_weight <= SLIDE_WEIGHTS[1]:
        allowed = f"it must be 0, or from {SLIDE_WEIGHTS[0]:g} to {SLIDE_WEIGHTS[1]:g} rad/m"
        raise InvalidInput(Status.OUT_OF_RANGE, "robot.slide_weight", slide_weight, allowed)
    checked = checked_urdf(text, base_link, tip_link, held_at, not slide_weight, inertia)
    urdf, endless = as_revolute(checked.xml)
    try:
        model, apart = pinocchio_models(urdf, checked.driven, checked.path)
    except (ValueError, RuntimeError) as error:
        raise InvalidInput(
            Status.BAD_ROBOT, "robot.urdf", "unreadable", f"Pinocchio says: {shown(str(error))}"
        ) from None
    model.gravity = pin.Motion.Zero()
    base_frame = model.frames[model.getFrameId(checked.base_link, pin.FrameType.BODY)]
    # The first two joints are Pinocchio's: the universe and the free-flyer.
    efforts, rates = np.array(model.upperEffortLimit[6:]), np.array(model.upperVelocityLimit[6:])
    tip_frame = model.getFrameId(checked.tip_link, pin.FrameType.BODY)
    tree = tree_of(model, apart, checked.driven, model.frames[tip_frame].parentJoint)
    names = [name for name in tuple(model.names)[2:] if name not in checked.driven]
    alone = [model.getJointId(name) - 2 for name in names]
    axes, slides = tree.axes[alone], tree.slides[alone]
    if base is Base.PLANAR:
        require_planar(apart, base_frame)
    whole = whole_body(model, checked.xml, text, geometry, srdf, directory)
    return Robot(
        model=model,
        tree=tree,
        urdf=urdf,
        drawn_urdf=with_locked(whole.drawn_urdf, checked.locked_joints),
        joint_names=tuple(names),
        base_link=checked.base_link,
        tip_link=checked.tip_link,
        tip_frame_id=tip_frame,
        position_chaser_in_base=frozen(model.inertias[1].lever),
        rotation_chaser_to_base=frozen(base_frame.placement.rotation),
        joint_axes=frozen(axes),
        joint_slides=frozen(slides),
        lower_position_limits=frozen(model.lowerPositionLimit[7:]),
        upper_position_limits=frozen(model.upperPositionLimit[7:]),
        continuous=tuple(name in endless for name in names),
        velocity_limits=frozen(np.where(rates < NO_VELOCITY_LIMIT, rates, np.inf)),
        effort_limits=frozen(np.where(efforts == 0.0, np.inf, efforts)),
        joint_weights=frozen(np.where(slides.any(axis=1), slide_weight, 1.0)),
        notes=(*checked.notes, *whole.notes),
        locked_joints=checked.locked_joints,
        base=base,
        wheels=wheels,
        geometry=whole.geometry,
        bodies=whole.bodies,
        pairs=whole.pairs,
        may_touch=whole.may_touch,
    )


def wheels_of(base: Base, wheels: Wheels | None) -> Wheels | None:
    """Return the wheels of a base; by default, one along each axis for `attitude_held`, else none.

    Raises:
        InvalidInput: Wheels are given for another base.
    """
    if base is Base.ATTITUDE_HELD:
        return wheels or Wheels()
    if wheels is not None:
        allowed = f"with robot.base {base} there must be none: wheels hold attitude_held"
        raise InvalidInput(Status.UNSUPPORTED, "robot.wheels", "given", allowed)
    return None
