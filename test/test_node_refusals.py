"""Every request that cannot be planned, through the real service: code, cause, and no harm."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from ff_planner_msgs.msg import (
    ChaserState,
    Goal,
    Obstacle,
    Payload,
    Phase,
    PlanAnswer,
    PlanRequest,
    PlanStatus,
    TargetBody,
)
from ff_planner_msgs.msg import Scene as SceneMessage
from quick_capture import resting_capture
from recorded_requests import replays_of
from ros_processes import (
    FRAME,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from shape_msgs.msg import SolidPrimitive

from ff_planner_ros.errors import REMEDIES, Status
from ff_planner_ros.runs.replay import Replayed, Verdict

pytestmark = pytest.mark.ci

NAN = float("nan")
# What an answer was made from is told, refusals included.
SOURCES = (
    "state_clock_offset",
    *("received_stamp", "state_stamp", "state_source", "joint_states_stamp"),
    *("obstacles_stamp", "obstacles_source", "previous_plan_id"),
    *("target_body_stamp", "target_body_source"),
)
# What a status says.
SAID = ("code", "message", "field", "value", "allowed", "retry")
ARGUMENTS = (
    *("-p", "state_max_age:=60.0", "-p", "planning_lead_time:=60.0"),
    *("-p", "planner.starts:=4", "-p", "time_budget:=300.0"),
)


@dataclass(frozen=True)
class Case:
    """A request that is complete and can be solved but for one fault."""

    status: Status
    words: tuple[str, ...]
    spoil: Callable[[PlanRequest], None]


def _set(path: str, value: Any) -> Callable[[PlanRequest], None]:
    """Return what sets a field, given by its dotted path in the request."""
    *owners, name = path.split(".")

    def spoil(request: PlanRequest) -> None:
        owner = request
        for step in owners:
            owner = owner[int(step)] if step.isdigit() else getattr(owner, step)
        if name.isdigit():
            owner[int(name)] = value
        else:
            setattr(owner, name, value)

    return spoil


def _age(seconds: float) -> Callable[[PlanRequest], None]:
    """Return what puts the start state so much before, from a stamp of now."""

    def spoil(request: PlanRequest) -> None:
        request.start_state[0].header.stamp.sec = round(time.time() - seconds)

    return spoil


def _of_a_body(sec: int) -> Callable[[PlanRequest], None]:
    """Return what asks for the capture of a body without inertia, stamped so [s]; zero: now."""

    def spoil(request: PlanRequest) -> None:
        request.goal.kind = Goal.CAPTURE
        body = TargetBody()
        body.header.frame_id = FRAME
        body.header.stamp.sec = sec
        if sec:
            body.inertia.ixx = body.inertia.iyy = body.inertia.izz = 1.0
        request.target_body = [body]

    return spoil


def _of_a_body_with(**fields: Any) -> Callable[[PlanRequest], None]:
    """Return what asks for the capture of a body that is seen now, with some fields set."""

    def spoil(request: PlanRequest) -> None:
        _of_a_body(1)(request)
        (body,) = request.target_body
        body.header.stamp.sec = 0
        for name, value in fields.items():
            setattr(body, name, value)

    return spoil


def _in_a_year(request: PlanRequest) -> None:
    request.start_time.sec = round(time.time()) + 365 * 86400


def _in_a_hurry(request: PlanRequest) -> None:
    """A metre in a second, nothing in the way."""
    request.duration = 1.0
    request.scene[0].spheres = []


def _too_fast(request: PlanRequest) -> None:
    """And soon, or the joint goes on until it is outside its position limit."""
    request.start_state[0].joint_velocities[2] = 0.6
    request.start_time.sec = int(time.time()) + 5


CASES = {
    "state of an hour ago": Case(
        Status.STATE_TOO_OLD, ("start_state.header.stamp", "state_max_age"), _age(3600.0)
    ),
    "state of the next hour": Case(
        Status.STATE_IN_FUTURE,
        ("start_state.header.stamp", "state_future_tolerance"),
        _age(-3600.0),
    ),
    "a start time long ago": Case(
        Status.START_IN_PAST,
        ("start_time", "s ago", "planning_lead_time"),
        _set("start_time.sec", 12),
    ),
    "a payload without a mass": Case(
        Status.OUT_OF_RANGE,
        ("payload.inertia.m", "greater than 0"),
        _set("payload", [Payload(link="link_7")]),
    ),
    "a start time in a year": Case(
        Status.OUT_OF_RANGE, ("start_time", "s ahead of now", "start_horizon"), _in_a_year
    ),
    "an end behaviour that nobody knows": Case(
        Status.OUT_OF_RANGE,
        ("end_behaviour is 'stop'", "stop_joints"),
        _set("end_behaviour", "stop"),
    ),
    "state in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("start_state.header.frame_id", "'map'", "'inertial'"),
        _set("start_state.0.header.frame_id", "map"),
    ),
    "a scene in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("scene.header.frame_id", "'map'"),
        _set("scene.0.header.frame_id", "map"),
    ),
    "target in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("goal.pose.header.frame_id", "'base'"),
        _set("goal.pose.header.frame_id", "base"),
    ),
    "an unknown joint": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "unknown: elbow", "missing: joint_4"),
        _set("start_state.0.joint_names.3", "elbow"),
    ),
    "a joint twice": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "more than once: joint_1"),
        _set("start_state.0.joint_names.3", "joint_1"),
    ),
    "no joints": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "missing: joint_1"),
        _set("start_state.0.joint_names", []),
    ),
    "too few joint positions": Case(
        Status.WRONG_SIZE,
        ("start_state.joint_positions",),
        _set("start_state.0.joint_positions", []),
    ),
    "too many joint velocities": Case(
        Status.WRONG_SIZE,
        ("start_state.joint_velocities", "7"),
        _set("start_state.0.joint_velocities", [0.0] * 8),
    ),
    "a joint position that is not a number": Case(
        Status.NOT_FINITE,
        ("start_state.joint_positions", "nan"),
        _set("start_state.0.joint_positions.2", NAN),
    ),
    "a chaser position that is not a number": Case(
        Status.NOT_FINITE,
        ("start_state.pose.position", "nan"),
        _set("start_state.0.pose.position.x", NAN),
    ),
    "an infinite chaser velocity": Case(
        Status.NOT_FINITE,
        ("start_state.twist.linear", "inf"),
        _set("start_state.0.twist.linear.z", math.inf),
    ),
    "a chaser attitude of length two": Case(
        Status.BAD_QUATERNION,
        ("start_state.pose.orientation", "norm", "2"),
        _set("start_state.0.pose.orientation.w", 2.0),
    ),
    "a chaser attitude left out": Case(
        Status.BAD_QUATERNION,
        ("start_state.pose.orientation", "norm", "0"),
        _set("start_state.0.pose.orientation.w", 0.0),
    ),
    "a target orientation of length two": Case(
        Status.BAD_QUATERNION,
        ("goal.pose.pose.orientation", "norm"),
        _set("goal.pose.pose.orientation.w", 2.0),
    ),
    "a target position that is not a number": Case(
        Status.NOT_FINITE,
        ("goal.pose.pose.position", "nan"),
        _set("goal.pose.pose.position.y", NAN),
    ),
    "a target twist that is not a number": Case(
        Status.NOT_FINITE, ("goal.twist.angular", "nan"), _set("goal.twist.angular.x", NAN)
    ),
    "a radius of zero": Case(
        Status.OUT_OF_RANGE,
        ("scene.spheres[1].radius", "greater than 0"),
        _set("scene.0.spheres.1.radius", 0.0),
    ),
    "a negative radius": Case(
        Status.OUT_OF_RANGE,
        ("scene.spheres[2].radius", "-0.1"),
        _set("scene.0.spheres.2.radius", -0.1),
    ),
    "a centre that is not a number": Case(
        Status.NOT_FINITE,
        ("scene.spheres[0].center", "nan"),
        _set("scene.0.spheres.0.center.x", NAN),
    ),
    "an obstacle that turns": Case(
        Status.UNSUPPORTED,
        ("scene.spheres[0].twist.angular", "must be zero"),
        _set("scene.0.spheres.0.twist.angular.x", 0.01),
    ),
    "a capture of nothing": Case(
        Status.NO_TARGET_BODY,
        ("target_body is missing", "publish it"),
        _set("goal.kind", Goal.CAPTURE),
    ),
    "a stale target body": Case(
        Status.TARGET_TOO_OLD, ("target_body.header.stamp", "target_max_age"), _of_a_body(1)
    ),
    "a target body of tomorrow": Case(
        Status.TARGET_IN_FUTURE, ("target_body.header.stamp", "ahead of now"), _of_a_body(2**31 - 1)
    ),
    "a target body without inertia": Case(
        Status.OUT_OF_RANGE, ("target_body.inertia", "must be positive"), _of_a_body(0)
    ),
    "an obstacle's twist that is not a number": Case(
        Status.NOT_FINITE,
        ("scene.spheres[0].twist", "nan"),
        _set("scene.0.spheres.0.twist.angular.z", NAN),
    ),
    "no duration": Case(Status.OUT_OF_RANGE, ("duration", "greater than 0"), _set("duration", 0.0)),
    "a negative duration": Case(Status.OUT_OF_RANGE, ("duration", "-10"), _set("duration", -10.0)),
    "a duration that is not a number": Case(
        Status.NOT_FINITE, ("duration", "nan"), _set("duration", NAN)
    ),
    "a duration in nanoseconds": Case(
        Status.OUT_OF_RANGE, ("duration", "2038"), _set("duration", 10e9)
    ),
    "three points": Case(Status.OUT_OF_RANGE, ("search.points is 3",), _set("search.points", 3)),
    "a million points": Case(
        Status.OUT_OF_RANGE, ("search.points",), _set("search.points", 1_000_000)
    ),
    "nothing to minimise": Case(
        Status.OUT_OF_RANGE,
        ("objective is all zero", "one weight must be positive"),
        _set("objective.joint_path_length", 0.0),
    ),
    "a negative weight": Case(
        Status.OUT_OF_RANGE,
        ("objective.chaser_attitude", "-1"),
        _set("objective.chaser_attitude", -1.0),
    ),
    "an arm inside an obstacle": Case(
        Status.START_IN_COLLISION, ("obstacles[c1]",), _set("scene.0.spheres.0.radius", 2.0)
    ),
    "a joint outside its limits": Case(
        Status.START_OUTSIDE_LIMITS, ("joint_2",), _set("start_state.0.joint_positions.1", 4.0)
    ),
    "a joint faster than its limit": Case(
        Status.START_OUTSIDE_LIMITS,
        ("joints.velocity[joint_3] is 0.6", "0.5"),
        _too_fast,
    ),
    "a negative time budget": Case(
        Status.OUT_OF_RANGE, ("search.time_budget is -1", "300 s"), _set("search.time_budget", -1.0)
    ),
    "a time budget that is not a number": Case(
        Status.NOT_FINITE, ("search.time_budget", "nan"), _set("search.time_budget", NAN)
    ),
    "a time budget of a microsecond": Case(
        Status.TIMED_OUT, ("time budget of 1e-06 s is used up",), _set("search.time_budget", 1e-6)
    ),
    "a duration too short for the arm": Case(
        Status.LIMIT_VIOLATED,
        ("moves at", "beyond its limit of 0.5", "a longer duration"),
        _in_a_hurry,
    ),
    "a goal ten metres away": Case(
        Status.GOAL_OUT_OF_REACH,
        ("goal.pose.pose.position is",),
        _set("goal.pose.pose.position.x", 10.0),
    ),
    "a goal of a kind that nobody knows": Case(
        Status.OUT_OF_RANGE, ("goal.kind is 5", "POSE (0), CAPTURE (1)"), _set("goal.kind", 5)
    ),
    "an orientation that nobody knows": Case(
        Status.OUT_OF_RANGE, ("goal.orientation is 3",), _set("goal.orientation", 3)
    ),
    "a limit of zero": Case(
        Status.OUT_OF_RANGE,
        ("limits.chaser_attitude is 0", "greater than 0 rad"),
        _set("limits.chaser_attitude", [0.0]),
    ),
    "momenta of wheels that the chaser has not": Case(
        Status.WRONG_SIZE,
        ("start_state.wheel_momenta is", "it must be empty"),
        _set("start_state.0.wheel_momenta", [0.1]),
    ),
    "what the target body looks like": Case(
        Status.OUT_OF_RANGE, ("target_body.urdf is",), _of_a_body_with(urdf="<robot/>")
    ),
    "a target body with bodies": Case(
        Status.WRONG_SIZE,
        ("target_body.bodies[0].primitive is missing",),
        _of_a_body_with(bodies=[Obstacle()]),
    ),
    "a scene with a body without a shape": Case(
        Status.WRONG_SIZE,
        ("scene.bodies[0].primitive is missing",),
        _set("scene.0.bodies", [Obstacle()]),
    ),
    "a depth of the search that is none": Case(
        Status.OUT_OF_RANGE,
        ("search.depth is 'deep'", "it must be quick, normal or thorough"),
        _set("search.depth", "deep"),
    ),
    "a posture without joints": Case(
        Status.UNKNOWN_JOINT, ("goal.joints.name", "missing"), _set("goal.kind", Goal.JOINTS)
    ),
    "a phase that says nothing": Case(
        Status.WRONG_FRAME, ("then[0].goal.pose.header.frame_id",), _set("then", [Phase()])
    ),
    "a grasp that takes no force": Case(
        Status.OUT_OF_RANGE,
        ("limits.grasp_force", "greater than 0 N"),
        _set("limits.grasp_force", [0.0]),
    ),
}


@dataclass
class Run:
    """What was heard from one planner process, from its start to its end."""

    refusals: dict[str, Any] = field(default_factory=dict)
    solved: Any = None
    own_scene: Any = None  # asked for while bodies were on their topic
    among_bodies: Any = None  # asked for when they were sound
    received: dict[str, list[Any]] = field(default_factory=dict)
    exit_code: int = -1
    bag: dict[str, list[Any]] = field(default_factory=dict)
    replayed: dict[str, Replayed] = field(default_factory=dict)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Ask every question that is refused, then one that is not, then end the node."""
    scene, directory, run = Scene(resting_capture()), tmp_path_factory.mktemp("refusals"), Run()
    with private_domain(), running_planner(directory, *ARGUMENTS) as planner:
        with connected_client() as client:
            client.wait_for_planner()
            run.refusals["no state"] = client.plan(scene.request())
            own_state = scene.complete_request()
            own_state.scene = []
            run.refusals["no obstacles"] = client.plan(own_state)
            for name, case in CASES.items():
                request = scene.complete_request()
                case.spoil(request)
                run.refusals[name] = client.plan(request)

            client.publish_obstacles(SceneMessage(header=scene.obstacles().header))
            old = scene.state(client.now_ns() - 1_000_000_000_000)
            client.publish_and_wait(old)
            run.refusals["published state too old"] = client.plan(scene.request())

            def refusal(state: ChaserState, status: Status) -> PlanAnswer:
                def arrived(answer: PlanAnswer) -> bool:
                    client.publish_state(state)
                    return answer.status.code == status

                return client.plan_until(scene.request(), arrived)

            early = scene.state(client.now_ns() + 1_000_000_000_000)
            run.refusals["published state in the future"] = refusal(early, Status.STATE_IN_FUTURE)
            spoilt = scene.state(client.now_ns())
            spoilt.pose.position.x = NAN
            run.refusals["published state not finite"] = refusal(spoilt, Status.NOT_FINITE)
            foreign = scene.state(client.now_ns())
            foreign.header.frame_id = "map"
            run.refusals["published state in a foreign frame"] = refusal(
                foreign, Status.WRONG_FRAME
            )
            run.solved = refusal(scene.state(client.now_ns()), Status.SOLVED)
            client.wait_until(lambda: client.received["joint_trajectory"], "a trajectory")

            def among(seen: SceneMessage, status: Status) -> PlanAnswer:
                def arrived(answer: PlanAnswer) -> bool:
                    client.publish_state(scene.state(client.now_ns()))
                    return answer.status.code == status

                client.publish_obstacles(seen)
                request = scene.request()
                request.plan_only = True
                return client.plan_until(request, arrived)

            seen = SceneMessage(source="camera", bodies=[Obstacle(id="panel")])
            seen.header.stamp.sec, seen.header.frame_id = 12, FRAME
            run.refusals["a bad scene on its topic"] = among(seen, Status.WRONG_SIZE)
            own_scene = scene.complete_request()
            own_scene.plan_only = True
            run.own_scene = client.plan(own_scene)
            seen.bodies[0].primitive = [SolidPrimitive(type=1, dimensions=[1.0, 2.0, 0.1])]
            seen.bodies[0].pose.position.x = 30.0
            run.among_bodies = among(seen, Status.SOLVED)
        run.received = client.received
        run.exit_code = planner.stop(signal.SIGTERM)
        run.bag = read_bag(planner.bag)
        run.replayed = replays_of(planner.bag)
    return run


