"""Requests rebuilt from a bag, each with all that the planner knew when it read the request."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.bag.provenance import PROVENANCE
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.bag.robot_plans import attached_robot
from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import BagError, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.task.library import KnownGuess
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.input_topics import INPUT_TOPICS, JOINT_STATES
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.messages.joint_names import joints_named, names_a_joint_of
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.reading import Knowledge, ReadRequest, read_request
from ff_planner_ros.runs.installed import PlanExchange, as_installed, installed_exchanges
from ff_planner_ros.runs.moments import moment
from ff_planner_ros.runs.recorded_inputs import Heard, Moment, heard, input_topic
from ff_planner_ros.runs.recorded_parameters import RecordedParameters


@dataclass(frozen=True, eq=False)
class RecordedRequest:
    """A request with its answer."""

    name: str  # the plan id of the answer, or else the number of the request
    door: str  # `service` or `action`
    request: PlanRequest | None  # None where the bag holds the answer alone
    response: PlanAnswer | None  # None where the bag holds no answer
    inputs: Knowledge | None  # what the node knew; None if that cannot be rebuilt
    missing: str  # why the inputs cannot be rebuilt; empty if they can
    # Inputs whose stamps the response does not name: the message recorded last before the
    # request was read is taken as the one that the node used
    by_time: tuple[str, ...]

    @property
    def status(self) -> Status | None:
        """Status of the recorded answer; None without an answer, or if it is unknown here."""
        if self.response is None or self.response.status.code not in iter(Status):
            return None
        return Status(self.response.status.code)

    def read_request(self) -> ReadRequest:
        """Read the request again, as the node did.

        Raises:
            BagError: The bag does not hold all that the node knew.
            InvalidInput: The request is refused, as by the node.
        """
        if self.request is None or self.inputs is None:
            raise BagError(self.missing)
        return read_request(self.request, self.inputs)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """The robot and all planning requests of a bag."""

    robot: Robot
    requests: tuple[RecordedRequest, ...]  # in order of arrival
    provenance: Mapping[str, str]  # host, versions and more, as recorded; may be empty
    notes: tuple[str, ...]  # what is wrong with the bag, and assumptions


def recorded_run(bag: Bag) -> RecordedRun:
    """Rebuild every request in a bag.

    Raises:
        BagError: The bag holds no request, or lacks the robot or the parameters.
        InvalidInput: The URDF in the bag is invalid.
    """
    found = installed_exchanges(bag)
    if not found:
        raise BagError(
            f"bag {bag.path} holds no request to a planner: no event of a service or an action "
            "PlanTrajectory"
        )
    robot = attached_robot(bag.path, bag.attachments)
    provenance = bag.metadata.get(PROVENANCE, {})
    namespaces = list(dict.fromkeys(exchange.namespace for exchange in found))
    node = provenance.get("node", f"{namespaces[0]}/ff_planner")
    recorded = RecordedParameters(bag, node)

    times_ns, moments = zip(*(moment(exchange, recorded) for exchange in found), strict=True)
    topics, absent = _topics(bag, _namespace(node), moments)
    of_another = _of_another(provenance, namespaces)
    requests = []
    own = {JOINT_STATES.name: names_a_joint_of(robot)}
    locked = {JOINT_STATES.name: joints_named([one.name for one in robot.locked_joints])}
    for i, all_heard in enumerate(heard(bag, topics, moments, own, locked)):
        exchange, now_ns = found[i], times_ns[i]
        inputs, missing = None, of_another.get(exchange.namespace, "")
        try:
            if not missing:
                _require_all(exchange, moments[i], all_heard, absent)
                parameters = recorded.at(now_ns)
                frame, source = parameters.inertial_frame, parameters.state_source
                states = StateInput(robot, frame, source, parameters.odometry)
                scenes = SceneInput(frame)
                keep = states.callbacks() | scenes.callbacks()
                for name, messages in all_heard.items():
                    for message in messages:
                        kind = INPUT_TOPICS[name].message_type
                        keep[name](as_installed(bag.decode(message), kind))
                published = _published(found[:i], exchange)
                guess = KnownGuess(np.array(_first_guess(exchange), dtype=np.float64))
                inputs = Knowledge(robot, parameters, states, scenes, published, now_ns, guess)
        except BagError as error:
            missing = str(error)
        plan_id = exchange.response.plan_id if exchange.response is not None else ""
        requests.append(
            RecordedRequest(
                name=plan_id or f"request {i + 1}",
                door=exchange.door,
                request=exchange.request,
                response=exchange.response,
                inputs=inputs,
                missing=missing,
                by_time=tuple(
                    name
                    for name in moments[i].inputs
                    if name not in moments[i].stamps_ns and not INPUT_TOPICS[name].optional
                ),
            )
        )
    notes = (*bag.notes, *recorded.notes)
    return RecordedRun(robot, tuple(requests), provenance, notes)


def _namespace(name: str) -> str:
    return name.rpartition("/")[0]


def _of_another(provenance: Mapping[str, str], namespaces: Sequence[str]) -> dict[str, str]:
    """Return why requests to some planners cannot be rebuilt, by the planner's namespace."""
    node, method = provenance.get("node"), provenance.get("method", OPTIMAL)
    if method != OPTIMAL:
        return dict.fromkeys(namespaces, f"it was planned by a baseline, --method {method}")
    if len(namespaces) == 1:
        return {}
    planners = ", ".join(f"{namespace}/" for namespace in namespaces)
    why = f"the bag holds requests to planners in {planners}, and parameters of one: "
    if node is None:
        return dict.fromkeys(namespaces, f"{why}it does not say of which")
    return {one: f"{why}{node}" for one in namespaces if one != _namespace(node)}


