"""Every topic, service and action of the node: one table for code, bags, docs and the SROS2 policy.

Quality of service is that of the defaults; parameters `qos_overrides.*` replace it. What reads a
bag reads this table, too, where there is no middleware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs import msg
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.srv import Describe, PlanTrajectory, PublishPlan
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.ros.messages.foreign import TFMessage

# Who comes late does not hear what was said before.
_STREAM = QualityOfService(depth=10)
# Whoever comes late still gets the last one.
_LATCHED = QualityOfService(durability="transient_local", depth=1)
_LAST_TEN = QualityOfService(durability="transient_local", depth=10)
# Hears every publisher; of joints at 1 kHz, enough wait that the odometry of 0.1 s ago finds its.
_MEASURED = QualityOfService(reliability="best_effort", depth=200)
# Requests that wait at each service and at the action; the middleware drops the oldest of more, and
# nobody answers those. More than a fleet's executives ask at once, and little where none wait.
_REQUESTS = QualityOfService(depth=1000)
NAVIGATION, CONTROLLER, EXECUTIVE = "navigation", "controller", "executive"
SCREEN, OPERATOR = "screen", "operator"


@dataclass(frozen=True)
class Endpoint:
    """A topic, service or action of the node."""

    name: str  # relative: a namespace moves it; `~` is the node's name
    message_type: type[Any]  # or that of the service or action
    sentence: str
    qos: QualityOfService = _STREAM
    peer: str = EXECUTIVE  # SROS2 enclave at the other end
    # Of an input: value of the parameter state_source with which it is heard; empty: any
    state_source: str = ""


CHASER_STATE = Endpoint(
    "chaser_state",
    msg.ChaserState,
    "chaser and joints in one snapshot (`state_source: chaser_state`)",
    _MEASURED,
    NAVIGATION,
    "chaser_state",
)
ODOMETRY = Endpoint(
    "odometry",
    Odometry,
    "of a sensor fixed to the chaser, twist in its own axes (`state_source: odometry`)",
    _MEASURED,
    NAVIGATION,
    "odometry",
)
JOINT_STATES = Endpoint(
    "joint_states",
    JointState,
    "any order, velocities required, of the whole arm or of each controller's part; locked joints "
    "must be where they are locked, others are ignored; paired with `odometry` by stamp",
    _MEASURED,
    CONTROLLER,
    "odometry",
)
OBSTACLES = Endpoint(
    "obstacles",
    msg.Scene,
    "spheres, boxes, cylinders, capsules, cones, meshes; each scene replaces the one before; an "
    "empty one says that nothing is in the way",
    _LAST_TEN,
    NAVIGATION,
)
TARGET_BODY = Endpoint(
    "target_body",
    msg.TargetBody,
    "the body that a request for a capture (`goal.kind`) means, if the request brings none",
    _MEASURED,
    NAVIGATION,
)
INPUTS = (CHASER_STATE, ODOMETRY, JOINT_STATES, OBSTACLES, TARGET_BODY)


def heard_with(state_source: str) -> list[Endpoint]:
    """Return the inputs that the node hears with a value of the parameter `state_source`."""
    return [one for one in INPUTS if one.state_source in (state_source, "")]


_PLAN = "the plan, as a `joint_trajectory_controller` takes it"
JOINT_TRAJECTORY = Endpoint("joint_trajectory", JointTrajectory, _PLAN, _LATCHED, CONTROLLER)
PUBLISHED_PLAN = Endpoint(
    "published_plan",
    msg.PublishedPlan,
    "the same trajectory with plan id, start time, end behaviour and requester",
    _LATCHED,
    CONTROLLER,
)
PREDICTED_CHASER_PATH = Endpoint(
    "predicted_chaser_path", Path, "where the chaser will be", _LATCHED
)
PREDICTED_CHASER_POSE = Endpoint(
    "predicted_chaser_pose", PoseStamped, "where the chaser should be now, while a plan runs"
)
PREDICTED_TARGET_PATH = Endpoint(
    "predicted_target_path", Path, "where a plan's captured body will be", _LATCHED
)
PREDICTED_RELATIVE_POSE = Endpoint(
    "predicted_relative_pose",
    PoseStamped,
    "where the end effector should be now, in the frame of the grasp (`target_grasp`), while a "
    "plan runs that captures a body",
)
PREDICTED_WHEEL_MOMENTUM = Endpoint(
    "predicted_wheel_momentum", msg.WheelState, "what each wheel should hold and give now"
)
TRACKING_ERROR = Endpoint(
    "tracking_error", msg.TrackingError, "measured against predicted chaser, while a plan runs"
)
PLAN_EVENTS = Endpoint(
    "plan_events",
    msg.PlanEvent,
    "what becomes of each plan: published, started, at goal, aborted, superseded",
    _LAST_TEN,
)
TF = Endpoint(
    "/tf",
    TFMessage,
    "in the inertial frame: the chaser as predicted, as previewed and, on request, as measured, "
    "each under a prefix ([frames](#frames))",
    QualityOfService(depth=100),
    SCREEN,
)
TF_STATIC = Endpoint(
    "/tf_static",
    TFMessage,
    "what is fixed: the chaser's centre of mass, the sensor of `odometry`, the grasp in the target",
    _LATCHED,
    SCREEN,
)
MARKERS = Endpoint(
    "markers",
    MarkerArray,
    "the published plan, and below `waiting/` the newest waiting one: obstacles, target body, "
    "end-effector path, corridor, arm and chaser at a few times, and where they come nearest",
    _LATCHED,
    SCREEN,
)
PLANNED_JOINT_STATES = Endpoint(
    "planned_joint_states",
    JointState,
    "preview: the waiting plan, or else the published one, again and again",
    peer=SCREEN,
)
ROBOT_DESCRIPTION = Endpoint(
    "robot_description", String, "the URDF file, shapes included", _LATCHED, SCREEN
)
ROBOT_MODEL = Endpoint(
    "robot_model",
    String,
    "the robot as plans are made with it: its locked joints fixed, meshes as hulls; tasks of "
    "`exchanges` name it by its SHA-256",
    _LATCHED,
    SCREEN,
)
EXCHANGES = Endpoint(
    "exchanges",
    msg.Exchange,
    "each request when it comes, and its end: the complete task in JSON, and the answer",
    # Whoever comes late, or is slow for a moment, still gets the last ones: a burst of refusals
    # counts two for each request, and a plan of 10,000 points takes 5 MB.
    QualityOfService(durability="transient_local", depth=50),
)
DIAGNOSTICS = Endpoint(
    "/diagnostics",
    DiagnosticArray,
    "state, obstacles, target body, last request, solve times, tracking, recorder",
    peer=OPERATOR,
)
OUTPUTS = (
    *(JOINT_TRAJECTORY, PUBLISHED_PLAN, PREDICTED_CHASER_PATH, PREDICTED_CHASER_POSE),
    *(PREDICTED_TARGET_PATH, PREDICTED_RELATIVE_POSE, PREDICTED_WHEEL_MOMENTUM, PLAN_EVENTS),
    *(TF, TF_STATIC, TRACKING_ERROR, MARKERS, PLANNED_JOINT_STATES, ROBOT_DESCRIPTION),
    ROBOT_MODEL,
    EXCHANGES,
    DIAGNOSTICS,
)

SERVICE = Endpoint("plan_trajectory", PlanTrajectory, "asks for a plan", _REQUESTS)
PUBLISH_PLAN = Endpoint(
    "~/publish_plan",
    PublishPlan,
    "publishes a waiting plan (`plan_only`), by its `plan_id`; with `reject: true` drops it",
    _REQUESTS,
)
DESCRIBE = Endpoint(
    "~/describe",
    Describe,
    "what the planner can do: its robot with limits and a hash, kinds of goals, obstacles and "
    "objectives, parameters that bound a request, versions; answered while inactive, too",
    _REQUESTS,
)
SPLIT_BAG = Endpoint(
    "~/split_bag", Trigger, "completes the bag's file and begins another one", _REQUESTS, OPERATOR
)
SERVICES = (SERVICE, PUBLISH_PLAN, DESCRIBE, SPLIT_BAG)
ACTION = Endpoint(
    "plan_trajectory_action",
    PlanTrajectoryAction,
    "the same as the service, with feedback and cancel",
    _REQUESTS,
)


def override(topic: str, kind: str, policy: str) -> str:
    """Return the name of the parameter for a policy of a topic, whose name is resolved.

    Args:
        kind: Publisher or subscription.
    """
    return f"qos_overrides.{topic}.{kind}.{policy}"
