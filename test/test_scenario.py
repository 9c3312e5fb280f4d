"""Scenario files."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from robots import LEMUR_URDF
from scipy.spatial.transform import Rotation

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.task.task import perform

# Every key of the format; the robot lies in the directory that `saved` writes to.
SCENARIO: dict[str, Any] = {
    "robot": {"urdf": "lemur.urdf", "base_link": "chaser", "tip_link": "end_effector"},
    "chaser": {
        "position": [1.0, 2.0, 3.0],
        "quaternion_xyzw": [0.0, 0.6, 0.0, 0.8],
        "linear_velocity": [0.01, 0.02, 0.03],
        "angular_velocity": [0.04, 0.05, 0.06],
    },
    "joints": {
        "position": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7],
        "velocity": [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07],
    },
    "target": {
        "position": [1.5, 2.5, 3.5],
        "quaternion_xyzw": [0.6, 0.0, 0.8, 0.0],
        "linear_velocity": [0.1, 0.2, 0.3],
        "angular_velocity": [0.4, 0.5, 0.6],
        "linear_acceleration": [0.7, 0.8, 0.9],
        "angular_acceleration": [1.0, 1.1, 1.2],
    },
    "duration": 12.5,
    "points": 40,
    "obstacles": [
        {"id": "mast", "center": [4.0, 5.0, 6.0], "radius": 0.25},
        {"id": "dish", "center": [7, 8, 9], "radius": 1},
    ],
    "objective": {"joint_path_length": 0.5, "chaser_attitude": 2.0},
    "limits": {"position": "from_urdf", "velocity": "from_urdf"},
}
MISSING = object()


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Where the robot lies that `SCENARIO` names."""
    (tmp_path / "lemur.urdf").write_text(LEMUR_URDF.read_text())
    return tmp_path


def saved(directory: Path, dotted: str = "", value: object = MISSING) -> Path:
    """Write `SCENARIO` with one value replaced, added or, if `MISSING`, taken out."""
    scenario = deepcopy(SCENARIO)
    if dotted:
        *parents, key = dotted.split(".")
        entry: Any = scenario
        for parent in parents:
            entry = entry[int(parent)] if parent.isdigit() else entry[parent]
        if value is MISSING:
            del entry[key]
        else:
            entry[key] = value
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return path


def refusal_of(path: Path) -> InvalidInput:
    """The error that loading raises."""
    with pytest.raises(InvalidInput) as refusal:
        load_scenario(path)
    return refusal.value


def test_every_value_of_a_file_arrives(directory: Path) -> None:
    problem = load_scenario(saved(directory))
    chaser, target = SCENARIO["chaser"], SCENARIO["target"]
    assert problem.robot.tip_link == "end_effector"
    for ours, written in (
        (problem.start.position_chaser_in_inertial, chaser["position"]),
        (problem.start.quaternion_chaser_to_inertial_xyzw, chaser["quaternion_xyzw"]),
        (problem.start.linear_velocity_chaser_in_inertial, chaser["linear_velocity"]),
        (problem.start.angular_velocity_chaser_in_inertial, chaser["angular_velocity"]),
        (problem.start.joint_positions, SCENARIO["joints"]["position"]),
        (problem.start.joint_velocities, SCENARIO["joints"]["velocity"]),
        *((getattr(problem.target, key), target[key]) for key in target),
        (problem.obstacles[0].center, [4.0, 5.0, 6.0]),
        (problem.obstacles[1].center, [7.0, 8.0, 9.0]),
    ):
        np.testing.assert_allclose(ours, written, rtol=1e-15)
    assert [(sphere.id, sphere.radius) for sphere in problem.obstacles] == [
        ("mast", 0.25),
        ("dish", 1.0),
    ]
    assert (problem.duration, problem.points) == (12.5, 40)
    assert problem.objective.joint_path_length == 0.5
    assert problem.objective.chaser_attitude == 2.0
    assert problem.limits.joint_velocities


