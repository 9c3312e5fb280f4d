"""The robot attached to a bag, and its plans with their scenes and limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, repeat
from pathlib import Path
from typing import Any

from ff_planner_ros.bag.exchanges import exchanges
from ff_planner_ros.bag.plans import RecordedPlan, recorded_plan
from ff_planner_ros.bag.reader import Message, open_bag
from ff_planner_ros.bag.scenes import (
    AskedScene,
    ReceivedScenes,
    Stamps,
    asked_scene,
    scene_at_start,
    stamps_of,
)
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.messages.payloads import payload_in
from ff_planner_ros.messages.target_bodies import is_capture
from ff_planner_ros.parameters.robot import OWN_WHEELS, RobotParameters
from ff_planner_ros.planning.motion.plan import Trajectory, begins_of
from ff_planner_ros.planning.problem.problem import Limits, carried, with_attached
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, uncertainty_from
from ff_planner_ros.planning.task.following import held_body
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.payload import Payload, with_payload

_ANGLES = ("chaser_attitude", "chaser_rotation")  # of the chaser, that have limits


@dataclass(frozen=True, eq=False)
class AskedPhase:
    """A phase of a request, as far as its plan's scene and robot depend on it."""

    captures: bool = False
    payload: Payload | None = None  # None: that of the phase before, or the captured body
    scene: Scene = field(default_factory=Scene)  # without obstacles and target body


@dataclass(frozen=True, eq=False)
class RobotPlans:
    """The plans of a bag, whether the node recorded it or `ff-planner plan --bag` wrote it.

    Of a sequence each phase is a plan, by the plan's id and the phase's number.
    """

    robots: Mapping[str, Robot]  # by plan id, with their payloads
    motions: Mapping[str, Trajectory]  # by plan id, in the order of the requests
    # By plan id, as in `PlanMetrics.msg`
    metrics: Mapping[str, Mapping[str, float | str | tuple[float, ...]]]
    scenes: Mapping[str, Scene]  # by plan id, without plans whose scene the bag lacks
    # By plan id, limits of the chaser's angles and of joint torques, from the parameters at the
    # node's start and from the request
    limits: Mapping[str, Limits]
    uncertainty: Uncertainty  # of `planner.robust` at the node's start, or the default
    notes: tuple[str, ...]  # what is wrong with the bag


def robot_plans(bag: Path) -> RobotPlans:
    """Read the robot attached to a bag, and every plan in its answers.

    Raises:
        BagError: The bag cannot be read, holds no plan, or lacks what is needed to understand it.
        InvalidInput: The URDF in it is refused.
    """
    with open_bag(bag) as opened:
        found = exchanges(opened, _asked, _answer)
        received = ReceivedScenes(opened)
        attachments, notes = opened.attachments, opened.notes
    answers = [one.response[0] for one in found if one.response is not None]
    motions = {one.plan_id: one.trajectory for one in answers if one.trajectory is not None}
    if not motions:
        refusals = "; ".join(f"{one.plan_id}: {one.message}" for one in answers)
        reasons = "; ".join([f"its answers: {refusals or 'none'}", *notes])
        raise BagError(f"bag {bag} holds no plan; {reasons}")
    robot = attached_robot(bag, attachments)
    for one in answers:
        if one.plan_id in motions and one.joint_names != robot.joint_names:
            moved, wanted = ", ".join(one.joint_names), ", ".join(robot.joint_names)
            raise BagError(f"bag {bag}: {one.plan_id} moves {moved}, but its robot has {wanted}")
    told = {
        exchange.response[0].plan_id: scene_at_start(
            None if exchange.request is None else exchange.request[0],
            exchange.response[1],
            exchange.response[0].start_ns,
            received.at(exchange.response[1], exchange.namespace, exchange.logged_ns),
        )
        for exchange in found
        if exchange.response is not None
    }
    scenes = {plan_id: scene for plan_id, scene in told.items() if scene is not None}
    metrics = {one.plan_id: one.metrics for one in answers}
    robots = {
        exchange.response[0].plan_id: robot
        if exchange.request is None or exchange.request[2] is None
        else with_payload(robot, exchange.request[2])
        for exchange in found
        if exchange.response is not None and exchange.response[0].plan_id in motions
    }
    parameters = _parameters(bag, attachments)
    limits = {
        exchange.response[0].plan_id: _limits(
            parameters, {} if exchange.request is None else exchange.request[1]
        )
        for exchange in found
        if exchange.response is not None
    }
    for exchange in found:
        if exchange.request is None or exchange.response is None or not exchange.response[0].phases:
            continue
        answer, asked = exchange.response[0], exchange.request[3]
        name = answer.plan_id
        scene, robot = scenes.pop(name, Scene()), robots.pop(name)
        del motions[name]
        kept, measured = limits.pop(name), metrics[name]
        for number, phase in enumerate(
            phases_of(answer.phases, robot, scene, asked, answer.duration), 1
        ):
            key = f"{name}, phase {number}"
            motions[key], robots[key], scenes[key] = phase
            limits[key], metrics[key] = kept, measured
    return RobotPlans(robots, motions, metrics, scenes, limits, _uncertainty(parameters), notes)


