"""Scenario files: a planning task written down."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import finite_vector
from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declare,
    declared,
    fields_of,
    read_keys,
    schema_of,
)
from ff_planner_ros.common.declared_parts import changes, part
from ff_planner_ros.common.forms import DIALECT, TEXT, Schema, a_number, a_word, by_name
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import Faults, InvalidInput, Status, fields_renamed
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.obstacles import InTheWay, with_mesh_read
from ff_planner_ros.planning.problem.posture import Posture, end_effector_at
from ff_planner_ros.planning.problem.problem import (
    USUAL_POINTS,
    DurationRange,
    Limits,
    PlanningProblem,
    with_attached,
)
from ff_planner_ros.planning.problem.settings import USUAL_SIGMAS
from ff_planner_ros.planning.problem.target import require_enough_joints
from ff_planner_ros.planning.scenario.body_file import TARGET_BODY, BodyFile
from ff_planner_ros.planning.scenario.defaults import Defaults as Defaults
from ff_planner_ros.planning.scenario.phases_file import KEY as PHASES_KEY
from ff_planner_ros.planning.scenario.phases_file import PHASES, built, first_named, split
from ff_planner_ros.planning.scenario.wheels_file import WheelsFile
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.following import require_askable_phases
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import SLIDE_WEIGHT, SLIDE_WEIGHTS, Base, Robot, load_robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.payload import Payload, with_payload

# A scenario names no frame, since it has one; messages about it must.
SCENARIO_FRAME = "inertial"

_NO_LIMITS = Limits()

Built = TypeVar("Built")
_Read: TypeAlias = Mapping[str, Any]  # values by key
# Of the first phase, the robot and the other phases.
_Build: TypeAlias = Callable[[_Read, Robot, Sequence[_Read]], Built]


@dataclass(frozen=True)
class RobotFile:
    """The block `robot` of a scenario: the robot's files, and how they are read."""

    urdf: str = declare(
        TEXT, "path of the URDF or SDF, relative to this file, or package://PACKAGE/PATH"
    )
    base_link: str = declare(TEXT, "link that carries the arm")
    tip_link: str = declare(TEXT, "link whose frame is the end effector")
    base: Base = declare(
        a_word(Base),
        "motion of the chaser: planar: x, y and rotation about z, on an air-bearing table; "
        "attitude_held: reaction wheels hold its attitude, and it drifts",
        brief=True,
        default=Base.FREE_FLYER,
    )
    wheels: WheelsFile | None = declare(
        part(WheelsFile),
        "reaction wheels of base attitude_held; default: one along each axis of the base link, "
        "without limits",
        default=None,
    )
    locked_joints: Mapping[str, float] | None = declare(
        by_name("a joint"),
        "locked joints and their positions; default: all joints that are not between base and tip, "
        "at zero",
        unit="rad, m",
        default=None,
    )
    geometry: Geometry | None = declare(
        a_word(Geometry),
        "collision geometry: shapes: the URDF's collision elements; lines: the link centre lines, "
        "as in the paper; default: shapes if the arm has any",
        default=None,
    )
    srdf: str | None = declare(
        TEXT,
        "path of an SRDF, as for the URDF: links that may touch; default: those that touch in "
        "nearly every posture",
        default=None,
    )
    payload: Payload | None = declare(
        part(Payload), "a body that a link holds; default: none", default=None
    )
    slide_weight: float | None = declare(
        a_number(at_least=0.0, at_most=SLIDE_WEIGHTS[1]),
        "weight of a prismatic joint in the joint path, in which a revolute joint counts 1; 0: "
        "prismatic joints are locked; default: 1",
        unit="rad/m",
        default=None,
    )

    def load(self, directory: Path) -> Robot:
        """Load the robot from its files, whose paths may be relative to a directory.

        Raises:
            InvalidInput: A file cannot be read, or is refused.
        """
        urdf = resolve_uri(self.urdf, relative_to=directory)
        srdf = None if self.srdf is None else resolve_uri(self.srdf, directory, "robot.srdf")
        links = self.base_link, self.tip_link
        held = self.locked_joints or {}
        wheels = None if self.wheels is None else self.wheels.wheels
        told = urdf, *links, self.base, held, self.geometry, srdf, wheels
        weight = SLIDE_WEIGHT if self.slide_weight is None else self.slide_weight
        robot = load_robot(*told, slide_weight=weight)
        return (
            robot if self.payload is None else with_payload(robot, self.payload.loaded(directory))
        )


