"""Joints that are locked where they were measured: in scenarios, and in the node."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from heard_inputs import HeardScenes, HeardStates
from robots import CONFIG, LEMUR_URDF
from ros_processes import FRAME, Scene

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.robot import RobotParameters, locked_joints_of
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import Defaults, built_task, load_scenario
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.ros.inputs.locked_joints import MeasuredRobot
from ff_planner_ros.ros.requests.reading import Knowledge, measured_state, read_request

NOW = 1_000 * NANOSECONDS
OTHER = """<link name="other"><inertial><origin xyz="0.4 0 0"/><mass value="60"/>
<inertia ixx="1" iyy="3" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="other_arm" type="revolute"><parent link="chaser"/><child link="other"/>
<origin xyz="-0.7 0 0.4"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<link name="hand"><inertial><mass value="2"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="other_hand" type="revolute"><parent link="other"/><child link="hand"/>
<origin xyz="0.8 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/>
<mimic joint="other_arm" multiplier="-0.5"/></joint></robot>"""
LOCKED = {"other_arm": 1.2, "other_hand": -0.6}


def two_arms() -> str:
    return LEMUR_URDF.read_text().replace("</robot>", OTHER)


def where(robot: Robot) -> dict[str, float]:
    return {one.name: one.position for one in robot.locked_joints if not one.is_fixed}


class Node:
    """What a node knows whose second arm is where it is measured."""

    def __init__(self, problem: PlanningProblem, tolerance: float = 0.02) -> None:
        given = load_parameters()
        own = replace(given.robot, locked_joints="measured", geometry="lines")
        self.parameters = replace(
            given,
            robot=own,
            inertial_frame=FRAME,
            planning_lead_time=0.0,
            locked_joint_tolerance=tolerance,
        )
        self.robot, self.renewed = own.load(two_arms()), list[Robot]()
        self.states = HeardStates(self.robot, self.parameters, lambda: NOW)
        self.robots = MeasuredRobot(
            self.robot, {}, lambda at: own.load(two_arms(), None, at), self.renewed.append
        )
        self.scene = Scene(problem)

    @property
    def knowledge(self) -> Knowledge:
        inputs = self.states, HeardScenes(lambda: NOW), None, NOW
        return Knowledge(self.robot, self.parameters, *inputs, robots=self.robots)

    def hear(self, at: float | None, rate: float = 0.0, hand: float | None = None) -> None:
        """Hear where the second arm is; None: of the first one alone."""
        state = self.scene.state(NOW)
        for name, where, moving in (
            ("other_arm", at, rate),
            ("other_hand", None if at is None else -0.5 * at if hand is None else hand, 0.0),
        ):
            if where is not None:
                state.joint_names = [*state.joint_names, name]
                state.joint_positions = [*state.joint_positions, where]
                state.joint_velocities = [*state.joint_velocities, moving]
        self.states.hear("chaser_state", state)

    def asked(self, own: bool = False) -> PlanningTask:
        request = self.scene.complete_request()
        if not own:
            request.start_state = []
        return read_request(request, self.knowledge).task


@pytest.fixture
def node(lemur_capture: PlanningProblem) -> Node:
    return Node(lemur_capture)


def test_a_request_is_planned_with_the_second_arm_where_it_is_measured(node: Node) -> None:
    node.hear(1.2)
    task = node.asked()
    assert where(task.problem.robot) == pytest.approx(LOCKED)
    expected = robot_from_urdf_text(
        two_arms(), "chaser", "end_effector", held_at={"other_arm": 1.2}
    )
    own = task.problem.robot.model.inertias[1]
    assert own.isApprox(expected.model.inertias[1], 1e-12)
    assert not own.isApprox(node.robot.model.inertias[1], 1e-3)
    (note,) = (note for note in task.problem.robot.notes if "other_arm" in note)
    assert "other_arm at 1.2 rad, other_hand at -0.6 rad" in note


def test_its_record_is_read_offline_as_the_same_task(node: Node) -> None:
    """The bag has the robot as it was configured; a task with another one brings its own."""
    node.hear(1.2)
    task = node.asked()
    document = json.loads(task_json(task, node.robot.drawn_urdf))
    again = built_task(document, None, Defaults(load_parameters().planner))
    assert again.digest == task.digest
    assert where(again.problem.robot) == pytest.approx(LOCKED)


def test_the_model_stays_until_a_joint_is_further_off_than_is_allowed(node: Node) -> None:
    found = []
    for at in (1.2, 1.21, 1.19, 1.23, 1.23):
        node.hear(at)
        found.append(node.asked().problem.robot)
    assert found[0] is found[1] is found[2]
    assert found[3] is found[4] is not found[0]
    assert node.renewed == [found[0], found[3]]


def test_a_second_arm_that_moves_or_was_never_measured_is_refused(node: Node) -> None:
    node.hear(1.2, rate=0.03)
    with pytest.raises(InvalidInput, match=r"joint_velocities\[other_arm\] is 0\.03 rad/s"):
        node.asked()
    unheard = Node(node.scene.problem)
    unheard.hear(None)
    with pytest.raises(InvalidInput, match="locked joint other_arm is never measured") as refused:
        unheard.asked()
    assert refused.value.status is Status.NO_STATE
    with pytest.raises(InvalidInput, match="locked joint other_arm is never measured"):
        unheard.asked(own=True)


def test_so_is_a_joint_that_is_not_where_the_one_takes_it_that_it_mimics(node: Node) -> None:
    node.hear(1.2, hand=0.0)
    with pytest.raises(InvalidInput, match=r"joint_positions\[other_hand\] is 0 rad") as refused:
        node.asked()
    assert refused.value.status is Status.START_OUTSIDE_LIMITS


def test_a_plan_that_waits_is_refused_when_the_second_arm_has_moved(node: Node) -> None:
    node.hear(1.2)
    planned = node.asked().problem.robot
    assert measured_state((), node.knowledge, planned).robot is planned
    node.hear(1.5)
    with pytest.raises(InvalidInput, match=r"joint_positions\[other_arm\] is 1\.5 rad"):
        measured_state((), node.knowledge, planned)


def test_a_joint_that_the_parameters_have_at_a_position_is_not_measured() -> None:
    text = "measured, other_arm: 0.3"
    assert locked_joints_of(text) == {"other_arm": 0.3}
    given = load_parameters().robot
    for told, measures in (("", False), (text, True), ("measured", True), ("a: 1", False)):
        assert replace(given, locked_joints=told).measures is measures
    robot = replace(given, locked_joints=text).load(two_arms(), None, {"other_arm": 1.2})
    assert where(robot)["other_arm"] == 0.3
    assert MeasuredRobot(robot, {"other_arm"}, lambda _: robot).at({}, 0.0) is robot
    with pytest.raises(InvalidInput, match=r"robot\.locked_joints"):
        RobotParameters(given.wheels, locked_joints="measures")


def scenario(directory: Path, **robot: object) -> dict[str, object]:
    (directory / "arms.urdf").write_text(two_arms())
    document = yaml.safe_load((CONFIG / "scenarios/lemur_capture.yaml").read_text())
    document["robot"] |= {"urdf": str(directory / "arms.urdf"), **robot}
    return dict(document)


def loaded(directory: Path, document: dict[str, object]) -> PlanningProblem:
    (directory / "s.yaml").write_text(yaml.safe_dump(document))
    return load_scenario(directory / "s.yaml")


def test_a_scenario_has_measured_positions_with_its_joints(tmp_path: Path) -> None:
    document = scenario(tmp_path, locked_joints="measured")
    document["joints"] |= {"locked": {"other_arm": 1.2}}
    robot = loaded(tmp_path, document).robot
    assert where(robot) == pytest.approx(LOCKED)
    given = loaded(tmp_path, scenario(tmp_path, locked_joints={"other_arm": 1.2})).robot
    assert robot.model == given.model
    np.testing.assert_array_equal(robot.position_chaser_in_base, given.position_chaser_in_base)


@pytest.mark.parametrize(
    ("locked_joints", "locked", "words"),
    [
        ("measured", {}, "joints.locked.other_arm is missing: robot.locked_joints is measured"),
        ("measured", None, "joints.locked.other_arm is missing: robot.locked_joints is measured"),
        ({}, {"other_arm": 1.0}, "joints.locked is given: it is there with robot.locked_joints"),
        ("measure", None, "robot.locked_joints is measure: it must hold a position"),
        ("measured", {"elbow": 1.0}, "robot.locked_joints 'elbow' is unknown"),
    ],
)
def test_without_them_it_is_refused(
    tmp_path: Path, locked_joints: object, locked: object, words: str
) -> None:
    document = scenario(tmp_path, locked_joints=locked_joints)
    if locked is not None:
        document["joints"] |= {"locked": locked}
    with pytest.raises(InvalidInput) as refused:
        loaded(tmp_path, document)
    assert words in str(refused.value)
