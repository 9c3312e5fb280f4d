"""What the planner has read of a robot: facts in SI, and the rows of a page that says them.

Joints are at zero, locked ones where they are locked. Points are in the frame of the base link,
vectors and inertias in its axes; an inertia is about its own centre of mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.bodies import defining_numbers
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.kinematics import arm_reach
from ff_planner_ros.robot.model import Robot

_FRAME = (
    "joints are at zero, locked ones where they are locked; points are in the frame of the base "
    "link, axes and inertias in its axes, inertias about centres of mass; limits are the file's, "
    "but where another source is named"
)
# Entries of a vector or an inertia that are as small beside the others are zero.
_ROUNDING = 1e-9
# Where a limit comes from.
_FILE, _PLANNER, _NONE = "file", "planner", "none known"


def robot_facts(robot: Robot) -> dict[str, Any]:
    """Return what the planner has read of a robot, for JSON: kg, m, rad, s, N; see this module."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    to_base = data.oMf[model.getFrameId(robot.base_link, pin.FrameType.BODY)].inverse()
    places = [to_base * place for place in data.oMi]
    parts = [place.act(weight) for place, weight in zip(places, model.inertias, strict=True)]
    links = _links(robot)
    tip = to_base * data.oMf[robot.tip_frame_id]
    joints = []
    for k, name in enumerate(robot.joint_names):
        number = model.getJointId(name)
        driven = 2 + np.flatnonzero(robot.tree.planned == k)
        moved = sorted({one for each in driven.tolist() for one in model.subtrees[each]})
        joints.append(
            {
                "name": name,
                "type": _type(robot, k),
                "axis": _list(places[number].rotation @ _direction(robot, k)),
                "position": _list(places[number].translation),
                "limits": _limits(robot, k),
                "moves": {
                    "links": sum(len(links[joint]) for joint in moved),
                    "mass": _sum([parts[joint] for joint in moved]).mass,
                },
                "carries": {"links": links[number], **_weight(parts[number])},
            }
        )
    return {
        "base_link": robot.base_link,
        "tip_link": robot.tip_link,
        "whole": _weight(_sum(parts[1:])),
        "base": {"links": links[1], **_weight(parts[1])},
        "tip": {"position": _list(tip.translation), "rotation": _list(tip.rotation)},
        "reach": arm_reach(robot),
        "joints": joints,
        **({"slide_weight": robot.slide_weight} if robot.has_slides else {}),
        "coupled_joints": [
            {
                "name": model.names[2 + k],
                "type": "prismatic" if robot.tree.slides[k].any() else "revolute",
                "follows": robot.joint_names[robot.tree.planned[k]],
                "multiplier": float(robot.tree.multipliers[k]),
                "offset": float(robot.tree.offsets[k]),
                "axis": _list(places[2 + k].rotation @ (robot.tree.axes + robot.tree.slides)[k]),
                "position": _list(places[2 + k].translation),
                "carries": {"links": links[2 + k], **_weight(parts[2 + k])},
            }
            for k in range(robot.tree.joints)
            if model.names[2 + k] not in robot.joint_names
        ],
        "locked_joints": [
            {"name": one.name, "type": one.type, "position": one.position, "follows": one.follows}
            | {"joint": _carrier(robot, _fixed_to(robot, one.name))}
            for one in robot.locked_joints
            if not one.is_fixed
        ],
        "geometry": robot.geometry.value,
        "bodies": [
            {"name": body.name, "link": body.link, "joint": _carrier(robot, body.joint)}
            | _shape(*defining_numbers(body)[:2])
            for body in robot.bodies
        ],
        "pairs": [[robot.bodies[one].name for one in pair] for pair in robot.pairs],
        "may_touch": [one._asdict() for one in robot.may_touch],
        "notes": list(robot.notes),
    }


