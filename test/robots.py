"""Robots and states that the tests share."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.polynomial import (
    EndEffectorMotion,
    EndEffectorPolynomial,
    end_effector_polynomials,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

CONFIG = Path(__file__).parent.parent / "config"
LEMUR_URDF = CONFIG / "robots/lemur/lemur.urdf"
LEMUR_SCENARIO = CONFIG / "scenarios/lemur_capture.yaml"
CANADARM2_URDF = CONFIG / "robots/canadarm2/canadarm2.urdf"
CANADARM2_SCENARIO = CONFIG / "scenarios/canadarm2_capture.yaml"


def random_urdf(joints: int, seed: int, sliding: Collection[int] = ()) -> str:
    """Write a robot with every difficulty that a URDF may hold.

    The base link `bus` hangs, turned and shifted, below a massless root; it and two arm links
    carry masses by fixed joints; no centre of mass lies in a frame's origin, no axis along one.

    Args:
        sliding: Numbers of the joints that slide, from 1 on; all others turn.
    """
    rng = np.random.default_rng(seed)
    parts = ['<link name="root"/>', _link("bus", rng, 200.0), _link("antenna", rng, 20.0)]
    parts += [_joint("bus_mount", "fixed", "root", "bus", rng)]
    parts += [_joint("antenna_mount", "fixed", "bus", "antenna", rng)]
    parent = "bus"
    for number in range(1, joints + 1):
        link = f"link_{number}"
        kind = "prismatic" if number in sliding else "revolute"
        parts += [_link(link, rng, 5.0), _joint(f"joint_{number}", kind, parent, link, rng)]
        parent = link
    carrying = f"link_{min(joints, 3)}"
    parts += [_link("camera", rng, 3.0), _joint("camera_mount", "fixed", carrying, "camera", rng)]
    parts += [_link("tool", rng, 2.0), _joint("tool_mount", "fixed", parent, "tool", rng)]
    return f'<robot name="random">{"".join(parts)}</robot>'


# Joints that mimic others, and what each mimics: in the arm, on it, on the base, on another.
MIMICS = {
    "joint_3": ("joint_1", -0.7, 0.1),
    "joint_5": ("joint_4", 0.4, 0.0),
    "rod": ("joint_2", -1.0, 0.2),
    "far_rod": ("rod", 0.5, -0.1),
    "a_panel": ("joint_4", 1.5, 0.3),
    "finger": ("joint_6", 0.1, 0.0),
}


def coupled_urdf(joints: int, seed: int, mimics: bool = True) -> str:
    """Write a robot of `random_urdf` with two rods, a panel and a finger, and joints that mimic."""
    rng = np.random.default_rng(seed)
    parts = [random_urdf(joints, seed, sliding=(5,)).replace("</robot>", "")]
    for name, kind, parent in (
        ("rod", "revolute", "link_1"),
        ("far_rod", "prismatic", "of_rod"),
        ("a_panel", "continuous", "bus"),
        ("finger", "prismatic", "tool"),
    ):
        parts += [_link(f"of_{name}", rng, 4.0), _joint(name, kind, parent, f"of_{name}", rng)]
    urdf = "".join(parts) + "</robot>"
    for name, (of, multiplier, offset) in MIMICS.items() if mimics else ():
        mimic = f'<mimic joint="{of}" multiplier="{multiplier}" offset="{offset}"/>'
        before, joint, after = urdf.partition(f'<joint name="{name}"')
        urdf = before + joint + after.replace("</joint>", f"{mimic}</joint>", 1)
    return urdf


def random_state(robot: Robot, rng: np.random.Generator) -> SystemState:
    """Draw a chaser anywhere in any attitude, drifting and tumbling, the arm moving."""
    quaternion = rng.normal(size=4)
    return SystemState(
        position_chaser_in_inertial=rng.uniform(-5.0, 5.0, 3),
        quaternion_chaser_to_inertial_xyzw=quaternion / np.linalg.norm(quaternion),
        linear_velocity_chaser_in_inertial=rng.normal(scale=0.1, size=3),
        angular_velocity_chaser_in_inertial=rng.normal(scale=0.1, size=3),
        joint_positions=rng.uniform(robot.lower_position_limits, robot.upper_position_limits),
        joint_velocities=rng.normal(scale=0.1, size=robot.joints),
    )


def paper_velocity(state: SystemState) -> Array:
    """Return the paper's q_v: v_ch, omega_ch and the joint rates."""
    return np.concatenate(
        [
            state.linear_velocity_chaser_in_inertial,
            state.angular_velocity_chaser_in_inertial,
            state.joint_velocities,
        ]
    )


