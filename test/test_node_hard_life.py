"""What a mission does to the planner node in the worst of its days, in real processes."""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from doomed_client import POINTS
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import (
    Approach,
    PlanAnswer,
    PlanRequest,
    PlanStatus,
)
from geometry_msgs.msg import Vector3
from managed_node import Holdings, holdings
from quick_capture import quick_capture, resting_capture
from ros_processes import (
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.scenario.scenario import load_scenario

SEED = 20260102
NO_NUMBERS = (float("nan"), float("inf"), float("-inf"))
HUGE = 3_000
# What a process may grow by, once it has seen everything [kB]. ROS's queues and the allocator take
# a few thousand; before each refusal let go of its request, huge ones took 15 000 and more.
GROWTH = 12_000
FEW = 8


Spoil = Callable[[random.Random, PlanRequest], str]


def _at(request: PlanRequest, path: str) -> Any:
    """Return what is at a dotted path, in which numbers are those of entries."""
    owner: Any = request
    for step in filter(None, path.split(".")):
        owner = owner[int(step)] if step.isdigit() else getattr(owner, step)
    return owner


def _named(path: str) -> str:
    """Return what an error calls a path: of what may be absent it does not say which entry."""
    return (
        path.replace("scene.0", "scene")
        .replace("start_state.0", "start_state")
        .replace("spheres.0", "spheres[0]")
    )


def _number(path: str, attribute: str, allowed_sign: int = 0) -> Spoil:
    """Spoil a number; where a sign is given, the other sign is wrong, too."""

    def spoil(dice: random.Random, request: PlanRequest) -> str:
        wrong = [*NO_NUMBERS, *((-dice.random(),) if allowed_sign else ())]
        setattr(_at(request, path), attribute, dice.choice(wrong))
        return _named(path if attribute in "xyz" else f"{path}.{attribute}".removeprefix("."))

    return spoil


def _quaternion(pose: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanRequest) -> str:
        orientation = _at(request, pose).orientation
        factor = dice.choice([0.0, 1.01, 0.9, 1e6, -2.0])
        for axis in "xyzw":
            setattr(orientation, axis, factor * getattr(orientation, axis))
        return _named(f"{pose}.orientation")

    return spoil


def _array(attribute: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanRequest) -> str:
        (state,) = request.start_state
        values = list(getattr(state, attribute))
        wrong = [
            *([], values[:-1], [*values, values[0]], values * HUGE),
            *(
                [[dice.choice(NO_NUMBERS), *values[1:]]]
                if attribute != "joint_names"
                else [["", *values[1:]]]
            ),
        ]
        setattr(state, attribute, dice.choice(wrong))
        return f"start_state.{attribute}"

    return spoil


def _frame(path: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanRequest) -> str:
        header = _at(request, path).header
        header.frame_id = dice.choice(["", "map", "Inertial", "inertial ", "x" * HUGE])
        return _named(f"{path}.header.frame_id")

    return spoil


def _twice(dice: random.Random, request: PlanRequest) -> str:
    (scene,) = request.scene
    scene.spheres.append(deepcopy(dice.choice(scene.spheres)))
    return "scene.spheres"


def _points(dice: random.Random, request: PlanRequest) -> str:
    request.search.points = dice.choice([1, 4, 10_001, 2**32 - 1])
    return "search.points"


def _word(dice: random.Random, request: PlanRequest) -> str:
    field = dice.choice(["end_behaviour", "on_cancel"])
    setattr(request, field, dice.choice(["stop", " ", "NONE", "z" * HUGE]))
    return field


def _goal(dice: random.Random, request: PlanRequest) -> str:
    field, known = dice.choice([("kind", 2), ("orientation", 3)])
    setattr(request.goal, field, dice.randrange(known, 256))
    return f"goal.{field}"


def _approach(dice: random.Random, request: PlanRequest) -> str:
    direction = Vector3(z=dice.choice(NO_NUMBERS))
    request.goal.approach = [Approach(direction=direction, distance=0.05)]
    return "goal.approach.direction"


def _accelerations(dice: random.Random, request: PlanRequest) -> str:
    wrong = [[number] for number in (*NO_NUMBERS, 0.0, -dice.random())]
    request.limits.accelerations = dice.choice([*wrong, [0.1, 0.2], [0.1] * HUGE])
    return "limits.accelerations"


def _angle(dice: random.Random, request: PlanRequest) -> str:
    field = dice.choice(["chaser_attitude", "chaser_rotation"])
    setattr(request.limits, field, [dice.choice([NO_NUMBERS[0], 0.0, -dice.random()])])
    return f"limits.{field}"


def _wheels(dice: random.Random, request: PlanRequest) -> str:
    request.start_state[0].wheel_momenta = [dice.random()] * dice.choice([1, 4, HUGE])
    return "start_state.wheel_momenta"


SPOILS: tuple[Spoil, ...] = (
    *(_number("goal.pose.pose.position", axis) for axis in "xyz"),
    *(_number("goal.twist.angular", axis) for axis in "xyz"),
    *(_number("start_state.0.pose.position", axis) for axis in "xyz"),
    *(_number("start_state.0.twist.linear", axis) for axis in "xyz"),
    *(_number("scene.0.spheres.0.center", axis) for axis in "xyz"),
    _number("scene.0.spheres.0", "radius", 1),
    _number("scene.0.spheres.0.twist.linear", "x"),
    *(
        _number(path, name, 1)
        for path, name in (
            ("", "duration"),
            ("", "duration_max"),
            ("objective", "joint_path_length"),
            ("objective", "chaser_attitude"),
            ("objective", "duration"),
            ("search", "time_budget"),
        )
    ),
    *(_quaternion(pose) for pose in ("goal.pose.pose", "start_state.0.pose")),
    *(_array(name) for name in ("joint_names", "joint_positions", "joint_velocities")),
    *(_frame(path) for path in ("goal.pose", "start_state.0", "scene.0")),
    *(_twice, _points, _word, _goal, _approach, _accelerations, _angle, _wheels),
)


@pytest.mark.nightly
@pytest.mark.law("NODE-16")
def test_huge_arrays_leave_nothing_behind(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    """Each is 20 000 names: 100 of them are of 33 MB, if anybody keeps them.

    A thread of a pool that begins late takes memory once; what is kept grows with every hundred.
    """
    request = Scene(resting_capture()).complete_request()
    (state,) = request.start_state
    state.joint_names = [*state.joint_names] * HUGE
    with connected_client() as client:
        client.wait_for_planner()

        def after(requests: int) -> Holdings:
            for _ in range(requests):
                assert client.plan(request).status.code == Status.UNKNOWN_JOINT
            return holdings(planner.process.pid)

        warm = after(times(20, 300))
        last = after(100)
        for _ in range(2):
            if last.memory - warm.memory > GROWTH:
                warm, last = last, after(100)
    _assert_no_growth(warm, last)


@pytest.mark.law("NODE-16")
def test_malformed_requests_are_refused_by_name_and_leave_nothing_behind(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    scene, dice, malformed = Scene(resting_capture()), random.Random(SEED), times(100, 300)
    with connected_client() as client:
        client.wait_for_planner()
        assert client.plan(scene.complete_request()).status.code == Status.SOLVED
        halfway = holdings(planner.process.pid)
        for number in range(malformed):
            request = scene.complete_request()
            field = dice.choice(SPOILS)(dice, request)
            answer = client.plan(request)
            status = Status(answer.status.code)
            assert Status.NOT_FINITE <= status <= Status.UNSUPPORTED, (field, answer.status)
            assert field in answer.status.message, answer.status
            assert answer.status.field.startswith(field), answer.status
            assert (answer.status.retry, answer.plans) == (PlanStatus.RETRY_CHANGED, [])
            if number == malformed // 2:
                halfway = holdings(planner.process.pid)
        _assert_no_growth(halfway, holdings(planner.process.pid))
        assert client.plan(scene.complete_request()).status.code == Status.SOLVED


@pytest.mark.law("NODE-16")
@pytest.mark.usefixtures("planner")
def test_malformed_messages_on_the_topics_are_refused_by_name(
    times: Callable[[int, int], int],
) -> None:
    scene, dice = Scene(resting_capture()), random.Random(SEED)
    each = times(8, 30)
    with connected_client() as client:
        client.wait_for_planner()
        for _ in range(each):
            request = scene.complete_request()
            request.start_state[0].header.stamp = client.node.get_clock().now().to_msg()
            spoil = dice.choice([_array("joint_positions"), _frame("start_state.0"), _wheels])
            field = spoil(dice, request).replace("start_state", "chaser_state")
            _refused(client, scene.request(), request, field)
        for _ in range(each):
            request = scene.complete_request()
            request.start_state[0].header.stamp = client.node.get_clock().now().to_msg()
            field = dice.choice([_twice, _frame("scene.0")])(dice, request)
            _refused(client, scene.request(), request, field.replace("scene", "obstacles"))
        sound = scene.state(client.now_ns())
        client.publish_obstacles(scene.obstacles())

        def solved(answer: PlanAnswer) -> bool:
            client.publish_state(sound)
            return answer.status.code == Status.SOLVED

        client.plan_until(scene.request(), solved)


def _refused(
    client: Client,
    request: PlanRequest,
    spoilt: PlanRequest,
    field: str,
) -> None:
    """Publish a request's state and scene until the planner names their fault in its refusal."""
    (state,), (scene,) = spoilt.start_state, spoilt.scene
    client.publish_obstacles(scene)

    def named(answer: PlanAnswer) -> bool:
        client.publish_state(state)
        return field in answer.status.message

    client.plan_until(request, named)


@contextmanager
def running(script: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a script of this directory, and kill it in the end."""
    process = subprocess.Popen([sys.executable, str(Path(__file__).parent / script), *arguments])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _later(client: Client, request: PlanRequest) -> PlanRequest:
    """Let a plan begin when the busiest machine has it ready."""
    request.start_time = client.node.get_clock().now().to_msg()
    request.start_time.sec += 120
    return request


@pytest.mark.ci
def test_a_flood_of_states_and_spheres_starves_no_plan(planner: PlannerProcess) -> None:
    """What floods is a process of its own, and keeps its rate whatever the planner does."""
    scene = Scene(resting_capture())
    with connected_client() as client, running("flood.py"):
        client.wait_for_planner()

        def crowded(answer: PlanAnswer) -> bool:
            return answer.status.code == Status.SOLVED

        client.plan_until(_later(client, scene.request()), crowded)
        for _ in range(5):
            answer = client.plan(_later(client, scene.request()))
            assert answer.status.code == Status.SOLVED, answer.status
    assert "a callback failed" not in planner.log


@pytest.mark.parametrize("door", ["service", pytest.param("action", marks=pytest.mark.ci)])
def test_a_client_that_dies_while_it_is_planned_for_harms_nobody_and_its_plan_goes_out(
    planner: PlannerProcess, door: str
) -> None:
    """Nobody can tell a dead client from a silent one; an executive that is back finds its plan."""
    scene = Scene(resting_capture())
    probe = PlanRequest(duration=-1.0)
    with connected_client() as client:
        client.wait_for_planner()

        def is_out() -> bool:
            return any(len(one.points) == POINTS for one in client.received["joint_trajectory"])

        feedback = client.hear(
            PlanTrajectory.Impl.FeedbackMessage, "plan_trajectory_action/_action/feedback"
        )
        with running("doomed_client.py", door) as doomed:
            client.plan_until(probe, lambda answer: answer.status.code == Status.BUSY)
            if door == "action":
                # It is busy before its client has heard of it, and withdrawn if nobody hears.
                client.wait_until(lambda: feedback or is_out(), "the search for the goal")
            doomed.kill()
            doomed.wait()
        client.wait_until(is_out, "the dead client's plan")
        answer = client.plan_until(
            _later(client, scene.complete_request()),
            lambda answer: answer.status.code != Status.BUSY,
        )
        assert answer.status.code == Status.SOLVED, answer.status
    assert "a callback failed" not in planner.log


@pytest.mark.nightly
def test_many_plans_leave_nothing_behind_and_the_node_ends_well(
    tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    """It is the node that is tested: the straight way to a goal nearby will do."""
    scene, plans = Scene(load_scenario(quick_capture(tmp_path))), times(40, 500)
    # The chaser drifts away.
    straight = ("-p", "planner.max_iterations:=1", "-p", "planning_lead_time:=5.0")
    with private_domain(), running_planner(tmp_path, *straight) as planner:
        with connected_client() as client:
            client.wait_for_planner()
            request, seconds = scene.complete_request(), []
            request.search.points = 12
            for number in range(plans):
                answer = client.plan(request)
                assert answer.status.code == Status.SOLVED, answer.status
                seconds.append(answer.solver.solve_time)
                if number == plans // 3:
                    warm = holdings(planner.process.pid)
        _assert_no_growth(warm, holdings(planner.process.pid))
        assert planner.stop() == 0
    # A clock is no judge of a test; what it says is for the reader of the log.
    half = plans // 2
    print(f"median of the first half of the plans {median(seconds[:half]):.3f} s")
    print(f"median of the second half of the plans {median(seconds[half:]):.3f} s")


def _assert_no_growth(warm: Holdings, last: Holdings) -> None:
    assert last.memory - warm.memory <= GROWTH, (warm, last)
    # Threads of pools begin when they are needed, descriptors come and go: few, not one a plan.
    assert last.files - warm.files <= FEW, (warm, last)
    assert last.threads - warm.threads <= FEW, (warm, last)
