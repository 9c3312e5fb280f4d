"""The paper's equations written out in plain numpy, from the URDF's XML alone.

Nothing here uses Pinocchio or the package: this is what the package is compared with. Every
vector is in axes of the inertial frame, as in the paper. Eq. (12) and (27)-(31) follow in
`test_paper_formulas.py`, Eq. (20) in `test_dynamics.py`, from what is returned here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PaperTerms:
    """What the equations name, at one state; index 0 of the links is the chaser.

    Attributes:
        r: Centres of mass. Shape (1 + n, 3).
        r_joint: Joint origins. Shape (n, 3).
        r_ee: End effector. Shape (3,).
        rotation_ee: End effector axes to inertial. Shape (3, 3).
        J_t: Partial Jacobians of Eq. (8). Shape (1 + n, 3, n).
        J_r: Partial Jacobians of Eq. (11). Shape (1 + n, 3, n).
        M: Generalised mass matrix, Eqs. (13)-(19). Shape (6 + n, 6 + n).
        H_ch: Eq. (25). Shape (6, 6).
        H_m: Eq. (26). Shape (6, n).
        J_ch: Eq. (29). Shape (6, 6).
        J_m: Of the fixed-base arm, Eq. (28). Shape (6, n).
        J_D: Eq. (32). Shape (6, n).
    """

    r: Array
    r_joint: Array
    r_ee: Array
    rotation_ee: Array
    J_t: Array
    J_r: Array
    M: Array
    H_ch: Array
    H_m: Array
    J_ch: Array
    J_m: Array
    J_D: Array


def paper_terms(
    urdf: str, base: str, tip: str, r_ch: Array, rotation_ch: Array, theta: Array
) -> PaperTerms:
    """Evaluate the equations at one state.

    Args:
        urdf: The robot's XML.
        base: Base link.
        tip: Tip link.
        r_ch: Chaser centre of mass. Shape (3,).
        rotation_ch: Base link axes to inertial. Shape (3, 3).
        theta: Joint angles from base to tip. Shape (n,).
    """
    n = len(theta)
    robot = ElementTree.fromstring(urdf)
    # The chaser's centre of mass is where the base link's frame at rest in the origin puts it.
    at_origin = _link_poses(robot, base, np.zeros(3), rotation_ch, theta)
    r_base = r_ch - _bodies(robot, at_origin, n)[1][0]
    links = _link_poses(robot, base, r_base, rotation_ch, theta)
    m, r, inertia = _bodies(robot, links, n)
    r_ee, rotation_ee = links.position[tip], links.rotation[tip]

    def partial_jacobians(point: Array, joints: int) -> tuple[Array, Array]:
        """As though the end effector were at `point`, carried by the first `joints` joints."""
        translational, rotational = np.zeros((3, n)), np.zeros((3, n))
        for j in range(joints):
            translational[:, j] = np.cross(links.axis[j], point - links.joint[j])
            rotational[:, j] = links.axis[j]
        return translational, rotational

    pairs = [partial_jacobians(r[i], i) for i in range(n + 1)]
    J_t, J_r = (np.array(column) for column in zip(*pairs, strict=True))
    arm = range(1, n + 1)
    tilde = [_tilde(r[i] - r[0]) for i in range(n + 1)]
    zero, one = np.zeros((3, 3)), np.eye(3)
    M_vv = sum(m) * one  # (14)
    M_vw = sum((m[i] * tilde[i].T for i in arm), zero)  # (15)
    M_ww = inertia[0] + sum((inertia[i] + m[i] * tilde[i].T @ tilde[i] for i in arm), zero)  # (16)
    M_vt = sum(m[i] * J_t[i] for i in arm)  # (17)
    M_wt = sum(inertia[i] @ J_r[i] + m[i] * tilde[i] @ J_t[i] for i in arm)  # (18)
    M_tt = sum(J_r[i].T @ inertia[i] @ J_r[i] + m[i] * J_t[i].T @ J_t[i] for i in arm)  # (19)
    M = np.block([[M_vv, M_vw, M_vt], [M_vw.T, M_ww, M_wt], [M_vt.T, M_wt.T, M_tt]])  # (13)

    r_tilde = _tilde(r_ch)
    H_ch = np.block([[M_vv, M_vw], [M_vw.T + r_tilde @ M_vv, M_ww + r_tilde @ M_vw]])  # (25)
    H_m = np.vstack([M_vt, M_wt + r_tilde @ M_vt])  # (26)
    J_ch = np.block([[one, _tilde(r_ee - r_ch).T], [zero, one]])  # (29)
    J_m = np.vstack(partial_jacobians(r_ee, n))
    J_D = J_m - J_ch @ np.linalg.inv(H_ch) @ H_m  # (32)
    return PaperTerms(
        r=r,
        r_joint=np.array(links.joint),
        r_ee=r_ee,
        rotation_ee=rotation_ee,
        J_t=J_t,
        J_r=J_r,
        M=M,
        H_ch=H_ch,
        H_m=H_m,
        J_ch=J_ch,
        J_m=J_m,
        J_D=J_D,
    )


def coriolis_matrix(
    urdf: str, base: str, tip: str, r_ch: Array, Theta_ch: Array, theta: Array, q_v: Array
) -> tuple[Array, Array]:
    """Evaluate Eq. (21) at one state, its derivatives by differences.

    The paper takes D, E and H from elsewhere. With D of Eq. (3), Lagrange's equations in q_p turn
    into Eq. (4) if E = D^-T, and H is the transposed derivative of D^-1 q_p' with respect to q_p
    at constant q_p'.

    Args:
        urdf: The robot's XML.
        base: Base link.
        tip: Tip link.
        r_ch: Chaser centre of mass. Shape (3,).
        Theta_ch: Euler angles phi, theta, psi of the chaser. Shape (3,).
        theta: Joint angles from base to tip. Shape (n,).
        q_v: v_ch, omega_ch and joint rates. Shape (6 + n,).

    Returns:
        C and the time derivative of M. Each of shape (6 + n, 6 + n).
    """

    def rates_map(q_p: Array) -> Array:
        """D^-1: omega_ch per Euler rate; every other rate is a velocity itself."""
        matrix = np.eye(len(q_p))
        _, pitch, yaw = q_p[3:6]
        x, y, z = np.eye(3)
        R_z = _axis_angle(z, yaw)
        matrix[3:6, 3:6] = np.column_stack([R_z @ _axis_angle(y, pitch) @ x, R_z @ y, z])
        return matrix

    def mass_matrix(q_p: Array) -> Array:
        return paper_terms(urdf, base, tip, q_p[:3], rotation_of_euler(q_p[3:6]), q_p[6:]).M

    q_p = np.concatenate([r_ch, Theta_ch, theta])
    D = np.linalg.inv(rates_map(q_p))  # (3)
    q_p_dot = D @ q_v
    dM = _derivative(mass_matrix, q_p)
    M_dot = dM @ q_p_dot
    E_dot = (_derivative(rates_map, q_p) @ q_p_dot).T
    H = _derivative(lambda at: rates_map(at) @ q_p_dot, q_p).T
    dMq_v = np.einsum("ijk,j->ik", dM, q_v)
    C = M_dot + D.T @ (E_dot - H) @ mass_matrix(q_p) - D.T @ dMq_v.T / 2  # (21)
    return C, M_dot


def rotation_of_euler(Theta: Array) -> Array:
    """Rz(psi) Ry(theta) Rx(phi)."""
    x, y, z = np.eye(3)
    phi, theta, psi = Theta
    return _axis_angle(z, psi) @ _axis_angle(y, theta) @ _axis_angle(x, phi)


def _derivative(f: Callable[[Array], Array], q_p: Array) -> Array:
    """Derivative with respect to q_p along a new last axis, by differences of fourth order."""
    step = 2e-3
    columns = []
    for direction in step * np.eye(len(q_p)):
        near = f(q_p + direction) - f(q_p - direction)
        far = f(q_p + 2 * direction) - f(q_p - 2 * direction)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class _Links:
    """Pose of every link by name and of every joint in order; `body` counts joints before it."""

    position: dict[str, Array]
    rotation: dict[str, Array]
    body: dict[str, int]
    joint: list[Array]
    axis: list[Array]


def _link_poses(
    robot: ElementTree.Element, base: str, r_base: Array, rotation: Array, theta: Array
) -> _Links:
    """Walk the tree from the base link outwards; links above the base are fixed to it."""
    ends = {
        (joint.find("parent").get("link"), joint.find("child").get("link")): joint
        for joint in robot.findall("joint")
    }
    links = _Links({base: r_base}, {base: rotation}, {base: 0}, [], [])
    todo = [base]
    while todo:
        here = todo.pop()
        p, R = links.position[here], links.rotation[here]
        for (parent, child), joint in ends.items():
            xyz, R_joint = _origin(joint.find("origin"))
            if parent == here and child not in links.body:
                links.position[child], links.rotation[child] = p + R @ xyz, R @ R_joint
                links.body[child] = links.body[here]
                if joint.get("type") == "revolute":
                    links.body[child] += 1
                    axis = _vector(joint.find("axis").get("xyz"))
                    axis = links.rotation[child] @ axis / np.linalg.norm(axis)
                    links.joint.append(links.position[child])
                    links.axis.append(axis)
                    turn = _axis_angle(axis, theta[links.body[here]])
                    links.rotation[child] = turn @ links.rotation[child]
                todo.append(child)
            elif child == here and parent not in links.body:
                links.rotation[parent] = R @ R_joint.T
                links.position[parent] = p - links.rotation[parent] @ xyz
                links.body[parent] = links.body[here]
                todo.append(parent)
    return links


def _bodies(robot: ElementTree.Element, links: _Links, n: int) -> tuple[Array, Array, Array]:
    """Mass, centre of mass and inertia about it, of the chaser and the n moving links."""
    pieces: list[list[tuple[float, Array, Array]]] = [[] for _ in range(n + 1)]
    for link in robot.findall("link"):
        name, inertial = link.get("name"), link.find("inertial")
        if inertial is None:
            continue
        xyz, R_inertial = _origin(inertial.find("origin"))
        R = links.rotation[name] @ R_inertial
        i = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}
        matrix = np.array(
            [
                [i["ixx"], i["ixy"], i["ixz"]],
                [i["ixy"], i["iyy"], i["iyz"]],
                [i["ixz"], i["iyz"], i["izz"]],
            ]
        )
        center = links.position[name] + links.rotation[name] @ xyz
        mass = float(inertial.find("mass").get("value"))
        pieces[links.body[name]].append((mass, center, R @ matrix @ R.T))
    masses = np.array([sum(mass for mass, _, _ in body) for body in pieces])
    centers = np.array(
        [sum(m * c for m, c, _ in body) / mass for body, mass in zip(pieces, masses, strict=True)]
    )
    inertias = np.array(
        [
            sum(i + m * _tilde(c - center).T @ _tilde(c - center) for m, c, i in body)
            for body, center in zip(pieces, centers, strict=True)
        ]
    )
    return masses, centers, inertias


def _tilde(a: Array) -> Array:
    """Eq. (10)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _axis_angle(axis: Array, angle: float) -> Array:
    """Rodrigues' formula."""
    k = _tilde(axis)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def _origin(element: ElementTree.Element | None) -> tuple[Array, Array]:
    if element is None:
        return np.zeros(3), np.eye(3)
    rotation = rotation_of_euler(_vector(element.get("rpy", "0 0 0")))
    return _vector(element.get("xyz", "0 0 0")), rotation


def _vector(text: str) -> Array:
    return np.array([float(word) for word in text.split()])
