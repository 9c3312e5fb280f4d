"""Conversion of planning objects to messages: pure functions, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from ff_planner_msgs.msg import (
    ChaserState,
    Goal,
    ObstacleSphere,
    PlanRequest,
    Scene,
    WheelPoint,
)
from ff_planner_msgs.msg import Obstacle as ObstacleMessage
from ff_planner_msgs.msg import Payload as PayloadMessage
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from shape_msgs.msg import Mesh, SolidPrimitive
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared_messages import write_object
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.messages.obstacles import in_message
from ff_planner_ros.parameters.controller import ERASED, ControllerParameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, SphereEntry
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import AttachedSphereEntry, TargetBody
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.planning.task.controller_rules import REST
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.collision.solids import MESH, MeshFile
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.payload import HeldShape, Payload
from ff_planner_ros.ros.messages.foreign import FollowJointTrajectory, JointTolerance
from ff_planner_ros.ros.messages.interfaces import entry_of
from ff_planner_ros.ros.messages.paths import goal_of_path

# What a goal of the joints has in common with one of the end effector.
_BESIDE_JOINTS = ("allowed_collisions", "chaser_rotation", "chaser_attitude")


def request_message(problem: PlanningProblem, inertial_frame: str) -> PlanRequest:
    """Write a problem as a request, without its state, obstacles and target body."""
    request: PlanRequest = write_object(problem, PlanRequest(), entry_of)
    request.goal.pose.header.frame_id = inertial_frame
    if problem.duration_range is not None:
        write_object(problem.duration_range, request, entry_of)
    if problem.target_body is not None:
        request.goal.kind = Goal.CAPTURE
    if problem.posture is not None:
        request.goal = goal_of_joints(request.goal, problem.posture, problem.robot.joint_names)
    if problem.path is not None:
        may_touch = request.goal.allowed_collisions
        request.goal = goal_of_path(problem.path, request.limits, inertial_frame, may_touch)
    return request


def payload_message(payload: Payload) -> PayloadMessage:
    """Write a payload as a message, with its shapes."""
    message: PayloadMessage = write_object(replace(payload, shapes=()), PayloadMessage(), entry_of)
    message.bodies = [_body_message(one) for one in payload.shapes]
    return message


def goal_of_joints(goal: Goal, posture: Posture, joint_names: Sequence[str]) -> Goal:
    """Write a joint goal, or the goal at rest, as a message, with the rest of a goal."""
    kept = {name: getattr(goal, name) for name in _BESIDE_JOINTS}
    if posture.positions is None:
        return Goal(kind=Goal.AT_REST, **kept)
    joints = JointState(name=list(joint_names), position=posture.positions.tolist())
    if posture.velocities is not None:
        joints.velocity = posture.velocities.tolist()
    return Goal(kind=Goal.JOINTS, joints=joints, **kept)


def state_message(
    state: SystemState, joint_names: Sequence[str], stamp_ns: int, inertial_frame: str
) -> ChaserState:
    """Write a state, measured at stamp_ns [ns], as a message."""
    header = _header(stamp_ns, inertial_frame)
    message: ChaserState = write_object(
        state, ChaserState(header=header, joint_names=list(joint_names)), entry_of
    )
    if state.wheel_momenta is not None:
        message.wheel_momenta = state.wheel_momenta.tolist()
    return message


def scene_message(
    obstacles: Sequence[Obstacle], stamp_ns: int, inertial_frame: str, source: str = ""
) -> Scene:
    """Write obstacles at stamp_ns [ns], without those fixed to a target body, as a scene.

    Args:
        source: Who publishes the scene; empty: it belongs to a request.
    """
    free = [one for one in obstacles if one.body is None]
    return Scene(
        header=_header(stamp_ns, inertial_frame),
        source=source,
        spheres=[_sphere_message(SphereEntry.of(one)) for one in free if one.is_sphere],
        bodies=[_body_message(one) for one in free if not one.is_sphere],
    )


def target_body_message(body: TargetBody, stamp_ns: int, inertial_frame: str) -> TargetBodyMessage:
    """Write a target body at stamp_ns [ns], with all that is fixed to it, as a message."""
    message = TargetBodyMessage(header=_header(stamp_ns, inertial_frame))
    write_object(replace(body, obstacles=()), message, entry_of)
    fixed = body.obstacles
    message.obstacles = [
        _sphere_message(AttachedSphereEntry.of(one)) for one in fixed if one.is_sphere
    ]
    message.bodies = [_body_message(one) for one in fixed if not one.is_sphere]
    return message


def plan_message(
    plan: Plan, start_ns: int, inertial_frame: str, captured: CapturedBody | None = None
) -> PlanMessage:
    """Write a plan as a message; the field `geometry` stays empty.

    Args:
        start_ns: Time of the plan's first point [ns].
        captured: The body that the plan captures; None: none.
    """
    motion = plan.trajectory
    offsets_ns = np.rint(motion.time * NANOSECONDS).astype(np.int64).tolist()
    headers = [_header(start_ns + t, inertial_frame) for t in offsets_ns]
    joint_trajectory = JointTrajectory(
        header=headers[0],
        joint_names=list(plan.joint_names),
        points=[
            JointTrajectoryPoint(
                positions=positions,
                velocities=velocities,
                accelerations=accelerations,
                effort=torques,
                time_from_start=Duration(sec=t // NANOSECONDS, nanosec=t % NANOSECONDS),
            )
            for t, positions, velocities, accelerations, torques in zip(
                offsets_ns,
                motion.joint_positions.tolist(),
                motion.joint_velocities.tolist(),
                motion.joint_accelerations.tolist(),
                motion.joint_torques.tolist(),
                strict=True,
            )
        ],
    )
    message = PlanMessage(
        family=plan.family,
        xi=plan.xi.tolist(),
        orientation_reading=plan.orientation_reading,
        duration=plan.duration or 0.0,
        effort=plan.effort,
        joint_trajectory=joint_trajectory,
        chaser_path=_path(headers, motion.chaser_positions, motion.chaser_quaternions_xyzw),
        chaser_twists=_twists(motion.chaser_linear_velocities, motion.chaser_angular_velocities),
        end_effector_path=_path(headers, motion.ee_positions, motion.ee_quaternions_xyzw),
        end_effector_twists=_twists(motion.ee_linear_velocities, motion.ee_angular_velocities),
    )
    if plan.wheels is not None:
        rows = zip(plan.wheels.momenta.tolist(), plan.wheels.torques.tolist(), strict=True)
        message.wheels = [WheelPoint(momenta=momenta, torques=given) for momenta, given in rows]
    if captured is not None:
        there = captured.along(motion)
        message.target_path = _path(headers, there.positions, there.quaternions_xyzw)
        message.target_twists = _twists(there.linear_velocities, there.angular_velocities)
    return message


def controller_message(trajectory: JointTrajectory, effort_interface: bool) -> JointTrajectory:
    """Return the trajectory for the controller; without torques if it takes no effort."""
    if effort_interface:
        return trajectory
    return JointTrajectory(
        header=trajectory.header,
        joint_names=trajectory.joint_names,
        points=[
            JointTrajectoryPoint(
                positions=point.positions,
                velocities=point.velocities,
                accelerations=point.accelerations,
                time_from_start=point.time_from_start,
            )
            for point in trajectory.points
        ],
    )


def controller_goal(trajectory: JointTrajectory, settings: ControllerParameters) -> Any:
    """Return the goal for a trajectory, with the tolerances of the parameters."""
    nanoseconds = round(settings.goal_time_tolerance * NANOSECONDS)
    return FollowJointTrajectory.Goal(
        trajectory=trajectory,
        path_tolerance=_tolerances(trajectory, settings.path_tolerance),
        goal_tolerance=_goal_tolerances(trajectory, settings.goal_tolerance),
        goal_time_tolerance=Duration(
            sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS
        ),
    )


def _goal_tolerances(trajectory: JointTrajectory, position: float) -> list[Any]:
    """Return the tolerances at the end, where joints that are to move need not have stopped."""
    told = {one.name: one for one in _tolerances(trajectory, position)}
    for point in trajectory.points[-1:]:
        for name, rate in zip(trajectory.joint_names, point.velocities, strict=False):
            if abs(rate) > REST:
                told.setdefault(name, JointTolerance(name=name)).velocity = ERASED
    return list(told.values())


def _tolerances(trajectory: JointTrajectory, position: float) -> list[Any]:
    """Return one tolerance for every joint; none at zero: the controller's own then holds."""
    if not position:
        return []
    return [JointTolerance(name=name, position=position) for name in trajectory.joint_names]


