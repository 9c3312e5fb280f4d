"""Plans out of bags: those of `ff-planner plan --bag` here, those of the node in test_verify."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml
from answers import answer_of, received, sent
from ff_planner_msgs.msg import Limits as LimitsMessage
from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.robot_plans import robot_plans
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.to_messages import answer_of_error, obstacles_message
from ff_planner_ros.runs.offline_bag import record_answer

EVENTS, EVENT = "/servicer/plan/_service_event", "ff_planner_msgs/srv/PlanTrajectory_Event"
SETTINGS = load_parameters().planner
LINKS = {
    "base_link": "chaser",
    "tip_link": "end_effector",
    "base": "free_flyer",
    "geometry": "lines",
    "locked_joints": "",
    "slide_weight": 1.0,
    "wheels": {},
}


def parameters(robot: object) -> bytes:
    return yaml.safe_dump({"/**": {"ros__parameters": {"robot": robot}}}).encode()


def write_bag(directory: Path, attachments: dict[str, bytes], *answers: PlanAnswer) -> Path:
    with BagWriter(directory, flush_interval=0.0) as bag:
        for name, content in attachments.items():
            bag.attach(name, "text/plain", content)
        bag.add_topic(EVENTS, EVENT, [])
        bag.write(EVENTS, encode(received(PlanRequest())), 0, 0)
        for time, answer in enumerate(answers):
            bag.write(EVENTS, encode(sent(answer)), time, time)
    return directory


def test_robot_and_plan_come_back_as_they_were(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    record_answer(tmp_path / "bag", PlanningTask(lemur_capture, SETTINGS), lemur_plan, 0.5)
    recorded = robot_plans(tmp_path / "bag")
    (robot,) = recorded.robots.values()
    assert robot.urdf == lemur_capture.robot.urdf
    assert robot.tip_link == "end_effector"
    (found,) = recorded.motions.values()
    for item in fields(lemur_plan.trajectory):
        tolerance = 1e-9 if item.name == "time" else 0.0  # a message counts nanoseconds
        wanted = getattr(lemur_plan.trajectory, item.name)
        assert getattr(found, item.name) == pytest.approx(wanted, abs=tolerance, rel=0)


def test_every_plan_of_a_run_is_found_and_refusals_are_left_out(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    first, third = (answer_of(lemur_plan, f"run.{number}") for number in (1, 3))
    second = answer_of_error(NoPlanFound(Status.COLLISION, "too near"), "run.2", 0.1)
    attached = {
        "robot.urdf": lemur_capture.robot.urdf.encode(),
        "parameters.yaml": parameters(LINKS),
    }
    bag = write_bag(tmp_path / "bag", attached, first, second, third)
    assert list(robot_plans(bag).motions) == ["run.1", "run.3"]


def test_an_answer_whose_arrays_do_not_fit_each_other_is_refused_by_name(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    answer = answer_of(lemur_plan)
    motion = answer.plans[0].joint_trajectory
    motion.points = motion.points[:-1]
    attached = {
        "robot.urdf": lemur_capture.robot.urdf.encode(),
        "parameters.yaml": parameters(LINKS),
    }
    bag = write_bag(tmp_path / "bag", attached, answer)
    with pytest.raises(
        BagError,
        match=r"run\.1 on .* cannot be understood: the shape of poses is \(50, 7\), not \(49, 7\)",
    ):
        robot_plans(bag)


def test_a_bag_without_plans_tells_its_answers(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    refusal = NoPlanFound(Status.COLLISION, "obstacle c1 is in the way")
    record_answer(tmp_path / "bag", PlanningTask(lemur_capture, SETTINGS), refusal, 0.5)
    with pytest.raises(BagError, match=r"bag holds no plan.*obstacle c1 is in the way"):
        robot_plans(tmp_path / "bag")
    silent = write_bag(tmp_path / "silent", {})
    with pytest.raises(BagError, match="silent holds no plan; its answers: none"):
        robot_plans(silent)


@pytest.mark.parametrize(
    ("attached", "message"),
    [
        ({}, r"no robot\.urdf attached"),
        ({"robot.urdf": b"<robot/>"}, r"no parameters\.yaml attached"),
        (
            {"robot.urdf": b"<robot/>", "parameters.yaml": b": ["},
            r"lacks parameters robot\.\*",
        ),
        (
            {"robot.urdf": b"<robot/>", "parameters.yaml": b"[]"},
            r"lacks parameters robot\.\*",
        ),
        (
            {"robot.urdf": b"<robot/>", "parameters.yaml": parameters({"base_link": "a"})},
            r"lacks parameters robot\.\*",
        ),
    ],
)
def test_a_bag_that_does_not_say_what_its_plans_are_for_is_refused(
    attached: dict[str, bytes], message: str, lemur_plan: Plan, tmp_path: Path
) -> None:
    answer = answer_of(lemur_plan)
    bag = write_bag(tmp_path / "bag", attached, answer)
    with pytest.raises(BagError, match=message):
        robot_plans(bag)


def test_an_attached_urdf_that_is_none_is_refused(lemur_plan: Plan, tmp_path: Path) -> None:
    answer = answer_of(lemur_plan)
    attached = {"robot.urdf": b"\xff\xfe", "parameters.yaml": parameters(LINKS)}
    with pytest.raises(InvalidInput, match=r"robot\.urdf is not XML"):
        robot_plans(write_bag(tmp_path / "bag", attached, answer))


def test_a_plan_for_other_joints_is_refused(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    answer = answer_of(lemur_plan)
    answer.plans[0].joint_trajectory.joint_names = [f"other_{k}" for k in range(7)]
    attached = {
        "robot.urdf": lemur_capture.robot.urdf.encode(),
        "parameters.yaml": parameters(LINKS),
    }
    with pytest.raises(BagError, match=r"run\.1 moves other_0.*its robot has joint_1"):
        robot_plans(write_bag(tmp_path / "bag", attached, answer))


def test_a_plan_comes_with_the_scene_that_it_was_made_among(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    """Of its request, or as it was received; where the bag has neither, it is not known."""
    record_answer(tmp_path / "bag", PlanningTask(lemur_capture, SETTINGS), lemur_plan, 0.5)
    (asked,) = robot_plans(tmp_path / "bag").scenes.values()
    stamp = 10**18 + 5 * 10**9
    answer = answer_of(lemur_plan)
    answer.inputs.obstacles_stamp.sec = stamp // 10**9
    attached = {
        "robot.urdf": lemur_capture.robot.urdf.encode(),
        "parameters.yaml": parameters(LINKS),
    }
    alone = write_bag(tmp_path / "alone", attached, answer)
    with BagWriter(tmp_path / "received", flush_interval=0.0) as bag:
        for name, content in attached.items():
            bag.attach(name, "text/plain", content)
        message = obstacles_message(lemur_capture.obstacles, stamp, "inertial")
        bag.add_topic("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", [])
        bag.write("/obstacles", encode(message), 0, 0)
        bag.add_topic(EVENTS, EVENT, [])
        bag.write(EVENTS, encode(sent(answer)), 1, 1)
    (received,) = robot_plans(tmp_path / "received").scenes.values()
    for scene in (asked, received):
        for found, wanted in zip(scene.obstacles, lemur_capture.obstacles, strict=True):
            assert (found.id, found.radius) == (wanted.id, wanted.radius)
            np.testing.assert_array_equal(found.center, wanted.center)
    assert asked.target is not None
    np.testing.assert_array_equal(asked.target.position, lemur_capture.target.position)
    assert asked.capture_time == lemur_capture.duration
    assert robot_plans(alone).scenes == {}


@pytest.mark.parametrize("angle", ["chaser_attitude", "chaser_rotation"])
@pytest.mark.parametrize("effort", ["from_urdf", "none"])
@pytest.mark.parametrize(
    ("asked", "parameter", "kept"),
    [([], 0.0, math.inf), ([], 0.3, 0.3), ([0.2], 0.3, 0.2), ([0.2], 0.0, 0.2)],
)
def test_a_plan_comes_with_the_limits_of_the_node_and_of_its_request(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    tmp_path: Path,
    asked: list[float],
    parameter: float,
    kept: float,
    effort: str,
    angle: str,
) -> None:
    robust = {"sigmas": 3.0, "mass": 0.25, "angular_velocity": 0.5}
    told = {
        "robot": LINKS,
        "limits": {angle: parameter, "effort": effort},
        "planner": {"robust": robust},
    }
    attached = {
        "robot.urdf": lemur_capture.robot.urdf.encode(),
        "parameters.yaml": yaml.safe_dump({"/**": {"ros__parameters": told}}).encode(),
    }
    directory = tmp_path / "bag"
    answer = answer_of(lemur_plan)
    request = PlanRequest(limits=LimitsMessage(**{angle: asked}))
    with BagWriter(directory, flush_interval=0.0) as bag:
        for name, content in attached.items():
            bag.attach(name, "text/plain", content)
        bag.add_topic(EVENTS, EVENT, [])
        for time, event in enumerate((received(request), sent(answer))):
            bag.write(EVENTS, encode(event), time, time)
    found = robot_plans(directory)
    limits = found.limits["run.1"]
    assert limits == Limits(**{angle: kept}, joint_torques=effort == "from_urdf")
    assert found.uncertainty == Uncertainty(mass=0.25, angular_velocity=0.5)
