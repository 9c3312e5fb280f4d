"""The plans in a bag, whether the node recorded it or `ff-planner plan --bag` wrote it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml
from ff_planner_msgs.srv import PlanTrajectory

from ff_planner_ros.bag.decoding import as_installed
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import BagError, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.ros.messages.from_messages import plan_from_response
from ff_planner_ros.ros.recorder.recorder import type_name
from ff_planner_ros.ros.requests.action_events import GET_RESULT

_EVENT, _RESULT_EVENT = type_name(PlanTrajectory.Event), type_name(GET_RESULT.Event)


@dataclass(frozen=True, eq=False)
class RecordedPlans:
    """What a bag says of plans.

    Attributes:
        robot: That they are for.
        plans: By plan id, in the order of the answers; first those of the service, then those of
            the action.
        notes: What is wrong with the bag.
    """

    robot: Robot
    plans: dict[str, Plan]
    notes: tuple[str, ...]


def recorded_plans(bag: Path) -> RecordedPlans:
    """Read every plan that was answered with.

    Args:
        bag: The directory, or its MCAP file.

    Raises:
        BagError: The bag cannot be read, holds no plan, or lacks what is needed to understand it.
        InvalidInput: The URDF in it is refused.
    """
    with open_bag(bag) as opened:
        responses = [
            *(r for _, event in opened.decoded(_EVENT) for r in event.response),
            *(r.result for _, event in opened.decoded(_RESULT_EVENT) for r in event.response),
        ]
        documents, notes = dict(opened.attachments), opened.notes
    responses = [as_installed(response, PlanTrajectory.Response) for response in responses]
    plans = {
        response.plan_id: _plan(bag, response)
        for response in responses
        if response.status.code == Status.SOLVED
    }
    if not plans:
        refusals = "; ".join(f"{r.plan_id}: {r.status.message}" for r in responses)
        reasons = "; ".join([f"its answers: {refusals or 'none'}", *notes])
        raise BagError(f"bag {bag} holds no plan; {reasons}")
    robot = attached_robot(bag, documents)
    for plan_id, plan in plans.items():
        if plan.joint_names != robot.joint_names:
            found, wanted = ", ".join(plan.joint_names), ", ".join(robot.joint_names)
            raise BagError(f"bag {bag}: {plan_id} moves {found}, but its robot has {wanted}")
    return RecordedPlans(robot, plans, notes)


def _plan(bag: Path, response: PlanTrajectory.Response) -> Plan:
    try:
        return plan_from_response(response)
    except ValueError as error:
        raise BagError(f"bag {bag}: the answer {response.plan_id} is damaged: {error}") from None


def attached_robot(bag: Path, attachments: Mapping[str, bytes]) -> Robot:
    """Return the robot whose URDF and links are attached to a bag.

    Raises:
        BagError: One of the two is missing or damaged.
        InvalidInput: The URDF is refused.
    """
    documents = {}
    for name in ("robot.urdf", "parameters.yaml"):
        if name not in attachments:
            raise BagError(f"bag {bag} has no {name} attached, which says what its plans are for")
        documents[name] = attachments[name].decode(errors="replace")
    try:
        links = yaml.safe_load(documents["parameters.yaml"])["/**"]["ros__parameters"]["robot"]
        base_link, tip_link = str(links["base_link"]), str(links["tip_link"])
    except (yaml.YAMLError, LookupError, TypeError):
        raise BagError(
            f"bag {bag}: its parameters.yaml does not name robot.base_link and robot.tip_link"
        ) from None
    return robot_from_urdf_text(documents["robot.urdf"], base_link, tip_link)
