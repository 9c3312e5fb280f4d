"""A real planner on a testbed: the state from odometry of a sensor and from joint states."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from recorded_requests import replays_of
from ros_processes import (
    FRAME,
    Client,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.runs.replay import Verdict

SENSOR_POSITION, SENSOR_TO_CHASER = np.array([0.3, -0.2, 0.1]), [0.5, 0.5, 0.5, 0.5]
LEAD_NS = 60_000_000_000
JOINTS_LATER_NS = 5_000_000


@pytest.mark.ci
def test_a_plan_starts_from_the_centre_of_mass_that_odometry_and_mounting_tell(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    scene, start = Scene(lemur_capture), lemur_capture.start
    arguments = {
        "state_source": "odometry",
        "state_future_tolerance": "600.0",
        "odometry.child_frame_id": "imu",
        "odometry.sensor_position_in_chaser": SENSOR_POSITION.tolist(),
        "odometry.sensor_quaternion_in_chaser_xyzw": SENSOR_TO_CHASER,
    }
    parameters = [word for name, value in arguments.items() for word in ("-p", f"{name}:={value}")]
    with (
        private_domain(),
        running_planner(tmp_path, *parameters) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        # Stamped ahead of now, so that the plan can start right from it.
        client.wait_for_an_answer()
        stamp_ns = client.now_ns() + LEAD_NS
        request = scene.request()
        request.start_time = time_message(stamp_ns)
        request.scene = scene.complete_request().scene
        testbed = _Testbed(client, lemur_capture, stamp_ns)
        missing = client.plan(request)
        testbed.joints_behind(1_000_000_000)
        apart = testbed.plan(request, "imu", {Status.NO_STATE})
        testbed.joints_behind(JOINTS_LATER_NS)
        lost = testbed.plan(request, "base_link", {Status.NO_STATE, Status.STATE_NOT_SYNCHRONIZED})
        solved = testbed.plan(
            request, "imu", {Status.NO_STATE, Status.WRONG_FRAME, Status.STATE_NOT_SYNCHRONIZED}
        )
        assert planner.stop(signal.SIGTERM) == 0
    assert missing.status.code == Status.NO_STATE
    assert "odometry is missing" in missing.status.message
    assert lost.status.code == Status.WRONG_FRAME
    assert "odometry.child_frame_id is 'base_link': it must be 'imu'" in lost.status.message

    assert apart.status.code == Status.STATE_NOT_SYNCHRONIZED
    assert "1.000 s apart" in apart.status.message
    assert solved.status.code == Status.SOLVED, solved.status.message
    (planned,) = solved.plans
    first = planned.chaser_path.poses[0].pose
    twist = planned.chaser_twists[0]
    for message, names, expected in (
        (first.position, "xyz", start.position_chaser_in_inertial),
        (first.orientation, "xyzw", start.quaternion_chaser_to_inertial_xyzw),
        (twist.linear, "xyz", start.linear_velocity_chaser_in_inertial),
        (twist.angular, "xyz", start.angular_velocity_chaser_in_inertial),
    ):
        read = [getattr(message, name) for name in names]
        np.testing.assert_allclose(read, expected, atol=1e-9)
    joints = planned.joint_trajectory.points[0]
    np.testing.assert_allclose(joints.positions, start.joint_positions, atol=1e-9)

    bag = read_bag(planner.bag)
    assert bag["/odometry"]
    assert bag["/joint_states"]

    assert nanoseconds(solved.inputs.state_stamp) == stamp_ns
    assert nanoseconds(solved.inputs.joint_states_stamp) == stamp_ns + JOINTS_LATER_NS
    replayed = replays_of(planner.bag)
    for answer in (missing, apart, lost):
        assert replayed[answer.plan_id].verdict is Verdict.NOT_PLANNED
    assert replayed[solved.plan_id].verdict is Verdict.IDENTICAL


class _Testbed:
    """Publishes what a sensor on the chaser and the joints' encoders measure."""

    def __init__(self, client: Client, problem: PlanningProblem, stamp_ns: int) -> None:
        self._client = client
        start = problem.start
        chaser = Rotation.from_quat(list(start.quaternion_chaser_to_inertial_xyzw))
        sensor = chaser * Rotation.from_quat(SENSOR_TO_CHASER)
        r = chaser.apply(SENSOR_POSITION)
        omega = np.array(start.angular_velocity_chaser_in_inertial)
        linear = start.linear_velocity_chaser_in_inertial + np.cross(omega, r)
        self._odometry = Odometry()
        self._odometry.header.frame_id = FRAME
        self._odometry.header.stamp = time_message(stamp_ns)
        pose, twist = self._odometry.pose.pose, self._odometry.twist.twist
        for message, names, values in (
            (pose.position, "xyz", start.position_chaser_in_inertial + r),
            (pose.orientation, "xyzw", sensor.as_quat()),
            (twist.linear, "xyz", sensor.inv().apply(linear)),
            (twist.angular, "xyz", sensor.inv().apply(omega)),
        ):
            for name, value in zip(names, values.tolist(), strict=True):
                setattr(message, name, value)
        # Each controller publishes half of the arm.
        self._joints = [
            JointState(
                name=["finger", *problem.robot.joint_names[half][::-1]],
                position=[0.0, *start.joint_positions[half].tolist()[::-1]],
                velocity=[0.0, *start.joint_velocities[half].tolist()[::-1]],
            )
            for half in (slice(0, 3), slice(3, None))
        ]
        self._stamp_ns = stamp_ns
        self.joints_behind(JOINTS_LATER_NS)
        create = client.node.create_publisher
        self._odometries = create(Odometry, "odometry", qos_profile_sensor_data)
        self._joint_states = [
            create(JointState, "joint_states", qos_profile_sensor_data) for _ in self._joints
        ]

    def joints_behind(self, later_ns: int) -> None:
        """Measure joint states so much later than odometry."""
        for half in self._joints:
            half.header.stamp = time_message(self._stamp_ns + later_ns)

    def plan(self, request: PlanRequest, child_frame_id: str, not_yet: set[Status]) -> Any:
        """Publish and ask until the answer is none of those of the time before."""
        self._odometry.child_frame_id = child_frame_id

        def accepted(answer: PlanAnswer) -> bool:
            self._odometries.publish(self._odometry)
            for publisher, half in zip(self._joint_states, self._joints, strict=True):
                publisher.publish(half)
            return answer.status.code not in not_yet

        return self._client.plan_until(request, accepted)