@pytest.mark.sampled
@pytest.mark.law("NODE-07")
@pytest.mark.parametrize("name", CASES)
def test_a_request_is_refused_with_its_cause(run: Run, name: str) -> None:
    case, status = CASES[name], run.refusals[name].status
    assert status.code == case.status, status.message
    for word in case.words:
        assert word in status.message


@pytest.mark.parametrize(
    ("name", "status", "words"),
    [
        ("no state", Status.NO_STATE, ("chaser_state", "start_state")),
        ("no obstacles", Status.NO_OBSTACLES, ("obstacles", "publish an empty scene")),
        (
            "published state too old",
            Status.STATE_TOO_OLD,
            ("chaser_state.header.stamp is 10", "s old", "at most 60 s", "state_max_age"),
        ),
        (
            "published state in the future",
            Status.STATE_IN_FUTURE,
            ("chaser_state.header.stamp", "ahead of its arrival", "at most 0.05 s"),
        ),
        ("published state not finite", Status.NOT_FINITE, ("chaser_state.pose.position", "nan")),
        (
            "published state in a foreign frame",
            Status.WRONG_FRAME,
            ("chaser_state.header.frame_id", "'map'"),
        ),
    ],
)
def test_what_is_or_is_not_published_is_refused_with_its_cause(
    run: Run, name: str, status: Status, words: tuple[str, ...]
) -> None:
    answer = run.refusals[name].status
    assert answer.code == status, answer.message
    for word in words:
        assert word in answer.message


