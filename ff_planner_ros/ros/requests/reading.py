"""From a request to a planning task and its start time, with the state and scene of now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ff_planner_msgs.msg import ChaserState, PlanInputs, PlanRequest

from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.forms import a_word
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.messages.target_bodies import NAMED_AS, captures
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.problem import TargetBody
from ff_planner_ros.planning.problem.settings import PlannerSettings, SearchDepth
from ff_planner_ros.planning.task.library import Library
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.ages import OF_STATES
from ff_planner_ros.ros.inputs.locked_joints import MeasuredRobot, positions_in, require_locked
from ff_planner_ros.ros.inputs.scene_input import SceneInput, SeenBody
from ff_planner_ros.ros.inputs.state_input import Snapshot, StateInput
from ff_planner_ros.ros.messages.from_messages import (
    problem_from_request,
    require_end,
    require_supported,
    state_from_message,
    time_in_ns,
)
from ff_planner_ros.ros.messages.phases import phases_in
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.continuing import continued_plan, followed_until, motion_on

# Longest name of a requester: it is in a message and in the log.
_LONGEST_NAME = 200


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What the planner knows besides the request, at the time when it reads the request."""

    robot: Robot
    parameters: NodeParameters  # for what the request leaves open
    states: StateInput  # for the state that the request does not bring
    scenes: SceneInput  # for obstacles and target body that the request does not bring
    published: PublishedPlan | None  # the last plan, which the arm may be following
    now_ns: int  # [ns]
    library: Library | None = None  # for warm starts
    # Of the robot where its locked joints are measured; None: the parameters say where they are
    robots: MeasuredRobot | None = None

    def followed(self, measured: Snapshot, start_ns: int) -> list[PublishedPlan]:
        """Return the published plans that the joints follow until start_ns [ns], in their order."""
        if self.published is None:
            return []
        most = self.parameters.tracking.max_joint_position
        return followed_until(self.published, measured, start_ns, self.robot, most)


@dataclass(frozen=True, eq=False)
class ReadRequest:
    """A request, with all that it refers to resolved at the time when it was read."""

    task: PlanningTask
    budget: Budget  # wall clock for the task
    start_ns: int  # time of the plan's first point [ns]
    inputs: PlanInputs  # what the task is made from
    plan_only: bool  # whether the plan waits for `~/publish_plan`


def read_request(
    request: PlanRequest, knowledge: Knowledge, inputs: PlanInputs | None = None
) -> ReadRequest:
    """Read a request of the service or the action.

    Args:
        inputs: Takes what the task is made from, of a refused request as far as it was read.

    Raises:
        InvalidInput: A field or an input is invalid.
    """
    parameters = knowledge.parameters
    inputs = PlanInputs() if inputs is None else inputs
    inputs.received_stamp = time_message(knowledge.now_ns)
    require_requester(request.requester)
    require_supported(request)
    budget = _time_budget(request, parameters)
    continues = request.replan_active
    start_ns = _start_time(request, knowledge, continues)
    end_behaviour = _end_behaviour(request, parameters)
    measured = measured_state(request.start_state, knowledge)
    robot = measured.robot
    inputs.state_stamp = time_message(measured.stamp_ns)
    inputs.state_source = measured.source
    inputs.state_clock_offset = measured.clock_offset
    inputs.joint_states_stamp = time_message(measured.joint_states_stamp_ns)
    # A state may be stamped a little ahead of now: two computers' clocks differ.
    if not nanoseconds(request.start_time):  # checked by `_start_time`
        start_ns = max(start_ns, measured.stamp_ns)
    _require_after_state(start_ns, measured.stamp_ns)
    continued = None
    if continues:
        inputs.previous_plan_id = getattr(knowledge.published, "plan_id", "")
        inputs.handover_delay = (start_ns - knowledge.now_ns) / NANOSECONDS
        continued = continued_plan(
            knowledge.published,
            measured,
            start_ns,
            robot,
            parameters.replanning.min_remainder,
            parameters.tracking,
        )
        inputs.splice_time = continued.splice_time
    scene = knowledge.scenes.moving_scene(
        request.scene[0] if request.scene else None,
        knowledge.now_ns,
        parameters.state_future_tolerance,
        parameters.obstacles_max_age,
    )
    inputs.obstacles_stamp = time_message(scene.stamp_ns)
    inputs.obstacles_source = scene.source
    body = None
    if captures(request):
        seen = _seen_body(request, knowledge)
        inputs.target_body_stamp = time_message(seen.stamp_ns)
        inputs.target_body_source = seen.source
        body = _carried(seen, start_ns)
    problem = problem_from_request(
        request,
        robot,
        measured.state,
        scene.obstacles_at(start_ns),
        parameters,
        body if request.goal.kind == GoalKind.CAPTURE else None,
        None if continued is None else continued.remaining,
    )
    then = phases_in(request, problem.robot, parameters, body)
    tail = 0.0 if end_behaviour is EndBehaviour.NONE else parameters.post_goal_duration
    lasts = problem.duration + sum(phase.longest_duration for phase in then) + tail
    field = "duration" if problem.duration_range is None else "duration_max"
    require_end(field, problem.duration, start_ns / NANOSECONDS + lasts)
    ahead = (start_ns - measured.stamp_ns) / NANOSECONDS
    running = None if continued is None else continued.motion
    if continued is None and (followed := knowledge.followed(measured, start_ns)):
        running = motion_on(followed, measured, robot.continuous).between(0.0, ahead)
        inputs.previous_plan_id = followed[-1].plan_id
    task = PlanningTask(
        problem=problem,
        settings=_settings(request, parameters),
        ahead=ahead,
        running=running,
        running_goal=None if continued is None else ahead + continued.remaining,
        end_behaviour=end_behaviour,
        tail=tail,
        controller=parameters.controller.setup,
        effort=request.search.effort,
        then=then,
    )
    guess = None if knowledge.library is None else knowledge.library.first_guess(task)
    if guess is not None:
        task = replace(task, first_guess=guess)
        inputs.first_guess = guess.tolist()
    return ReadRequest(task, budget, start_ns, inputs, request.plan_only)


