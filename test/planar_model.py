"""A planar arm on a planar base written out, and robots on a table to compare it with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState


@dataclass(frozen=True)
class Body:
    """A body in the plane: its mass, where that is from the joint before it, what it turns like."""

    mass: float
    center: tuple[float, float]
    inertia: float  # about its centre of mass and z
    end: tuple[float, float]  # next joint, or end effector, from the joint before it


# The published robot of the planar testbed, functions.py: m, a, I, L; the mounting point p1, p2.
TESTBED = (
    Body(64.859, (0.0, 0.0), 2.6952, (0.3696, 0.001279)),
    Body(2.9130, (0.1805, 0.0), 0.091391, (0.4488, 0.0)),
    Body(2.6460, (0.2000, 0.0), 0.081375, (0.4499, 0.0)),
    Body(1.6990, (0.1029, 0.0), 0.021904, (0.3545, 0.0)),
)


def random_bodies(joints: int, rng: np.random.Generator) -> tuple[Body, ...]:
    """Draw a carriage and an arm whose centres of mass are off every line."""
    bodies = []
    for k in range(joints + 1):
        mass = rng.uniform(20.0, 60.0) if k == 0 else rng.uniform(1.0, 4.0)
        bodies.append(
            Body(
                mass,
                (float(rng.uniform(-0.1, 0.2)), float(rng.uniform(-0.1, 0.1))),
                float(mass * rng.uniform(0.02, 0.05)),
                (float(rng.uniform(0.3, 0.5)), float(rng.uniform(-0.05, 0.05))),
            )
        )
    return tuple(bodies)


def planar_urdf(bodies: tuple[Body, ...], rng: np.random.Generator, down: bool = False) -> str:
    """Write a robot whose motion in the plane is that of the bodies.

    What does not matter on a table is drawn: heights of joints and masses, and moments of inertia
    about other axes, their products with z among them. The axis of the last joint points down if
    asked.
    """
    parts = []
    for k, body in enumerate(bodies):
        tilt, most = (rng.uniform(-0.3, 0.3, 3) * body.inertia).tolist(), 2.0 * body.inertia
        parts.append(
            f'<link name="body_{k}"><inertial>'
            f'<origin xyz="{body.center[0]!r} {body.center[1]!r} {rng.uniform(-0.3, 0.3)!r}"/>'
            f'<mass value="{body.mass!r}"/><inertia ixx="{most!r}" iyy="{most!r}" '
            f'izz="{body.inertia!r}" ixy="{tilt[0]!r}" ixz="{tilt[1]!r}" iyz="{tilt[2]!r}"/>'
            "</inertial></link>"
        )
        end = f"{body.end[0]!r} {body.end[1]!r} {rng.uniform(-0.2, 0.2)!r}"
        last = k == len(bodies) - 1
        axis = -1 if down and k == len(bodies) - 2 else 1
        parts.append(
            f'<joint name="joint_{k + 1}" type="{"fixed" if last else "revolute"}">'
            f'<parent link="body_{k}"/><child link="{"tip" if last else f"body_{k + 1}"}"/>'
            f'<origin xyz="{end}"/>'
            + (
                ""
                if last
                else f'<axis xyz="0 0 {axis}"/>'
                '<limit lower="-2.6" upper="2.6" velocity="0.8" effort="20"/>'
            )
            + "</joint>"
        )
    return f'<robot name="on_a_table">{"".join(parts)}<link name="tip"/></robot>'


def planar_robot(bodies: tuple[Body, ...], rng: np.random.Generator, down: bool = False) -> Robot:
    """Return a robot on a table, see `planar_urdf`."""
    return robot_from_urdf_text(planar_urdf(bodies, rng, down), "body_0", "tip", Base.PLANAR)


def planar_state(
    x_y_heading: Array, rates: Array, joints: Array, joint_rates: Array, carriage: Body, z: float
) -> SystemState:
    """Return a state on the table; place and velocity are those of the carriage's joint frame."""
    heading, turn = float(x_y_heading[2]), float(rates[2])
    center = turned(heading) @ np.array(carriage.center)
    return SystemState(
        position_chaser_in_inertial=[*(x_y_heading[:2] + center), z],
        quaternion_chaser_to_inertial_xyzw=[0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)],
        linear_velocity_chaser_in_inertial=[*(rates[:2] + turn * _left_of(center)), 0.0],
        angular_velocity_chaser_in_inertial=[0.0, 0.0, turn],
        joint_positions=joints,
        joint_velocities=joint_rates,
    )


def mass_matrix(bodies: tuple[Body, ...], angles: Array) -> Array:
    """Return M of the kinetic energy 1/2 u^T M u.

    Args:
        angles: Heading of the carriage and joint angles. Shape (1 + joints,) [rad].

    Returns:
        For u = x', y', heading' and joint rates in inertial axes. Shape (3 + joints, 3 + joints).
    """
    size = 2 + len(angles)
    matrix = np.zeros((size, size))
    for body, (place, turn) in zip(bodies, _jacobians(bodies, angles), strict=True):
        matrix += body.mass * place.T @ place + body.inertia * np.outer(turn, turn)
    return matrix


def momentum(bodies: tuple[Body, ...], place: Array, angles: Array, u: Array) -> Array:
    """Return P_x, P_y and L_z about the inertial origin; place: of the carriage, x and y."""
    total = np.zeros(3)
    centers = _centers(bodies, angles) + place
    jacobians = _jacobians(bodies, angles)
    for body, center, (of_place, of_turn) in zip(bodies, centers, jacobians, strict=True):
        moving = body.mass * of_place @ u
        total[:2] += moving
        total[2] += center[0] * moving[1] - center[1] * moving[0] + body.inertia * of_turn @ u
    return total


def turned(angle: float) -> Array:
    """Return the turn by an angle [rad]. Shape (2, 2)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _left_of(vector: Array) -> Array:
    return np.array([-vector[1], vector[0]])


def _chain(bodies: tuple[Body, ...], angles: Array) -> tuple[list[Array], list[Array]]:
    """Return where each body's joint is from the carriage's frame, and its centre of mass."""
    joints, centers, place = [], [], np.zeros(2)
    for body, angle in zip(bodies, np.cumsum(angles), strict=True):
        joints.append(place)
        centers.append(place + turned(angle) @ np.array(body.center))
        place = place + turned(angle) @ np.array(body.end)
    return joints, centers


def _centers(bodies: tuple[Body, ...], angles: Array) -> Array:
    return np.array(_chain(bodies, angles)[1])


def _jacobians(bodies: tuple[Body, ...], angles: Array) -> list[tuple[Array, Array]]:
    """Return velocity of the centre of mass and turn of each body per entry of u."""
    joints, centers = _chain(bodies, angles)
    found = []
    for k, center in enumerate(centers):
        place, turn = np.zeros((2, 2 + len(angles))), np.zeros(2 + len(angles))
        place[:, :2] = np.eye(2)
        for j in range(k + 1):
            place[:, 2 + j], turn[2 + j] = _left_of(center - joints[j]), 1.0
        found.append((place, turn))
    return found
