"""Frames on /tf against Pinocchio, and against the topics that tell of the same."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from changed_parameters import replaced
from drawn_plans import drawn_plan
from geometry_msgs.msg import Pose, Transform
from rclpy.lifecycle import LifecycleNode
from robots import LEMUR_URDF, ROBOTS, random_state
from scipy.spatial.transform import Rotation
from test_plan_output import START, Output
from visualization_msgs.msg import MarkerArray

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.ros.outputs import made_plan
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.prediction import FramePose
from ff_planner_ros.ros.outputs.transforms import Transforms, root_link, root_pose


def placement(told: Transform | Pose) -> pin.SE3:
    """A message as Pinocchio has it."""
    at = told.translation if isinstance(told, Transform) else told.position
    turn = told.rotation if isinstance(told, Transform) else told.orientation
    return pin.XYZQUATToSE3(np.array([at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]))


def same(a: pin.SE3, b: pin.SE3, within: float = 1e-12) -> bool:
    return bool(np.abs(a.homogeneous - b.homogeneous).max() < within)


def frames(messages: list[Any]) -> dict[str, Any]:
    """The newest transform of each frame."""
    return {one.child_frame_id: one for message in messages for one in message.transforms}


def transforms(robot: Robot, parameters: NodeParameters) -> tuple[Transforms, dict[str, list[Any]]]:
    heard = dict[str, list[Any]]()
    node = Mock(spec=LifecycleNode)
    node.create_lifecycle_publisher.side_effect = lambda _, topic, __, **___: SimpleNamespace(
        publish=heard.setdefault(topic, []).append
    )
    return Transforms(node, robot, parameters), heard


@pytest.mark.parametrize("name", ROBOTS)
def test_the_root_link_is_where_the_chasers_centre_of_mass_and_axes_say(name: str) -> None:
    text, base, tip = ROBOTS[name]
    robot = robot_from_urdf_text(text, base, tip)
    model, rng = robot.model, np.random.default_rng(5)
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    q[:3] = rng.normal(size=3)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    link = data.oMf[model.getFrameId(robot.base_link, pin.FrameType.BODY)]
    center = data.oMi[1].act(model.inertias[1].lever)
    found = root_pose(robot, FramePose(center, Rotation.from_matrix(np.array(link.rotation))))
    root = data.oMf[model.getFrameId(root_link(robot), pin.FrameType.BODY)]
    assert same(pin.SE3(found.rotation.as_matrix(), found.position), root)
    assert all(root_link(robot) != joint for joint in children(text))


def captured() -> CapturedBody:
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    return CapturedBody(body)


def children(text: str) -> set[str]:
    return {part.split('"')[1] for part in text.split("<child link=")[1:]}


def test_the_chain_of_frames_leads_to_the_pose_that_the_topic_tells(lemur: Robot) -> None:
    output, plan = Output(lemur), drawn_plan(lemur, seed=4)
    output.output.transforms.describe()
    output.publish(plan, "run.1")
    output.now_ns = START + 3_217_000_000
    output.output.stream(None)
    found = frames([*output.heard["/tf"], *output.heard["/tf_static"]])
    root, center = found["predicted/chaser"], found["chaser_center_of_mass"]
    assert root.header.frame_id == "inertial"
    assert nanoseconds(root.header.stamp) == output.now_ns
    assert center.header.frame_id == "chaser"  # where a state publisher without prefix has it
    (pose,) = output.heard["predicted_chaser_pose"]
    chain = placement(root.transform) * placement(center.transform)
    assert same(chain, placement(pose.pose))


def test_the_frames_of_a_capture_lead_to_the_way_that_the_topic_tells(lemur: Robot) -> None:
    output, plan = Output(lemur), drawn_plan(lemur, seed=4)
    output.publish(plan, "run.1", body=captured().body)
    output.now_ns = START + 6_400_000_000
    output.output.stream(None)
    found = frames([*output.heard["/tf"], *output.heard["/tf_static"]])
    assert found["target_grasp"].header.frame_id == "predicted/target"
    target, grasp, ee = (
        placement(found[name].transform)
        for name in ("predicted/target", "target_grasp", "predicted/end_effector")
    )
    (relative,) = output.heard["predicted_relative_pose"]
    assert relative.header.frame_id == "target_grasp"
    assert same((target * grasp).inverse() * ee, placement(relative.pose))


def test_the_preview_moves_in_the_inertial_frame(
    lemur: Robot, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all links, so that nobody needs another node to see the arm on its planned path."""
    monkeypatch.setattr(made_plan, "plan_markers", Mock(return_value=MarkerArray()))
    output, motion = Output(lemur), lemur_plan.trajectory
    output.output.preview.release(
        MadePlan("run.1", lemur_plan, 0, "none", lemur, Scene(), "inertial")
    )
    output.output.preview.draw()
    model = lemur.model
    data, rate = model.createData(), load_parameters().rates.preview
    for number in range(round(motion.time[-1] * rate) + 1):
        output.now_ns += NANOSECONDS
        output.output.preview._play()
        found, joints = frames(output.heard["/tf"][-1:]), output.heard["planned_joint_states"]
        root = found["preview/chaser"]
        assert root.header.frame_id == "inertial"
        assert root.header.stamp == joints[-1].header.stamp
        q = np.concatenate([pin.SE3ToXYZQUAT(placement(root.transform)), joints[-1].position])
        pin.framesForwardKinematics(model, data, q)
        tip = data.oMf[lemur.tip_frame_id].translation
        for joint in ElementTree.parse(LEMUR_URDF).iter("joint"):
            carrier, link = (joint.find(one).get("link") for one in ("parent", "child"))
            shown = found[f"preview/{link}"]
            assert shown.header.frame_id == f"preview/{carrier}"
            on, there = (data.oMf[model.getFrameId(one)] for one in (carrier, link))
            assert same(on * placement(shown.transform), there)
        path = [np.interp(number / rate, motion.time, motion.ee_positions[:, i]) for i in range(3)]
        np.testing.assert_allclose(tip, path, atol=5e-3)