def require_requester(name: str) -> None:
    """Refuse the name of a requester that is too long, or not printable.

    Raises:
        InvalidInput: It is.
    """
    if len(name) > _LONGEST_NAME or not name.isprintable():
        allowed = f"it must be at most {_LONGEST_NAME} printable characters"
        raise InvalidInput(Status.OUT_OF_RANGE, "requester", repr(name), allowed)


@dataclass(frozen=True, eq=False)
class MeasuredState(Snapshot):
    """A state with the robot whose locked joints are where they were measured with it."""

    robot: Robot = field(kw_only=True)


def measured_state(
    own: Sequence[ChaserState], knowledge: Knowledge, planned: Robot | None = None
) -> MeasuredState:
    """Return the state that a request brings, or else the newest one of the topics.

    Args:
        own: Field `start_state` of the request, with one entry at most.
        planned: The robot of a plan, whose locked joints must be where it has them; None: as the
            parameters say.

    Raises:
        InvalidInput: There is no state, it is invalid, too old or too far ahead of now, or it has
            a joint elsewhere than the model, which has it locked.
    """
    parameters, now_ns = knowledge.parameters, knowledge.now_ns
    limits = (now_ns, parameters.state_max_age, parameters.state_future_tolerance)
    tolerance, robots = parameters.locked_joint_tolerance, knowledge.robots
    if not own:
        states = knowledge.states
        found = states.snapshot(*limits, tolerance)
        robot = knowledge.robot
        if robots is not None:
            robot = planned or robots.at(states.locked.positions(), tolerance)
            states.locked.require_locked(tolerance, robot)
        return MeasuredState(**vars(found), robot=robot)
    message, source = own[0], "start_state"
    stamp_ns = time_in_ns(f"{source}.header.stamp", message.header.stamp) or now_ns
    OF_STATES.require(f"{source}.header.stamp", stamp_ns, *limits, is_own=True)
    state = state_from_message(message, source, knowledge.robot, parameters.inertial_frame)
    robot = knowledge.robot
    if robots is not None:
        robot = planned or robots.at(positions_in(message, robot), tolerance)
    require_locked(source, message, robot, tolerance)
    return MeasuredState(state, stamp_ns, source, robot=robot)


def _seen_body(request: PlanRequest, knowledge: Knowledge) -> SeenBody:
    """Return the target body that a request brings, or else the topic's newest one."""
    parameters = knowledge.parameters
    limits = (knowledge.now_ns, parameters.target_max_age, parameters.state_future_tolerance)
    own = request.target_body[0] if request.target_body else None
    return knowledge.scenes.target_body(own, *limits)


def _carried(seen: SeenBody, start_ns: int) -> TargetBody:
    """Return a target body at a time [ns], after torque-free motion."""
    with fields_named(NAMED_AS):
        return seen.body.after((start_ns - seen.stamp_ns) / NANOSECONDS)


def _require_after_state(start_ns: int, stamp_ns: int) -> None:
    if start_ns < stamp_ns:
        raise InvalidInput(
            Status.START_IN_PAST,
            "start_time",
            f"{(stamp_ns - start_ns) / NANOSECONDS:.3f} s before the start state",
            "a plan starts from the state or later",
        )


def _settings(request: PlanRequest, parameters: NodeParameters) -> PlannerSettings:
    asked = request.search.depth or parameters.planner.search
    return replace(parameters.planner, search=a_word(SearchDepth).checked("search.depth", asked))


def _time_budget(request: PlanRequest, parameters: NodeParameters) -> Budget:
    asked = request.search.time_budget
    if asked < 0.0:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "search.time_budget",
            asked,
            "it must not be negative; 0 stands for the parameter time_budget, "
            f"{parameters.time_budget:g} s",
        )
    if finite_number("search.time_budget", asked):
        return Budget(asked)
    return parameters.budget(request.objective.chaser_attitude > 0.0)


def _start_time(request: PlanRequest, knowledge: Knowledge, continues: bool) -> int:
    asked_ns = time_in_ns("start_time", request.start_time)
    parameters, now_ns = knowledge.parameters, knowledge.now_ns
    if not asked_ns:
        of_handover = parameters.replanning.lead_time
        kept_free = of_handover if continues else parameters.planning_lead_time
        return now_ns + round(kept_free * NANOSECONDS)
    lead = (asked_ns - now_ns) / NANOSECONDS
    if lead < 0.0:
        raise InvalidInput(
            Status.START_IN_PAST,
            "start_time",
            f"{-lead:.3f} s ago",
            "it must be ahead of now by what planning takes; zero stands for now + the parameter "
            f"planning_lead_time, {parameters.planning_lead_time:g} s",
        )
    if lead > parameters.start_horizon:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "start_time",
            f"{lead:.3f} s ahead of now",
            f"it must be at most {parameters.start_horizon:g} s ahead (parameter "
            "start_horizon): no measured state tells what will be then",
        )
    return asked_ns


def _end_behaviour(request: PlanRequest, parameters: NodeParameters) -> EndBehaviour:
    word = request.end_behaviour or parameters.end_behaviour
    if word not in tuple(EndBehaviour):
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "end_behaviour",
            repr(word),
            f"it must be {', '.join(EndBehaviour)}, or empty for the parameter end_behaviour",
        )
    return EndBehaviour(word)