def test_a_refusal_is_empty_but_for_its_cause_its_sources_and_the_worth_of_the_best_attempt(
    run: Run,
) -> None:
    attempted = run.refusals["a duration too short for the arm"]
    (metrics,) = attempted.metrics
    assert metrics.min_velocity_margin < 0.0
    assert metrics.joint_path_length > 0.0
    assert metrics.min_torque_margin < math.inf
    assert attempted.solver.rollouts > 0
    assert attempted.solver.solve_time > 0.0
    for name, answer in run.refusals.items():
        empty = PlanAnswer(
            status=answer.status, plan_id=answer.plan_id, task_digest=answer.task_digest
        )
        for told in SOURCES:
            setattr(empty.inputs, told, getattr(answer.inputs, told))
        if answer is attempted:
            empty.metrics, empty.solver = answer.metrics, answer.solver
        assert answer == empty, name
        assert answer.plan_id, name


@pytest.mark.law("NODE-07")
def test_a_refused_value_is_told_to_programs_and_whether_to_ask_again(run: Run) -> None:
    for name, answer in run.refusals.items():
        status = answer.status
        if status.code < Status.GOAL_OUT_OF_REACH:
            assert status.message == f"{status.field} is {status.value}: {status.allowed}", name
            documented = REMEDIES[Status(status.code)].field
            assert status.field == (documented or status.field), name
        else:
            assert status.field == REMEDIES[Status(status.code)].field, name
            assert status.value in status.message, name
    late = run.refusals["a negative duration"].status
    assert (late.field, late.value) == ("duration", "-10.0")
    assert late.allowed.startswith("it must be greater than 0")
    again = {
        "no state": PlanStatus.RETRY_LATER,
        "no obstacles": PlanStatus.RETRY_LATER,
        "a capture of nothing": PlanStatus.RETRY_LATER,
        "published state too old": PlanStatus.RETRY_LATER,
        "published state in the future": PlanStatus.RETRY_LATER,
        "a negative duration": PlanStatus.RETRY_CHANGED,
        "a bad scene on its topic": PlanStatus.RETRY_CHANGED,
        "a goal ten metres away": PlanStatus.RETRY_CHANGED,
        "an arm inside an obstacle": PlanStatus.RETRY_CHANGED,
    }
    assert {name: run.refusals[name].status.retry for name in again} == again
    solved = run.solved.status
    assert (solved.field, solved.value, solved.allowed) == ("", "", "")
    assert solved.retry == PlanStatus.RETRY_NOT_NEEDED