def test_the_measured_chaser_is_told_where_it_was_measured(lemur: Robot) -> None:
    told, heard = transforms(lemur, replaced(load_parameters(), "tf.measured", True))
    state = random_state(lemur, np.random.default_rng(3))
    for _ in range(2):  # buffers complain about a stamp that comes again
        told.measured(state, START - 5)
    (message,) = heard["/tf"]
    (root,) = message.transforms
    assert (root.child_frame_id, root.header.frame_id) == ("chaser", "inertial")
    assert nanoseconds(root.header.stamp) == START - 5
    told.describe()
    center = frames(heard["/tf_static"])["chaser_center_of_mass"]
    chain = placement(root.transform) * placement(center.transform)
    np.testing.assert_allclose(chain.translation, state.position_chaser_in_inertial, atol=1e-12)


def test_the_sensor_of_odometry_is_fixed_to_the_chaser(lemur: Robot) -> None:
    parameters = load_parameters()
    sensor = replace(
        parameters.odometry,
        child_frame_id="star_tracker",
        sensor_position_in_chaser=(0.1, -0.2, 0.3),
        sensor_quaternion_in_chaser_xyzw=(0.0, 0.0, 0.6, 0.8),
    )
    parameters = replace(parameters, odometry=sensor, state_source="odometry")
    told, heard = transforms(lemur, parameters)
    told.describe()
    found = frames(heard["/tf_static"])
    center, tracker = (
        placement(found[name].transform) for name in ("chaser_center_of_mass", "star_tracker")
    )
    mounted = pin.XYZQUATToSE3(np.array([0.1, -0.2, 0.3, 0.0, 0.0, 0.6, 0.8]))
    assert same(center.inverse() * tracker, mounted)
    link = replace(parameters, odometry=replace(sensor, child_frame_id="chaser"))
    told, heard = transforms(lemur, link)
    told.describe()
    assert set(frames(heard["/tf_static"])) == {"chaser_center_of_mass"}


def test_without_a_prefix_there_is_no_frame(lemur: Robot) -> None:
    parameters = replaced(load_parameters(), "tf.predicted_prefix", "")
    output, plan = (
        Output(lemur, replaced(parameters, "tf.preview_prefix", "")),
        drawn_plan(lemur, 4),
    )
    output.publish(plan, "run.1", body=captured().body)
    output.output.stream(None)
    assert output.heard["predicted_chaser_pose"]
    assert not output.heard["/tf"]