def tangent_per_paper_velocity(robot: Robot, state: SystemState) -> Array:
    """Return Pinocchio's velocity per entry of q_v: `configuration` is linear in velocities."""
    columns = []
    for unit in np.eye(6 + robot.joints):
        moving = SystemState(
            state.position_chaser_in_inertial,
            state.quaternion_chaser_to_inertial_xyzw,
            unit[:3],
            unit[3:6],
            state.joint_positions,
            unit[6:],
        )
        columns.append(configuration(robot, moving)[1])
    return np.array(columns).T


def random_path(
    robot: Robot, state: SystemState, rng: np.random.Generator, duration: float, reach: float = 0.15
) -> EndEffectorPolynomial:
    """Draw paths from a state to an end, moving there, a few decimetres away."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, *configuration(robot, state))
    placement = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    start = EndEffectorMotion(placement.translation, placement.rotation, twist.vector, np.zeros(6))
    end = EndEffectorMotion(
        placement.translation + rng.normal(scale=reach, size=3),
        placement.rotation @ pin.exp3(rng.normal(scale=0.3, size=3)),
        rng.normal(scale=0.05, size=6),
        rng.normal(scale=0.02, size=6),
    )
    return end_effector_polynomial(start, end, duration)


def end_effector_polynomial(
    start: EndEffectorMotion, end: EndEffectorMotion, duration: float
) -> EndEffectorPolynomial:
    """Return the first, and nearly always the only one, of `end_effector_polynomials`."""
    return end_effector_polynomials(start, end, duration)[0]


def _link(name: str, rng: np.random.Generator, mass: float) -> str:
    """A body of ten point masses: whatever is drawn, its inertia is one that a body can have."""
    points = rng.uniform(-0.3, 0.3, (10, 3))
    points -= points.mean(axis=0)
    matrix = mass / 10 * sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)
    entries = (
        ("ixx", 0, 0),
        ("iyy", 1, 1),
        ("izz", 2, 2),
        ("ixy", 0, 1),
        ("ixz", 0, 2),
        ("iyz", 1, 2),
    )
    inertia = " ".join(f'{key}="{matrix[row, column]}"' for key, row, column in entries)
    return (
        f'<link name="{name}"><inertial>{_origin(rng)}<mass value="{mass}"/>'
        f"<inertia {inertia}/></inertial></link>"
    )


def _joint(name: str, kind: str, parent: str, child: str, rng: np.random.Generator) -> str:
    axis = _numbers(rng.normal(size=3))
    limit = '<limit lower="-2.5" upper="2.8" velocity="0.5" effort="50"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{_origin(rng)}" + (f'<axis xyz="{axis}"/>{limit}' if kind != "fixed" else "") + "</joint>"
    )


def _origin(rng: np.random.Generator) -> str:
    xyz, rpy = rng.uniform(-0.6, 0.6, 3), rng.uniform(-1.5, 1.5, 3)
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def _numbers(vector: Array) -> str:
    return " ".join(str(float(number)) for number in vector)


# URDF, base link and tip link of each; the tests that hold for any robot hold for these.


def of_lines(urdf: Path) -> str:
    """A URDF without what collides: the arm's lines are kept clear."""
    return re.sub("<collision>.*?</collision>", "", urdf.read_text(), flags=re.DOTALL)


ROBOTS = {
    "six joints": (random_urdf(6, seed=6), "bus", "tool"),
    "lemur": (of_lines(LEMUR_URDF), "chaser", "end_effector"),
    "nine joints": (random_urdf(9, seed=9), "bus", "tool"),
    "canadarm2": (of_lines(CANADARM2_URDF), "station", "end_effector"),
}


def one_line_urdf() -> str:
    """Six joints about the base's z axis, every centre of mass on it: nothing but turns about z."""
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts = [f'<link name="base">{inertial}</link>']
    parent = "base"
    for number in range(1, 7):
        parts.append(
            f'<link name="link_{number}">{inertial}</link>'
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{number}"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        )
        parent = f"link_{number}"
    return f'<robot name="one_line">{"".join(parts)}</robot>'
