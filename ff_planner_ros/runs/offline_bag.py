"""Writes a bag of a plan made without a node, with the exchange and topics that a node records."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from ff_planner_msgs.msg import Exchange, PlanInputs, PlanRequest
from std_msgs.msg import Header

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.provenance import PROVENANCE, provenance, versions
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.common.text_file import read_bytes
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.common.yaml_file import MOST_BYTES
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.captured import captured_in
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.planning.task.whole import (
    captured_bodies,
    efforts_of,
    whole,
    whole_scene,
)
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.phases import not_in_requests, phase_message
from ff_planner_ros.ros.messages.to_messages import (
    plan_message,
    request_message,
    scene_message,
    state_message,
    target_body_message,
    time_message,
)
from ff_planner_ros.ros.outputs.markers import plan_markers
from ff_planner_ros.ros.topics import (
    EXCHANGES,
    JOINT_TRAJECTORY,
    MARKERS,
    PREDICTED_CHASER_PATH,
    PREDICTED_TARGET_PATH,
    Endpoint,
)


def record_answer(
    directory: Path,
    task: PlanningTask,
    answer: Plan | FfPlannerError,
    solve_time: float,
    scenario: Path | None = None,
    method: str = OPTIMAL,
) -> None:
    """Write a task and its answer to a new bag, as the node would have recorded them.

    Args:
        directory: The bag; must not exist.
        answer: The plan, or why there is none.
        solve_time: Wall-clock time of planning [s].
        scenario: File that the task was loaded from, to be attached; None: no file.
        method: Name of the planning method; a replay refuses any other than OPTIMAL.

    Raises:
        BagError: The directory exists or cannot be written.
        InvalidInput: No scenario can hold the task.
    """
    now, robot = time.time_ns(), task.problem.robot
    start_ns = now + round(task.ahead * NANOSECONDS)
    ended, plan_id = task.ended_at(*efforts_of(answer)), directory.name
    response = answer_of(answer, plan_id, solve_time, ended, start_ns, SCENARIO_FRAME)
    response.inputs = PlanInputs(
        received_stamp=time_message(now),
        state_stamp=time_message(now),
        state_source="start_state",
        obstacles_stamp=time_message(start_ns),
        obstacles_source="scene",
        first_guess=[] if task.first_guess is None else task.first_guess.tolist(),
    )
    header = Header(stamp=time_message(now), frame_id=SCENARIO_FRAME)
    told = {"header": header, "plan_id": plan_id, "interface": Interface.COMMAND_LINE}
    request = [] if any(not_in_requests(task)) else [_request(task, now, start_ns)]
    exchanges = (
        Exchange(event=Event.RECEIVED, request=request, **told),
        Exchange(
            event=Event.ANSWERED,
            request=request,
            task=task_json(ended, robot.drawn_urdf),
            versions=json.dumps(versions()),
            answer=[response],
            **told,
        ),
    )
    with BagWriter(directory, flush_interval=0.0) as bag:

        def put(topic: Endpoint, *messages: Any) -> None:
            name = f"/{topic.name}"
            bag.add_topic(name, type_name(topic.message_type), [topic.qos])
            for message in messages:
                bag.write(name, encode(message), now, now)

        bag.attach("robot.urdf", "application/xml", robot.drawn_urdf.encode())
        if scenario is not None:
            bag.attach("scenario.yaml", "application/yaml", read_bytes(scenario, MOST_BYTES))
        bag.add_record(PROVENANCE, provenance(method=method))
        put(EXCHANGES, *exchanges)
        if isinstance(answer, Plan):
            scene, total = whole_scene(task, answer), whole(answer)
            captured = captured_in(scene)
            written = plan_message(total, start_ns, SCENARIO_FRAME, captured)
            put(JOINT_TRAJECTORY, written.joint_trajectory)
            put(PREDICTED_CHASER_PATH, written.chaser_path)
            if captured is not None:
                put(PREDICTED_TARGET_PATH, written.target_path)
            put(MARKERS, plan_markers(robot, total, scene, SCENARIO_FRAME))


def _request(task: PlanningTask, now_ns: int, start_ns: int) -> PlanRequest:
    """Return the request that asks a node for the task's goals, with its state and scene."""
    problem, names = task.problem, task.problem.robot.joint_names
    request = request_message(problem, SCENARIO_FRAME)
    request.then = [phase_message(one, names, SCENARIO_FRAME) for one in task.then]
    request.start_state = [state_message(problem.start, names, now_ns, SCENARIO_FRAME)]
    # As they are at the plan's first point, and so is the target body.
    request.scene = [scene_message(problem.obstacles, start_ns, SCENARIO_FRAME)]
    body = next((one for one in captured_bodies(task) if one is not None), None)
    if body is not None:
        request.target_body = [target_body_message(body, start_ns, SCENARIO_FRAME)]
    request.start_time = time_message(start_ns)
    return request
