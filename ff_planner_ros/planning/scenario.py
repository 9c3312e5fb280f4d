"""Scenario files: a planning task written down."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array, finite_number, finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.approach import CONE, Approach
from ff_planner_ros.planning.controller_rules import Controller
from ff_planner_ros.planning.joint_motion import JointMotion
from ff_planner_ros.planning.problem import (
    CONTACT_DISTANCE,
    DurationRange,
    Limits,
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Sphere,
    Target,
    with_attached_spheres,
)
from ff_planner_ros.planning.settings import USUAL_SIGMAS, PlannerSettings, RobustSettings
from ff_planner_ros.planning.tail import EndBehaviour
from ff_planner_ros.planning.target import require_enough_joints
from ff_planner_ros.planning.target_body import AttachedSphere, TargetBody
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.planning.yaml_file import (
    boolean,
    integer,
    mapping,
    number,
    numbers,
    read_yaml,
    sequence,
    text,
)
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import Base, Robot, load_robot
from ff_planner_ros.robot.rotation import rotation_from_euler
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.share import resolve_uri
from ff_planner_ros.shown import quoted

# A scenario names no frame, since it has one; messages about it must.
SCENARIO_FRAME = "inertial"

_NO_LIMITS = Limits()

_ROBOT_MAY_HAVE = ("base", "held_joints", "geometry", "srdf")
_REQUIRED = ("robot", "chaser", "joints", "duration", "obstacles", "objective")
_OF_PROBLEM = (
    *("target", "target_body", "points", "limits", "parametrisation"),
    *("allowed_at_goal", "contact_distance", "approach"),
)
_OF_TASK = (
    *(
        "start_after",
        "running",
        "running_goal",
        "end_behaviour",
        "tail_duration",
        "controller",
        "planner",
    ),
    "first_guess",
)


@dataclass(frozen=True)
class Defaults:
    """Values for what a scenario leaves out. What has no value here must be in the scenario."""

    settings: PlannerSettings
    limits: Limits = _NO_LIMITS  # beside the joints' position limits
    end_behaviour: EndBehaviour = EndBehaviour.AS_PLANNED  # what the arm does after the goal
    tail: float | None = None  # duration [s]
    points: int | None = None  # of the plan
    controller: Controller | None = None  # must take the plan; its joints are the robot's


def load_scenario(path: Path) -> PlanningProblem:
    """Read a planning problem from a scenario file.

    The URDF that it names is relative to it, or `package://`.

    Raises:
        InvalidInput: The file or its URDF cannot be read, or a value is unknown, missing, of
            the wrong type or not to be planned with; named as in the file, `chaser.position`.
    """
    return _problem(_document(path), path.parent, _NO_LIMITS, None)


def load_task(path: Path, defaults: Defaults) -> PlanningTask:
    """Read a planning task from a scenario file.

    Raises:
        InvalidInput: As by `load_scenario`.
    """
    scenario = _document(path)
    problem = _problem(scenario, path.parent, defaults.limits, defaults.points)
    joints, end_behaviour = problem.robot.joints, defaults.end_behaviour
    if "end_behaviour" in scenario:
        end_behaviour = end_behaviour_of(text("end_behaviour", scenario["end_behaviour"]))
    tail = 0.0
    if end_behaviour is not EndBehaviour.AS_PLANNED:
        tail = number("tail_duration", scenario.get("tail_duration", defaults.tail))
    running, guess = scenario.get("running"), scenario.get("first_guess")
    goal = scenario.get("running_goal")
    names = [item.name for item in fields(PlannerSettings)]
    changes = dict(mapping("planner", scenario.get("planner", {}), (), optional=names))
    if "robust" in changes:
        changes["robust"] = robust_of(changes["robust"], defaults.settings.robust)
    return PlanningTask(
        problem=problem,
        settings=replace(defaults.settings, **changes),
        ahead=number("start_after", scenario.get("start_after", 0.0)),
        running=None if running is None else _running(running, joints),
        running_goal=None if goal is None else number("running_goal", goal),
        end_behaviour=end_behaviour,
        tail=tail,
        controller=_controller(scenario, problem.robot, defaults.controller),
        first_guess=None if guess is None else numbers("first_guess", guess),
    )


def robust_of(value: object, defaults: RobustSettings) -> RobustSettings:
    """Return what a mapping asks to keep back; without a word on how much it is the usual.

    Raises:
        InvalidInput: It is no such mapping.
    """
    names = [item.name for item in fields(RobustSettings)]
    told = mapping("planner.robust", value, (), optional=names)
    return replace(defaults, **({"sigmas": defaults.sigmas or USUAL_SIGMAS} | told))


def end_behaviour_of(word: str) -> EndBehaviour:
    """Return what a word stands for.

    Raises:
        InvalidInput: It is not known.
    """
    if word not in tuple(EndBehaviour):
        allowed = f"it must be {', '.join(EndBehaviour)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "end_behaviour", quoted(word), allowed)
    return EndBehaviour(word)


def parametrisation_of(word: str) -> Parametrisation:
    """Return what a word stands for.

    Raises:
        InvalidInput: It is not known.
    """
    if word not in tuple(Parametrisation):
        allowed = f"it must be {', '.join(Parametrisation)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "parametrisation", quoted(word), allowed)
    return Parametrisation(word)


def _document(path: Path) -> dict[str, Any]:
    return mapping("", read_yaml(path), _REQUIRED, optional=(*_OF_PROBLEM, *_OF_TASK))


def _problem(
    scenario: dict[str, Any], directory: Path, limits: Limits, points: int | None
) -> PlanningProblem:
    if points is None and "points" not in scenario:
        raise InvalidInput(Status.OUT_OF_RANGE, "points", "missing", "it must be given")
    if ("target" in scenario) == ("target_body" in scenario):
        found = "given beside target_body" if "target" in scenario else "missing"
        allowed = "either it or target_body must be given"
        raise InvalidInput(Status.OUT_OF_RANGE, "target", found, allowed)
    robot = _robot(scenario["robot"], directory)
    duration, window = _duration(scenario["duration"])
    body = target_body_of(scenario["target_body"]) if "target_body" in scenario else None
    target = _target(scenario["target"]) if body is None else body.target(duration)
    # Before the start: an arm that cannot meet the target may well be unable to rest, too.
    require_enough_joints(robot, target)
    start = _start(robot, scenario["chaser"], scenario["joints"])
    obstacles = _obstacles(scenario["obstacles"])
    return PlanningProblem(
        robot=robot,
        start=start,
        target=target,
        duration=duration,
        duration_range=window,
        points=integer("points", scenario.get("points", points)),
        obstacles=obstacles if body is None else with_attached_spheres(obstacles, body),
        objective=_objective(scenario["objective"]),
        limits=limits_from(scenario.get("limits", {}), limits),
        parametrisation=parametrisation_of(
            text("parametrisation", scenario.get("parametrisation", "auto"))
        ),
        allowed_at_goal=tuple(
            text(f"allowed_at_goal[{index}]", name)
            for index, name in enumerate(
                sequence("allowed_at_goal", scenario.get("allowed_at_goal", []))
            )
        ),
        contact_distance=number(
            "contact_distance", scenario.get("contact_distance", CONTACT_DISTANCE)
        ),
        target_body=body,
        approach=approach_of(scenario["approach"]) if "approach" in scenario else None,
    )


def _duration(value: object) -> tuple[float, DurationRange | None]:
    """Return the duration and, where the planner is to choose one, its range, else None."""
    if not isinstance(value, dict):
        return finite_number("duration", number("duration", value), above=0.0), None
    entry = mapping("duration", value, required=("min", "max"))
    shortest, longest = (number(f"duration.{name}", entry[name]) for name in ("min", "max"))
    window = DurationRange(shortest, longest)
    return window.maximum, window


def approach_of(value: object) -> Approach:
    """Return what a mapping describes.

    Raises:
        InvalidInput: It describes no approach.
    """
    entry = mapping("approach", value, ("direction", "distance"), optional=("cone",))
    return Approach(
        numbers("approach.direction", entry["direction"]),
        number("approach.distance", entry["distance"]),
        number("approach.cone", entry.get("cone", CONE)),
    )


def limits_from(value: object, defaults: Limits) -> Limits:
    """Return the limits that a mapping describes.

    Raises:
        InvalidInput: It describes none.
    """
    names = ("position", "velocity", "acceleration", "effort", "chaser_attitude")
    limits = mapping("limits", value, (), optional=names)
    position_limits = limits.get("position", "from_urdf")
    if position_limits != "from_urdf":
        field, allowed = "limits.position", "it must be from_urdf"
        raise InvalidInput(Status.UNSUPPORTED, field, position_limits, allowed)
    velocities, attitude = defaults.joint_velocities, defaults.chaser_attitude
    if "velocity" in limits:
        velocities = from_urdf("limits.velocity", limits["velocity"])
    if "chaser_attitude" in limits:
        asked = limits["chaser_attitude"]
        attitude = math.inf if asked == "none" else number("limits.chaser_attitude", asked)
    accelerations = defaults.joint_accelerations
    if "acceleration" in limits:
        accelerations = _accelerations("limits.acceleration", limits["acceleration"])
    torques = defaults.joint_torques
    if "effort" in limits:
        torques = from_urdf("limits.effort", limits["effort"])
    return Limits(velocities, attitude, accelerations, torques)


def _accelerations(field: str, value: object) -> tuple[float, ...] | None:
    """Return one limit for each joint, or one for all [rad/s2]; None: any acceleration."""
    if value == "none":
        return None
    if isinstance(value, list):
        return tuple(numbers(field, value).tolist())
    return (finite_number(field, number(field, value), above=0.0),)


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
    names = ("urdf", "base_link", "tip_link")
    entry = mapping("robot", value, required=names, optional=_ROBOT_MAY_HAVE)
    held = entry.get("held_joints", {})
    if not isinstance(held, dict) or not all(isinstance(name, str) for name in held):
        allowed = "it must hold a position for each name of a joint"
        raise InvalidInput(Status.OUT_OF_RANGE, "robot.held_joints", held, allowed)
    held_at = {
        name: finite_number(f"robot.held_joints.{name}", number(f"robot.held_joints.{name}", at))
        for name, at in held.items()
    }
    base = entry.get("base", Base.FREE_FLYER)
    if base not in tuple(Base):
        allowed = f"it must be {', '.join(Base)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "robot.base", quoted(base), allowed)
    urdf = resolve_uri(text("robot.urdf", entry["urdf"]), relative_to=directory)
    base_link = text("robot.base_link", entry["base_link"])
    tip_link = text("robot.tip_link", entry["tip_link"])
    geometry, srdf = entry.get("geometry"), entry.get("srdf")
    if geometry is not None and geometry not in tuple(Geometry):
        allowed = f"it must be {' or '.join(Geometry)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "robot.geometry", quoted(geometry), allowed)
    if srdf is not None:
        srdf = resolve_uri(text("robot.srdf", srdf), directory, "robot.srdf")
    geometry = None if geometry is None else Geometry(geometry)
    return load_robot(urdf, base_link, tip_link, Base(base), held_at, geometry, srdf)


def _start(robot: Robot, chaser: object, joints: object) -> SystemState:
    names = ("position", "quaternion_xyzw", "linear_velocity", "angular_velocity")
    chaser_entry = mapping("chaser", chaser, required=names)
    joints_entry = mapping(
        "joints",
        joints,
        required=("position",),
        optional=("velocity", "end_effector_at_rest", "acceleration"),
    )
    entry = joints_entry.get("end_effector_at_rest", False)
    at_rest = boolean("joints.end_effector_at_rest", entry)
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
        joint_accelerations=numbers("joints.acceleration", joints_entry["acceleration"])
        if "acceleration" in joints_entry
        else None,
    )
    if at_rest:
        return replace(state, joint_velocities=joint_rates_with_ee_at_rest(robot, state))
    return state


def _target(value: object) -> Target:
    optional = [item.name for item in fields(Target)[1:6]]
    optional[1:1] = ["euler_xyz_deg", "orientation", "free_axis"]
    entry = dict(mapping("target", value, required=("position",), optional=optional))
    orientation = orientation_of("target.orientation", entry.pop("orientation", "fixed"))
    attitudes = [name for name in ("quaternion_xyzw", "euler_xyz_deg") if name in entry]
    if len(attitudes) > 1 or (not attitudes and orientation is not Orientation.FREE):
        found = "given twice" if attitudes else "missing"
        allowed = "give it or euler_xyz_deg"
        raise InvalidInput(Status.BAD_QUATERNION, "target.quaternion_xyzw", found, allowed)
    vectors: dict[str, Any] = {key: numbers(f"target.{key}", entry[key]) for key in entry}
    if "euler_xyz_deg" in vectors:
        vectors["quaternion_xyzw"] = _quaternion(vectors.pop("euler_xyz_deg"))
    vectors.setdefault("quaternion_xyzw", [0.0, 0.0, 0.0, 1.0])
    vectors["free_axis_in_ee"] = vectors.pop("free_axis", None)
    return Target(**vectors, orientation=orientation)


def orientation_of(field: str, word: object) -> Orientation:
    """Return what a word stands for.

    Raises:
        InvalidInput: It is not known.
    """
    if word not in tuple(Orientation):
        allowed = f"it must be {', '.join(Orientation)}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(word), allowed)
    return Orientation(str(word))


def _quaternion(euler_xyz_deg: Array) -> Array:
    euler = np.deg2rad(finite_vector("target.euler_xyz_deg", euler_xyz_deg, 3))
    quaternion: Array = pin.Quaternion(rotation_from_euler(euler)).coeffs()
    return quaternion


def target_body_of(value: object) -> TargetBody:
    """Return what a mapping describes.

    Raises:
        InvalidInput: It describes no body.
    """
    told = "target_body"
    moving = ("linear_velocity", "angular_velocity")
    entry = mapping(
        told,
        value,
        required=("position", "quaternion_xyzw", "inertia", "grasp"),
        optional=(*moving, "obstacles"),
    )
    grasp = mapping(f"{told}.grasp", entry["grasp"], required=("position", "quaternion_xyzw"))
    vectors: dict[str, Any] = {
        name: numbers(f"{told}.{name}", entry[name])
        for name in ("position", "quaternion_xyzw", *moving)
        if name in entry
    }
    vectors |= {f"grasp_{name}": numbers(f"{told}.grasp.{name}", grasp[name]) for name in grasp}
    spheres = []
    for index, item in enumerate(sequence(f"{told}.obstacles", entry.get("obstacles", []))):
        field = f"{told}.obstacles[{index}]"
        sphere = mapping(field, item, required=("id", "center", "radius"))
        name = text(f"{field}.id", sphere["id"])
        center = numbers(f"{field}.center", sphere["center"])
        spheres.append(AttachedSphere(name, center, number(f"{field}.radius", sphere["radius"])))
    inertia = _inertia(f"{told}.inertia", entry["inertia"])
    return TargetBody(**vectors, inertia=inertia, obstacles=tuple(spheres))


def _inertia(field: str, value: object) -> Array:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entry = mapping(field, value, required=names)
    xx, xy, xz, yy, yz, zz = (number(f"{field}.{name}", entry[name]) for name in names)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _obstacles(value: object) -> tuple[Sphere, ...]:
    spheres: dict[str, Sphere] = {}
    for index, item in enumerate(sequence("obstacles", value)):
        field = f"obstacles[{index}]"
        entry = mapping(field, item, required=("id", "center", "radius"), optional=("velocity",))
        name = entry["id"]
        if not isinstance(name, str):
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.id", quoted(name), "it must be text")
        if name in spheres:
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.id", name, "it must be unique")
        center = numbers(f"{field}.center", entry["center"])
        radius = number(f"{field}.radius", entry["radius"])
        velocity = numbers(f"{field}.velocity", entry.get("velocity", [0.0] * 3))
        spheres[name] = Sphere(name, center, radius, velocity)
    return tuple(spheres.values())


def _objective(value: object) -> Objective:
    required = ("joint_path_length", "chaser_attitude")
    entry = mapping("objective", value, required, optional=("duration",))
    return Objective(**{key: number(f"objective.{key}", entry[key]) for key in entry})


def _running(value: object, joints: int) -> JointMotion:
    names = [item.name for item in fields(JointMotion)]
    entry = mapping("running", value, required=names)
    rows = {"time": numbers("running.time", entry["time"])}
    points = len(rows["time"])
    for name in names[1:]:
        field = f"running.{name}"
        given = sequence(field, entry[name])
        if len(given) != points:
            allowed = f"it must be one for each of the {points} times"
            raise InvalidInput(Status.WRONG_SIZE, field, f"{len(given)} rows", allowed)
        samples = [numbers(f"{field}[{i}]", row) for i, row in enumerate(given)]
        rows[name] = np.array(
            [finite_vector(f"{field}[{i}]", row, joints) for i, row in enumerate(samples)]
        )
    if points < 2 or not (np.diff(rows["time"]) > 0.0).all() or not np.isfinite(rows["time"]).all():
        allowed = "it must be two times or more, each later than the one before"
        raise InvalidInput(Status.OUT_OF_RANGE, "running.time", rows["time"].tolist(), allowed)
    return JointMotion(**rows)


def _controller(
    scenario: dict[str, Any], robot: Robot, default: Controller | None
) -> Controller | None:
    value = scenario.get("controller", default)
    if value is None or value == "none":
        return None
    if isinstance(value, Controller):
        return replace(value, joints=robot.joint_names)
    names = ("allow_nonzero_velocity_at_trajectory_end", "effort_interface")
    rules = mapping("controller", value, required=names)
    given = {name: boolean(f"controller.{name}", rules[name]) for name in names}
    return Controller(robot.joint_names, **given)