def test_every_value_of_a_body_arrives(directory: Path) -> None:
    body = {
        "position": [1.5, 2.5, 3.5],
        "quaternion_xyzw": [0.6, 0.0, 0.8, 0.0],
        "linear_velocity": [0.01, -0.02, 0.03],
        "angular_velocity": [-0.04, 0.05, 0.06],
    }
    inertia = {"ixx": 3.0, "ixy": 0.1, "ixz": -0.2, "iyy": 4.0, "iyz": 0.3, "izz": 5.0}
    grasp = {"position": [0.5, 0.6, -0.7], "quaternion_xyzw": [0.0, 0.6, 0.0, -0.8]}
    mast = {"id": "boom", "center": [-1.0, -1.5, 2.5], "radius": 0.2}
    scenario = yaml.safe_load(saved(directory, "target").read_text())
    scenario["target_body"] = body | {"inertia": inertia, "grasp": grasp, "obstacles": [mast]}
    (directory / "body.yaml").write_text(yaml.safe_dump(scenario))
    found = load_scenario(directory / "body.yaml").target_body
    assert found is not None
    for name, wanted in body.items():
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=1e-15)
    assert found.inertia.tolist() == [[3.0, 0.1, -0.2], [0.1, 4.0, 0.3], [-0.2, 0.3, 5.0]]
    np.testing.assert_allclose(found.grasp_position, grasp["position"])
    np.testing.assert_allclose(found.grasp_quaternion_xyzw, grasp["quaternion_xyzw"], rtol=1e-15)
    (sphere,) = found.obstacles
    assert (sphere.id, *sphere.position, sphere.radius) == ("boom", -1.0, -1.5, 2.5, 0.2)


def test_a_target_that_names_no_twist_is_at_rest(directory: Path) -> None:
    target = {key: SCENARIO["target"][key] for key in ("position", "quaternion_xyzw")}
    problem = load_scenario(saved(directory, "target", target))
    for name in ("linear_velocity", "angular_velocity", "linear_acceleration"):
        np.testing.assert_array_equal(getattr(problem.target, name), np.zeros(3))


def test_euler_angles_turn_about_x_then_y_then_z_of_the_inertial_frame(directory: Path) -> None:
    target = {"position": [0.0, 0.0, 0.0], "euler_xyz_deg": [-65.0, 80.0, -85.0]}
    quaternion = load_scenario(saved(directory, "target", target)).target.quaternion_xyzw
    about_x, about_y, about_z = (
        Rotation.from_rotvec(np.deg2rad(angle) * axis)
        for angle, axis in zip((-65.0, 80.0, -85.0), np.eye(3), strict=True)
    )
    np.testing.assert_allclose(
        Rotation.from_quat(quaternion).as_matrix(),
        (about_z * about_y * about_x).as_matrix(),
        atol=1e-15,
    )


def test_limits_may_be_left_out(directory: Path) -> None:
    found = load_scenario(saved(directory, "limits"))
    assert found.points == 40
    assert found.limits.joint_accelerations is None


@pytest.mark.parametrize(
    ("value", "limits"), [("none", None), (0.2, (0.2,) * 7), ([0.1], (0.1,) * 7)]
)
def test_joint_accelerations_are_limited_where_the_file_says_so(
    directory: Path, value: object, limits: tuple[float, ...] | None
) -> None:
    found = load_scenario(saved(directory, "limits.acceleration", value)).limits
    assert found.joint_accelerations == limits


def test_a_robot_may_lie_in_a_package(directory: Path) -> None:
    uri = "package://ff_planner_ros/config/robots/lemur/lemur.urdf"
    assert load_scenario(saved(directory, "robot.urdf", uri)).robot.joints == 7


