"""A real planner for an air-bearing table: cameras tell the state; a part of a pose is asked."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import Goal, PlanAnswer, PlanRequest
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from recorded_requests import replays_of
from robots import CONFIG
from ros_processes import FRAME, Scene, connected_client, private_domain, running_planner
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.model import Base
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.runs.replay import Verdict
from ff_planner_ros.simulation.verification import verify

pytestmark = pytest.mark.ci

# The markers sit on a mast beside the centre of mass, turned about z.
MARKERS, MARKERS_TO_CHASER = np.array([0.1, -0.2, 0.6]), Rotation.from_euler("z", 0.5)
# What cameras that are not quite level say of a flat table: [rad], [rad/s].
LEAN, WOBBLE = Rotation.from_euler("xy", [0.004, -0.006]), np.array([0.002, -0.001, 0.0])
PLANAR = CONFIG / "scenarios/planar_capture.yaml"
LEAD_NS = 60_000_000_000


def odometry(problem: PlanningProblem, stamp_ns: int, lean: Rotation) -> Odometry:
    """Return what the cameras say of the scenario's start."""
    start = problem.start
    chaser = lean * Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw.copy())
    markers, r = chaser * MARKERS_TO_CHASER, chaser.apply(MARKERS)
    omega = start.angular_velocity_chaser_in_inertial + WOBBLE
    linear = start.linear_velocity_chaser_in_inertial + np.cross(omega, r)
    message = Odometry(child_frame_id="mast")
    message.header.frame_id, message.header.stamp = FRAME, time_message(stamp_ns)
    pose, twist = message.pose.pose, message.twist.twist
    fill(pose.position, start.position_chaser_in_inertial + r)
    fill(pose.orientation, markers.as_quat())
    fill(twist.linear, markers.inv().apply(linear))
    fill(twist.angular, markers.inv().apply(omega))
    return message


def fill(message: object, values: Array) -> None:
    for name, value in zip("xyzw", values.tolist(), strict=False):
        setattr(message, name, value)


def test_a_node_plans_on_a_table_from_odometry_and_joint_states(tmp_path: Path) -> None:
    problem = load_scenario(PLANAR)
    arguments = {
        "state_source": "odometry",
        "state_future_tolerance": "600.0",
        "odometry.child_frame_id": "mast",
        "odometry.sensor_position_in_chaser": MARKERS.tolist(),
        "odometry.sensor_quaternion_in_chaser_xyzw": MARKERS_TO_CHASER.as_quat().tolist(),
    }
    parameters = ["--params-file", str(CONFIG / "planar_testbed.yaml")]
    parameters += [word for name, value in arguments.items() for word in ("-p", f"{name}:={value}")]
    with (
        private_domain(),
        running_planner(tmp_path, *parameters) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        client.wait_for_an_answer()
        stamp_ns = client.now_ns() + LEAD_NS
        scene = Scene(problem)
        whole = scene.request()
        whole.start_time = time_message(stamp_ns)
        whole.scene = scene.complete_request().scene
        part = scene.request()
        part.start_time, part.scene = whole.start_time, whole.scene
        part.goal.orientation = Goal.FREE
        part.goal.pose.pose.orientation.w = 0.0  # nobody looks at it
        above = scene.request()
        above.start_time, above.scene = whole.start_time, whole.scene
        above.goal.pose.pose.position.z = 0.3

        chasers = client.node.create_publisher(Odometry, "odometry", qos_profile_sensor_data)
        arms = client.node.create_publisher(JointState, "joint_states", qos_profile_sensor_data)
        joints = JointState(
            name=["gripper", *problem.robot.joint_names[::-1]],
            position=[0.0, *problem.start.joint_positions.tolist()[::-1]],
            velocity=[0.0, *problem.start.joint_velocities.tolist()[::-1]],
        )
        joints.header.stamp = time_message(stamp_ns)

        def asked(request: PlanRequest, lean: Rotation, not_yet: set[Status]) -> PlanAnswer:
            def heard(answer: PlanAnswer) -> bool:
                chasers.publish(odometry(problem, stamp_ns, lean))
                arms.publish(joints)
                return answer.status.code not in not_yet

            return client.plan_until(request, heard)

        waiting = {Status.NO_STATE, Status.STATE_NOT_SYNCHRONIZED}
        solved = {"whole": asked(whole, LEAN, waiting), "part": asked(part, LEAN, waiting)}
        off_plane = asked(above, LEAN, waiting)
        # Until the message arrives, the one before is taken.
        tilted = asked(whole, Rotation.from_euler("x", 0.1), {Status.SOLVED})
        assert planner.stop(signal.SIGTERM) == 0

    assert off_plane.status.code == Status.OUT_OF_RANGE
    assert "goal.pose.pose.position" in off_plane.status.message
    assert "end effector stays at z = " in off_plane.status.message
    assert tilted.status.code == Status.OUT_OF_RANGE
    assert "degrees off" in tilted.status.message
    headings = {}
    for name, answer in solved.items():
        assert answer.status.code == Status.SOLVED, answer.status.message
        assert answer.plans[0].family == "joint_spline"
        plan = plan_from_answer(answer)
        motion = plan.trajectory
        assert np.ptp(motion.chaser_positions[:, 2]) < 1e-12
        assert not motion.chaser_linear_velocities[:, 2].any()
        np.testing.assert_allclose(
            motion.chaser_positions[0, :2], problem.start.position_chaser_in_inertial[:2], atol=5e-3
        )
        np.testing.assert_allclose(
            motion.ee_positions[-1, :2], problem.target.position[:2], atol=1e-3
        )
        assert verify(problem.robot, motion).passed
        reached = Rotation.from_quat(motion.ee_quaternions_xyzw[-1].copy())
        headings[name] = reached.as_euler("xyz", degrees=True)[2]
    assert abs(headings["whole"] - 40.0) < 0.1
    assert abs(headings["part"] - 40.0) > 3.0  # else it was not free

    replayed = replays_of(planner.bag)
    recorded = replayed[solved["whole"].plan_id].exchange
    assert recorded.planned_task().problem.robot.base is Base.PLANAR
    assert replayed[off_plane.plan_id].verdict is Verdict.NOT_PLANNED
    for answer in solved.values():
        found = replayed[answer.plan_id]
        assert found.verdict is Verdict.IDENTICAL, (found.words, *map(str, found.differences))
