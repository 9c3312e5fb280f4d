"""Writes a bag of a plan made without a node, with the topics and types that a node records."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.qos import QoSProfile
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.provenance import PROVENANCE, provenance
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.common.text_file import read_bytes
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.common.yaml_file import MOST_BYTES
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.limits import OF_ONE_NUMBER, Limits
from ff_planner_ros.planning.problem.user_requirements import requirements_written
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME
from ff_planner_ros.planning.task.captured import captured_in
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.planning.task.whole import captured_bodies, whole, whole_scene
from ff_planner_ros.robot.wheels import Wheels
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.phases import (
    bodies_of,
    efforts_of,
    not_in_requests,
    phase_message,
    plan_messages,
    tell_found,
)
from ff_planner_ros.ros.messages.to_messages import (
    answer_of_error,
    answer_with_plan,
    bodies_message,
    obstacles_message,
    plan_message,
    request_message,
    scene_message,
    state_message,
    target_body_message,
    time_message,
)
from ff_planner_ros.ros.outputs.markers import plan_markers
from ff_planner_ros.ros.qos import EVENT_QOS, LATCHED_QOS, STATE_QOS
from ff_planner_ros.ros.recorder.recorder import offered_qos
from ff_planner_ros.ros.requests.reading import Provenance


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
        InvalidInput: The task has a field that no request to the node can hold.
    """
    require_recordable(task)
    problem, now = task.problem, time.time_ns()
    names = problem.robot.joint_names
    state = state_message(problem.start, names, now, SCENARIO_FRAME)
    start_ns = now + round(task.ahead * NANOSECONDS)
    # As they are at the plan's first point, and so is the target body.
    obstacles = obstacles_message(problem.obstacles, start_ns, SCENARIO_FRAME)
    bodies = bodies_message(problem.obstacles, start_ns, SCENARIO_FRAME)
    request = request_message(problem, SCENARIO_FRAME)
    request.search.effort = task.effort
    request.then = [phase_message(one, names, SCENARIO_FRAME) for one in task.then]
    request.start_state = [state]
    request.scene = [scene_message(problem.obstacles, start_ns, SCENARIO_FRAME)]
    body = next((one for one in captured_bodies(task) if one is not None), None)
    if body is not None:
        request.target_body = [target_body_message(body, start_ns, SCENARIO_FRAME)]
    request.start_time = time_message(start_ns)
    plan_id = directory.name
    if isinstance(answer, Plan):
        told, total = (start_ns, SCENARIO_FRAME), whole(answer)
        each = plan_messages(answer, *told, bodies_of(task, answer))
        scene = whole_scene(task, answer)
        captured = captured_in(scene)
        written = plan_message(total, *told, captured) if answer.then else each[0]
        response = answer_with_plan(total, each, plan_id, solve_time)
    else:
        response = answer_of_error(answer, plan_id, solve_time)
        tell_found(response, answer, task, start_ns, SCENARIO_FRAME)
    Provenance(
        received_stamp_ns=now,
        state_stamp_ns=now,
        state_source="start_state",
        obstacles_stamp_ns=start_ns,
        obstacles_source="scene",
        target_body_stamp_ns=0 if body is None else start_ns,
        task_digest=task.ended_at(*efforts_of(response)).digest,
        first_guess=() if task.first_guess is None else tuple(task.first_guess.tolist()),
        geometry=problem.robot.geometry.value,
    ).tell(response)

    with BagWriter(directory, flush_interval=0.0) as bag:

        def put(topic: str, qos: QoSProfile, *messages: Any) -> None:
            bag.add_topic(topic, type_name(type(messages[0])), [offered_qos(qos)])
            for message in messages:
                bag.write(topic, encode(message), now, now)

        robot = problem.robot
        parameters = yaml.safe_dump({"/**": {"ros__parameters": _used(task)}})
        bag.attach("robot.urdf", "application/xml", robot.drawn_urdf.encode())
        bag.attach("parameters.yaml", "application/yaml", parameters.encode())
        if scenario is not None:
            bag.attach("scenario.yaml", "application/yaml", read_bytes(scenario, MOST_BYTES))
        bag.add_record(PROVENANCE, provenance(method=method))
        put("/chaser_state", STATE_QOS, state)
        put("/obstacles", LATCHED_QOS, obstacles)
        if bodies.bodies:
            put("/obstacle_bodies", LATCHED_QOS, bodies)
        if body is not None:
            put("/target_body", LATCHED_QOS, *request.target_body)
        events = _events(request, response, now)
        put("/plan_trajectory/_service_event", EVENT_QOS, *events)
        if isinstance(answer, Plan):
            put("/joint_trajectory", LATCHED_QOS, written.joint_trajectory)
            put("/predicted_chaser_path", LATCHED_QOS, written.chaser_path)
            if captured is not None:
                put("/predicted_target_path", LATCHED_QOS, written.target_path)
            put("/markers", LATCHED_QOS, plan_markers(robot, total, scene, SCENARIO_FRAME))


