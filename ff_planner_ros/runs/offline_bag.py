"""A bag of a plan that was made without a running node: the same topics, the same types."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.qos import QoSProfile
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.bag.encoding import encode
from ff_planner_ros.bag.provenance import PROVENANCE, provenance
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.scenario import SCENARIO_FRAME
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import (
    obstacles_message,
    request_message,
    response_from_error,
    response_from_plan,
    state_message,
    time_message,
)
from ff_planner_ros.ros.qos import EVENT_QOS, LATCHED_QOS, STATE_QOS
from ff_planner_ros.ros.recorder.recorder import offered_qos
from ff_planner_ros.ros.requests.reading import Sources

# What `ff-planner plan` plans with, if not with a baseline.
OPTIMAL = "optimal"


def record_answer(
    directory: Path,
    problem: PlanningProblem,
    settings: PlannerSettings,
    answer: Plan | FfPlannerError,
    solve_time: float,
    scenario: Path | None = None,
    method: str = OPTIMAL,
) -> None:
    """Write question and answer as the node would have recorded them.

    Args:
        directory: The bag; must not exist.
        answer: The plan, or why there is none.
        solve_time: Wall clock of the answer [s].
        scenario: The file that the question is from, if it is from one.
        method: That made the plan; only OPTIMAL is what a node answers with.

    Raises:
        BagError: The directory exists or cannot be written.
    """
    now = time.time_ns()
    names = problem.robot.joint_names
    state = state_message(problem.start, names, now, SCENARIO_FRAME)
    obstacles = obstacles_message(problem.obstacles, now, SCENARIO_FRAME)
    request = request_message(problem, SCENARIO_FRAME)
    request.use_start_state, request.start_state = True, state
    request.use_obstacles, request.obstacles = True, obstacles
    request.start_time = state.header.stamp
    plan_id = directory.name
    if isinstance(answer, Plan):
        response = response_from_plan(answer, plan_id, now, SCENARIO_FRAME, solve_time)
    else:
        response = response_from_error(answer, plan_id, solve_time)
    Sources(
        taken_up_ns=now, state_stamp_ns=now, state_source="start_state", obstacles_stamp_ns=now
    ).tell(response)

    with BagWriter(directory, flush_interval=0.0) as bag:

        def put(topic: str, qos: QoSProfile, *messages: Any) -> None:
            bag.add_topic(topic, type_name(type(messages[0])), [offered_qos(qos)])
            for message in messages:
                bag.write(topic, encode(message), now, now)

        robot = problem.robot
        used = {
            "robot": {"base_link": robot.base_link, "tip_link": robot.tip_link},
            "limits": {"velocity": "from_urdf" if problem.limits.joint_velocities else "none"},
            "planner": asdict(settings),
        }
        parameters = yaml.safe_dump({"/**": {"ros__parameters": used}})
        bag.attach("robot.urdf", "application/xml", robot.urdf.encode())
        bag.attach("parameters.yaml", "application/yaml", parameters.encode())
        if scenario is not None:
            bag.attach("scenario.yaml", "application/yaml", scenario.read_bytes())
        bag.add_record(PROVENANCE, provenance(method=method))
        put("/chaser_state", STATE_QOS, state)
        put("/obstacles", LATCHED_QOS, obstacles)
        events = _events(request, response, now)
        put("/plan_trajectory/_service_event", EVENT_QOS, *events)
        if isinstance(answer, Plan):
            put("/joint_trajectory", LATCHED_QOS, response.joint_trajectory)
            put("/predicted_chaser_path", LATCHED_QOS, response.predicted_chaser_path)


def _events(
    request: PlanTrajectory.Request, response: PlanTrajectory.Response, now: int
) -> list[PlanTrajectory.Event]:
    """Return the request and the response as service introspection tells of them."""
    received, sent = (
        ServiceEventInfo(event_type=kind, stamp=time_message(now), sequence_number=1)
        for kind in (ServiceEventInfo.REQUEST_RECEIVED, ServiceEventInfo.RESPONSE_SENT)
    )
    return [
        PlanTrajectory.Event(info=received, request=[request]),
        PlanTrajectory.Event(info=sent, response=[response]),
    ]
