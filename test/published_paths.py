"""Published problems in which the end effector follows a path: their robots, and their paths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.planning.problem.path.followed import PathPoint, PathToFollow, end_effector
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem, Target
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import base_twist, generalised_jacobian
from ff_planner_ros.robot.state import SystemState


@dataclass(frozen=True)
class Link:
    """A body, and the joint before it; inertia about the centre of mass."""

    mass: float
    center: tuple[float, float, float]
    inertia: tuple[float, float, float]
    axis: str = "z"  # of the joint before it
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of that joint, in the body before
    limits: tuple[float, float] = (-np.pi, np.pi)


_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def robot_of(links: list[Link], tip: tuple[float, float, float], base: Base = Base.FREE_FLYER):
    """Return the robot of a base and its links; the end effector is at `tip` in the last."""
    parts = []
    for k, one in enumerate(links):
        xyz, (ixx, iyy, izz) = " ".join(map(repr, one.center)), one.inertia
        parts.append(
            f'<link name="body_{k}"><inertial><origin xyz="{xyz}"/><mass value="{one.mass!r}"/>'
            f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
        if k:
            xyz, (low, high) = " ".join(map(repr, one.origin)), one.limits
            parts.append(
                f'<joint name="joint_{k}" type="revolute"><parent link="body_{k - 1}"/>'
                f'<child link="body_{k}"/><origin xyz="{xyz}"/><axis xyz="{_AXES[one.axis]}"/>'
                f'<limit lower="{low!r}" upper="{high!r}" effort="100" velocity="2"/></joint>'
            )
    last, xyz = len(links) - 1, " ".join(map(repr, tip))
    parts.append(
        f'<link name="tip"/><joint name="to_tip" type="fixed"><parent link="body_{last}"/>'
        f'<child link="tip"/><origin xyz="{xyz}"/></joint>'
    )
    text = f'<robot name="published">{"".join(parts)}</robot>'
    return robot_from_urdf_text(text, "body_0", "tip", base, geometry=Geometry.LINES)


def capsule(mass: float, length: float, radius: float = 0.04) -> tuple[float, float, float]:
    """Return the moments of inertia of a uniform capsule along z."""
    cylinder, ends = np.pi * radius**2 * length, 4.0 / 3.0 * np.pi * radius**3
    m, s = mass * np.array([cylinder, ends]) / (cylinder + ends)
    across = m * (length**2 / 12.0 + radius**2 / 4.0)
    across += s * (0.4 * radius**2 + length**2 / 4.0 + 0.375 * length * radius)
    return (float(across), float(across), float(m * radius**2 / 2.0 + 0.4 * s * radius**2))


def at_rest(robot: Robot, joints: list[float]) -> SystemState:
    """Return a state at rest with the chaser at the origin."""
    return SystemState(
        np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3),
        np.array(joints), np.zeros(robot.joints),
    )  # fmt: skip


def problem_along(
    robot: Robot, start: SystemState, path: PathToFollow, objective: Objective, points: int = 61
) -> PlanningProblem:
    """Return the problem of following a path."""
    pose, _ = end_effector(robot, start)
    there = Target(pose.translation, pin.Quaternion(pose.rotation).coeffs())
    return PlanningProblem(
        robot=robot, start=start, target=there, path=path, duration=path.duration,
        points=points, obstacles=(), objective=objective, limits=Limits(),
    )  # fmt: skip


ATTITUDE = Objective(joint_path_length=0.0, chaser_attitude=1.0)


# P5: five velocity laws on three satellites (Gonzalez-Annan/reactionless-compliance).
def p5_robot(mass: float) -> Robot:
    """Return the seven-joint arm of P5 on a cube of this mass [kg]."""
    half = 0.5 * (mass / 300.0) ** (1.0 / 3.0)
    links = [Link(mass, (0.0, 0.0, 0.0), (2.0 / 3.0 * mass * half**2,) * 3)]
    lengths, origin = (0.12, 0.225, 0.225, 0.20, 0.20, 0.06, 0.06), half
    for axis, length, m in zip(
        "zyzyzyz", lengths, (2.5, 2.5, 2.0, 2.0, 1.5, 1.0, 1.0), strict=True
    ):
        most = 2.9 if axis == "z" else 2.0
        center = (0.0, 0.0, length / 2.0)
        links.append(Link(m, center, capsule(m, length), axis, (0.0, 0.0, origin), (-most, most)))
        origin = length
    return robot_of(links, (0.0, 0.0, lengths[-1]))


P5_START = [1.59, -0.3, 0.07, -1.52, 0.07, 1.42, -2.41]


def p5(mass: float, tolerance: float, count: int = 121) -> PlanningProblem:
    """Return two loops of a circle of 0.1 m in 30 s, position only."""
    robot = p5_robot(mass)
    start = at_rest(robot, P5_START)
    begin = end_effector(robot, start)[0].translation
    times = np.linspace(0.0, 30.0, count)
    s = times / 30.0
    angle = 4.0 * np.pi * (3.0 * s**2 - 2.0 * s**3)
    places = begin + 0.1 * np.stack([1.0 - np.cos(angle), 0.0 * s, np.sin(angle)], axis=1)
    points = tuple(PathPoint(float(t), p) for t, p in zip(times, places, strict=True))
    return problem_along(robot, start, PathToFollow(points, tolerance), ATTITUDE)


# P6: a half circle from full stretch (TrustPaddy/space-robot-rl, the URDF of April 2026).
def p6(tolerance: float = 1e-3, count: int = 61) -> PlanningProblem:
    """Return the half circle of 0.4 m in 8.5 s, begun and ended at rest."""
    side = np.radians([85.0, 170.0, 170.0, 170.0])
    links = [Link(65.0, (0.0, 0.0, 0.0), (8.0, 8.0, 8.0))]
    for k, most in enumerate(side.tolist()):
        origin = (0.5, 0.0, 0.0) if k == 0 else (1.0, 0.0, 0.0)
        links.append(Link(1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.01), "z", origin, (-most, most)))
    # The tip of 0.1 kg at the end of the last link, as one body with it.
    mass, center = 1.1, 0.6 / 1.1
    moved = 0.101 + (center - 0.5) ** 2 + 0.1 * (1.0 - center) ** 2
    about = 0.011 + (center - 0.5) ** 2 + 0.1 * (1.0 - center) ** 2
    links[-1] = replace(
        links[-1], mass=mass, center=(center, 0.0, 0.0), inertia=(0.101, moved, about)
    )
    robot = robot_of(links, (1.0, 0.0, 0.0), Base.PLANAR)
    start, times = at_rest(robot, [0.0] * 4), np.linspace(0.0, 8.5, count)
    s = times / 8.5
    angle = np.pi * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    places = np.stack([4.1 + 0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.0 * s], axis=1)
    points = tuple(PathPoint(float(t), p) for t, p in zip(times, places, strict=True))
    return problem_along(robot, start, PathToFollow(points, tolerance), ATTITUDE)


# P2c: a pose held on a tumbling target (HJahanshahi/space-robot-dq 0.3.0).
def p2_robot() -> Robot:
    """Return the seven-joint arm of P2 on 100 kg."""
    flat, point = (0.00060833, 0.00060833, 0.0008), np.pi / 2
    table = (
        ("z", 0.0, np.pi, 4.65, 0.155, (0.03909888, 0.03909888, 0.00372)),
        ("y", 0.310, point, 1.00, 0.310, flat),
        ("x", 0.310, np.pi, 6.00, 0.510, (0.0824, 0.0824, 0.0048)),
        ("y", 0.710, None, 1.00, 0.710, flat),
        ("x", 0.710, np.pi, 5.85, 0.905, (0.07648875, 0.07648875, 0.00468)),
        ("y", 1.100, point, 1.00, 1.100, flat),
        ("x", 1.100, np.pi, 1.17, 1.139, (0.00106119, 0.00106119, 0.000936)),
    )
    links, before = [Link(100.0, (0.0, 0.0, 0.0), (10.0, 10.0, 8.0))], 0.0
    for axis, at, most, mass, center, inertia in table:
        limits = (0.1, np.pi - 0.1) if most is None else (-most, most)
        links.append(
            Link(mass, (0.0, 0.0, center - at), inertia, axis, (0.0, 0.0, at - before), limits)
        )
        before = at
    return robot_of(links, (0.0, 0.0, 0.078))


P2_START = [0.3, 0.4, -0.2, 0.8, 0.1, 0.5, 0.0]


def p2c(tolerance: float = 1e-4, turn: float = 1e-4, count: int = 21) -> PlanningProblem:
    """Return the pose held on a target that tumbles at 5 deg/s for 10 s, without momentum.

    The joints begin with the least velocities with which the end effector turns with the target.
    """
    robot = p2_robot()
    still = at_rest(robot, P2_START)
    axis = np.array([0.3, 1.0, 0.5]) / np.linalg.norm([0.3, 1.0, 0.5])
    spin = np.radians(5.0) * axis
    q = np.concatenate([np.zeros(3), [0.0, 0.0, 0.0, 1.0], P2_START])
    data = robot.model.createData()
    rates = np.linalg.pinv(generalised_jacobian(robot, data, q)) @ np.append(np.zeros(3), spin)
    twist = base_twist(robot, data, q, np.zeros(6), rates)
    start = replace(
        still, joint_velocities=rates, linear_velocity_chaser_in_inertial=twist[:3],
        angular_velocity_chaser_in_inertial=twist[3:],
    )  # fmt: skip
    pose, _ = end_effector(robot, start)
    points = []
    for time in np.linspace(0.0, 10.0, count).tolist():
        turned = pin.Quaternion(pin.exp3(time * spin) @ pose.rotation)
        points.append(PathPoint(time, pose.translation, turned.normalized().coeffs()))
    path = PathToFollow(tuple(points), tolerance, turn)
    return problem_along(robot, start, path, ATTITUDE)
