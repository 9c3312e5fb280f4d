"""A circle is a short form of a path: its points follow from where the end effector starts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from robots import LEMUR_SCENARIO
from scipy.spatial.transform import Rotation

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.path.circle import CircleToFollow, Turning
from ff_planner_ros.planning.problem.path.followed import PathToFollow, curve_of, end_effector
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform

AXIS = np.array([0.6, 0.0, 0.8])
OFF = np.array([0.05, -0.08, 0.03])  # from the end effector at the start to the axis [m]


def at_rest(goal: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return the paper's capture as a document, at rest, turned, with another goal."""
    document = yaml.safe_load(LEMUR_SCENARIO.read_text())
    document["robot"]["urdf"] = str(LEMUR_SCENARIO.parent / document["robot"]["urdf"])
    document["chaser"] = {
        "position": [0.3, -0.2, 0.1], "quaternion_xyzw": [0.5, 0.5, -0.5, 0.5],
        "linear_velocity": [0.0] * 3, "angular_velocity": [0.0] * 3,
    }  # fmt: skip
    document["joints"] = {"position": document["joints"]["position"], "velocity": [0.0] * 7}
    return document | {"target": goal, "obstacles": [], "duration": 12.0} | more


def loaded(document: dict[str, Any], path: Path) -> PlanningTask:
    path.write_text(yaml.safe_dump(document))
    return load_task(path, Defaults(load_parameters().planner))


def circling(tmp_path: Path, **circle: Any) -> PlanningTask:
    """Return the task of a circle about an axis beside the end effector, wherever that is."""
    still = loaded(at_rest({"at_rest": True}), tmp_path / "still.yaml").problem
    center = end_effector(still.robot, still.start)[0].translation + OFF
    told = {"center": center.tolist(), "axis": AXIS.tolist()} | circle
    goal = {"circle": told, "position_tolerance": 5e-4, "orientation_tolerance": 2e-3}
    return loaded(at_rest(goal), tmp_path / "circle.yaml")


def expected(task: PlanningTask, turns: float, times: np.ndarray):
    """Return positions and turns of the circle by Rodrigues' formula."""
    problem = task.problem
    pose, _ = end_effector(problem.robot, problem.start)
    center, s = pose.translation + OFF, times / problem.duration
    angles = 2.0 * np.pi * turns * (6.0 * s**5 - 15.0 * s**4 + 10.0 * s**3)
    arm = pose.translation - center
    across = np.cross(AXIS, arm)
    along = AXIS * (AXIS @ arm)
    places = center + along + np.cos(angles)[:, None] * (arm - along)
    return places + np.sin(angles)[:, None] * across, angles[:, None] * AXIS, pose.rotation


@pytest.mark.parametrize("turns", [1.0, -0.3, 2.5])
@pytest.mark.parametrize("orientation", list(Turning))
def test_the_curve_is_the_circle_between_its_points_too(turns, orientation, tmp_path):
    task = circling(tmp_path, turns=turns, orientation=str(orientation))
    times = np.linspace(0.0, 12.0, 4001)
    poses, (places, turned, at_start) = (
        curve_of(task.problem).at(times),
        expected(task, turns, times),
    )
    assert np.linalg.norm(poses.positions - places, axis=1).max() < 0.02 * 5e-4
    if orientation is Turning.FREE:
        assert poses.rotations is None
        return
    if orientation is Turning.KEPT:
        turned = np.zeros_like(turned)
    wanted = Rotation.from_rotvec(turned) * Rotation.from_matrix(at_start)
    off = wanted.inv() * Rotation.from_quat(poses.quaternions)
    assert off.magnitude().max() < 1e-5


def test_a_plan_keeps_the_circle(tmp_path):
    task = circling(tmp_path, turns=-0.15, orientation="carried")
    plan = perform(task)
    motion, robot = plan.trajectory, task.problem.robot
    places, turned, at_start = expected(task, -0.15, motion.time)
    q = np.hstack([
        motion.chaser_positions, motion.chaser_quaternions_xyzw, motion.joint_positions,
    ])  # fmt: skip
    data = robot.model.createData()
    for one, place, turn in zip(q, places, turned, strict=True):
        pin.framesForwardKinematics(robot.model, data, one)
        tip = data.oMf[robot.tip_frame_id]
        assert np.linalg.norm(tip.translation - place) < 5e-4 * 1.02
        assert np.linalg.norm(pin.log3((pin.exp3(turn) @ at_start).T @ tip.rotation)) < 2.1e-3


def test_it_is_written_as_the_points_of_a_path(tmp_path):
    task = circling(tmp_path, orientation="kept")
    write_scenario(task, tmp_path / "written.yaml")
    written = yaml.safe_load((tmp_path / "written.yaml").read_text())
    assert len(written["target"]["path"]) == len(task.problem.path.points)
    again = load_task(tmp_path / "written.yaml", Defaults(task.settings))
    assert again.digest == task.digest
    assert isinstance(again.problem.path, PathToFollow)


def test_an_axis_through_the_end_effector_makes_no_circle(tmp_path):
    still = loaded(at_rest({"at_rest": True}), tmp_path / "still.yaml").problem
    tip = end_effector(still.robot, still.start)[0].translation
    goal = {"circle": {"center": (tip + 0.7 * AXIS).tolist(), "axis": AXIS.tolist()}}
    with pytest.raises(InvalidInput, match="further away than position_tolerance") as refusal:
        loaded(at_rest(goal), tmp_path / "on_axis.yaml")
    assert refusal.value.field == "target.circle.center"


def test_too_many_turns_are_refused(tmp_path):
    with pytest.raises(InvalidInput, match="10000 points") as refusal:
        circling(tmp_path, turns=1e4)
    assert refusal.value.field == "target.circle.turns"


def test_it_is_refused_in_a_later_phase(tmp_path):
    goal = {"circle": {"center": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0]}}
    phases = [{"target": {"at_rest": True}, "duration": 5.0}, {"target": goal, "duration": 5.0}]
    document = at_rest({}, phases=phases)
    del document["target"], document["duration"]
    with pytest.raises(InvalidInput, match="first phase alone") as refusal:
        loaded(document, tmp_path / "phases.yaml")
    assert refusal.value.status is Status.UNSUPPORTED
    assert refusal.value.field == "phases[1].target.circle"


def test_the_circle_is_about_the_end_effector_that_the_start_has(tmp_path):
    """Another posture at the start is another circle: nothing of it is in the file."""
    task = circling(tmp_path, turns=0.1)
    problem = task.problem
    circle = CircleToFollow(center=np.zeros(3), axis=AXIS, turns=0.1)
    bent = replace(problem.start, joint_positions=problem.start.joint_positions + 0.1)
    for start in (problem.start, bent):
        place = pin.SE3(end_effector(problem.robot, start)[0]).translation
        first = circle.path(problem.robot, start, 3.0).points[0]
        assert np.allclose(first.position, place, rtol=0.0, atol=1e-15)