def test_the_reference_scenario_is_the_paper_s(lemur_capture: PlanningProblem) -> None:
    start, target = lemur_capture.start, lemur_capture.target
    np.testing.assert_array_equal(start.linear_velocity_chaser_in_inertial, [0.02, 0.0, 0.05])
    np.testing.assert_array_equal(start.angular_velocity_chaser_in_inertial, [0.0, 0.05, 0.01])
    np.testing.assert_allclose(
        np.rad2deg(start.joint_positions),
        [12.54, -13.90, 0.0, -64.93, -105.28, 65.61, -127.95],
        rtol=1e-14,
    )
    np.testing.assert_allclose(
        np.rad2deg(start.joint_velocities),
        [0.261, -0.076, -0.071, -1.794, -5.066, -0.416, -0.969],
        atol=0.0013,
    )
    np.testing.assert_array_equal(target.position, [1.7, 0.4, 0.6])
    np.testing.assert_array_equal(target.linear_velocity, np.zeros(3))
    assert {sphere.id: (*sphere.center, sphere.radius) for sphere in lemur_capture.obstacles} == {
        "c1": (1.2, 0.4, 0.54, 0.20),
        "c2": (1.2, 0.7, 0.7, 0.15),
        "c3": (1.2, 0.1, 0.7, 0.25),
    }
    assert (lemur_capture.duration, lemur_capture.points) == (10.0, 50)


@pytest.mark.parametrize(
    "name",
    [
        *(key for key in SCENARIO if key not in ("limits", "points")),
        *(f"{key}.{name}" for key in ("robot", "chaser", "objective") for name in SCENARIO[key]),
        "joints.position",
        "joints.velocity",
        "target.position",
        "target.quaternion_xyzw",
    ],
)
def test_a_missing_key_is_named(directory: Path, name: str) -> None:
    error = refusal_of(saved(directory, name))
    assert (error.field, error.value) == (name, "missing")


def test_points_that_a_scenario_leaves_out_are_those_of_the_parameter(directory: Path) -> None:
    path = saved(directory, "points")
    told = load_task(path, Defaults(load_parameters().planner)).problem.points
    assert load_scenario(path).points == told == load_parameters().points


def test_accelerations_of_the_joints_may_be_given(directory: Path) -> None:
    assert load_scenario(saved(directory)).start.joint_accelerations is None
    given = [0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7]
    found = load_scenario(saved(directory, "joints.acceleration", given)).start
    assert found.joint_accelerations is not None
    assert found.joint_accelerations.tolist() == given


@pytest.mark.parametrize("key", ["id", "center", "radius"])
def test_a_missing_key_of_an_obstacle_is_named(directory: Path, key: str) -> None:
    error = refusal_of(saved(directory, f"obstacles.1.{key}"))
    assert (error.field, error.value) == (f"obstacles[1].{key}", "missing")


