"""Planning objects to messages: pure functions, no clock."""

from __future__ import annotations

import math
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
from geometry_msgs.msg import Inertia, Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from nav_msgs.msg import Path
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.arrays import Array, normalising_to
from ff_planner_ros.bag.decoding import NANOSECONDS
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem, Sphere, TargetBody
from ff_planner_ros.robot.state import SystemState


def request_message(problem: PlanningProblem, inertial_frame: str) -> PlanTrajectory.Request:
    """Write a problem as a request for the latest published state, obstacles and target body."""
    target, angle = problem.target, problem.limits.chaser_attitude
    axis, window = target.free_axis_in_ee, problem.duration_range
    approach = problem.approach
    return PlanTrajectory.Request(
        target_pose=PoseStamped(
            header=Header(frame_id=inertial_frame),
            pose=pose_message(target.position.tolist(), target.quaternion_xyzw.tolist()),
        ),
        target_twist=_twist(target.linear_velocity.tolist(), target.angular_velocity.tolist()),
        duration=problem.duration if window is None else window.minimum,
        duration_max=0.0 if window is None else window.maximum,
        weight_joint_path_length=problem.objective.joint_path_length,
        weight_chaser_attitude=problem.objective.chaser_attitude,
        weight_duration=problem.objective.duration,
        points=problem.points,
        limit_chaser_attitude=angle if math.isfinite(angle) else 0.0,
        limit_accelerations=list(problem.limits.joint_accelerations or ()),
        parametrisation=problem.parametrisation.value,
        allowed_at_goal=list(problem.allowed_at_goal),
        contact_distance=problem.contact_distance,
        capture=problem.target_body is not None,
        orientation=target.orientation.value,
        free_axis=_vector(axis.tolist() if axis is not None else [0.0] * 3),
        approach_direction=_vector([0.0] * 3 if approach is None else approach.direction.tolist()),
        approach_distance=0.0 if approach is None else approach.distance,
        approach_cone=0.0 if approach is None else approach.cone,
    )


def goal_message(problem: PlanningProblem, inertial_frame: str) -> PlanTrajectoryAction.Goal:
    """Write a problem as a goal of the action, as `request_message` does for the service."""
    return same_fields(request_message(problem, inertial_frame), PlanTrajectoryAction.Goal)


def same_fields(message: Any, kind: Any) -> Any:
    """Return a message of another type that has the same fields."""
    return kind(**{name: getattr(message, name) for name in kind.get_fields_and_field_types()})


def state_message(
    state: SystemState, joint_names: Sequence[str], stamp_ns: int, inertial_frame: str
) -> ChaserState:
    """Write a state at a time [ns] as a message."""
    accelerations = state.joint_accelerations
    return ChaserState(
        header=Header(stamp=time_message(stamp_ns), frame_id=inertial_frame),
        pose=pose_message(
            state.position_chaser_in_inertial.tolist(),
            state.quaternion_chaser_to_inertial_xyzw.tolist(),
        ),
        twist=_twist(
            state.linear_velocity_chaser_in_inertial.tolist(),
            state.angular_velocity_chaser_in_inertial.tolist(),
        ),
        joint_names=list(joint_names),
        joint_positions=state.joint_positions.tolist(),
        joint_velocities=state.joint_velocities.tolist(),
        joint_accelerations=[] if accelerations is None else accelerations.tolist(),
    )


def obstacles_message(
    spheres: Sequence[Sphere], stamp_ns: int, inertial_frame: str
) -> ObstacleSphereArray:
    """Write a scene of a time [ns] as a message, without what is fixed to a target body."""
    return ObstacleSphereArray(
        header=Header(stamp=time_message(stamp_ns), frame_id=inertial_frame),
        spheres=[
            ObstacleSphere(
                id=s.id,
                center=point_message(s.center.tolist()),
                radius=s.radius,
                twist=_twist(s.velocity.tolist(), [0.0] * 3),
            )
            for s in spheres
            if s.body is None
        ],
    )


def target_body_message(body: TargetBody, stamp_ns: int, inertial_frame: str) -> TargetBodyMessage:
    """Write a target body of a time [ns] as a message, without loss."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia.tolist()
    return TargetBodyMessage(
        header=Header(stamp=time_message(stamp_ns), frame_id=inertial_frame),
        pose=_exact_pose(body.position, body.quaternion_xyzw),
        twist=_twist(body.linear_velocity.tolist(), body.angular_velocity.tolist()),
        inertia=Inertia(ixx=xx, ixy=xy, ixz=xz, iyy=yy, iyz=yz, izz=zz),
        grasp=_exact_pose(body.grasp_position, body.grasp_quaternion_xyzw),
        obstacles=[
            ObstacleSphere(id=s.id, center=point_message(s.center.tolist()), radius=s.radius)
            for s in body.obstacles
        ],
    )


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


def _exact_pose(position: Array, quaternion_xyzw: Array) -> Pose:
    return pose_message(position.tolist(), normalising_to(quaternion_xyzw).tolist())


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
