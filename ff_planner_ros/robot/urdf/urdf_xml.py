"""What is read of URDFs and SRDFs, element by element, and what the rest means for a plan."""

from __future__ import annotations

from dataclasses import replace
from xml.etree.ElementTree import Element

from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.urdf_faults import (
    Faults,
    InertiaChoice,
    finite_numbers,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.xml_reader import MAX_CHARACTERS as MAX_CHARACTERS
from ff_planner_ros.robot.urdf.xml_reader import Format, Formats, Tag, read_xml

SRDF_FIELD = "robot.srdf"

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
_SRDF_SAYS = "links that may touch are told by an SRDF"


def _of(reason: str, *names: str) -> dict[str, str]:
    return dict.fromkeys(names, reason)


_ORIGIN = Tag(("xyz", "rpy", "quat_xyzw"))
_GEOMETRY = {name: Tag(tuple(one.sizes)) for name, one in PRIMITIVES.items()}
_SHAPE = Tag(
    parts={
        "origin": _ORIGIN,
        "geometry": Tag(
            parts=dict(sorted({**_GEOMETRY, "mesh": Tag(("filename", "scale"))}.items()))
        ),
    },
    unread=_of(_LOOKS, "material", "laser_retro", "verbose")
    | _of(_CONTACT, "compliant_contact", "contact", "contact_coefficients", "surface")
    | _of(_SIMULATOR, "max_contacts"),
    several=True,
)
_VISUAL = replace(_SHAPE, is_quiet=True, means="drawn, and kept clear of nothing")
# Entries of an inertia, which is symmetric, and those that must be the same where they are given.
_MIRRORED = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
_INERTIAL = Tag(
    parts={
        "origin": _ORIGIN,
        "mass": Tag(("value",)),
        "inertia": Tag(("ixx", "iyy", "izz", "ixy", "ixz", "iyz", *_MIRRORED)),
    }
)
_LINK = Tag(
    ("name",),
    {"inertial": _INERTIAL, "visual": _VISUAL, "collision": _SHAPE},
    _of(_CONTACT, "contact", "contact_coefficients", "surface")
    | _of(_LOOKS, "material", "sensor")
    | _of(_SIMULATOR, "collision_checking", "gazebo", "gravity", "kinematic")
    | _of(_SRDF_SAYS, "self_collide", "self_collision", "self_collision_checking", "self_filter"),
    several=True,
)
_NOT_KEPT = "plans do not keep it; the parameter `limits.acceleration` limits accelerations"
_STRICTER = "limits stricter than those of `limit` are not kept; a note names them"
_JOINT = Tag(
    ("name", "type"),
    {
        "origin": _ORIGIN,
        "parent": Tag(("link",)),
        "child": Tag(("link",)),
        "axis": Tag(("xyz",)),
        "limit": Tag(
            ("lower", "upper", "velocity", "effort"),
            noted=_of(_NOT_KEPT, "@acceleration", "@deceleration", "@jerk")
            | _of("a motor's, not the joint's", "@command_effort", "@current", "@gear_velocity"),
        ),
        "mimic": Tag(("joint", "multiplier", "offset")),
        LOCKED: Tag(("type", "position")),
        "safety_controller": Tag(
            ("soft_lower_limit", "soft_upper_limit"),
            unread=_of(_SIMULATOR, "@k_position", "@k_velocity"),
            means=_STRICTER,
        ),
        "dynamics": Tag(
            ("damping", "friction", "stiffness"),
            means="not counted in torques; a note names those that are not zero",
        ),
    },
    _of(_SIMULATOR, "actuator", "calibration", "gazebo", "hardware", "sensor", "transmission"),
    several=True,
)
_PARAMETER = Tag(("name",), has_text=True, several=True)
_MIMICS = "a joint that mimics another by `param` alone moves by itself; a note names it"
_SWITCH = Tag(("enable",), several=True)
_COMMANDS = Tag(("name",), {"param": _PARAMETER, "limits": _SWITCH}, several=True, means=_STRICTER)
_CONTROLLED = Tag(
    ("name",),
    {"command_interface": _COMMANDS, "limits": _SWITCH, "param": _PARAMETER},
    _of("the state is measured", "state_interface"),
    several=True,
    means=_MIMICS,
)
_CONTROL = Tag(
    parts={"joint": _CONTROLLED},
    unread=_of(_SIMULATOR, "gpio", "hardware", "sensor", "transmission"),
    several=True,
)
_TOUCHING = {
    DISABLE: Tag(("link1", "link2", "reason"), several=True),
    DISABLE_ALL: Tag(("link",), several=True),
    ENABLE: Tag(("link1", "link2"), several=True),
}
_ROBOT = Tag(
    ("name", INERTIA),
    {"link": _LINK, "joint": _JOINT, "ros2_control": _CONTROL},
    _of(_LOOKS, "material", "sensor")
    | _of(_SIMULATOR, "gazebo", "transmission")
    | _of("those of a recorded URDF are read like an SRDF's", *_TOUCHING),
)
# Also a `<pose>`, as an SDF has it.
_KNOWN = frozenset(
    ("pose", *_TOUCHING, *(path.rpartition("/")[2] for path, _ in _ROBOT.within("robot")))
)
URDF = Format(
    "robot",
    _ROBOT,
    2 * MAX_LINKS,
    f"{MAX_LINKS} links and as many joints",
    never_within=frozenset(("link", "joint", "inertial", "collision", "child")),
    known=_KNOWN,
    # What a robot or body can be without: a missing mesh, say, shall not stop a plan
    apart=frozenset(("visual", "collision", "safety_controller", "dynamics", "ros2_control")),
)
_GROUPS = "groups, postures and the base are told by parameters and the measured state"
SRDF = Format(
    "robot",
    Tag(
        ("name",),
        _TOUCHING,
        _of(_GROUPS, "end_effector", "group", "group_state", "gripper", "virtual_joint")
        | _of(_SIMULATOR, "joint_property", "specificities")
        | _of("shapes are the URDF's", "link_sphere_approximation"),
        _of("a joint from base to tip moves, unless it is locked", "passive_joint")
        | _of("a rotor's inertia is not counted", "rotor_params"),
    ),
    _MOST_DISABLED,
    f"{_MOST_DISABLED} {DISABLE}",
    known=_KNOWN,
)


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
    robot = _read(text, URDF, faults, in_parts=True)
    for link in robot.iterfind("link"):
        for inertia in link.iterfind("inertial/inertia"):
            _drop_mirrored(link.get("name", ""), inertia, faults)
    return robot


def _drop_mirrored(link: str, inertia: Element, faults: Faults) -> None:
    """Drop the entries of an inertia that are there twice; add a fault of one that differs."""
    for name, other in _MIRRORED.items():
        text = inertia.attrib.pop(name, None)
        if text is None or finite_numbers(text) == finite_numbers(inertia.get(other, "")) != []:
            continue
        allowed = f"it must be {other}, {shortened(inertia.get(other, 'missing'))}"
        faults.add("link", link, f"inertia {name}", shortened(text), allowed, inertia)


def read_shapes(text: str, faults: Faults | None = None) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with all that is read of it.

    Args:
        faults: Collects what is wrong in `<collision>` elements.

    Raises:
        InvalidInput: As for `read_elements`.
    """
    return _read(text, URDF, Faults() if faults is None else faults, told_in="collision")


def read_collisions(text: str, field: str, faults: Faults) -> Element:
    """Return the `<robot>` with its elements on links that may touch.

    Args:
        field: Of the text: that of an SRDF, or of a recorded URDF, which has other elements, too.

    Raises:
        InvalidInput: As for `read_elements`; the error names `field`.
    """
    told_in = "" if field == SRDF_FIELD else "nothing"
    return _read(text, replace(SRDF, field=field), faults, told_in=told_in)


def _read(
    text: str, form: Format, faults: Faults, in_parts: bool = False, told_in: str = ""
) -> Element:
    robot = read_xml(text, _formats(text, form), faults, in_parts, told_in)
    if robot.tag != form.root:
        from ff_planner_ros.robot.urdf.sdf import robot_of

        robot = robot_of(robot, faults)
    for owner, tag in (("link", "collision"), ("joint", "dynamics")) if in_parts else ():
        for element in robot.iterfind(f"{owner}[{tag}]"):  # of an SDF
            for part in element.findall(tag):
                element.remove(part)
    robot.set("name", robot.get("name") or "robot")
    return robot


def _formats(text: str, form: Format) -> Formats:
    """Return the formats that a text may have."""
    if form.field == SRDF_FIELD or "<sdf" not in text:
        return {form.root: form}
    # With Pinocchio, which takes long to load: readers of recorded URDFs do without.
    from ff_planner_ros.robot.urdf.sdf_model import SDF

    return {form.root: form, SDF.root: SDF}