def phases_of(
    motions: Sequence[Trajectory],
    robot: Robot,
    scene: Scene,
    asked: Sequence[AskedPhase],
    duration: float | None,
) -> Iterator[tuple[Trajectory, Robot, Scene]]:
    """Yield motion, robot with payload, and scene of each phase of a sequence.

    Args:
        robot: Robot in the first phase.
        scene: Scene at the first point of the first phase, with the body that a phase captures.
        asked: Phases of the request; empty: not known.
        duration: Time from the first point to the last goal [s]; None: not known.
    """
    free, body = [one for one in scene.obstacles if one.body is None], scene.target_body
    begins, last = begins_of(motions), len(motions) - 1
    scene = replace(scene, obstacles=free, target_body=None)
    phases = chain(asked, repeat(AskedPhase()))
    for number, (begin, motion, phase) in enumerate(zip(begins, motions, phases, strict=False)):
        if number > 0:
            held, touching = phase.payload, list[str]()
            if scene.target_body is not None:  # the phase before captured it
                held, body = held or held_body(scene.target_body, robot), None
                touching = [pair.partition("/")[0] for pair in scene.allowed_collisions]
            if held is not None:
                robot = with_payload(robot, held, touching)
            reached: float | None = float(motion.time[-1])
            if number == last:
                reached = None if duration is None else duration - begin
            scene = replace(phase.scene, obstacles=carried(free, begin), capture_time=reached)
        if phase.captures and body is not None:
            there = body.after(begin)
            around = with_attached(scene.obstacles, there)
            scene = replace(scene, obstacles=around, target=None, target_body=there)
        yield motion, robot, scene


def asked_phases(request: Any) -> list[AskedPhase]:
    """Return the phases of a decoded request, the first one included; None: the bag lacks it.

    Raises:
        InvalidInput: A payload is invalid.
    """
    if request is None:
        return []
    first = AskedPhase(is_capture(request))  # its scene and payload are known otherwise
    return [
        first,
        *(
            AskedPhase(is_capture(one), payload_in(one), asked_scene(one).scene)
            for one in value_at(request, "then", ())
        ),
    ]


def _asked(
    request: Any,
) -> tuple[AskedScene, Mapping[str, float], Payload | None, Sequence[AskedPhase]]:
    """Return a request's scene, limits of angles (zero: none), payload and phases."""
    angles = {name: float(value_at(request, f"limits.{name}[0]", 0.0)) for name in _ANGLES}
    try:
        payload, phases = payload_in(request), asked_phases(request)
    except InvalidInput:
        payload, phases = None, []  # it was refused
    return asked_scene(request), angles, payload, phases


def _uncertainty(parameters: Mapping[str, Any]) -> Uncertainty:
    planner = parameters.get("planner", {})
    robust = planner.get("robust", {}) if isinstance(planner, dict) else {}
    try:
        told = {name: value for name, value in robust.items() if name != "sigmas"}
        return uncertainty_from("planner.robust", told)
    except (AttributeError, InvalidInput):
        return Uncertainty()


def _limits(parameters: Mapping[str, Any], asked: Mapping[str, float]) -> Limits:
    """Return the limits of angles and torques; what the parameters lack has its default.

    Args:
        asked: Limits of angles in the request, by name; zero: none [rad].
    """
    told = parameters.get("limits", {})
    told = told if isinstance(told, dict) else {}
    try:
        angles = {
            name: asked.get(name, 0.0) or float(told.get(name, 0.0)) or math.inf for name in _ANGLES
        }
        return Limits(
            chaser_attitude=angles["chaser_attitude"],
            chaser_rotation=angles["chaser_rotation"],
            joint_torques=told.get("effort") != "none",
        )
    except (InvalidInput, TypeError, ValueError):
        return Limits()


def _answer(message: Message, answer: Any) -> tuple[RecordedPlan, Stamps]:
    """Return an answer, and the stamps of its inputs."""
    return recorded_plan(message, answer), stamps_of(answer)


def attached_robot(bag: Path, attachments: Mapping[str, bytes]) -> Robot:
    """Return the robot whose URDF and links are attached to a bag.

    Raises:
        BagError: One of the two is missing or damaged.
        InvalidInput: The URDF is refused.
    """
    urdf, links = _attached(bag, attachments, "robot.urdf"), _parameters(bag, attachments)
    try:
        links = links["robot"]
        base_link, tip_link = str(links["base_link"]), str(links["tip_link"])
        base, geometry = str(links["base"]), str(links["geometry"])
        held = str(links["locked_joints"])
        told = {name: tuple(given) for name, given in links["wheels"].items()}
        wheels = replace(OWN_WHEELS, **told)
        slide_weight = float(links["slide_weight"])
    except (InvalidInput, LookupError, TypeError, ValueError, AttributeError):
        raise BagError(f"bag {bag}: its parameters.yaml lacks parameters robot.*") from None
    named = "robot.urdf", base_link, tip_link
    robot = RobotParameters(wheels, *named, base, held, geometry, "", slide_weight)
    return robot.load(urdf)


def _parameters(bag: Path, attachments: Mapping[str, bytes]) -> Mapping[str, Any]:
    """Return the attached parameters; empty if the document cannot be understood."""
    text = _attached(bag, attachments, "parameters.yaml")
    try:
        found = yaml_document(text, "parameters.yaml", "damaged")["/**"]["ros__parameters"]
    except (InvalidInput, LookupError, TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _attached(bag: Path, attachments: Mapping[str, bytes], name: str) -> str:
    if name not in attachments:
        raise BagError(f"bag {bag} has no {name} attached, which says what its plans are for")
    return attachments[name].decode(errors="replace")