# Every key of a scenario file.
KEYS: DeclaredFields = {
    "robot": DeclaredField(part(RobotFile), "the robot", name="robot"),
    **declared(SystemState),
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
    return _built(file, USUAL_POINTS, lambda read, robot, _: _problem(read, robot, _NO_LIMITS))


def load_task(path: AnyPath, defaults: Defaults) -> PlanningTask:
    """Read a planning task from a scenario file.

    Raises:
        InvalidInput: As by `load_scenario`.
    """
    file = path_of("path", path)
    an_object("defaults", defaults, Defaults)

    def task(read: _Read, robot: Robot, others: Sequence[_Read]) -> PlanningTask:
        first = _task(read, robot, defaults)
        then = built(others, robot, first.problem.limits, file.parent)
        whole = replace(first, then=then) if then else first
        require_askable_phases(whole)
        return whole

    return _built(file, defaults.points, task)


def scenario_schema() -> Schema:
    """Return the JSON Schema of a scenario file."""
    schema = schema_of(KEYS)
    schema["required"] = [key for key in schema["required"] if key != "duration"]
    goals = [
        {"required": ["target", "duration"]},
        {"required": ["target_body", "duration"]},
        {"required": [PHASES_KEY]},
    ]
    return {"$schema": DIALECT, "title": "a scenario"} | schema | {"oneOf": goals}


def limits_from(value: object, defaults: Limits) -> Limits:
    """Return default limits changed by the values of a scenario's block `limits`.

    Raises:
        InvalidInput: It is no mapping, a key is unknown, or a value is not allowed.
    """
    return replace(defaults, **changes(Limits).read("limits", value))


def _built(path: Path, points: int, build: _Build[Built]) -> Built:
    """Return what is built of a file's values, once nothing is wrong with any of them."""
    whole = read_yaml(path)
    with first_named(whole):
        return _built_of(whole, path, points, build)


def _built_of(whole: object, path: Path, points: int, build: _Build[Built]) -> Built:
    faults = Faults()
    document, others = split(whole, faults)
    read = read_keys(KEYS, "", document, faults)
    if isinstance(document, dict) and ("target" in document) == ("target_body" in document):
        found = "given beside target_body" if "target" in document else "missing"
        faults.add("target", found, "either it or target_body must be given")
    robot: Any = None  # only if there are faults
    if "robot" in read:
        with faults.gathered():
            robot = read["robot"].load(path.parent)
    if robot is not None:
        _check_sizes(read, robot.joints, faults)
    _read_meshes(read, "", path.parent, faults)
    for index, phase in enumerate(others, start=1):
        _read_meshes(phase, f"{PHASES_KEY}[{index}].", path.parent, faults)
    faults.refuse()
    return build({"points": points} | read, robot, others)


def _read_meshes(read: dict[str, Any], place: str, directory: Path, faults: Faults) -> None:
    """Read the mesh files of obstacles and target body, and the target body's URDF."""

    def loaded(told: str, entries: Sequence[InTheWay]) -> tuple[InTheWay, ...]:
        found = list[InTheWay]()
        with Meshes(directory) as meshes:
            for index, one in enumerate(entries):
                with faults.gathered():
                    found.append(with_mesh_read(one, f"{told}[{index}]", meshes))
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
        read["target_body"] = replace(body, obstacles=fixed)


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
    if isinstance(posture := given["target"], Posture):
        start = _start(robot, read)
        given |= {"target": end_effector_at(robot, start), "posture": posture}
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
