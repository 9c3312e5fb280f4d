"""Arms whose lengths are round numbers, and motions of them that are told point by point.

All joints turn about z, and at zero angles the arm lies along x: geometry says where everything is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import Obstacle, attached
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

_INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@cache
def straight_arm(first: float, *lengths: float, solids: tuple[tuple[str, str], ...] = ()) -> Robot:
    """Return an arm.

    Args:
        first: Where its first joint is before the chaser's origin [m].
        lengths: Of its links `link_1`, `link_2` and so on [m].
        solids: `<collision>` elements by link, in its frame.
    """
    of_link: Mapping[str, str] = dict(solids)

    def link(name: str) -> str:
        return f'<link name="{name}">{_INERTIAL}{of_link.get(name, "")}</link>'

    parts, parent, at = [link("chaser")], "chaser", first
    for number, length in enumerate(lengths, 1):
        parts.append(link(f"link_{number}"))
        parts.append(
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{number}"/><origin xyz="{at} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-9" upper="9" velocity="9" effort="9"/></joint>'
        )
        parent, at = f"link_{number}", length
    parts.append(
        '<link name="tip"/><joint name="hand" type="fixed">'
        f'<parent link="{parent}"/><child link="tip"/><origin xyz="{at} 0 0"/></joint>'
    )
    return robot_from_urdf_text(f'<robot name="straight">{"".join(parts)}</robot>', "chaser", "tip")


def ball(radius: float, x: float) -> str:
    """Write a ball on a link's line, `x` [m] from its joint."""
    return (
        f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry>'
        "</collision>"
    )


def told(
    times: Sequence[float] | Array,
    angles: Array,
    rates: Array,
    base: Array | None = None,
    base_twists: Array | None = None,
) -> FollowedMotion:
    """Return a motion through points, whatever momentum says of it.

    Args:
        times: Of the points [s].
        angles: Shape (points, joints) [rad].
        rates: Of the joints, likewise [rad/s].
        base: Positions and quaternions. Shape (points, 7); None: it rests in the origin.
        base_twists: Shape (points, 6); None: zero.
    """
    count = len(times)
    if base is None:
        base = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (count, 1))
    twists = np.zeros((count, 6)) if base_twists is None else base_twists
    time = np.array(times, np.float64)
    still = np.zeros_like(rates)
    joints = JointMotion(time, angles, rates, still)
    q, v = np.hstack([base, angles]), np.hstack([twists, rates])
    return FollowedMotion(joints, 1, time, q, v, still)


def turning(times: Sequence[float] | Array, begin: Array, rates: Array) -> FollowedMotion:
    """Return a motion whose joints turn at constant rates [rad/s] from angles [rad] on."""
    time = np.array(times, np.float64)
    angles = np.asarray(begin) + np.outer(time - time[0], rates)
    return told(time, angles, np.tile(rates, (len(time), 1)))


def panel_about(x: float, begin: float, rate: float) -> list[Obstacle]:
    """A sphere of 0.3 m on a body that turns about z at a place on the x axis, 1 m from there.

    Args:
        begin: Angle from the x axis at the start [rad].
        rate: [rad/s].
    """
    body = TargetBody(
        position=np.array([x, 0.0, 0.0]),
        quaternion_xyzw=[0.0, 0.0, np.sin(begin / 2), np.cos(begin / 2)],
        inertia=np.eye(3),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        angular_velocity=[0.0, 0.0, rate],
        obstacles=(AttachedObstacle.sphere("panel", [1.0, 0.0, 0.0], 0.3),),
    )
    return [one for one in attached(body) if one.is_sphere]