@pytest.mark.parametrize(
    "name", ["", "robot.", "chaser.", "joints.", "target.", "objective.", "limits.", "obstacles.0."]
)
def test_an_unknown_key_is_named(directory: Path, name: str) -> None:
    error = refusal_of(saved(directory, f"{name}colour", "blue"))
    assert error.field == f"{name}colour".replace(".0", "[0]")
    assert error.value == "unknown"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("robot", "lemur.urdf", "robot is lemur.urdf: it must hold urdf, base_link, tip_link"),
        ("robot.urdf", 7, "robot.urdf is 7: it must be text"),
        ("robot.urdf", "gone.urdf", "robot.urdf is gone.urdf: there is no file "),
        ("robot.urdf", "package://gone/a.urdf", "robot.urdf is package://gone/a.urdf: there is"),
        ("robot.base_link", "bus", "robot.base_link is bus: it must be one of the URDF's links"),
        ("robot.tip_link", ["hand"], "robot.tip_link is ['hand']: it must be text"),
        ("chaser", None, "chaser is None: it must hold position, quaternion_xyzw, "),
        ("chaser.position", 1.0, "chaser.position is 1.0: it must be a list"),
        ("chaser.position", [1.0, 2.0], "chaser.position is [1. 2.]: it must have 3 entries"),
        ("chaser.position", [1.0, 2.0, "c"], "chaser.position[2] is 'c': it must be a number"),
        ("chaser.position", [1.0, 2.0, float("nan")], "chaser.position is [ 1.  2. nan]: every"),
        ("chaser.quaternion_xyzw", [0, 0, 0, 0], "chaser.quaternion_xyzw is [0.0, 0.0, 0.0, 0.0]"),
        ("chaser.linear_velocity", {}, "chaser.linear_velocity is {}: it must be a list"),
        ("chaser.angular_velocity", [float("inf")] * 3, "chaser.angular_velocity is [inf inf inf]"),
        ("joints", [], "joints is []: it must hold position, velocity, end_effector_at_rest"),
        ("joints.position", [0.0] * 6, "joints.position is [0. 0. 0. 0. 0. 0.]: it must have 7"),
        ("joints.acceleration", [0.0] * 8, "joints.acceleration is [0. 0. 0. 0. 0. 0. 0. 0.]: it"),
        ("joints.acceleration", None, "joints.acceleration is None"),
        ("joints.velocity", [0.0] * 8, "joints.velocity is [0. 0. 0. 0. 0. 0. 0. 0.]: it must h"),
        ("joints.end_effector_at_rest", True, "joints.velocity is given twice: give it or"),
        ("joints.end_effector_at_rest", 1, "joints.end_effector_at_rest is 1: it must be true or"),
        ("target", 0, "target is 0: it must hold position, quaternion_xyzw, euler_xyz_deg, "),
        ("target.position", [1, 2], "target.position is [1. 2.]: it must have 3 entries"),
        ("target.quaternion_xyzw", [1, 0, 0], "target.quaternion_xyzw is [1. 0. 0.]: it must ha"),
        ("target.euler_xyz_deg", [0, 0, 0], "target.quaternion_xyzw is given twice: give it or"),
        ("target.linear_velocity", [0, 0, None], "target.linear_velocity[2] is None: it must be"),
        ("duration", "10 s", "duration is '10 s': it must be a number"),
        ("duration", 0, "duration is 0.0: it must be greater than 0"),
        ("duration", float("nan"), "duration is nan: it must be finite"),
        ("points", 50.0, "points is 50.0: it must be a whole number"),
        ("points", 4, "points is 4: it must be from 5 to 10000"),
        ("obstacles", None, "obstacles is None: it must be a list"),
        ("obstacles.0.id", 5, "obstacles[0].id is 5: it must be text"),
        ("obstacles.1.id", "mast", "obstacles[1].id is mast: it must be unique"),
        ("obstacles.1.center", [7, 8], "obstacles[dish].center is [7. 8.]: it must have 3"),
        ("obstacles.1.radius", "big", "obstacles[1].radius is 'big': it must be a number"),
        ("obstacles.1.velocity", [7, 8], "obstacles[dish].velocity is [7. 8.]: it must have 3"),
        ("obstacles.1.velocity", [0, -1e200, 0], "obstacles[dish].velocity is [ 0.e+000 -1.e+200"),
        ("obstacles.1.velocity", 7, "obstacles[1].velocity is 7: it must be a list"),
        ("obstacles.1.radius", 0, "obstacles[dish].radius is 0.0: it must be greater than 0"),
        ("objective.chaser_attitude", -1, "objective.chaser_attitude is -1.0: it must not be neg"),
        ("objective", {"joint_path_length": 0, "chaser_attitude": 0}, "objective is all zero: one"),
        ("limits", "from_urdf", "limits is from_urdf: it must hold position"),
        ("limits.position", "none", "limits.position is none: it must be from_urdf"),
        ("limits.velocity", "fast", "limits.velocity is fast: it must be from_urdf or none"),
        ("limits.velocity", True, "limits.velocity is True: it must be from_urdf or none"),
        ("limits.acceleration", "slow", "limits.acceleration is 'slow': it must be a number"),
        ("limits.acceleration", 0, "limits.acceleration is 0.0: it must be greater than 0"),
        ("limits.acceleration", [0.1, 0.2], "limits.acceleration is (0.1, 0.2): it must have 7"),
        ("limits.acceleration", [0.1] * 6 + [-1.0], "limits.acceleration[6] is -1.0: it must be"),
    ],
)
def test_a_value_that_cannot_be_planned_with_is_refused_by_its_dotted_name(
    directory: Path, name: str, value: object, message: str
) -> None:
    assert str(refusal_of(saved(directory, name, value))).startswith(message)