def test_a_bad_scene_is_refused_until_a_good_one_comes_but_not_beside_a_requests_own(
    run: Run,
) -> None:
    refused = run.refusals["a bad scene on its topic"]
    assert refused.status.field == "obstacles.bodies[0].primitive"
    for answer in (run.own_scene, run.among_bodies):
        assert Status(answer.status.code) is Status.SOLVED, answer.status.message
    own, among = run.own_scene.inputs, run.among_bodies.inputs
    assert (own.obstacles_source, own.obstacles_stamp) == ("scene", Time())
    assert (among.obstacles_source, among.obstacles_stamp) == ("camera", Time(sec=12))
    assert run.replayed[run.among_bodies.plan_id].verdict is Verdict.IDENTICAL


def test_every_request_has_an_id_of_its_own(run: Run) -> None:
    ids = [
        answer.plan_id
        for answer in (*run.refusals.values(), run.solved, run.own_scene, run.among_bodies)
    ]
    assert len(set(ids)) == len(ids)


def test_the_node_lives_on_and_answers_a_good_request(run: Run) -> None:
    assert Status(run.solved.status.code) is Status.SOLVED


@pytest.mark.parametrize("name", ["no state", "no obstacles", "a bad scene on its topic", *CASES])
def test_a_refusal_comes_again_from_the_bag_where_its_task_was_complete(
    run: Run, name: str
) -> None:
    refusal = run.refusals[name]
    found = run.replayed[refusal.plan_id]
    if not refusal.task_digest:
        assert found.verdict is Verdict.NOT_PLANNED
    else:
        assert found.verdict is Verdict.IDENTICAL, (found.words, *map(str, found.differences))