def time_message(time_ns: int) -> Time:
    """Return a time in nanoseconds as a message."""
    return Time(sec=time_ns // NANOSECONDS, nanosec=time_ns % NANOSECONDS)


def pose_message(position: Sequence[float], quaternion_xyzw: Sequence[float]) -> Pose:
    """Return a position, shape (3,) [m], and a quaternion, shape (4,), as a message's pose."""
    x, y, z, w = quaternion_xyzw
    return Pose(position=point_message(position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def point_message(position: Sequence[float]) -> Point:
    """Return a position, shape (3,) [m], as a message's point."""
    x, y, z = position
    return Point(x=x, y=y, z=z)


def _header(stamp_ns: int, frame_id: str) -> Header:
    return Header(stamp=time_message(stamp_ns), frame_id=frame_id)


def _sphere_message(entry: AttachedSphereEntry) -> ObstacleSphere:
    message: ObstacleSphere = write_object(entry, ObstacleSphere(), entry_of)
    return message


def _body_message(body: Obstacle | HeldShape) -> ObstacleMessage:
    message: ObstacleMessage = write_object(body, ObstacleMessage(), entry_of)
    shape = body.shape
    if isinstance(shape, MeshFile):
        shape = shape.load(f"obstacles[{body.id}].shape.mesh", Meshes(None))
    if shape.kind == MESH:
        corners = shape.corners.tolist()
        message.mesh = [Mesh(vertices=[Point(x=x, y=y, z=z) for x, y, z in corners])]
    else:
        number, sizes = PRIMITIVES[shape.kind].message, shape.sizes.tolist()
        dimensions = in_message(shape.kind, sizes)
        message.primitive = [SolidPrimitive(type=number, dimensions=dimensions)]
    return message


def _path(headers: Sequence[Header], positions: Array, quaternions_xyzw: Array) -> Path:
    poses = []
    for header, position, quaternion in zip(
        headers, positions.tolist(), quaternions_xyzw.tolist(), strict=True
    ):
        # Filled in: constructors make each part by default, too, and a plan has thousands.
        stamped = PoseStamped()
        stamped.header = header
        place, turn = stamped.pose.position, stamped.pose.orientation
        place.x, place.y, place.z = position
        turn.x, turn.y, turn.z, turn.w = quaternion
        poses.append(stamped)
    return Path(header=headers[0], poses=poses)


def _twists(linear_velocities: Array, angular_velocities: Array) -> list[Twist]:
    twists = []
    for linear, angular in zip(
        linear_velocities.tolist(), angular_velocities.tolist(), strict=True
    ):
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.linear.z = linear
        twist.angular.x, twist.angular.y, twist.angular.z = angular
        twists.append(twist)
    return twists
