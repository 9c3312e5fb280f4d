"""Scenario files: a planning problem written down."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array, finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem import Limits, Objective, PlanningProblem, Sphere, Target
from ff_planner_ros.planning.yaml_file import (
    integer,
    mapping,
    number,
    numbers,
    read_yaml,
    sequence,
    text,
)
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import Robot, load_robot
from ff_planner_ros.robot.rotation import rotation_from_euler
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.share import resolve_uri

# A scenario names no frame, since it has one; messages about it must.
SCENARIO_FRAME = "inertial"


def load_scenario(path: Path) -> PlanningProblem:
    """Read a planning problem from a scenario file.

    Args:
        path: A YAML file; the URDF that it names is relative to it, or `package://`.

    Raises:
        InvalidInput: The file or its URDF cannot be read, or a value is unknown, missing, of
            the wrong type or not to be planned with; named as in the file, `chaser.position`.
    """
    scenario = mapping(
        "",
        read_yaml(path),
        required=(
            "robot",
            "chaser",
            "joints",
            "target",
            "duration",
            "points",
            "obstacles",
            "objective",
        ),
        optional=("limits",),
    )
    limits = mapping("limits", scenario.get("limits", {}), (), optional=("position", "velocity"))
    position_limits = limits.get("position", "from_urdf")
    if position_limits != "from_urdf":
        field, allowed = "limits.position", "it must be from_urdf"
        raise InvalidInput(Status.UNSUPPORTED, field, position_limits, allowed)
    robot = _robot(scenario["robot"], path.parent)
    return PlanningProblem(
        robot=robot,
        start=_start(robot, scenario["chaser"], scenario["joints"]),
        target=_target(scenario["target"]),
        duration=number("duration", scenario["duration"]),
        points=integer("points", scenario["points"]),
        obstacles=_obstacles(scenario["obstacles"]),
        objective=_objective(scenario["objective"]),
        limits=Limits(
            joint_velocities=from_urdf("limits.velocity", limits.get("velocity", "none"))
        ),
    )


def from_urdf(field: str, source: object) -> bool:
    """Return whether limits are kept: those `from_urdf`, or `none`.

    Raises:
        InvalidInput: It is neither.
    """
    if source not in ("from_urdf", "none"):
        allowed = "it must be from_urdf or none"
        raise InvalidInput(Status.UNSUPPORTED, field, source, allowed)
    return source == "from_urdf"


def _robot(value: object, directory: Path) -> Robot:
    entry = mapping("robot", value, required=("urdf", "base_link", "tip_link"))
    urdf = resolve_uri(text("robot.urdf", entry["urdf"]), relative_to=directory)
    base_link = text("robot.base_link", entry["base_link"])
    return load_robot(urdf, base_link, text("robot.tip_link", entry["tip_link"]))


def _start(robot: Robot, chaser: object, joints: object) -> SystemState:
    chaser_entry = mapping(
        "chaser",
        chaser,
        required=("position", "quaternion_xyzw", "linear_velocity", "angular_velocity"),
    )
    joints_entry = mapping(
        "joints", joints, required=("position",), optional=("velocity", "end_effector_at_rest")
    )
    at_rest = joints_entry.get("end_effector_at_rest", False)
    if not isinstance(at_rest, bool):
        field, allowed = "joints.end_effector_at_rest", "it must be true or false"
        raise InvalidInput(Status.OUT_OF_RANGE, field, repr(at_rest), allowed)
    if at_rest == ("velocity" in joints_entry):
        found = "given twice" if at_rest else "missing"
        allowed = "give it or `end_effector_at_rest: true`"
        raise InvalidInput(Status.OUT_OF_RANGE, "joints.velocity", found, allowed)
    pose_and_twist = {key: numbers(f"chaser.{key}", chaser_entry[key]) for key in chaser_entry}
    state = SystemState(
        position_chaser_in_inertial=pose_and_twist["position"],
        quaternion_chaser_to_inertial_xyzw=pose_and_twist["quaternion_xyzw"],
        linear_velocity_chaser_in_inertial=pose_and_twist["linear_velocity"],
        angular_velocity_chaser_in_inertial=pose_and_twist["angular_velocity"],
        joint_positions=finite_vector(
            "joints.position",
            numbers("joints.position", joints_entry["position"]),
            robot.joints,
        ),
        joint_velocities=np.zeros(robot.joints)
        if at_rest
        else numbers("joints.velocity", joints_entry["velocity"]),
    )
    if at_rest:
        return replace(state, joint_velocities=joint_rates_with_ee_at_rest(robot, state))
    return state


def _target(value: object) -> Target:
    entry = mapping(
        "target",
        value,
        required=("position",),
        optional=(
            "quaternion_xyzw",
            "euler_xyz_deg",
            "linear_velocity",
            "angular_velocity",
            "linear_acceleration",
            "angular_acceleration",
        ),
    )
    if ("quaternion_xyzw" in entry) == ("euler_xyz_deg" in entry):
        found = "given twice" if "euler_xyz_deg" in entry else "missing"
        allowed = "give it or euler_xyz_deg"
        raise InvalidInput(Status.BAD_QUATERNION, "target.quaternion_xyzw", found, allowed)
    vectors = {key: numbers(f"target.{key}", entry[key]) for key in entry}
    if "euler_xyz_deg" in vectors:
        vectors["quaternion_xyzw"] = _quaternion(vectors.pop("euler_xyz_deg"))
    return Target(**vectors)


def _quaternion(euler_xyz_deg: Array) -> Array:
    euler = np.deg2rad(finite_vector("target.euler_xyz_deg", euler_xyz_deg, 3))
    quaternion: Array = pin.Quaternion(rotation_from_euler(euler)).coeffs()
    return quaternion


def _obstacles(value: object) -> tuple[Sphere, ...]:
    spheres: dict[str, Sphere] = {}
    for index, item in enumerate(sequence("obstacles", value)):
        field = f"obstacles[{index}]"
        entry = mapping(field, item, required=("id", "center", "radius"))
        name = text(f"{field}.id", entry["id"])
        if name in spheres:
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.id", name, "it must be unique")
        center = numbers(f"{field}.center", entry["center"])
        spheres[name] = Sphere(name, center, number(f"{field}.radius", entry["radius"]))
    return tuple(spheres.values())


def _objective(value: object) -> Objective:
    entry = mapping("objective", value, required=("joint_path_length", "chaser_attitude"))
    return Objective(**{key: number(f"objective.{key}", entry[key]) for key in entry})