def test_what_is_planned_beside_bodies_comes_again_from_the_bag(run: Run) -> None:
    for answer in (run.own_scene, run.among_bodies):
        found = run.replayed[answer.plan_id]
        assert found.verdict is Verdict.IDENTICAL, (found.words, *map(str, found.differences))


@pytest.mark.law("NODE-02")
def test_nothing_is_published_for_a_refusal(run: Run) -> None:
    # The first and only plan that anybody heard of is the one of the good request.
    for topic in ("joint_trajectory", "predicted_chaser_path"):
        assert len(run.bag[f"/{topic}"]) == 1
    (received,) = run.received["joint_trajectory"]
    assert received.header == run.solved.plans[0].joint_trajectory.header
    assert run.bag["/predicted_chaser_pose"] == []  # it starts when all is over


@pytest.mark.law("BAG-01")
def test_every_refusal_is_in_the_bag_with_its_request(run: Run) -> None:
    answered = {one.plan_id: one for one in run.bag["/exchanges"] if one.event == "answered"}
    for name, answer in run.refusals.items():
        recorded = answered[answer.plan_id].answer[0].status
        for said in SAID:
            assert getattr(recorded, said) == getattr(answer.status, said), name
    (request,) = answered[run.refusals["an obstacle that turns"].plan_id].request
    assert request.scene[0].spheres[0].twist.angular.x == 0.01


def test_the_node_ends_with_exit_code_zero_on_sigterm(run: Run) -> None:
    assert run.exit_code == 0
