"""The service `~/describe`: what the planner can do, for programs that ask before they plan."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from xml.etree import ElementTree

import numpy as np
from ff_planner_msgs.msg import Objective, RobotDescription
from ff_planner_msgs.srv import Describe
from rclpy.node import Node

from ff_planner_ros.common.share import PACKAGE, share_directory
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.problem import Orientation
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.robot.collision.solids import KINDS
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.ros.qos import serving
from ff_planner_ros.ros.topics import DESCRIBE

_MESSAGES = "ff_planner_msgs"
# Parameters that no request depends on, by prefix: files, topics and visualisation.
_NOT_OF_REQUESTS = (
    *("robot.", "bag.", "rates.", "odometry.", "tracking.", "tf.", "allow_remote_paths"),
    *("autostart", "planner.library", "planner.plugins"),
)


@contextmanager
def description_service(
    node: Node,
    robot: Robot,
    parameters: NodeParameters,
    is_active: Callable[[], bool],
) -> Iterator[None]:
    """Answer `~/describe` as long as the context lasts, whether the node is active or not.

    Args:
        is_active: Returns whether requests are accepted.
    """
    constant = _constant(robot)
    names = [name for name in DECLARATIONS if not name.startswith(_NOT_OF_REQUESTS)]

    def describe(_: Describe.Request, response: Describe.Response) -> Describe.Response:
        for name, value in constant.items():
            setattr(response, name, value)
        response.state = "active" if is_active() else "inactive"
        response.inertial_frame = parameters.inertial_frame
        response.robot = _robot(robot, parameters)
        response.requirements = [type(one).__name__ for one in parameters.requirements]
        response.parameters = [one.to_parameter_msg() for one in node.get_parameters(names)]
        return response

    with serving(node, DESCRIBE, describe):
        yield


def _constant(robot: Robot) -> dict[str, str | list[str]]:
    """Return the fields that stay the same as long as the node is configured."""
    schema = (share_directory() / "config" / "schemas" / "scenario.json").read_bytes()
    objectives = list(Objective.get_fields_and_field_types())
    if robot.base is not Base.ATTITUDE_HELD:
        objectives.remove("wheel_momentum")  # there are no wheels
    return {
        "version": version(PACKAGE),
        "messages_version": version(_MESSAGES),
        "schema_hash": hashlib.sha256(schema).hexdigest(),
        "goal_kinds": [kind.name for kind in GoalKind],
        "orientations": [one.name for one in Orientation],
        "obstacles": [*KINDS],
        "objectives": objectives,
        "end_behaviours": [str(one) for one in EndBehaviour],
    }


def _robot(robot: Robot, parameters: NodeParameters) -> RobotDescription:
    limits = parameters.limits.limits().of_joints(robot.joints)
    unlimited = np.full(robot.joints, math.inf)
    velocities = robot.velocity_limits if limits.joint_velocities else unlimited
    efforts = robot.effort_limits if limits.joint_torques else unlimited
    lower, upper = robot.lower_position_limits, robot.upper_position_limits
    return RobotDescription(
        name=ElementTree.fromstring(robot.urdf).get("name", ""),
        model_hash=digest_of(robot),
        base=str(robot.base),
        base_link=robot.base_link,
        tip_link=robot.tip_link,
        geometry=str(robot.geometry),
        joint_names=list(robot.joint_names),
        prismatic=[robot.slides(joint) for joint in range(robot.joints)],
        continuous=list(robot.continuous),
        lower_position_limits=np.where(robot.continuous, -math.inf, lower).tolist(),
        upper_position_limits=np.where(robot.continuous, math.inf, upper).tolist(),
        velocity_limits=velocities.tolist(),
        acceleration_limits=list(limits.joint_accelerations or unlimited.tolist()),
        effort_limits=efforts.tolist(),
    )
