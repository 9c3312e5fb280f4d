"""The free-floating robot in MuJoCo, read from its URDF by MuJoCo's own code.

Nothing here uses Pinocchio's model: masses, inertias, kinematics, the chaser's frame and the
momentum are what MuJoCo makes of the URDF.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.locked_joints import Drive, mimics
from ff_planner_ros.simulation.mujoco_model import engine_model, mujoco, specification

ENGINE = f"MuJoCo {mujoco.__version__}"

# It would write a file wherever the process stands; what went wrong is seen in the numbers.
mujoco.set_mju_user_warning(lambda _: None)


class Observation(NamedTuple):
    """Poses, momentum and twist of the system in one state, in the inertial frame."""

    chaser_position: Array  # of the chaser's centre of mass; shape (3,) [m]
    chaser_quaternion_xyzw: Array  # of the base link's axes; shape (4,)
    ee_position: Array  # shape (3,) [m]
    ee_quaternion_xyzw: Array  # shape (4,)
    momentum: Array  # P [kg m/s] and L about the inertial origin [kg m2/s]; shape (6,)
    ee_twist: Array  # linear, then angular; inertial axes; shape (6,) [m/s, rad/s]


class Engine:
    """A robot with a free, planar or attitude-held base, on which its joint torques alone act.

    A state is a vector: inertial position of the root link's origin, its quaternion (w first),
    joint positions; then the origin's velocity in inertial axes, the angular velocity in axes of
    the root link, joint velocities. To MuJoCo, a base whose attitude wheels hold is on three
    prismatic joints along the axes of the root link.
    """

    def __init__(self, robot: Robot) -> None:
        """Read a robot's URDF; only this, the kind of base, and names are used.

        Raises:
            InvalidInput: MuJoCo refuses the URDF.
        """
        self._is_held = robot.base is Base.ATTITUDE_HELD
        spec, names = specification(robot.urdf, slides=self._is_held)
        self.model = engine_model(spec, robot.base)
        self._data = mujoco.MjData(self.model)
        self._with_friction = False
        self._base = self._data.body(names[robot.base_link])
        self._tip = self._data.body(names[robot.tip_link])
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in robot.joint_names])
        self._rates = np.array([self.model.joint(name).dofadr[0] for name in robot.joint_names])
        # Joints that follow others, and the rates of all by those that move by themselves.
        self._followers, coupling = list[tuple[int, int, Drive]](), np.eye(self.model.nv)
        for name, drive in mimics(robot.urdf).items():
            one, other = (self.model.joint(joint) for joint in (name, drive.of))
            self._followers.append((one.qposadr[0], other.qposadr[0], drive))
            coupling[one.dofadr[0], [one.dofadr[0], other.dofadr[0]]] = 0.0, drive.multiplier
        self._alone = np.flatnonzero(coupling.any(axis=0))
        self._coupling = coupling[:, self._alone]
        self._root = self._data.body(1).id  # 0 is the universe
        self._size = self.model.nq + (4 if self._is_held else 0)  # of a state's positions
        # MuJoCo's numbers of links: 0 is the universe, 1 the root link.
        self.chaser_bodies = np.flatnonzero(self.model.body_weldid == 1)
        self.arm_bodies = np.flatnonzero(self.model.body_weldid > 1)

    @property
    def mass(self) -> float:
        """Mass of the whole system [kg]."""
        return float(self.model.body_subtreemass[0])

    def state(self, start: SystemState) -> Array:
        """Return the state vector of a system state."""
        data = self._data
        mujoco.mj_resetData(self.model, data)
        # The root link in the inertial frame.
        if self._is_held:
            self.model.body_quat[self._root] = [1.0, 0.0, 0.0, 0.0]
        else:
            data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        data.qpos[self._joints] = start.joint_positions
        self._let_follow()
        mujoco.mj_kinematics(self.model, data)
        chaser_in_root, chaser_to_root = self._chaser_position(), _rotation(self._base)
        chaser = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw)
        root = chaser * chaser_to_root.inv()
        root_to_inertial = root.as_matrix()
        root_from_chaser = -root_to_inertial @ chaser_in_root
        omega = start.angular_velocity_chaser_in_inertial
        data.qvel[self._rates] = start.joint_velocities
        data.qvel[:] = self._coupling @ data.qvel[self._alone]
        first, second = self._of_base
        velocity = start.linear_velocity_chaser_in_inertial + np.cross(omega, root_from_chaser)
        return np.concatenate(
            [
                start.position_chaser_in_inertial + root_from_chaser,
                np.roll(root.as_quat(), 1),
                data.qpos[first:],
                velocity,
                root_to_inertial.T @ omega,
                data.qvel[second:],
            ]
        )

    def _let_follow(self) -> None:
        """Put joints that follow others where these put them."""
        positions = self._data.qpos
        for one, other, drive in self._followers:
            positions[one] = drive.multiplier * positions[other] + drive.offset

    def center_of_mass(self, start: SystemState) -> tuple[Array, Array]:
        """Return the whole system's centre of mass [m] and its velocity [m/s], both inertial."""
        # Next to the chaser: far away, or where all moves fast, digits would be lost.
        beside = replace(
            start,
            position_chaser_in_inertial=np.zeros(3),
            linear_velocity_chaser_in_inertial=np.zeros(3),
        )
        self._forward(self.state(beside))
        mujoco.mj_subtreeVel(self.model, self._data)
        return (
            start.position_chaser_in_inertial + self._data.subtree_com[0],
            start.linear_velocity_chaser_in_inertial + self._data.subtree_linvel[0],
        )

    def derivative(self, state: Array, joint_torques: Array) -> Array:
        """Return the rate of change of a state under joint torques [N m]: forward dynamics."""
        data = self._data
        data.qfrc_applied[self._rates] = joint_torques
        self._forward(state)
        rate = np.zeros_like(state)
        position_rate, velocity_rate = np.split(rate, [self._size])
        _, velocity = np.split(state, [self._size])
        position_rate[:3], position_rate[7:] = velocity[:3], velocity[6:]
        accelerations = self._accelerations()
        if self._is_held:
            along_slides = Rotation.from_quat(np.roll(state[3:7], -1)).apply(accelerations[:3])
            velocity_rate[:3], velocity_rate[6:] = along_slides, accelerations[3:]
            return rate
        mujoco.mju_mulQuat(
            position_rate[3:7], state[3:7], np.concatenate([[0.0], velocity[3:6] / 2])
        )
        velocity_rate[:] = accelerations
        return rate

    def _accelerations(self) -> Array:
        """Return those of all joints: MuJoCo's, or of d'Alembert's principle where some follow.

        G^T (M G a + h) = G^T f, with the rates G v of all joints by those that move by themselves.
        MuJoCo's own constraint of a joint is soft; with dry friction it is what there is.
        """
        data, G = self._data, self._coupling
        if G.shape[0] != G.shape[1] and not self._with_friction:
            inertia = np.empty_like(G.T)  # M G
            for row, column in zip(inertia, G.T.copy(), strict=True):
                mujoco.mj_mulM(self.model, data, row, column)
            forces = data.qfrc_applied + data.qfrc_passive - data.qfrc_bias
            data.qacc[:] = G @ np.linalg.solve(inertia @ G, G.T @ forces)
        return np.asarray(data.qacc, np.float64)

    def holding_torque(self, state: Array, joint_torques: Array) -> Array:
        """Return the torque that keeps a held base from rotating, in base link axes, (3,) [N m].

        It is the constraint torque of the prismatic joints on the root link.
        """
        data = self._data
        data.qfrc_applied[self._rates] = joint_torques
        self._forward(state)
        self._accelerations()
        mujoco.mj_rnePostConstraint(self.model, data)
        torque: Array = _rotation(self._base).inv().apply(data.cfrc_int[self._root, :3])
        return torque

    def observe(self, state: Array) -> Observation:
        """Return poses, momentum and end-effector twist of a state."""
        data = self._data
        self._forward(state)
        mujoco.mj_subtreeVel(self.model, data)
        linear = self.model.body_subtreemass[0] * data.subtree_linvel[0]
        angular = data.subtree_angmom[0] + np.cross(data.subtree_com[0], linear)
        twist = np.empty(6)  # the angular velocity first
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, data, kind, self._tip.id, twist, 0)
        return Observation(
            chaser_position=self._chaser_position(),
            chaser_quaternion_xyzw=_rotation(self._base).as_quat(),
            ee_position=self._tip.xpos.copy(),
            ee_quaternion_xyzw=_rotation(self._tip).as_quat(),
            momentum=np.concatenate([linear, angular]),
            ee_twist=np.roll(twist, 3),
        )

    def joints(self, state: Array) -> tuple[Array, Array]:
        """Return joint positions and velocities of a state, in the robot's order of joints."""
        first, second = self._of_base
        rates = state[self._size :]
        return state[self._joints + 7 - first], rates[self._rates + 6 - second]

    def links_moved_by(self, joint: str) -> NDArray[np.int64]:
        """Return MuJoCo's numbers of the link that a joint moves and of links fixed to that."""
        moved = self.model.joint(joint).bodyid[0]
        return np.flatnonzero(self.model.body_weldid == self.model.body_weldid[moved])

    def scale_inertias(self, bodies: NDArray[np.int64], masses: Array, inertias: Array) -> None:
        """Scale masses, and inertias about the centres of mass, by a factor for each link.

        Args:
            bodies: MuJoCo's numbers of the links. Shape (links,), as of the factors.
        """
        self.model.body_mass[bodies] *= masses
        self.model.body_inertia[bodies] *= inertias[:, None]
        mujoco.mj_setConst(self.model, self._data)

    def add_friction(self, viscous: Array, dry: Array) -> None:
        """Set viscous friction [N m s/rad] and the limit of dry friction [N m] of each joint."""
        self.model.dof_damping[self._rates] = viscous
        self.model.dof_frictionloss[self._rates] = dry
        # By default a joint that friction holds would still get a tenth of its acceleration.
        self.model.dof_solimp[self._rates, :2] = 0.999
        self._with_friction = bool(dry.any())
        self.model.eq_active0[:] = self._data.eq_active[:] = self._with_friction

    @property
    def _of_base(self) -> tuple[int, int]:
        """Numbers of MuJoCo's positions and velocities that are the base's."""
        return (3, 3) if self._is_held else (7, 6)

    def _forward(self, state: Array) -> None:
        data = self._data
        positions, velocities = np.split(state, [self._size])
        if self._is_held:
            self.model.body_quat[self._root] = positions[3:7]
            to_slides = Rotation.from_quat(np.roll(positions[3:7], -1)).inv()
            positions = np.append(to_slides.apply(positions[:3]), positions[7:])
            velocities = np.append(to_slides.apply(velocities[:3]), velocities[6:])
        data.qpos[:], data.qvel[:] = positions, velocities
        mujoco.mj_forward(self.model, data)

    def _chaser_position(self) -> Array:
        masses = self.model.body_mass[self.chaser_bodies]
        return np.asarray(masses @ self._data.xipos[self.chaser_bodies] / masses.sum(), np.float64)


def _rotation(body: Any) -> Rotation:
    """Return the rotation from a link's axes to inertial axes."""
    return Rotation.from_quat(np.roll(body.xquat, -1))
