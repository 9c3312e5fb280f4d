"""Scenario files: a planning task written down."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import finite_vector
from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declared,
    fields_of,
    read_keys,
)
from ff_planner_ros.common.declared_parts import changes, part, schema_of
from ff_planner_ros.common.forms import DIALECT, Form, Schema
from ff_planner_ros.common.plain_values import an_object, integer
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import Faults, InvalidInput, Status, fields_renamed
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.limits import ChaserGoal
from ff_planner_ros.planning.problem.path.circle import CircleToFollow
from ff_planner_ros.planning.problem.posture import Posture, end_effector_at
from ff_planner_ros.planning.problem.problem import (
    USUAL_POINTS,
    DurationRange,
    Limits,
    PlanningProblem,
    with_attached,
)
from ff_planner_ros.planning.problem.settings import USUAL_SIGMAS
from ff_planner_ros.planning.problem.target import Target, require_enough_joints
from ff_planner_ros.planning.scenario.body_file import TARGET_BODY, BodyFile
from ff_planner_ros.planning.scenario.defaults import Defaults as Defaults
from ff_planner_ros.planning.scenario.phases_file import KEY as PHASES_KEY
from ff_planner_ros.planning.scenario.phases_file import (
    PHASES,
    built,
    first_named,
    split,
    with_duration_of_path,
)
from ff_planner_ros.planning.scenario.robot_file import MEASURED_POSITIONS, POSITIONS, RobotFile
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.following import require_askable_phases
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.solids import Thing
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import (
    Robot,
)
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.meshes import Meshes

# A scenario names no frame, since it has one; messages about it must.
SCENARIO_FRAME = "inertial"

# Version of the format of scenarios; increased when a key gets another meaning.
FORMAT = 1

_NO_LIMITS = Limits()

Built = TypeVar("Built")
_Read: TypeAlias = Mapping[str, Any]  # values by key
# Of the first phase, the robot and the other phases.
_Build: TypeAlias = Callable[[_Read, Robot, Sequence[_Read]], Built]


def _format(field: str, value: object) -> int:
    if integer(field, value) != FORMAT:
        allowed = f"this version reads format {FORMAT}: a newer one may read this scenario"
        raise InvalidInput(Status.UNSUPPORTED, field, value, allowed)
    return FORMAT


# Every key of a scenario file.
KEYS: DeclaredFields = {
    "format": DeclaredField(
        Form(_format, lambda: {"const": FORMAT}),
        "version of the format of scenarios",
        optional=True,
        default=FORMAT,
    ),
    "robot": DeclaredField(part(RobotFile), "the robot", name="robot"),
    **declared(SystemState),
    MEASURED_POSITIONS: DeclaredField(
        POSITIONS,
        "where locked joints were measured, with robot.locked_joints measured",
        unit="rad, m",
        optional=True,
        default=None,
    ),
    **declared(PlanningProblem),
    "target_body": replace(declared(PlanningProblem)["target_body"], form=TARGET_BODY),
    **declared(PlanningTask),
    PHASES_KEY: PHASES,
}


def load_scenario(path: AnyPath) -> PlanningProblem:
    """Read a planning problem from a scenario file.

    The path of its URDF is relative to the file, or `package://`.

    Raises:
        InvalidInput: The file or its URDF cannot be read, a key is unknown or missing, or a value
            is of the wrong type or not allowed. Fields are named as in the file,
            `chaser.position`; `faults` holds all faults.
    """
    file = path_of("path", path)

    def problem(read: _Read, robot: Robot, _: Sequence[_Read]) -> PlanningProblem:
        return _problem(read, robot, _NO_LIMITS)

    return _built(read_yaml(file), file.parent, USUAL_POINTS, problem)


def load_task(path: AnyPath, defaults: Defaults) -> PlanningTask:
    """Read a planning task from a scenario file.

    Raises:
        InvalidInput: As by `load_scenario`.
    """
    file = path_of("path", path)
    an_object("defaults", defaults, Defaults)
    return built_task(read_yaml(file), file.parent, defaults)


def built_task(document: object, directory: Path | None, defaults: Defaults) -> PlanningTask:
    """Return the task of a scenario's document.

    Args:
        directory: Directory that paths in it are relative to; None: it is from elsewhere, and no
            file is read.

    Raises:
        InvalidInput: As by `load_scenario`.
    """

    def task(read: _Read, robot: Robot, others: Sequence[_Read]) -> PlanningTask:
        first = _task(read, robot, defaults)
        then = built(others, robot, first.problem.limits, directory)
        whole = replace(first, then=then) if then else first
        require_askable_phases(whole)
        return whole

    return _built(document, directory, defaults.points, task)


def scenario_schema() -> Schema:
    """Return the JSON Schema of a scenario file."""
    schema = schema_of(KEYS)
    schema["required"] = [key for key in schema["required"] if key != "duration"]
    of_chaser = schema_of(declared(ChaserGoal))
    with_path = {"properties": {"target": {"required": ["path"]}}}
    goals = [
        {
            "required": ["target"],
            "anyOf": [{"required": ["duration"]}, with_path],
            "not": {"required": ["target_body"]},
        },
        {"required": ["target_body", "duration"], "properties": of_chaser["properties"]},
        {"required": [PHASES_KEY]},
    ]
    return {"$schema": DIALECT, "title": "a scenario"} | schema | {"oneOf": goals}


def limits_from(value: object, defaults: Limits) -> Limits:
    """Return default limits changed by the values of a scenario's block `limits`.

    Raises:
        InvalidInput: It is no mapping, a key is unknown, or a value is not allowed.
    """
    return replace(defaults, **changes(Limits).read("limits", value))


def _built(whole: object, directory: Path | None, points: int, build: _Build[Built]) -> Built:
    """Return what is built of a document's values, once nothing is wrong with any of them."""
    with first_named(whole):
        return _built_of(whole, directory, points, build)


