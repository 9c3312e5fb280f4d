"""What is read of URDFs and SRDFs, element by element, and what the rest means for a plan."""

from __future__ import annotations

import enum
from dataclasses import replace
from types import MappingProxyType
from xml.etree.ElementTree import Element

from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.sdf import robot_of
from ff_planner_ros.robot.urdf.sdf_model import SDF
from ff_planner_ros.robot.urdf.urdf_faults import Faults, listed, shortened
from ff_planner_ros.robot.urdf.xml_reader import MAX_CHARACTERS as MAX_CHARACTERS
from ff_planner_ros.robot.urdf.xml_reader import Format, Formats, Tag, read_xml

# A humanoid with both hands has two hundred. The time to build a model grows with the square.
MAX_LINKS = 1000

# Element of a recorded URDF: where a joint is locked that is a fixed one there.
LOCKED = "locked"
INERTIA = "inertia"  # attribute of a recorded URDF's `<robot>`
# Elements of an SRDF, also in a recorded URDF: pairs of links that may touch, links that may touch
# any other, and pairs that may not nevertheless.
DISABLE, DISABLE_ALL = "disable_collisions", "disable_default_collisions"
ENABLE = "enable_collisions"
_MOST_DISABLED = 100_000  # a humanoid's SRDF has two thousand

_LOOKS = "what only looks changes no plan"
_SIMULATOR = "settings of a simulator or controller, which change no plan"
_CONTACT = "bodies that may touch do not push each other in a plan"
_READ_APART = "its shapes are read apart, see `link/collision`"


def _of(reason: str, *names: str) -> dict[str, str]:
    return dict.fromkeys(names, reason)


_ORIGIN = Tag(("xyz", "rpy", "quat_xyzw"))
_SHAPE = Tag(
    parts={
        "origin": _ORIGIN,
        "geometry": Tag(
            parts={
                name: Tag(tuple(PRIMITIVES[name].sizes))
                if name in PRIMITIVES
                else Tag(("filename", "scale"))
                for name in sorted((*PRIMITIVES, "mesh"))
            }
        ),
    },
    unread=_of(_LOOKS, "material", "laser_retro", "verbose")
    | _of(_CONTACT, "compliant_contact", "contact", "contact_coefficients", "surface")
    | _of(_SIMULATOR, "max_contacts"),
    several=True,
)
_SHAPES = {"visual": replace(_SHAPE, is_told=False), "collision": replace(_SHAPE, is_told=True)}
_INERTIAL = Tag(
    parts={
        "origin": _ORIGIN,
        "mass": Tag(("value",)),
        "inertia": Tag(("ixx", "iyy", "izz", "ixy", "ixz", "iyz")),
    }
)
_LINK = Tag(
    ("name",),
    {"inertial": _INERTIAL},
    _of(_READ_APART, *_SHAPES)
    | _of(_CONTACT, "contact", "contact_coefficients", "surface")
    | _of(_LOOKS, "material", "sensor")
    | _of(_SIMULATOR, "collision_checking", "gazebo", "gravity", "kinematic")
    | _of("links that may touch are told by an SRDF", "self_collision_checking", "self_filter"),
    several=True,
)
_NOT_KEPT = "not kept by plans; `limits.acceleration` is"
_LIMIT = Tag(
    ("lower", "upper", "velocity", "effort"),
    noted=_of(
        _NOT_KEPT,
        *("@acceleration", "@deceleration", "@jerk", "@command_effort", "@current"),
        "@gear_velocity",
    ),
)
_STRICTER = "limits stricter than those of `<limit>` are not kept, which a note says"
_RESISTS = "damping, friction and stiffness are not counted in torques, which a note says"
_JOINT = Tag(
    ("name", "type"),
    {
        "origin": _ORIGIN,
        "parent": Tag(("link",)),
        "child": Tag(("link",)),
        "axis": Tag(("xyz",)),
        "limit": _LIMIT,
        "mimic": Tag(("joint", "multiplier", "offset")),
        LOCKED: Tag(("type", "position")),
    },
    {"safety_controller": _STRICTER, "dynamics": _RESISTS}
    | _of(_SIMULATOR, "actuator", "calibration", "gazebo", "hardware", "sensor", "transmission"),
    several=True,
)
_TOUCHING = {
    DISABLE: Tag(("link1", "link2", "reason"), several=True),
    DISABLE_ALL: Tag(("link",), several=True),
    ENABLE: Tag(("link1", "link2"), several=True),
}
_ROBOT = Tag(
    ("name", INERTIA),
    {"link": _LINK, "joint": _JOINT},
    {"ros2_control": _STRICTER}
    | _of(_LOOKS, "material", "sensor")
    | _of(_SIMULATOR, "gazebo", "transmission")
    | _of("those of a recorded URDF are read like an SRDF's", *_TOUCHING),
    is_told=True,
)
_OF_ROBOTS = frozenset(("link", "joint", "inertial", "collision", "child"))
_URDF = Format(
    "robot",
    _ROBOT,
    2 * MAX_LINKS,
    f"{MAX_LINKS} links and as many joints",
    never_within=_OF_ROBOTS,
    place="links and joints must be directly in <robot>",
)
# The same file once more, for what a missing mesh shall not stop a plan for.
_SHAPES_OF_URDF = replace(
    _URDF,
    tag=Tag(("name",), {"link": Tag(("name",), _SHAPES, several=True)}, is_told=False),
)
_GROUPS = "groups, states and the base are told by parameters and the measured state"
_SRDF = Format(
    "robot",
    Tag(
        ("name",),
        _TOUCHING,
        _of(_GROUPS, "end_effector", "group", "group_state", "gripper", "virtual_joint")
        | _of("joints that move are those from base to tip", "passive_joint")
        | _of("a rotor's inertia is not counted", "rotor_params")
        | _of(_SIMULATOR, "joint_property", "specificities")
        | _of("shapes are the URDF's", "link_sphere_approximation"),
        is_told=True,
    ),
    _MOST_DISABLED,
    f"{_MOST_DISABLED} {DISABLE}",
)
# What a URDF says of joints beside the limits that plans keep.
_PARAMETER = Tag(("name",), has_text=True, several=True)
_SWITCH = Tag(("enable",), several=True)
_OTHER_FACTS = Tag(
    ("name",),
    {
        "joint": Tag(
            ("name", "type"),
            {
                "limit": Tag(_LIMIT.attributes),
                "safety_controller": Tag(("soft_lower_limit", "soft_upper_limit")),
                "dynamics": Tag(("damping", "friction", "stiffness")),
            },
            several=True,
        ),
        "ros2_control": Tag(
            parts={
                "joint": Tag(
                    ("name",),
                    {
                        "command_interface": Tag(
                            ("name",), {"param": _PARAMETER, "limits": _SWITCH}, several=True
                        ),
                        "limits": _SWITCH,
                    },
                    several=True,
                )
            },
            several=True,
        ),
    },
    is_told=False,
)
_KNOWN = frozenset(
    path.rpartition("/")[2]
    for row in (_ROBOT, _SHAPES_OF_URDF.tag, _SRDF.tag)
    for path, _ in row.within("robot")
)
_URDF, _SHAPES_OF_URDF, _SRDF = (
    replace(one, known=_KNOWN) for one in (_URDF, _SHAPES_OF_URDF, _SRDF)
)