@pytest.mark.parametrize(
    ("name", "value"),
    [("limits", MISSING), ("limits.velocity", MISSING), ("limits.velocity", "none")],
)
def test_joint_rates_are_limited_only_where_the_file_says_so(
    directory: Path, name: str, value: object
) -> None:
    assert not load_scenario(saved(directory, name, value)).limits.joint_velocities


def test_euler_angles_of_two_entries_are_refused(directory: Path) -> None:
    target = {"position": [0.0, 0.0, 0.0], "euler_xyz_deg": [1.0, 2.0]}
    error = refusal_of(saved(directory, "target", target))
    assert error.field == "target.euler_xyz_deg"


def test_joint_rates_given_as_not_at_rest_are_still_missing(directory: Path) -> None:
    joints = {"position": SCENARIO["joints"]["position"], "end_effector_at_rest": False}
    error = refusal_of(saved(directory, "joints", joints))
    assert (error.field, error.value) == ("joints.velocity", "missing")


def test_the_end_effector_cannot_be_at_rest_in_a_singular_posture(directory: Path) -> None:
    stretched = [0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0]
    joints = {"position": stretched, "end_effector_at_rest": True}
    assert refusal_of(saved(directory, "joints", joints)).status is Status.START_SINGULAR


@pytest.mark.parametrize("limited", ["from_urdf", "none"])
@pytest.mark.parametrize("ahead", [0.0, 0.001])
def test_a_chaser_too_fast_for_an_end_effector_at_rest_is_what_the_file_says(
    directory: Path, limited: str, ahead: float
) -> None:
    """A file in a frame in which the chaser orbits: it gives no joint velocity."""
    scenario = deepcopy(SCENARIO)
    joints = {"position": scenario["joints"]["position"], "end_effector_at_rest": True}
    scenario["chaser"]["linear_velocity"] = [7500.0, 0.0, 0.0]
    scenario |= {"joints": joints, "limits": {"velocity": limited}, "start_after": ahead}
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario))
    task = load_task(path, Defaults(load_parameters().planner))
    with pytest.raises(InvalidInput) as refused:
        perform(task)
    error = refused.value
    assert error.field == "joints.end_effector_at_rest"
    assert re.match(r"true, for which joint_\d (moves at|comes to) -?\d+", str(error.value))
    assert "while the chaser moves at 7500 m/s" in str(error.value)
    given = replace(task.problem, start=replace(task.problem.start, ee_at_rest=False))
    assert replace(task, problem=given).digest == task.digest


@pytest.mark.parametrize("content", ["", "[1, 2]", "text", "duration: [", "\x00"])
def test_a_file_that_is_no_scenario_is_refused(directory: Path, content: str) -> None:
    path = directory / "scenario.yaml"
    path.write_text(content)
    assert refusal_of(path).field == "file"


def test_a_file_that_is_not_there_is_refused(directory: Path) -> None:
    assert refusal_of(directory / "gone.yaml").field == "file"


def test_conditions_that_are_too_many_are_named_before_an_arm_that_cannot_rest(
    directory: Path,
) -> None:
    scenario = deepcopy(SCENARIO)
    scenario["robot"]["locked_joints"] = {"joint_1": 0.5, "joint_2": 0.5}
    scenario["joints"] = {"position": [0.1] * 5, "end_effector_at_rest": True}
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario))
    with pytest.raises(InvalidInput, match=r"target\.orientation is fixed: .*the arm has 5 joints"):
        load_scenario(path)