def _built_of(whole: object, directory: Path | None, points: int, build: _Build[Built]) -> Built:
    faults = Faults()
    document, others = split(whole, faults)
    document = with_duration_of_path(document)
    read = read_keys(KEYS, "", document, faults)
    has_goal, has_body = (
        _has_goal(document),
        isinstance(document, dict) and "target_body" in document,
    )
    if isinstance(document, dict) and has_goal == has_body:
        found = "given beside target_body" if has_goal else "missing"
        faults.add("target", found, "either it or target_body must be given")
    robot: Any = None  # only if there are faults
    if "robot" in read:
        with faults.gathered():
            robot = read["robot"].load(directory, read.get(MEASURED_POSITIONS))
    if robot is not None:
        _check_sizes(read, robot.joints, faults)
    _read_meshes(read, "", directory, faults)
    for index, phase in enumerate(others, start=1):
        _read_meshes(phase, f"{PHASES_KEY}[{index}].", directory, faults)
    faults.refuse()
    return build({"points": points} | read, robot, others)


def _has_goal(document: object) -> bool:
    """Tell whether a target says more than the chaser's attitude, which any goal may have."""
    if not isinstance(document, dict) or "target" not in document:
        return False
    target, of_chaser = document["target"], declared(ChaserGoal).keys()
    if not isinstance(target, dict) or not target:
        return True
    return not {f"target.{key}" for key in target} <= of_chaser


def _read_meshes(read: dict[str, Any], place: str, directory: Path | None, faults: Faults) -> None:
    """Read the mesh files of obstacles and target body, and the target body's URDF."""

    def loaded(told: str, entries: Sequence[Thing]) -> tuple[Thing, ...]:
        found = list[Thing]()
        meshes = Meshes(directory)
        for index, one in enumerate(entries):
            with faults.gathered():
                found.append(one.with_mesh_read(f"{told}[{index}]", meshes))
        return tuple(found)

    if "obstacles" in read:
        read["obstacles"] = loaded("obstacles", read["obstacles"])
    if "target_body" in read:
        body = read["target_body"]
        if isinstance(body, BodyFile):
            with faults.gathered(), fields_renamed(lambda field: place + field):
                body = body.load(directory)
        if isinstance(body, BodyFile):
            return  # it is a fault
        fixed = loaded(f"{place}target_body.obstacles", body.obstacles)
        # As it was read, if all is there: normalised once more, a quaternion changes its last bits.
        is_whole = all(map(operator.is_, fixed, body.obstacles))
        read["target_body"] = body if is_whole else replace(body, obstacles=fixed)