class InertiaChoice(enum.StrEnum):
    """What happens to an inertia that no body has."""

    POSSIBLE = "possible"  # it is refused
    AS_GIVEN = "as_given"  # it counts as written: a body that moves needs positive moments alone
    NEAREST = "nearest_possible"  # the nearest one that a body has counts instead


def inertia_choice(robot: Element, given: InertiaChoice, faults: Faults) -> InertiaChoice:
    """Return what happens to impossible inertias, and write it into a `<robot>` to be recorded.

    Args:
        given: `POSSIBLE`: what the `<robot>` says itself.
    """
    if given is InertiaChoice.POSSIBLE and (recorded := robot.get(INERTIA)) is not None:
        if recorded in list(InertiaChoice):
            return InertiaChoice(recorded)
        allowed = f"it must be one of {listed(InertiaChoice)}"
        faults.add("robot.urdf", "", INERTIA, repr(shortened(recorded)), allowed, robot)
    elif given is not InertiaChoice.POSSIBLE:
        robot.set(INERTIA, given)
    return given


def read_elements(text: str, faults: Faults) -> Element:
    """Return the `<robot>` of a URDF or SDF with its links and joints, without shapes.

    Raises:
        InvalidInput: The text is no XML, another document, a xacro file, too large, or declares
            entities, say; or it is an SDF with faults.
    """
    robot = _read(text, _URDF, faults)
    for link in robot.iterfind("link[collision]"):  # of an SDF
        for collision in link.findall("collision"):
            link.remove(collision)
    return robot


def read_shapes(text: str, faults: Faults | None = None) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with the shapes of its links.

    Args:
        faults: Collects what is wrong in `<collision>` elements.

    Raises:
        InvalidInput: As for `read_elements`.
    """
    return _read(text, _SHAPES_OF_URDF, Faults() if faults is None else faults)


def read_other_facts(text: str) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with what no plan keeps."""
    return _read(text, replace(_URDF, tag=_OTHER_FACTS, counted=0), Faults())


def read_collisions(text: str, field: str, faults: Faults) -> Element:
    """Return the `<robot>` with its elements on links that may touch.

    Args:
        field: Of the text: that of an SRDF, or of a recorded URDF, which has other elements, too.

    Raises:
        InvalidInput: As for `read_elements`; the error names `field`.
    """
    if field == _URDF.field:  # whose other elements are known
        return _read(text, replace(_URDF, tag=replace(_SRDF.tag, is_told=False)), faults)
    return _read(text, replace(_SRDF, field=field), faults, others={})


def _read(
    text: str, form: Format, faults: Faults, others: Formats = MappingProxyType({"sdf": SDF})
) -> Element:
    read = read_xml(text, {form.root: form, **others}, faults)
    robot = robot_of(read, faults) if read.tag == SDF.root else read
    robot.set("name", robot.get("name") or "robot")
    return robot
