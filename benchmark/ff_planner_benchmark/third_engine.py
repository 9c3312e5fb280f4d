"""A plan in Basilisk: a third engine, with dynamics of spinning bodies of its own.

It has no shapes: nothing tells how near bodies come. Nothing else needs Basilisk.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.gallery.motions import Moved, at_start
from ff_planner_benchmark.parts import parts_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.simulation.deviation import Deviation
from ff_planner_ros.simulation.feed_forward import feed_forward
from ff_planner_ros.simulation.other_engines import Flown

try:
    from Basilisk.architecture import messaging
    from Basilisk.simulation import (
        prescribedRotation1DOF,
        spacecraft,
        spinningBodyNDOFStateEffector,
    )
    from Basilisk.utilities import SimulationBaseClass
except ModuleNotFoundError:
    raise FfPlannerError(
        Status.UNSUPPORTED,
        "flying a plan in the third engine needs Basilisk: pip install './benchmark[basilisk]'",
    ) from None

# Steps between two points of a plan. In each the torque is that of its middle: the error falls with
# the square of the step.
_STEPS_PER_POINT = 200
# A body lighter than this has no mass in Basilisk, which refuses none [kg].
_LIGHTEST = 1e-5
_NANO = 1e9


class _Simulated(NamedTuple):
    """A simulation and what is read from it."""

    simulation: Any
    hub: Any
    arm: Any
    torques: Any  # message that the motors read


def flown(robot: Robot, trajectory: Trajectory, _scene: Scene, parts: int) -> Flown:
    """Execute a plan's torques open loop in Basilisk, in parts that each begin on the plan.

    As in `verify`, the sum of the parts' deviations is multiplied by the number of parts.

    Raises:
        FfPlannerError: The base is held, or a joint is prismatic.
    """
    if robot.base is Base.ATTITUDE_HELD or robot.has_slides:
        words = "Basilisk executes plans of free bases and revolute joints alone"
        raise FfPlannerError(Status.UNSUPPORTED, words)
    off = [_deviation(robot, part) for _, part in parts_of(trajectory, parts)]
    total = Deviation(*(parts * np.sum(off, axis=0)).tolist())
    return Flown(f"Basilisk {version('bsk')}", total, "", 0.0, np.inf)


def _deviation(robot: Robot, trajectory: Trajectory) -> tuple[float, ...]:
    """Return the fields of a `Deviation` of one part."""
    q, v = from_trajectory(robot, trajectory)
    command = feed_forward(robot, trajectory, _STEPS_PER_POINT)
    middles = command.torques[1::2]
    step = round(_NANO * float(trajectory.time[1]) / _STEPS_PER_POINT)
    made = _simulated(robot, q[0], v[0], step)
    reached = [q[0]]
    for number, torque in enumerate(middles):
        # Read after the step that ends here, so it is of the next one.
        _write(made.torques, torque)
        _run_to(made, number * step)
        if number and number % _STEPS_PER_POINT == 0:
            reached.append(_configuration(robot, made))
    _run_to(made, len(middles) * step)
    reached.append(_configuration(robot, made))
    there = Moved(robot, trajectory.time, np.array(reached))
    planned = Moved(robot, trajectory.time, q)
    ends = planned.ee().actInv(there.ee())
    of_chaser = [_chaser(robot, one.q) for one in (planned, there)]
    places, attitudes = zip(*of_chaser, strict=True)
    turned = (attitudes[0].inv() * attitudes[1]).magnitude()
    return (
        float(np.linalg.norm(planned.ee().translation - there.ee().translation)),
        float(np.linalg.norm(pin.log3(ends.rotation))),
        float(np.linalg.norm(places[0] - places[1], axis=1).max()),
        float(turned.max()),
    )


def _chaser(robot: Robot, q: Array) -> tuple[Array, Rotation]:
    attitude = Rotation.from_quat(q[:, 3:7])
    return q[:, :3] + attitude.apply(robot.position_chaser_in_base.copy()), attitude


def robotic_arm(
    robot: Robot, goals: Array, accelerations: Array, seconds: float, step: float
) -> Moved:
    """Run Basilisk's scenarioRoboticArm without gravity, and return its motion.

    Springs of 500 N m/rad and 100 N m s/rad hold the joints on its own profiler's motion.

    Args:
        robot: Of the gallery.
        goals: Of the joints. Shape (joints,) [rad].
        accelerations: Largest of the profile. Shape (joints,) [rad/s2].
        seconds: That are simulated.
        step: Of the integration [s].
    """
    start = at_start(robot, np.zeros(robot.joints))
    made = _simulated(
        robot, start, np.zeros(robot.model.nv), round(_NANO * step), stiffness=500.0, damping=100.0
    )
    for joint, (goal, most) in enumerate(zip(goals, accelerations, strict=True)):
        profiler = prescribedRotation1DOF.PrescribedRotation1DOF()
        profiler.setThetaDDotMax(float(most))
        profiler.setThetaInit(0.0)
        profiler.setSmoothingDuration(10.0)
        asked = messaging.HingedRigidBodyMsgPayload(theta=float(goal), thetaDot=0.0)
        made.simulation.kept.append(messaging.HingedRigidBodyMsg().write(asked))
        profiler.spinningBodyInMsg.subscribeTo(made.simulation.kept[-1])
        made.arm.spinningBodyRefInMsgs[joint].subscribeTo(profiler.spinningBodyOutMsg)
        made.simulation.AddModelToTask("task", profiler)
        made.simulation.kept.append(profiler)
    made.simulation.InitializeSimulation()
    reached, times = [start], np.arange(0.0, seconds + 0.5, 1.0)
    for time in times[1:]:
        _run_to(made, round(_NANO * float(time)))
        reached.append(_configuration(robot, made))
    return Moved(robot, times, np.array(reached))


def _simulated(
    robot: Robot, q: Array, v: Array, step: int, stiffness: float = 0.0, damping: float = 0.0
) -> _Simulated:
    """Return a simulation that begins in a state, with a step in nanoseconds.

    With springs it waits for what they follow; without, torques drive the joints.
    """
    simulation: Any = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    hub, arm = (
        spacecraft.Spacecraft(),
        spinningBodyNDOFStateEffector.SpinningBodyNDOFStateEffector(),
    )
    body = robot.model.inertias[1]
    hub.hub.mHub = body.mass
    hub.hub.r_BcB_B = _column(body.lever)
    hub.hub.IHubPntBc_B = np.array(body.inertia).tolist()
    data, attitude = robot.model.createData(), Rotation.from_quat(q[3:7])
    center = pin.centerOfMass(robot.model, data, q, v)
    hub.hub.r_CN_NInit, hub.hub.v_CN_NInit = _column(center), _column(data.vcom[0])
    hub.hub.sigma_BNInit = _column(attitude.as_mrp())
    hub.hub.omega_BN_BInit = _column(v[3:6])
    for joint in range(robot.joints):
        arm.addSpinningBody(_spinning(robot, joint, q[7:], v[6:], stiffness, damping))
    hub.addStateEffector(arm)
    torques: Any = messaging.ArrayMotorTorqueMsg()
    if not stiffness:
        _write(torques, np.zeros(robot.joints))
        arm.motorTorqueInMsg.subscribeTo(torques)
    simulation.AddModelToTask("task", hub)
    simulation.AddModelToTask("task", arm)
    simulation.kept = [hub, arm, torques]  # Basilisk holds no references of its own
    if not stiffness:
        simulation.InitializeSimulation()
    return _Simulated(simulation, hub, arm, torques)


def _spinning(
    robot: Robot, joint: int, positions: Array, rates: Array, stiffness: float, damping: float
) -> Any:
    """Return the body that a joint moves."""
    spinning, body = spinningBodyNDOFStateEffector.SpinningBody(), robot.model.inertias[joint + 2]
    place = robot.model.jointPlacements[joint + 2]
    has_mass = body.mass > _LIGHTEST
    spinning.setMass(body.mass if has_mass else 0.0)
    spinning.setISPntSc_S((np.array(body.inertia) * has_mass).tolist())
    spinning.setR_ScS_S(_column(body.lever))
    spinning.setR_SP_P(_column(place.translation))
    spinning.setDCM_S0P(place.rotation.T.tolist())
    spinning.setSHat_S(_column(robot.joint_axes[joint]))
    spinning.setThetaInit(float(positions[joint]))
    spinning.setThetaDotInit(float(rates[joint]))
    spinning.setK(stiffness)
    spinning.setC(damping)
    return spinning


def _column(vector: Array) -> Sequence[Sequence[float]]:
    return [[float(one)] for one in vector]


def _write(message: Any, torques: Array) -> None:
    message.write(messaging.ArrayMotorTorqueMsgPayload(motorTorque=torques.tolist()))


def _run_to(made: _Simulated, nanoseconds: int) -> None:
    made.simulation.ConfigureStopTime(nanoseconds)
    made.simulation.ExecuteSimulation()


def _configuration(robot: Robot, made: _Simulated) -> Array:
    """Return the configuration that the simulation is in."""
    state = made.hub.scStateOutMsg.read()
    joints = [made.arm.spinningBodyOutMsgs[joint].read().theta for joint in range(robot.joints)]
    attitude = Rotation.from_mrp(state.sigma_BN).as_quat()
    return np.concatenate([state.r_BN_N, attitude, joints])