def require_recordable(task: PlanningTask) -> None:
    """Refuse a task that no request to the node can hold.

    Raises:
        InvalidInput: A field of the task has no place in a request.
    """
    window = task.problem.duration_range
    first, *others = _limits_of_phases(task)
    for field, given in (
        ("running", task.running is not None),
        ("running_goal", task.running_goal is not None),
        ("duration_range.target_velocity", window is not None and window.target_velocity.any()),
        *((field, True) for field in not_in_requests(task)),
        *(
            (f"phases[{k}].limits.{limit}", getattr(one, flag) is not getattr(first, flag))
            for k, one in enumerate(others, 1)
            for limit, flag in (("velocity", "joint_velocities"), ("effort", "joint_torques"))
        ),
        ("start_after", task.ahead * NANOSECONDS % 1.0 != 0.0),
    ):
        if given:
            allowed = "a request to the node cannot ask for it: leave out --bag"
            raise InvalidInput(Status.UNSUPPORTED, field, "given", allowed)


def _limits_of_phases(task: PlanningTask) -> list[Limits]:
    return [task.problem.limits, *(one.limits for one in task.then if one.limits is not None)]


def _used(task: PlanningTask) -> dict[str, Any]:
    """Return the parameters with which a node reads the same task from the request."""
    robot, controller, limits = task.problem.robot, task.controller, _limits_of_phases(task)
    each = [one.joint_accelerations or (math.inf,) for one in limits]
    fastest = np.max(np.broadcast_arrays(*each), axis=0)
    required = requirements_written(task.problem.requirements)
    wheels = robot.wheels or Wheels()  # without, they are not looked at
    return {
        "robot": {
            "urdf": "robot.urdf",
            "base_link": robot.base_link,
            "tip_link": robot.tip_link,
            "base": robot.base.value,
            "locked_joints": "",
            "geometry": robot.geometry.value,
            "srdf": "",
            "slide_weight": robot.slide_weight,
            "wheels": {
                "axes": wheels.axes.ravel().tolist(),
                "momentum": list(wheels.momentum or (0.0,)),
                "torque": list(wheels.torque or (0.0,)),
            },
        },
        "inertial_frame": SCENARIO_FRAME,
        "state_source": "chaser_state",
        "points": task.problem.points,
        "planning_lead_time": 0.0,
        "start_horizon": max(task.ahead, 600.0),
        "following_tolerance": 0.0,
        "state_max_age": 0.5,
        "state_future_tolerance": task.ahead,
        "target_max_age": 0.0,
        "end_behaviour": task.end_behaviour.value,
        "post_goal_duration": task.tail or 1.0,
        "limits": {
            # The laxest of all phases: each asks for its own, which may be lower.
            "velocity": "from_urdf" if limits[0].joint_velocities else "none",
            "acceleration": fastest.tolist() if np.isfinite(fastest).all() else [0.0],
            "effort": "from_urdf" if limits[0].joint_torques else "none",
            **{
                name: float(most) if math.isfinite(most) else 0.0
                for name in OF_ONE_NUMBER
                for most in (max(getattr(one, name) for one in limits),)
            },
        },
        "controller": {
            "allow_nonzero_velocity_at_trajectory_end": controller is None
            or controller.allow_nonzero_velocity_at_trajectory_end,
            "effort_interface": controller is not None and controller.effort_interface,
            "stopped_velocity_tolerance": 0.0
            if controller is None
            else controller.stopped_velocity_tolerance,
        },
        "planner": asdict(task.settings)
        | {"search": str(task.settings.search)}
        | {"plugins": yaml.safe_dump(required) if required else ""},
    }


def _events(request: PlanRequest, answer: PlanAnswer, now: int) -> list[PlanTrajectory.Event]:
    """Return request and answer as events of service introspection."""
    received, sent = (
        ServiceEventInfo(event_type=kind, stamp=time_message(now), sequence_number=1)
        for kind in (ServiceEventInfo.REQUEST_RECEIVED, ServiceEventInfo.RESPONSE_SENT)
    )
    return [
        PlanTrajectory.Event(info=received, request=[PlanTrajectory.Request(request=request)]),
        PlanTrajectory.Event(info=sent, response=[PlanTrajectory.Response(answer=answer)]),
    ]
