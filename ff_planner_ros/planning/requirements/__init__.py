"""Requirements of a plan, the most harmful violation first; a new one is a file and an entry."""

from __future__ import annotations

from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.approach import ApproachCorridor
from ff_planner_ros.planning.requirements.camera_view import CameraView
from ff_planner_ros.planning.requirements.chaser_at_goal import ChaserAtGoal
from ff_planner_ros.planning.requirements.clear_of_itself import ClearOfItself
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.planning.requirements.follows_path import FollowsPath
from ff_planner_ros.planning.requirements.goal import Goal
from ff_planner_ros.planning.requirements.limits.capture_impulse import CaptureImpulse
from ff_planner_ros.planning.requirements.limits.chaser_rotation import (
    ChaserAttitude,
    ChaserRotation,
)
from ff_planner_ros.planning.requirements.limits.joint_limits import (
    JointAccelerations,
    JointPositions,
    JointRates,
)
from ff_planner_ros.planning.requirements.limits.loads import GraspWrench, Torques
from ff_planner_ros.planning.requirements.limits.wheels import WheelLimits
from ff_planner_ros.planning.requirements.momentum import Momentum
from ff_planner_ros.planning.requirements.plane import Plane
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.planning.requirements.start_velocity import StartVelocity

# Checked for every plan, in this order.
REQUIREMENTS: tuple[Requirement, ...] = (
    ClearOfObstacles(),
    ClearOfItself(),
    ApproachCorridor(),
    CameraView(),
    FollowsPath(),
    JointPositions(),
    JointRates(),
    JointAccelerations(),
    ChaserAttitude(),
    ChaserRotation(),
    ChaserAtGoal(),
    SingularValues(),
    WheelLimits(),
    GraspWrench(),
    CaptureImpulse(),
    Torques(),  # after the singularity, near which torques are a symptom
    Goal(),
    Plane(),
    Momentum(),
    StartVelocity(),
)


def requirements_of(problem: PlanningProblem) -> tuple[Requirement, ...]:
    """Return the requirements of a problem: those of every plan, then those of its plug-ins."""
    return (*REQUIREMENTS, *problem.requirements)
