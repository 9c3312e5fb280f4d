"""Planning objects to messages: pure functions, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import (
    ChaserState,
    ObstacleSphere,
    ObstacleSphereArray,
    PlanMetrics,
    PlanStatus,
    SolverReport,
)
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
from ff_planner_msgs.srv import PlanTrajectory
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from nav_msgs.msg import Path
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.arrays import Array
from ff_planner_ros.bag.decoding import NANOSECONDS
from ff_planner_ros.declared import value_at, write_object
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem, Sphere, TargetBody
from ff_planner_ros.robot.state import SystemState


def request_message(problem: PlanningProblem, inertial_frame: str) -> PlanTrajectory.Request:
    """Write a problem as a request for the latest published state, obstacles and target body."""
    request: PlanTrajectory.Request = write_object(problem, PlanTrajectory.Request())
    request.target_pose.header.frame_id = inertial_frame
    if problem.duration_range is not None:
        write_object(problem.duration_range, request)
    request.capture = problem.target_body is not None
    return request


def goal_message(problem: PlanningProblem, inertial_frame: str) -> PlanTrajectoryAction.Goal:
    """Write a problem as a goal of the action, as `request_message` does for the service."""
    return same_fields(request_message(problem, inertial_frame), PlanTrajectoryAction.Goal)


def same_fields(message: Any, kind: Any) -> Any:
    """Return a message of another type that has the same fields."""
    return kind(**{name: value_at(message, name) for name in kind.get_fields_and_field_types()})


def state_message(
    state: SystemState, joint_names: Sequence[str], stamp_ns: int, inertial_frame: str
) -> ChaserState:
    """Write a state at a time [ns] as a message."""
    header = Header(stamp=time_message(stamp_ns), frame_id=inertial_frame)
    message: ChaserState = write_object(
        state, ChaserState(header=header, joint_names=list(joint_names))
    )
    return message


def obstacles_message(
    spheres: Sequence[Sphere], stamp_ns: int, inertial_frame: str
) -> ObstacleSphereArray:
    """Write a scene of a time [ns] as a message, without what is fixed to a target body."""
    return ObstacleSphereArray(
        header=Header(stamp=time_message(stamp_ns), frame_id=inertial_frame),
        spheres=[
            write_object(sphere, ObstacleSphere()) for sphere in spheres if sphere.body is None
        ],
    )


def target_body_message(body: TargetBody, stamp_ns: int, inertial_frame: str) -> TargetBodyMessage:
    """Write a target body of a time [ns] as a message, without loss."""
    header = Header(stamp=time_message(stamp_ns), frame_id=inertial_frame)
    message: TargetBodyMessage = write_object(
        body, TargetBodyMessage(header=header), ObstacleSphere
    )
    return message


def response_from_plan(
    plan: Plan,
    plan_id: str,
    start_ns: int,
    inertial_frame: str,
    solve_time: float,
    body: TargetBody | None = None,
) -> PlanTrajectory.Response:
    """Build the response with a plan that starts at start_ns [ns] and took solve_time [s].

    Args:
        body: That it captures, at its first point; None: none.
    """
    motion = plan.trajectory
    offsets_ns = np.rint(motion.time * NANOSECONDS).astype(np.int64).tolist()
    headers = [
        Header(stamp=time_message(start_ns + t), frame_id=inertial_frame) for t in offsets_ns
    ]
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
    response = PlanTrajectory.Response(
        status=PlanStatus(code=int(Status.SOLVED), message=plan.message),
        plan_id=plan_id,
        joint_trajectory=joint_trajectory,
        predicted_chaser_path=_path(
            headers, motion.chaser_positions, motion.chaser_quaternions_xyzw
        ),
        predicted_chaser_twists=_twists(
            motion.chaser_linear_velocities, motion.chaser_angular_velocities
        ),
        end_effector_path=_path(headers, motion.ee_positions, motion.ee_quaternions_xyzw),
        end_effector_twists=_twists(motion.ee_linear_velocities, motion.ee_angular_velocities),
        xi=plan.xi.tolist(),
        orientation_reading=plan.orientation_reading,
        parametrisation=plan.family,
        duration=plan.duration or 0.0,
        metrics=PlanMetrics(**asdict(plan.metrics)),
        solver=SolverReport(solve_time=solve_time, **asdict(plan.solver)),
    )
    if body is not None:
        there = body.motion(np.zeros(3), motion.time)
        turns = Rotation.from_matrix(there.rotations).as_quat()
        response.predicted_target_path = _path(headers, there.positions, turns)
        response.predicted_target_twists = _twists(*np.hsplit(there.twists, 2))
    return response


def response_from_error(
    error: FfPlannerError, plan_id: str, solve_time: float
) -> PlanTrajectory.Response:
    """Build the response without a plan: its cause, in code and words; solve_time [s].

    The best attempt's metrics go with it, so that one sees what was missing; its motion does not.
    """
    status = PlanStatus(code=int(error.status), message=str(error))
    response = PlanTrajectory.Response(status=status, plan_id=plan_id)
    if isinstance(error, NoPlanFound) and isinstance(error.attempt, Plan):
        response.duration = error.attempt.duration or 0.0
        response.metrics = PlanMetrics(**asdict(error.attempt.metrics))
        response.solver = SolverReport(solve_time=solve_time, **asdict(error.attempt.solver))
    return response


def time_message(time_ns: int) -> Time:
    """Return integer nanoseconds as a message's time."""
    return Time(sec=time_ns // NANOSECONDS, nanosec=time_ns % NANOSECONDS)


def pose_message(position: Sequence[float], quaternion_xyzw: Sequence[float]) -> Pose:
    """Return a position, shape (3,) [m], and a quaternion, shape (4,), as a message's pose."""
    x, y, z, w = quaternion_xyzw
    return Pose(position=point_message(position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def point_message(position: Sequence[float]) -> Point:
    """Return a position, shape (3,) [m], as a message's point."""
    x, y, z = position
    return Point(x=x, y=y, z=z)


def _path(headers: Sequence[Header], positions: Array, quaternions_xyzw: Array) -> Path:
    poses = [
        PoseStamped(header=header, pose=pose_message(position, quaternion))
        for header, position, quaternion in zip(
            headers, positions.tolist(), quaternions_xyzw.tolist(), strict=True
        )
    ]
    return Path(header=headers[0], poses=poses)


def _twists(linear_velocities: Array, angular_velocities: Array) -> list[Twist]:
    return [
        _twist(linear, angular)
        for linear, angular in zip(
            linear_velocities.tolist(), angular_velocities.tolist(), strict=True
        )
    ]


def _twist(linear_velocity: Sequence[float], angular_velocity: Sequence[float]) -> Twist:
    return Twist(linear=_vector(linear_velocity), angular=_vector(angular_velocity))


def _vector(vector: Sequence[float]) -> Vector3:
    x, y, z = vector
    return Vector3(x=x, y=y, z=z)