def _topics(
    bag: Bag, namespace: str, moments: Sequence[Moment]
) -> tuple[dict[str, str], dict[str, BagError]]:
    """Return the topics of the inputs that are needed, and the errors of inputs without one."""
    topics, absent = {}, {}
    for name in dict.fromkeys(name for one in moments for name in one.inputs):
        try:
            topics[name] = input_topic(bag, name, namespace)
        except BagError as error:
            absent[name] = error
    return topics, absent


def _require_all(
    exchange: PlanExchange, moment: Moment, found: Heard, absent: Mapping[str, BagError]
) -> None:
    """Refuse a request whose inputs are not all in the bag."""
    if exchange.request is None:
        raise BagError("its answer is in the bag, but not the request itself")
    if exchange.response is None:
        raise BagError("it has no answer in the bag: recording ended before, or the planner did")
    for name, stamp_ns in moment.stamps_ns.items():
        if name not in found:
            stamp = f"{stamp_ns // NANOSECONDS}.{stamp_ns % NANOSECONDS:09d}"
            why = absent.get(name, "the bag was cut, or it was dropped")
            raise BagError(f"{name} stamped {stamp} is not in the bag: {why}")


def _published(before: Sequence[PlanExchange], exchange: PlanExchange) -> PublishedPlan | None:
    """Return the plan that the joints followed, or may have followed, at a request."""
    response = exchange.response
    if response is None or not (followed := response.inputs.previous_plan_id):
        return None
    by_id = {
        one.response.plan_id: one.response
        for one in before
        if one.response is not None and one.response.status.code == Status.SOLVED
    }
    if followed not in by_id:
        raise BagError(f"plan {followed}, which the joints followed, is not in the bag")
    now_ns = nanoseconds(response.inputs.received_stamp)
    return _with_those_before(by_id[followed], by_id, now_ns)


def _with_those_before(
    answer: PlanAnswer, by_id: Mapping[str, PlanAnswer], now_ns: int
) -> PublishedPlan:
    """Return a plan with those that are followed before it from now [ns] on, and one more."""
    plan, before = _plan_in(answer), by_id.get(answer.inputs.previous_plan_id)
    if before is None:
        return plan
    if now_ns < plan.start_ns:
        return replace(plan, before=_with_those_before(before, by_id, now_ns))
    return replace(plan, before=_plan_in(before))


def _first_guess(exchange: PlanExchange) -> Sequence[float]:
    """Return the initial guess from the warm-start library; empty: a cold start."""
    return () if exchange.response is None else exchange.response.inputs.first_guess


def _plan_in(answer: PlanAnswer) -> PublishedPlan:
    try:
        start_ns = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
        plan = plan_from_answer(answer)
    except (ValueError, IndexError) as error:
        raise BagError(f"plan {answer.plan_id}, which the joints followed, is damaged") from error
    return PublishedPlan(answer.plan_id, plan.trajectory, start_ns, duration=plan.duration)
