"""Every request that cannot be planned, through the real service: code, cause, and no harm."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from ff_planner_msgs.srv import PlanTrajectory
from quick_capture import resting_capture
from ros_processes import (
    EVENT_TOPIC,
    FRAME,
    REQUEST_RECEIVED,
    RESPONSE_SENT,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import Status
from ff_planner_ros.runs.recorded_run import recorded_run
from ff_planner_ros.runs.replay import Replayed, Verdict, replay

pytestmark = pytest.mark.ci

NAN = float("nan")
# What an answer was made from is told, refusals included.
SOURCES = (
    *("taken_up", "state_stamp", "state_source", "joint_states_stamp"),
    *("obstacles_stamp", "obstacles_source", "following", "task_digest"),
    *("target_body_stamp", "target_body_source", "geometry"),
)
ARGUMENTS = (
    *("-p", "state_max_age:=60.0", "-p", "planning_allowance:=60.0"),
    *("-p", "planner.starts:=4", "-p", "time_budget:=300.0"),
)


@dataclass(frozen=True)
class Case:
    """A request that is complete and can be solved but for one fault."""

    status: Status
    words: tuple[str, ...]
    spoil: Callable[[PlanTrajectory.Request], None]


def _set(path: str, value: Any) -> Callable[[PlanTrajectory.Request], None]:
    """Return what sets a field, given by its dotted path in the request."""
    *owners, name = path.split(".")

    def spoil(request: PlanTrajectory.Request) -> None:
        owner = request
        for step in owners:
            owner = owner[int(step)] if step.isdigit() else getattr(owner, step)
        if name.isdigit():
            owner[int(name)] = value
        else:
            setattr(owner, name, value)

    return spoil


def _age(seconds: float) -> Callable[[PlanTrajectory.Request], None]:
    """Return what makes the start state this much older, from a stamp of now."""

    def spoil(request: PlanTrajectory.Request) -> None:
        request.start_state.header.stamp.sec = round(time.time() - seconds)

    return spoil


def _of_a_body(sec: int) -> Callable[[PlanTrajectory.Request], None]:
    """Return what asks for the capture of a body without inertia, stamped so [s]; zero: now."""

    def spoil(request: PlanTrajectory.Request) -> None:
        request.capture = request.use_target_body = True
        request.target_body.header.frame_id = FRAME
        request.target_body.header.stamp.sec = sec
        if sec:
            inertia = request.target_body.inertia
            inertia.ixx = inertia.iyy = inertia.izz = 1.0

    return spoil


def _in_a_year(request: PlanTrajectory.Request) -> None:
    request.start_time.sec = round(time.time()) + 365 * 86400


def _in_a_hurry(request: PlanTrajectory.Request) -> None:
    """A metre in a second, nothing in the way."""
    request.duration = 1.0
    request.obstacles.spheres = []


def _too_fast(request: PlanTrajectory.Request) -> None:
    """And soon, or the joint goes on until it is outside its position limit."""
    request.start_state.joint_velocities[2] = 0.6
    request.start_time.sec = int(time.time()) + 5


CASES = {
    "state of an hour ago": Case(
        Status.STATE_TOO_OLD, ("start_state.header.stamp", "state_max_age"), _age(3600.0)
    ),
    "state of the next hour": Case(
        Status.STATE_IN_FUTURE, ("start_state.header.stamp", "state_max_lead"), _age(-3600.0)
    ),
    "a start time long ago": Case(
        Status.START_IN_PAST,
        ("start_time", "s ago", "planning_allowance"),
        _set("start_time.sec", 12),
    ),
    "a start time in a year": Case(
        Status.OUT_OF_RANGE, ("start_time", "s ahead of now", "start_max_lead"), _in_a_year
    ),
    "an end behaviour that nobody knows": Case(
        Status.OUT_OF_RANGE,
        ("end_behaviour is 'stop'", "stop_joints"),
        _set("end_behaviour", "stop"),
    ),
    "state in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("start_state.header.frame_id", "'map'", "'inertial'"),
        _set("start_state.header.frame_id", "map"),
    ),
    "obstacles in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("obstacles.header.frame_id", "'map'"),
        _set("obstacles.header.frame_id", "map"),
    ),
    "target in a foreign frame": Case(
        Status.WRONG_FRAME,
        ("target_pose.header.frame_id", "'base'"),
        _set("target_pose.header.frame_id", "base"),
    ),
    "an unknown joint": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "unknown: elbow", "missing: joint_4"),
        _set("start_state.joint_names.3", "elbow"),
    ),
    "a joint twice": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "more than once: joint_1"),
        _set("start_state.joint_names.3", "joint_1"),
    ),
    "no joints": Case(
        Status.UNKNOWN_JOINT,
        ("start_state.joint_names", "missing: joint_1"),
        _set("start_state.joint_names", []),
    ),
    "too few joint positions": Case(
        Status.WRONG_SIZE, ("start_state.joint_positions",), _set("start_state.joint_positions", [])
    ),
    "too many joint velocities": Case(
        Status.WRONG_SIZE,
        ("start_state.joint_velocities", "7"),
        _set("start_state.joint_velocities", [0.0] * 8),
    ),
    "a joint position that is not a number": Case(
        Status.NOT_FINITE,
        ("start_state.joint_positions", "nan"),
        _set("start_state.joint_positions.2", NAN),
    ),
    "a chaser position that is not a number": Case(
        Status.NOT_FINITE,
        ("start_state.pose.position", "nan"),
        _set("start_state.pose.position.x", NAN),
    ),
    "an infinite chaser velocity": Case(
        Status.NOT_FINITE,
        ("start_state.twist.linear", "inf"),
        _set("start_state.twist.linear.z", math.inf),
    ),
    "a chaser attitude of length two": Case(
        Status.BAD_QUATERNION,
        ("start_state.pose.orientation", "norm", "2"),
        _set("start_state.pose.orientation.w", 2.0),
    ),
    "a chaser attitude left out": Case(
        Status.BAD_QUATERNION,
        ("start_state.pose.orientation", "norm", "0"),
        _set("start_state.pose.orientation.w", 0.0),
    ),
    "a target orientation of length two": Case(
        Status.BAD_QUATERNION,
        ("target_pose.pose.orientation", "norm"),
        _set("target_pose.pose.orientation.w", 2.0),
    ),
    "a target position that is not a number": Case(
        Status.NOT_FINITE,
        ("target_pose.pose.position", "nan"),
        _set("target_pose.pose.position.y", NAN),
    ),
    "a target twist that is not a number": Case(
        Status.NOT_FINITE, ("target_twist.angular", "nan"), _set("target_twist.angular.x", NAN)
    ),
    "a radius of zero": Case(
        Status.OUT_OF_RANGE,
        ("obstacles.spheres[1].radius", "greater than 0"),
        _set("obstacles.spheres.1.radius", 0.0),
    ),
    "a negative radius": Case(
        Status.OUT_OF_RANGE,
        ("obstacles.spheres[2].radius", "-0.1"),
        _set("obstacles.spheres.2.radius", -0.1),
    ),
    "a centre that is not a number": Case(
        Status.NOT_FINITE,
        ("obstacles.spheres[0].center", "nan"),
        _set("obstacles.spheres.0.center.x", NAN),
    ),
    "an obstacle that turns": Case(
        Status.UNSUPPORTED,
        ("obstacles.spheres[0].twist.angular", "must be zero"),
        _set("obstacles.spheres.0.twist.angular.x", 0.01),
    ),
    "a capture of nothing": Case(
        Status.NO_TARGET_BODY, ("target_body is missing", "publish it"), _set("capture", True)
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
        ("obstacles.spheres[0].twist", "nan"),
        _set("obstacles.spheres.0.twist.angular.z", NAN),
    ),
    "no duration": Case(Status.OUT_OF_RANGE, ("duration", "greater than 0"), _set("duration", 0.0)),
    "a negative duration": Case(Status.OUT_OF_RANGE, ("duration", "-10"), _set("duration", -10.0)),
    "a duration that is not a number": Case(
        Status.NOT_FINITE, ("duration", "nan"), _set("duration", NAN)
    ),
    "a duration in nanoseconds": Case(
        Status.OUT_OF_RANGE, ("duration", "2038"), _set("duration", 10e9)
    ),
    "three points": Case(Status.OUT_OF_RANGE, ("points is 3",), _set("points", 3)),
    "a million points": Case(Status.OUT_OF_RANGE, ("points",), _set("points", 1_000_000)),
    "nothing to minimise": Case(
        Status.OUT_OF_RANGE,
        ("weight_joint_path_length, weight_chaser_attitude and weight_duration", "zero"),
        _set("weight_joint_path_length", 0.0),
    ),
    "a negative weight": Case(
        Status.OUT_OF_RANGE,
        ("weight_chaser_attitude", "-1"),
        _set("weight_chaser_attitude", -1.0),
    ),
    "an arm inside an obstacle": Case(
        Status.START_IN_COLLISION, ("obstacles[c1]",), _set("obstacles.spheres.0.radius", 2.0)
    ),
    "a joint outside its limits": Case(
        Status.START_OUTSIDE_LIMITS, ("joint_2",), _set("start_state.joint_positions.1", 4.0)
    ),
    "a joint faster than its limit": Case(
        Status.START_OUTSIDE_LIMITS,
        ("joints.velocity[joint_3] is 0.6", "0.5"),
        _too_fast,
    ),
    "a negative time budget": Case(
        Status.OUT_OF_RANGE, ("time_budget is -1", "300 s"), _set("time_budget", -1.0)
    ),
    "a time budget that is not a number": Case(
        Status.NOT_FINITE, ("time_budget", "nan"), _set("time_budget", NAN)
    ),
    "a time budget of a microsecond": Case(
        Status.TIMED_OUT, ("time budget of 1e-06 s is used up",), _set("time_budget", 1e-6)
    ),
    "a duration too short for the arm": Case(
        Status.LIMIT_VIOLATED,
        ("turns at", "faster than its limit of 0.5", "a longer duration"),
        _in_a_hurry,
    ),
    "a goal ten metres away": Case(
        Status.GOAL_OUT_OF_REACH, ("target",), _set("target_pose.pose.position.x", 10.0)
    ),
}


@dataclass
class Run:
    """What was heard from one planner process, from its start to its end."""

    refusals: dict[str, Any] = field(default_factory=dict)
    solved: Any = None
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
            own_state.use_obstacles = False
            run.refusals["no obstacles"] = client.plan(own_state)
            for name, case in CASES.items():
                request = scene.complete_request()
                case.spoil(request)
                run.refusals[name] = client.plan(request)

            client.publish_obstacles(ObstacleSphereArray(header=scene.obstacles().header))
            old = scene.state(client.now_ns() - 1_000_000_000_000)
            client.publish_and_wait(old)
            run.refusals["published state too old"] = client.plan(scene.request())

            def refusal(state: ChaserState, status: Status) -> PlanTrajectory.Response:
                def arrived(response: PlanTrajectory.Response) -> bool:
                    client.publish_state(state)
                    return response.status.code == status

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
        run.received = client.received
        run.exit_code = planner.stop(signal.SIGTERM)
        run.bag = read_bag(planner.bag)
        with open_bag(planner.bag) as bag:
            run.replayed = {one.name: replay(one) for one in recorded_run(bag).requests}
    return run


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
        ("no obstacles", Status.NO_OBSTACLES, ("obstacles", "publish an empty array")),
        (
            "published state too old",
            Status.STATE_TOO_OLD,
            ("chaser_state.header.stamp is 10", "s old", "at most 60 s", "state_max_age"),
        ),
        (
            "published state in the future",
            Status.STATE_IN_FUTURE,
            ("chaser_state.header.stamp", "ahead of now", "at most 0.05 s"),
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
    assert attempted.metrics.min_velocity_margin < 0.0
    assert attempted.metrics.joint_path_length > 0.0
    assert attempted.solver.rollouts > 0
    assert attempted.solver.solve_time > 0.0
    assert attempted.duration > 0.0
    assert attempted.metrics.min_torque_margin < math.inf
    for name, answer in run.refusals.items():
        empty = PlanTrajectory.Response(status=answer.status, plan_id=answer.plan_id)
        for told in SOURCES:
            setattr(empty, told, getattr(answer, told))
        if answer is attempted:
            empty.metrics, empty.solver = answer.metrics, answer.solver
            empty.duration = answer.duration
        assert answer == empty, name
        assert answer.plan_id, name


def test_every_request_has_an_id_of_its_own(run: Run) -> None:
    ids = [answer.plan_id for answer in (*run.refusals.values(), run.solved)]
    assert len(set(ids)) == len(ids)


def test_the_node_lives_on_and_answers_a_good_request(run: Run) -> None:
    assert Status(run.solved.status.code) is Status.SOLVED


@pytest.mark.parametrize("name", ["no state", "no obstacles", *CASES])
def test_a_refusal_comes_again_from_the_bag_in_the_same_words(run: Run, name: str) -> None:
    found, refusal = run.replayed[run.refusals[name].plan_id], run.refusals[name].status
    assert found.answer is not None
    if refusal.code == Status.TIMED_OUT:
        assert (found.verdict, found.answer.status.code) == (Verdict.WITHOUT_CLOCK, Status.SOLVED)
    else:
        assert found.verdict is Verdict.IDENTICAL, (found.words, *map(str, found.differences))
        assert found.answer.status == refusal


def test_nothing_is_published_for_a_refusal(run: Run) -> None:
    # The first and only plan that anybody heard of is the one of the good request.
    for topic in ("joint_trajectory", "predicted_chaser_path"):
        assert len(run.bag[f"/{topic}"]) == 1
    (received,) = run.received["joint_trajectory"]
    assert received.header == run.solved.joint_trajectory.header
    assert run.bag["/predicted_chaser_pose"] == []  # it starts when all is over


def test_every_refusal_is_in_the_bag_with_its_request(run: Run) -> None:
    events = run.bag[EVENT_TOPIC]
    asked = {
        (bytes(event.info.client_gid), event.info.sequence_number): event.request[0]
        for event in events
        if event.info.event_type == REQUEST_RECEIVED
    }
    answered = {
        event.response[0].plan_id: event
        for event in events
        if event.info.event_type == RESPONSE_SENT
    }
    for name, answer in run.refusals.items():
        event = answered[answer.plan_id]
        recorded = event.response[0].status
        assert (recorded.code, recorded.message) == (answer.status.code, answer.status.message), (
            name
        )
        assert (bytes(event.info.client_gid), event.info.sequence_number) in asked, name
    moving = answered[run.refusals["an obstacle that turns"].plan_id].info
    request = asked[bytes(moving.client_gid), moving.sequence_number]
    assert request.obstacles.spheres[0].twist.angular.x == 0.01


def test_the_node_ends_with_exit_code_zero_on_sigterm(run: Run) -> None:
    assert run.exit_code == 0
