"""From a request to what is to be planned, and from when on: the clock's reading comes in here."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from ff_planner_msgs.srv import PlanTrajectory

from ff_planner_ros.arrays import finite_number
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.problem import Limits
from ff_planner_ros.planning.scenario import from_urdf
from ff_planner_ros.planning.tail import EndBehaviour
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import Snapshot, StateInput, require_current
from ff_planner_ros.ros.messages.from_messages import (
    NANOSECONDS,
    nanoseconds,
    problem_from_request,
    state_from_message,
)
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.parameters import NodeParameters


@dataclass
class Sources:
    """What an answer is made from, noted while its request is read: a refusal tells it, too.

    Attributes:
        taken_up_ns: The node's time when the request was read; zero: it was not [ns].
        state_stamp_ns: Of the measured state [ns].
        state_source: Topic or field that it came from; empty: no state is known.
        joint_states_stamp_ns: Of the joint states that went with odometry; zero: none did [ns].
        obstacles_stamp_ns: Of the obstacles [ns].
        obstacles_source: Who says so.
        following: Name of the plan that the joints follow until the start; empty: none.
    """

    taken_up_ns: int = 0
    state_stamp_ns: int = 0
    state_source: str = ""
    joint_states_stamp_ns: int = 0
    obstacles_stamp_ns: int = 0
    obstacles_source: str = ""
    following: str = ""

    def tell(self, response: PlanTrajectory.Response) -> None:
        """Write them into an answer."""
        response.taken_up = time_message(self.taken_up_ns)
        response.state_stamp = time_message(self.state_stamp_ns)
        response.state_source = self.state_source
        response.joint_states_stamp = time_message(self.joint_states_stamp_ns)
        response.obstacles_stamp = time_message(self.obstacles_stamp_ns)
        response.obstacles_source = self.obstacles_source
        response.following = self.following


@dataclass(frozen=True, eq=False)
class ReadRequest:
    """What a request asks at the moment when it is taken up.

    Attributes:
        task: What to plan.
        budget: Wall clock for it [s].
        start_ns: Time of the plan's first point [ns].
    """

    task: PlanningTask
    budget: float
    start_ns: int


def read_request(
    request: PlanTrajectory.Request,
    robot: Robot,
    parameters: NodeParameters,
    states: StateInput,
    scenes: SceneInput,
    published: PublishedPlan | None,
    now_ns: int,
    sources: Sources,
) -> ReadRequest:
    """Read a request.

    Args:
        request: Of the service, or the goal of the action.
        parameters: For what the request leaves open.
        states: Where the state comes from that the request does not bring.
        scenes: Where the obstacles come from that the request does not bring.
        published: The last plan, which the arm may be following.
        now_ns: The time now [ns].
        sources: Noted here as soon as they are known.

    Raises:
        InvalidInput: The first thing that cannot be used; the error names it.
    """
    sources.taken_up_ns = now_ns
    budget = _time_budget(request, parameters)
    start_ns = _start_time(request, parameters, now_ns)
    end_behaviour = _end_behaviour(request, parameters)
    measured = _measured(request, robot, parameters, states, now_ns)
    sources.state_stamp_ns, sources.state_source = measured.stamp_ns, measured.source
    sources.joint_states_stamp_ns = measured.joint_states_stamp_ns
    # A state may be stamped a little ahead of now, where two computers' clocks differ.
    start_ns = start_ns if nanoseconds(request.start_time) else max(start_ns, measured.stamp_ns)
    if start_ns < measured.stamp_ns:
        raise InvalidInput(
            Status.START_IN_PAST,
            "start_time",
            f"{(measured.stamp_ns - start_ns) / NANOSECONDS:.3f} s before the start state",
            "a plan starts from the state or later",
        )
    scene = scenes.scene(request.obstacles if request.use_obstacles else None)
    sources.obstacles_stamp_ns, sources.obstacles_source = scene.stamp_ns, scene.source
    tail = 0.0 if end_behaviour is EndBehaviour.AS_PLANNED else parameters.tail_duration
    problem = problem_from_request(
        request,
        robot,
        measured.state,
        start_ns + round(tail * NANOSECONDS),
        scene.spheres,
        parameters.inertial_frame,
        parameters.points,
        Limits(joint_velocities=from_urdf("limits.velocity", parameters.limits.velocity)),
    )
    running = _running(published, measured, parameters.following_tolerance)
    if published is not None and running is not None:
        sources.following = published.plan_id
    task = PlanningTask(
        problem=problem,
        ahead=(start_ns - measured.stamp_ns) / NANOSECONDS,
        running=running,
        end_behaviour=end_behaviour,
        tail=tail,
    )
    return ReadRequest(task, budget, start_ns)


def _time_budget(request: PlanTrajectory.Request, parameters: NodeParameters) -> float:
    if request.time_budget < 0.0:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "time_budget",
            request.time_budget,
            "it must not be negative; 0 stands for the parameter time_budget, "
            f"{parameters.time_budget:g} s",
        )
    return finite_number("time_budget", request.time_budget) or parameters.time_budget


def _start_time(request: PlanTrajectory.Request, parameters: NodeParameters, now_ns: int) -> int:
    asked_ns = nanoseconds(request.start_time)
    if not asked_ns:
        return now_ns + round(parameters.planning_allowance * NANOSECONDS)
    lead = (asked_ns - now_ns) / NANOSECONDS
    if lead < 0.0:
        raise InvalidInput(
            Status.START_IN_PAST,
            "start_time",
            f"{-lead:.3f} s ago",
            "it must be ahead of now by what planning takes; zero stands for now + the parameter "
            f"planning_allowance, {parameters.planning_allowance:g} s",
        )
    if lead > parameters.start_max_lead:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "start_time",
            f"{lead:.3f} s ahead of now",
            f"it must be at most {parameters.start_max_lead:g} s ahead (parameter "
            "start_max_lead): no measured state tells what will be then",
        )
    return asked_ns


def _end_behaviour(request: PlanTrajectory.Request, parameters: NodeParameters) -> EndBehaviour:
    word = request.end_behaviour or parameters.end_behaviour
    if word not in tuple(EndBehaviour):
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "end_behaviour",
            repr(word),
            f"it must be {', '.join(EndBehaviour)}, or empty for the parameter end_behaviour",
        )
    return EndBehaviour(word)


def _measured(
    request: PlanTrajectory.Request,
    robot: Robot,
    parameters: NodeParameters,
    states: StateInput,
    now_ns: int,
) -> Snapshot:
    limits = (now_ns, parameters.state_max_age, parameters.state_max_lead)
    if not request.use_start_state:
        return states.snapshot(*limits)
    message, source = request.start_state, "start_state"
    stamp_ns = nanoseconds(message.header.stamp) or now_ns
    require_current(f"{source}.header.stamp", stamp_ns, *limits)
    state = state_from_message(message, source, robot, parameters.inertial_frame)
    return Snapshot(state, stamp_ns, source)


def _running(
    published: PublishedPlan | None, measured: Snapshot, tolerance: float
) -> JointMotion | None:
    """Return the published plan if it runs: the joints are where it wants them to be.

    Nobody tells the planner which plans are executed; a plan that was not leaves the joints behind.
    """
    if published is None:
        return None
    start = (published.start_ns - measured.stamp_ns) / NANOSECONDS
    # The controller was told whole nanoseconds, and so was the bag, which a replay starts from.
    trajectory = published.trajectory
    told = np.rint(trajectory.time * NANOSECONDS) / NANOSECONDS
    motion = joint_motion(replace(trajectory, time=told), start)
    if not motion.time[0] <= 0.0 <= motion.time[-1]:
        return None
    (planned,), _, _ = motion.at(np.zeros(1))
    off = float(np.abs(measured.state.joint_positions - planned).max())
    return motion if off <= tolerance else None
