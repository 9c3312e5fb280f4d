"""The plans in a bag, whether the node recorded it or `ff-planner plan --bag` wrote it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.serialization import deserialize_message

from ff_planner_ros.bag.reader import Recording, read_bag
from ff_planner_ros.errors import BagError, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.ros.action_events import GET_RESULT
from ff_planner_ros.ros.from_messages import plan_from_response
from ff_planner_ros.ros.recorder import type_name


@dataclass(frozen=True, eq=False)
class RecordedPlans:
    """What a bag says of plans.

    Attributes:
        robot: That they are for.
        plans: By plan id, in the order of the answers; first those of the service, then those of
            the action.
    """

    robot: Robot
    plans: dict[str, Plan]


def recorded_plans(bag: Path) -> RecordedPlans:
    """Read every plan that was answered with.

    Args:
        bag: The directory, or its MCAP file.

    Raises:
        BagError: The bag cannot be read, holds no plan, or lacks what is needed to understand it.
        InvalidInput: The URDF in it is refused.
    """
    recording = read_bag(bag, type_name(PlanTrajectory.Event))
    events = [deserialize_message(cdr, PlanTrajectory.Event) for cdr in recording.messages]
    responses = [response for event in events for response in event.response]
    of_action = read_bag(bag, type_name(GET_RESULT.Event)).messages
    results = [deserialize_message(cdr, GET_RESULT.Event) for cdr in of_action]
    responses += [response.result for event in results for response in event.response]
    plans = {
        response.plan_id: plan_from_response(response)
        for response in responses
        if response.status.code == Status.SOLVED
    }
    if not plans:
        refusals = "; ".join(f"{r.plan_id}: {r.status.message}" for r in responses)
        raise BagError(f"bag {bag} holds no plan; its answers: {refusals or 'none'}")
    robot = _robot(bag, recording)
    for plan_id, plan in plans.items():
        if plan.joint_names != robot.joint_names:
            found, wanted = ", ".join(plan.joint_names), ", ".join(robot.joint_names)
            raise BagError(f"bag {bag}: {plan_id} moves {found}, but its robot has {wanted}")
    return RecordedPlans(robot, plans)


def _robot(bag: Path, recording: Recording) -> Robot:
    """Return the robot whose URDF and links are attached to a bag."""
    documents = {}
    for name in ("robot.urdf", "parameters.yaml"):
        if name not in recording.attachments:
            raise BagError(f"bag {bag} has no {name} attached, which says what its plans are for")
        documents[name] = recording.attachments[name].decode(errors="replace")
    try:
        links = yaml.safe_load(documents["parameters.yaml"])["/**"]["ros__parameters"]["robot"]
        base_link, tip_link = str(links["base_link"]), str(links["tip_link"])
    except (yaml.YAMLError, LookupError, TypeError):
        raise BagError(
            f"bag {bag}: its parameters.yaml does not name robot.base_link and robot.tip_link"
        ) from None
    return robot_from_urdf_text(documents["robot.urdf"], base_link, tip_link)
