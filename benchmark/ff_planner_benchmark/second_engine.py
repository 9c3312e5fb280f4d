"""A plan in Drake: an engine with dynamics and an integrator of its own, beside MuJoCo.

Basilisk would fly an arm of several joints by MuJoCo, too; Drake shares nothing with it. Nothing
else needs Drake.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import angular_momenta
from ff_planner_ros.robot.urdf.payload import payload_frame
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice
from ff_planner_ros.robot.urdf.urdf_xml import INERTIA
from ff_planner_ros.simulation.feed_forward import feed_forward

try:  # others have Drake from here: what its absence means is told once
    from pydrake import geometry as geometry
    from pydrake.common.value import AbstractValue as AbstractValue
    from pydrake.math import RigidTransform as RigidTransform
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, SpatialInertia
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import TrajectorySource
    from pydrake.trajectories import PiecewisePolynomial
except ModuleNotFoundError:
    raise FfPlannerError(
        Status.UNSUPPORTED,
        "flying a plan in the second engine needs Drake: pip install './benchmark[drake]'",
    ) from None

# Samples of the torques between two points of a plan, linear between them, and relative accuracy of
# the integration. Both leave errors below a thousandth of a millimetre.
_STEPS_PER_POINT, _ACCURACY = 60, 1e-10
# The torque that holds a base depends on accelerations, and those of a light wrist need more; so
# does an arm that is light beside its payload, and diverges from the plan without control.
_MORE_STEPS = 960
# The longest step [s].
_STEP = 0.01


class Miss(NamedTuple):
    """Deviations of the motion in Drake from the plan."""

    position: float  # of the end effector at the end [m]
    orientation: float  # of the end effector at the end [rad]
    chaser: float  # of its centre of mass, at the worst point [m]
    chaser_orientation: float  # at the worst point [rad]
    # Largest difference about any axis, at the points, between the torque that holds the base and
    # the plan's wheel torque [N m]; zero: no wheels hold the base
    holding_torque: float


# Told at each point of a plan: Drake's poses of the chaser and of the link that each joint moves,
# and the time [s].
Look = Callable[[Sequence[Any], float], None]


def flown_in_drake(
    robot: Robot, trajectory: Trajectory, look: Look | None = None, finer: int = 1
) -> Miss:
    """Execute a plan's torques open loop in Drake, from the plan's first state.

    Drake reads the URDF itself. A planar base floats freely: nothing lifts it off its plane. A base
    that wheels hold is on three prismatic joints along the axes of its root link. Nothing exerts a
    contact force: shapes are looked at by `look` alone.

    Args:
        finer: Factor of the number of samples of the torques.
    """
    if ElementTree.fromstring(robot.drawn_urdf).get(INERTIA) == InertiaChoice.AS_GIVEN:
        allowed = "Drake counts possible inertias alone, as with nearest_possible"
        raise InvalidInput(Status.UNSUPPORTED, "robot.inertia", InertiaChoice.AS_GIVEN, allowed)
    is_held = robot.base is Base.ATTITUDE_HELD
    to_base = Rotation.from_matrix(robot.rotation_chaser_to_base)
    attitudes = Rotation.from_quat(trajectory.chaser_quaternions_xyzw)
    turn = attitudes[0] * to_base.inv()
    builder = DiagramBuilder()
    plant: Any = builder.AddSystem(MultibodyPlant(0.0))  # Drake's stubs take it for any system
    Parser(plant).AddModelsFromString(_without_shapes(robot.drawn_urdf), "urdf")
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    base = plant.GetBodyByName(robot.base_link)
    slides = _slides(plant, base, turn) if is_held else []
    plant.Finalize()
    joints = [plant.GetJointByName(name) for name in robot.joint_names]
    needs_more = is_held or payload_frame(robot) is not None
    steps = _MORE_STEPS if needs_more else _STEPS_PER_POINT
    command = feed_forward(robot, trajectory, finer * steps)
    forces = np.zeros((plant.num_velocities(), len(command.time)))
    for joint, torques in zip(joints, command.torques.T, strict=True):
        forces[joint.velocity_start()] = torques
    drives = builder.AddSystem(
        TrajectorySource(PiecewisePolynomial.FirstOrderHold(command.time, forces))
    )
    builder.Connect(drives.get_output_port(), plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    integrator = ResetIntegratorFromFlags(simulator, "runge_kutta3", _STEP)
    integrator.set_target_accuracy(_ACCURACY)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    tip = plant.GetBodyByName(robot.tip_link)
    # A plan tells of the chaser's centre of mass, in the axes of the base link
    center = np.array(robot.position_chaser_in_base)
    lever, rate = turn.apply(center), trajectory.chaser_angular_velocities[0]
    place = trajectory.chaser_positions[0] - lever
    velocity = trajectory.chaser_linear_velocities[0] - np.cross(rate, lever)
    moving = [(joint, *start) for joint, *start in zip(joints, *_starts(trajectory), strict=True)]
    if is_held:
        seen = turn.inv().apply([place, velocity])
        moving += [(slide, *start) for slide, *start in zip(slides, *seen, strict=True)]
    else:
        plant.SetFreeBodyPose(context, base, RigidTransform(as_pose(turn.as_matrix(), place)))
        plant.SetFreeBodySpatialVelocity(
            context=context, body=base, V_JpJc=SpatialVelocity(rate, velocity)
        )
    positions, speeds = plant.GetPositions(context), plant.GetVelocities(context)
    for joint, position, speed in moving:
        positions[joint.position_start()] = position
        speeds[joint.velocity_start()] = speed
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, speeds)
    simulator.Initialize()
    worst, worst_turn, held_by = 0.0, 0.0, []
    planned_poses = zip(trajectory.time, trajectory.chaser_positions, attitudes, strict=True)
    for time, planned, attitude in planned_poses:
        simulator.AdvanceTo(float(time))
        pose = plant.EvalBodyPoseInWorld(context, base)
        worst = max(worst, float(np.linalg.norm(pose.multiply(center) - planned)))
        turned = Rotation.from_matrix(pose.rotation().matrix()) * to_base
        worst_turn = max(worst_turn, float((attitude.inv() * turned).magnitude()))
        if look is not None:
            links = [base, *(joint.child_body() for joint in joints)]
            look([plant.EvalBodyPoseInWorld(context, link) for link in links], float(time))
        if is_held:
            reactions = plant.get_reaction_forces_output_port().Eval(context)
            held_by.append(reactions[int(slides[-1].index())].rotational())
    off_wheels = 0.0
    if is_held:  # Drake tells it in the root link's axes, the plan in those of the base link
        q, v = from_trajectory(robot, trajectory)
        _, rates = angular_momenta(robot, q, v, trajectory.joint_accelerations)
        in_base = np.array(held_by) @ robot.rotation_chaser_to_base
        off_wheels = float(np.abs(in_base - rates).max())
    reached = plant.EvalBodyPoseInWorld(context, tip)
    wanted = Rotation.from_quat(trajectory.ee_quaternions_xyzw[-1])
    off = wanted.inv() * Rotation.from_matrix(reached.rotation().matrix())
    missed = float(np.linalg.norm(reached.translation() - trajectory.ee_positions[-1]))
    return Miss(missed, float(off.magnitude()), worst, worst_turn, off_wheels)


def _starts(trajectory: Trajectory) -> tuple[Array, Array]:
    return trajectory.joint_positions[0], trajectory.joint_velocities[0]


def _slides(plant: Any, base: Any, turn: Rotation) -> list[Any]:
    """Put the base on three prismatic joints along its own axes, and return them."""
    turned = plant.AddFrame(
        FixedOffsetFrame(
            "turned", plant.world_frame(), RigidTransform(as_pose(turn.as_matrix(), np.zeros(3)))
        )
    )
    slides, parent = [], turned
    for name, axis in zip("xyz", np.eye(3), strict=True):
        last = name == "z"
        # What is between two slides weighs nothing.
        child = base
        if not last:
            instance = base.model_instance()
            child = plant.AddRigidBody(f"on_{name}", instance, SpatialInertia.Zero())
        # Drake's stubs take the types of an array for its shape
        along: Any = axis
        slide = PrismaticJoint(f"slide_{name}", parent, child.body_frame(), along)
        slides.append(plant.AddJoint(slide))
        parent = child.body_frame()
    return slides


def as_pose(rotation: Array, position: Array) -> Any:
    """Return a pose as a matrix, of which Drake makes its own. Shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def _without_shapes(urdf: str) -> str:
    """Return a URDF without collision and visual shapes."""
    tree = ElementTree.fromstring(urdf)
    for link in tree.findall("link"):
        for kind in ("collision", "visual"):
            for shape in link.findall(kind):
                link.remove(shape)
    return ElementTree.tostring(tree, encoding="unicode")