def _check_sizes(read: Mapping[str, Any], joints: int, faults: Faults) -> None:
    """Gather what has not one number for each of so many joints."""
    for key in ("joints.position", "joints.velocity", "joints.acceleration"):
        if isinstance(read.get(key), np.ndarray):
            with faults.gathered():
                finite_vector(key, read[key], joints)
    with faults.gathered():
        Limits(joint_accelerations=read.get("limits", {}).get("joint_accelerations")).of_joints(
            joints
        )
    if "running" in read:
        with faults.gathered():
            _running(read["running"], joints)


def _problem(read: Mapping[str, Any], robot: Robot, limits: Limits) -> PlanningProblem:
    given = fields_of(PlanningProblem, read)
    window, body = given["duration"], given.get("target_body")
    if isinstance(window, DurationRange):
        given |= {"duration": window.maximum, "duration_range": window}
    if body is not None:
        given["target"] = body.target(given["duration"])
        given["obstacles"] = with_attached(given["obstacles"], body)
    given["limits"] = replace(limits, **given.get("limits", {}))
    if not isinstance(goal := given["target"], Target):
        start, field = _start(robot, read), "posture" if isinstance(goal, Posture) else "path"
        if isinstance(goal, CircleToFollow):
            goal = goal.path(robot, start, given["duration"])
        given |= {"target": end_effector_at(robot, start), field: goal}
        return PlanningProblem(robot=robot, start=start, **given)
    # Before the start: an arm that cannot meet the target may well be unable to rest, too.
    require_enough_joints(robot, given["target"])
    return PlanningProblem(robot=robot, start=_start(robot, read), **given)


def _start(robot: Robot, read: Mapping[str, Any]) -> SystemState:
    given, told = fields_of(SystemState, read), read["robot"].wheels
    given["wheel_momenta"] = None if told is None else told.stored
    if given["joint_velocities"] is not True:
        return SystemState(**given)
    state = SystemState(**given | {"joint_velocities": np.zeros(robot.joints)}, ee_at_rest=True)
    return replace(state, joint_velocities=joint_rates_with_ee_at_rest(robot, state))


def _task(read: Mapping[str, Any], robot: Robot, defaults: Defaults) -> PlanningTask:
    problem = _problem(read, robot, defaults.limits)
    given: dict[str, Any] = {"end_behaviour": defaults.end_behaviour, "tail": defaults.tail}
    given |= {"controller": defaults.controller} | fields_of(PlanningTask, read)
    if given["end_behaviour"] is EndBehaviour.NONE:
        given["tail"] = 0.0
    elif given["tail"] is None:
        allowed = f"end_behaviour {given['end_behaviour']} needs it"
        raise InvalidInput(Status.OUT_OF_RANGE, "post_goal_duration", "missing", allowed)
    if isinstance(given["controller"], dict):
        given["controller"] = Controller(**given["controller"])
    if "running" in given:
        given["running"] = _running(given["running"], robot.joints)
    changes, settings = given.pop("settings", {}), defaults.settings
    if "robust" in changes:
        usual = {"sigmas": settings.robust.sigmas or USUAL_SIGMAS}
        changes["robust"] = replace(settings.robust, **usual | changes["robust"])
    return PlanningTask(problem, replace(settings, **changes), **given)


def _running(given: Mapping[str, Any], joints: int) -> JointMotion:
    """Return the motion of a robot with so many joints."""
    time, rows, faults = given["time"], dict[str, Any](), Faults()
    for name, samples in given.items():
        field = f"running.{name}"
        if name != "time" and len(samples) != len(time):
            allowed = f"it must be one for each of the {len(time)} times"
            error = InvalidInput(Status.WRONG_SIZE, field, f"{len(samples)} rows", allowed)
            faults.found.append(error)
        elif name != "time":
            with faults.gathered():
                rows[name] = np.array(
                    [finite_vector(f"{field}[{i}]", row, joints) for i, row in enumerate(samples)]
                )
    if len(time) < 2 or not (np.diff(time) > 0.0).all():
        allowed = "it must be two times or more, each later than the one before"
        faults.add("running.time", time.tolist(), allowed)
    faults.refuse()
    return JointMotion(time=time, **rows)