def robot_rows(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and value of what `robot_facts` returns, as a user reads it."""
    yield "base link", f"{facts['base_link']} (the chaser, with all that is fixed to it)"
    yield "tip link", f"{facts['tip_link']} (the end effector)"
    yield "", _FRAME
    yield "whole", f"{facts['whole']['mass']:g} kg"
    yield from _weight_rows(facts["whole"])
    yield "chaser", f"{facts['base']['mass']:g} kg: {_named(facts['base']['links'])}"
    yield from _weight_rows(facts["base"])
    yield "end effector", f"at {_vector(facts['tip']['position'])} m"
    angles = np.rad2deg(pin.rpy.matrixToRpy(np.array(facts["tip"]["rotation"])))
    yield "  roll, pitch, yaw", f"{_vector(angles)} deg"
    yield "  reach", f"at most {facts['reach']:g} m from the first joint"
    yield "joints", str(len(facts["joints"]))
    for joint in facts["joints"]:
        yield from _joint_rows(joint)
    if (weight := facts.get("slide_weight")) is not None:
        yield "joint path", f"sliding by 1 m counts as {weight:g} rad"
    for one in facts["coupled_joints"]:
        offset = f" {one['offset']:+g}" if one["offset"] else ""
        moves = f"at {one['multiplier']:g} {one['follows']}{offset}"
        yield f"  {one['name']}", f"{one['type']}, coupled: {moves}"
        yield from _part_rows(one)
    yield "locked joints", str(len(facts["locked_joints"]))
    for one in facts["locked_joints"]:
        unit = "m" if one["type"] == "prismatic" else "rad"
        at = f"{one['type']}, at {one['position']:g} {unit}"
        why = ", by the joint that it mimics" if one["follows"] else ""
        yield f"  {one['name']}", f"{at}{why}, on {one['joint'] or 'the chaser'}"
    yield from _geometry_rows(facts)
    yield "notes", str(len(facts["notes"]))
    yield from ((f"  {number}", note) for number, note in enumerate(facts["notes"], start=1))


def _joint_rows(joint: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    moved = joint["moves"]
    yield f"  {joint['name']}", joint["type"]
    yield "    limits", _limits_told(joint)
    yield "    moves", f"{moved['mass']:g} kg, {moved['links']} links"
    yield from _part_rows(joint)


def _part_rows(joint: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    carried = joint["carries"]
    yield "    axis", f"{_vector(joint['axis'])} through {_vector(joint['position'])} m"
    yield "    carries", f"{carried['mass']:g} kg: {_named(carried['links'])}"
    yield from (("  " + name, value) for name, value in _weight_rows(carried))


def _limits_told(joint: Mapping[str, Any]) -> str:
    limits, source = joint["limits"], joint["limits"]["from"]
    slides = joint["type"] == "prismatic"
    scale, unit = (1.0, "m") if slides else (np.rad2deg(1.0), "deg")
    force = ("force", "N") if slides else ("torque", "N m")
    ends = f"{scale * limits['lower']:g} to {scale * limits['upper']:g} {unit}"
    told = {
        "position": f"{ends}, either way of any turn" if source["position"] == _PLANNER else ends,
        "velocity": _told(limits["velocity"], scale, f"{unit}/s", "velocity"),
        "effort": _told(limits["effort"], 1.0, force[1], force[0]),
    }
    return ", ".join(
        text if source[name] == _FILE else f"{text} ({source[name]})" for name, text in told.items()
    )


def _told(limit: float | None, scale: float, unit: str, what: str) -> str:
    return f"any {what}" if limit is None else f"{scale * limit:g} {unit}"


def _geometry_rows(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if facts["geometry"] == Geometry.LINES.value:
        yield "geometry", "lines: the arm's centre lines are kept clear of obstacles"
        return
    yield "geometry", "shapes, as <collision> has them"
    yield "bodies", f"{len(facts['bodies'])} that are kept clear"
    for body in facts["bodies"]:
        vertices = f" of {body['vertices']} vertices" if "vertices" in body else ""
        on = body["joint"] or "the chaser"
        yield f"  {body['name']}", f"{body['kind']}{vertices}, {_vector(body['size'])} m, on {on}"
    yield "pairs", f"{len(facts['pairs'])} that must not touch"
    yield "may touch", str(len(facts["may_touch"]))
    for pair in facts["may_touch"]:
        yield "", f"{pair['link1']} - {pair['link2']}: {pair['reason']}"


def _weight_rows(weight: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "  centre of mass", f"{_vector(weight['center_of_mass'])} m"
    xx, xy, xz, yy, yz, zz = np.array(weight["inertia"])[np.triu_indices(3)]
    yield "  inertia", f"xx {xx:g}, yy {yy:g}, zz {zz:g} kg m2"
    if max(map(abs, (xy, xz, yz))) > _ROUNDING * max(xx, yy, zz):
        yield "", f"xy {xy:g}, xz {xz:g}, yz {yz:g} kg m2"


def _links(robot: Robot) -> list[list[str]]:
    """Return the links that each of Pinocchio's joints carries."""
    found: list[list[str]] = [[] for _ in robot.model.names]
    for frame in robot.model.frames:
        if frame.type == pin.FrameType.BODY:
            found[frame.parentJoint].append(frame.name)
    return found


def _sum(weights: Sequence[pin.Inertia]) -> pin.Inertia:
    return sum(weights, pin.Inertia.Zero())


def _weight(weight: pin.Inertia) -> dict[str, Any]:
    return {
        "mass": weight.mass,
        "center_of_mass": _list(weight.lever),
        "inertia": _list(weight.inertia),
    }


def _type(robot: Robot, joint: int) -> str:
    if robot.slides(joint):
        return "prismatic"
    return "continuous" if robot.continuous[joint] else "revolute"


def _direction(robot: Robot, joint: int) -> Array:
    axis: Array = robot.joint_axes[joint] + robot.joint_slides[joint]  # one of them is zero
    return axis


def _limits(robot: Robot, joint: int) -> dict[str, Any]:
    """Return the limits of a joint, None for none, and where they come from."""
    ends = robot.lower_position_limits[joint], robot.upper_position_limits[joint]
    most = {"velocity": robot.velocity_limits[joint], "effort": robot.effort_limits[joint]}
    known = {name: bool(np.isfinite(limit)) for name, limit in most.items()}
    return {
        "lower": float(ends[0]),
        "upper": float(ends[1]),
        **{name: float(limit) if known[name] else None for name, limit in most.items()},
        "from": {
            "position": _PLANNER if robot.continuous[joint] else _FILE,
            **{name: _FILE if is_known else _NONE for name, is_known in known.items()},
        },
    }


def _fixed_to(robot: Robot, locked: str) -> int:
    """Return Pinocchio's number of the joint that moves a locked one; 1: it is on the chaser."""
    frame = robot.model.frames[robot.model.getFrameId(locked, pin.FrameType.FIXED_JOINT)]
    return int(frame.parentJoint)


def _carrier(robot: Robot, joint: int) -> str | None:
    """Return the name of one of Pinocchio's joints; None: the chaser."""
    return None if joint == 1 else str(robot.model.names[joint])


def _shape(kind: str, numbers: Array) -> dict[str, Any]:
    if kind == "convex":
        return {"kind": "hull", "vertices": len(numbers), "size": _list(np.ptp(numbers, axis=0))}
    return {"kind": kind, "size": _list(numbers)}


def _list(values: Array) -> Any:
    return np.asarray(values, float).tolist()


def _named(links: Sequence[str]) -> str:
    return ", ".join(links) or "no link"


def _vector(values: Sequence[float] | Array) -> str:
    """Return numbers of six digits; what rounding leaves of a zero is zero."""
    least = _ROUNDING * max(1.0, *map(abs, values))
    return f"[{', '.join(f'{0.0 if abs(x) < least else x:g}' for x in values)}]"
