"""What a message leaves out, names twice or names in part, and where each number of it belongs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState, ObstacleSphere, Scene, TargetBody
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from test_state_input import FRAME, NOW_NS, Fed, _joints, _odometry

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_messages import (
    problem_from_request,
    scene_from_message,
    state_from_message,
    target_body_from_message,
)
from ff_planner_ros.ros.messages.to_messages import (
    request_message,
    scene_message,
    state_message,
    target_body_message,
    time_message,
)

# No two numbers are the same, but for what is no number of ours.
POSE = Pose(
    position=Point(x=1.0, y=2.0, z=3.0), orientation=Quaternion(x=0.1, y=0.3, z=-0.3, w=0.9)
)
TWIST = Twist(linear=Vector3(x=0.01, y=-0.02, z=0.03), angular=Vector3(x=0.04, y=0.05, z=-0.06))


@pytest.mark.parametrize("limit", [0.05, 0.3, math.inf])
def test_the_limit_of_the_attitude_goes_with_a_request(
    lemur_capture: PlanningProblem, limit: float
) -> None:
    asked = replace(lemur_capture, limits=Limits(chaser_attitude=limit))
    request = request_message(asked, FRAME)
    assert list(request.limits.chaser_attitude) == ([limit] if limit < 1.0 else [])
    back = problem_from_request(request, asked.robot, asked.start, (), load_parameters())
    assert back.limits.chaser_attitude == limit


@pytest.mark.parametrize("joint", [0, 3, 6])
def test_a_joint_that_is_named_twice_is_refused(lemur_capture: PlanningProblem, joint: int) -> None:
    robot = lemur_capture.robot
    message = state_message(lemur_capture.start, robot.joint_names, NOW_NS, FRAME)
    message.joint_names = [*message.joint_names, robot.joint_names[joint]]
    for values in (message.joint_positions, message.joint_velocities):
        values.append(0.0)
    with pytest.raises(InvalidInput, match=f"more than once: {robot.joint_names[joint]}") as found:
        state_from_message(message, "chaser_state", robot, FRAME)
    assert found.value.status is Status.UNKNOWN_JOINT
    testbed, states = Fed(robot, "odometry"), _joints(robot)
    states.name = [*states.name, "finger", robot.joint_names[joint]]
    for values in (states.position, states.velocity):
        values.extend([0.5, 0.5])
    testbed.keep["odometry"](_odometry())
    testbed.keep["joint_states"](states)
    assert testbed.refusal().status is Status.UNKNOWN_JOINT
    assert f"more than once: {robot.joint_names[joint]}" in testbed.refusal().allowed


def test_joint_states_of_a_part_of_the_arm_count_beside_the_newest_of_the_others(
    lemur: Robot,
) -> None:
    testbed = Fed(lemur, "odometry")
    testbed.keep["odometry"](_odometry())
    part = JointState(name=[lemur.joint_names[0], "finger"], position=[0.7] * 2, velocity=[0.0] * 2)
    part.header = _joints(lemur).header
    testbed.keep["joint_states"](part)
    assert testbed.refusal().status is Status.UNKNOWN_JOINT
    assert f"missing: {lemur.joint_names[1]}" in testbed.refusal().allowed
    whole = _joints(lemur)
    testbed.keep["joint_states"](whole)
    assert testbed.ask().state.joint_positions.tolist() == list(whole.position)
    testbed.keep["joint_states"](part)
    assert testbed.ask().state.joint_positions.tolist() == [0.7, *whole.position[1:]]


def test_each_number_of_a_chasers_message_has_its_place_read_and_written(lemur: Robot) -> None:
    message = ChaserState(
        header=Header(stamp=time_message(NOW_NS), frame_id=FRAME),
        pose=POSE,
        twist=TWIST,
        joint_names=list(lemur.joint_names),
        joint_positions=[0.1 * n for n in range(1, 8)],
        joint_velocities=[0.01 * n for n in range(1, 8)],
        joint_accelerations=[0.001 * n for n in range(1, 8)],
    )
    state = state_from_message(message, "chaser_state", lemur, FRAME)
    assert state.position_chaser_in_inertial.tolist() == [1.0, 2.0, 3.0]
    assert state.quaternion_chaser_to_inertial_xyzw == pytest.approx([0.1, 0.3, -0.3, 0.9])
    assert state.linear_velocity_chaser_in_inertial.tolist() == [0.01, -0.02, 0.03]
    assert state.angular_velocity_chaser_in_inertial.tolist() == [0.04, 0.05, -0.06]
    assert state.joint_positions == pytest.approx(0.1 * np.arange(1, 8))
    assert state.joint_velocities == pytest.approx(0.01 * np.arange(1, 8))
    assert state.joint_accelerations == pytest.approx(0.001 * np.arange(1, 8))
    again = state_message(state, lemur.joint_names, NOW_NS, FRAME)
    again.pose.orientation = POSE.orientation  # but for rounding
    assert again == message


def test_each_number_of_a_bodys_message_has_its_place_read_and_written() -> None:
    message = TargetBody(header=Header(stamp=time_message(NOW_NS), frame_id=FRAME))
    message.pose, message.twist = POSE, TWIST
    inertia = message.inertia
    inertia.ixx, inertia.ixy, inertia.ixz = 3.0, 0.1, -0.2
    inertia.iyy, inertia.iyz, inertia.izz = 4.0, 0.3, 5.0
    message.grasp = Pose(position=Point(x=0.5, y=0.6, z=-0.7), orientation=POSE.orientation)
    message.obstacles = [ObstacleSphere(id="mast", center=Point(x=-1.0, y=-1.5, z=2.5), radius=0.2)]
    body = target_body_from_message(message, FRAME)
    assert body.position.tolist() == [1.0, 2.0, 3.0]
    assert body.linear_velocity.tolist() == [0.01, -0.02, 0.03]
    assert body.angular_velocity.tolist() == [0.04, 0.05, -0.06]
    assert body.inertia.tolist() == [[3.0, 0.1, -0.2], [0.1, 4.0, 0.3], [-0.2, 0.3, 5.0]]
    assert body.grasp_position.tolist() == [0.5, 0.6, -0.7]
    (sphere,) = body.obstacles
    assert (sphere.id, *sphere.position, sphere.radius) == ("mast", -1.0, -1.5, 2.5, 0.2)
    again = target_body_message(body, NOW_NS, FRAME)
    for pose in (again.pose, again.grasp):
        pose.orientation = POSE.orientation  # but for rounding
    assert again == message


def test_each_number_of_a_scenes_sphere_has_its_place_read_and_written() -> None:
    header = Header(stamp=time_message(NOW_NS), frame_id=FRAME)
    sphere = ObstacleSphere(id="mast", center=POSE.position, radius=0.25)
    sphere.twist.linear = TWIST.linear
    message = Scene(header=header, source="mapper", spheres=[sphere])
    (read,) = scene_from_message(message, "obstacles", FRAME)
    assert (read.id, *read.center, read.radius) == ("mast", 1.0, 2.0, 3.0, 0.25)
    assert read.motion.velocity.tolist() == [0.01, -0.02, 0.03]
    assert scene_message([read], NOW_NS, FRAME, "mapper") == message
