"""A whole capture in MuJoCo: robot and target are two free bodies until a weld joins them.

The joints get the plan's torques and a PD correction of their deviations. At the grasp the weld is
switched on in the bodies' present poses: a robot with a payload is used for the torques alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import mass_matrix
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.feed_forward import feed_forward
from ff_planner_ros.simulation.mujoco_model import compiled, mujoco, specification

# Step of MuJoCo [s], and time constant of the weld in steps.
_STEP, _STIFF = 1e-3, 2.0
# Bandwidth of the control [rad/s], and number of steps after which its inertia is updated.
_CONTROL, _RENEWED = 20.0, 20
_STEPS_PER_POINT = 40  # of the torques
_BODY = "captured body"
_WELD = "grasp"


@dataclass(frozen=True)
class Reached:
    """Position and orientation errors at the end of a phase."""

    end_effector: tuple[float, float]  # from the plan [m], [rad]
    chaser: tuple[float, float]  # from the plan [m], [rad]
    grasp: tuple[float, float]  # of the end effector from the body's grasp [m], [rad]


def fly(task: PlanningTask, plan: Plan) -> list[Reached]:
    """Execute a plan that captures a body in its first phase; return the errors after each phase.

    Raises:
        InvalidInput: The first phase captures nothing, or the base is not free.
    """
    body, robot = task.problem.target_body, task.problem.robot
    allowed = "a whole capture is flown by a free chaser that captures a body first"
    if robot.base is not Base.FREE_FLYER:
        raise InvalidInput(Status.UNSUPPORTED, "robot.base", robot.base.value, allowed)
    if body is None:
        raise InvalidInput(Status.UNSUPPORTED, "target_body", "missing", allowed)
    flight = _Flight(robot, body, state_at(plan.trajectory, 0))
    reached = list[Reached]()
    for one, found in phase_tasks(task, plan):
        if reached:
            flight.hold()
        reached.append(flight.through(one.problem.robot, found))
    return reached


class _Flight:
    """Robot and target body in MuJoCo, in their present states."""

    def __init__(self, robot: Robot, body: TargetBody, start: SystemState) -> None:
        self._engine, self._body = Engine(robot), body
        spec, names = specification(robot.urdf)
        target = spec.worldbody.add_body(name=_BODY)
        target.add_freejoint()
        moments, axes = np.linalg.eigh(body.inertia)
        axes[:, 0] *= np.linalg.det(axes)
        target.mass, target.inertia, target.explicitinertial = body.mass, moments, True
        # To MuJoCo the body's axes are its principal axes.
        self._main_to_body = Rotation.from_matrix(axes)
        weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name, weld.active = _WELD, False
        weld.name1, weld.name2 = names[robot.tip_link], _BODY
        weld.solref, weld.solimp = [_STIFF * _STEP, 1.0], [0.9999, 0.9999, 1e-3, 0.5, 2.0]
        self._model = compiled(spec)
        self._model.opt.gravity, self._model.opt.timestep = 0.0, _STEP
        self._model.dof_damping = self._model.dof_frictionloss = 0.0
        self._model.opt.disableflags = (
            mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        )
        self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self._weld = self._model.equality(_WELD).id
        # All others are of joints that follow others.
        self._model.eq_active0[np.arange(self._model.neq) != self._weld] = True
        self._data, self._tip = mujoco.MjData(self._model), names[robot.tip_link]
        joints = [self._model.joint(name) for name in robot.joint_names]
        self._positions = np.array([joint.qposadr[0] for joint in joints])
        self._rates = np.array([joint.dofadr[0] for joint in joints])
        state = self._engine.state(start)
        own = self._engine.model
        self._data.qpos[: own.nq], self._data.qvel[: own.nv] = state[: own.nq], state[own.nq :]
        main = Rotation.from_quat(body.quaternion_xyzw.copy()) * self._main_to_body
        self._data.qpos[own.nq :] = [*body.position, *np.roll(main.as_quat(), 1)]
        rate = main.inv().apply(body.angular_velocity.copy())
        self._data.qvel[own.nv :] = [*body.linear_velocity, *rate]
        mujoco.mj_forward(self._model, self._data)

    def hold(self) -> None:
        """Weld the body to the end effector in their present poses."""
        tip, body = self._data.body(self._tip), self._data.body(_BODY)
        turn = Rotation.from_quat(np.roll(tip.xquat, -1)).inv()
        place = turn.apply(body.xpos - tip.xpos)
        attitude = turn * Rotation.from_quat(np.roll(body.xquat, -1))
        # MuJoCo's eq_data of a weld: anchor, relative pose, and torque scale.
        numbers = [*np.zeros(3), *place, *np.roll(attitude.as_quat(), 1), 1.0]
        self._model.eq_data[self._weld, : len(numbers)] = numbers
        self._data.eq_active[self._weld] = True

    def through(self, robot: Robot, plan: Plan) -> Reached:
        """Execute a phase, and return the errors at its end.

        Args:
            robot: The robot with the body that it holds, for the torques.
        """
        motion = plan.trajectory
        command = feed_forward(robot, motion, _STEPS_PER_POINT)
        joints, lasts = joint_motion(motion), float(motion.time[-1])
        steps = max(1, round(lasts / _STEP))
        self._model.opt.timestep = lasts / steps
        time = np.linspace(0.0, lasts, steps + 1)[:-1]
        torques = np.array([np.interp(time, command.time, row) for row in command.torques.T]).T
        positions, rates, _ = joints.at(time)
        data = self._data
        for k in range(steps):
            joints_now = data.qpos[self._positions]
            if k % _RENEWED == 0:
                inertia = _joint_inertia(robot, joints_now)
            off, slow = positions[k] - joints_now, rates[k] - data.qvel[self._rates]
            control = inertia @ (_CONTROL**2 * off + 2.0 * _CONTROL * slow)
            data.qfrc_applied[self._rates] = torques[k] + control
            mujoco.mj_step(self._model, data)
        mujoco.mj_forward(self._model, data)
        return self._reached(plan)

    def _reached(self, plan: Plan) -> Reached:
        own, data, motion = self._engine.model, self._data, plan.trajectory
        seen = self._engine.observe(np.concatenate([data.qpos[: own.nq], data.qvel[: own.nv]]))
        body, tip = data.body(_BODY), Rotation.from_quat(seen.ee_quaternion_xyzw)
        attitude = Rotation.from_quat(np.roll(body.xquat, -1)) * self._main_to_body.inv()
        grasp = body.xpos + attitude.apply(self._body.grasp_position.copy())
        turned = attitude * Rotation.from_quat(self._body.grasp_quaternion_xyzw.copy())
        return Reached(
            end_effector=_apart(
                (seen.ee_position, tip),
                (motion.ee_positions[-1], Rotation.from_quat(motion.ee_quaternions_xyzw[-1])),
            ),
            chaser=_apart(
                (seen.chaser_position, Rotation.from_quat(seen.chaser_quaternion_xyzw)),
                (
                    motion.chaser_positions[-1],
                    Rotation.from_quat(motion.chaser_quaternions_xyzw[-1]),
                ),
            ),
            grasp=_apart((seen.ee_position, tip), (grasp, turned)),
        )


def _joint_inertia(robot: Robot, positions: Array) -> Array:
    """Return the joint-space inertia of a free-floating base. Shape (joints, joints)."""
    q = np.concatenate([np.zeros(6), [1.0], positions])
    upper = np.triu(mass_matrix(robot, robot.model.createData(), q))
    mass = upper + np.triu(upper, 1).T
    free: Array = mass[6:, 6:] - mass[6:, :6] @ np.linalg.solve(mass[:6, :6], mass[:6, 6:])
    return free


def _apart(one: tuple[Array, Rotation], other: tuple[Array, Rotation]) -> tuple[float, float]:
    """Return distance [m] and rotation angle [rad] between two poses."""
    turn = (one[1].inv() * other[1]).magnitude()
    return float(np.linalg.norm(one[0] - other[0])), float(turn)
