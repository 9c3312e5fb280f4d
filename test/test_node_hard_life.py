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

import pytest
from doomed_client import POINTS
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from ff_planner_msgs.srv import PlanTrajectory
from managed_node import Holdings, Manager, holdings
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
from ff_planner_ros.planning.scenario import load_scenario

SEED = 20260102
NO_NUMBERS = (float("nan"), float("inf"), float("-inf"))
HUGE = 3_000
# What a process may grow by, once it has seen everything [kB]. ROS's queues and the allocator take
# a few thousand; before each refusal let go of its request, huge ones took 15 000 and more.
GROWTH = 12_000
FEW = 8


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = ("-p", "planning_allowance:=60.0", "-p", "state_max_age:=3600.0")
    directory = tmp_path_factory.mktemp("hard_life")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


Spoil = Callable[[random.Random, PlanTrajectory.Request], str]


def _number(path: str, attribute: str, allowed_sign: int = 0) -> Spoil:
    """Spoil a number; where a sign is given, zero and the other sign are wrong, too."""

    def spoil(dice: random.Random, request: PlanTrajectory.Request) -> str:
        owner = request
        for step in filter(None, path.split(".")):
            owner = owner[0] if step == "0" else getattr(owner, step)
        wrong = [*NO_NUMBERS, *((-dice.random(),) if allowed_sign else ())]
        setattr(owner, attribute, dice.choice(wrong))
        return path.split(".")[0] or attribute

    return spoil


def _quaternion(pose: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanTrajectory.Request) -> str:
        owner = request
        for step in pose.split("."):
            owner = getattr(owner, step)
        factor = dice.choice([0.0, 1.01, 0.9, 1e6, -2.0])
        for axis in "xyzw":
            setattr(owner.orientation, axis, factor * getattr(owner.orientation, axis))
        return pose.split(".")[0]

    return spoil


def _array(attribute: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanTrajectory.Request) -> str:
        values = list(getattr(request.start_state, attribute))
        wrong = [
            *([], values[:-1], [*values, values[0]], values * HUGE),
            *(
                [[dice.choice(NO_NUMBERS), *values[1:]]]
                if attribute != "joint_names"
                else [["", *values[1:]]]
            ),
        ]
        setattr(request.start_state, attribute, dice.choice(wrong))
        return f"start_state.{attribute}"

    return spoil


def _frame(path: str) -> Spoil:
    def spoil(dice: random.Random, request: PlanTrajectory.Request) -> str:
        header = getattr(request, path).header
        header.frame_id = dice.choice(["", "map", "Inertial", "inertial ", "x" * HUGE])
        return f"{path}.header.frame_id"

    return spoil


def _twice(dice: random.Random, request: PlanTrajectory.Request) -> str:
    request.obstacles.spheres.append(deepcopy(dice.choice(request.obstacles.spheres)))
    return "obstacles.spheres"


def _points(dice: random.Random, request: PlanTrajectory.Request) -> str:
    request.points = dice.choice([1, 4, 10_001, 2**32 - 1])
    return "points"


def _word(dice: random.Random, request: PlanTrajectory.Request) -> str:
    request.end_behaviour = dice.choice(["stop", " ", "AS_PLANNED", "z" * HUGE])
    return "end_behaviour"


def _accelerations(dice: random.Random, request: PlanTrajectory.Request) -> str:
    wrong = [[number] for number in (*NO_NUMBERS, 0.0, -dice.random())]
    request.limit_accelerations = dice.choice([*wrong, [0.1, 0.2], [0.1] * HUGE])
    return "limit_accelerations"


SPOILS: tuple[Spoil, ...] = (
    *(_number("target_pose.pose.position", axis) for axis in "xyz"),
    *(_number("target_twist.angular", axis) for axis in "xyz"),
    *(_number("start_state.pose.position", axis) for axis in "xyz"),
    *(_number("start_state.twist.linear", axis) for axis in "xyz"),
    *(_number("obstacles.spheres.0.center", axis) for axis in "xyz"),
    _number("obstacles.spheres.0", "radius", 1),
    _number("obstacles.spheres.0.twist.linear", "x"),
    _number("approach_direction", "z"),
    *(
        _number("", name, 1)
        for name in (
            "duration",
            "duration_max",
            "weight_joint_path_length",
            "weight_chaser_attitude",
            "weight_duration",
            "time_budget",
        )
    ),
    *(_quaternion(pose) for pose in ("target_pose.pose", "start_state.pose")),
    *(_array(name) for name in ("joint_names", "joint_positions", "joint_velocities")),
    *(_frame(path) for path in ("target_pose", "start_state", "obstacles")),
    *(_twice, _points, _word, _accelerations),
)


@pytest.mark.ci
def test_huge_arrays_leave_nothing_behind(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    """Each is 20 000 names: 100 of them are of 33 MB, if anybody keeps them.

    A thread of a pool that begins late takes memory once; what is kept grows with every hundred.
    """
    request = Scene(resting_capture()).complete_request()
    request.start_state.joint_names = [*request.start_state.joint_names] * HUGE
    with connected_client() as client:
        client.wait_for_planner()

        def after(requests: int) -> Holdings:
            for _ in range(requests):
                assert client.plan(request).status.code == Status.UNKNOWN_JOINT
            return holdings(planner.process.pid)

        warm = after(times(50, 300))
        last = after(100)
        for _ in range(2):
            if last.memory - warm.memory > GROWTH:
                warm, last = last, after(100)
    _assert_no_growth(warm, last)


def test_malformed_requests_are_refused_by_name_and_leave_nothing_behind(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    scene, dice, malformed = Scene(resting_capture()), random.Random(SEED), times(200, 300)
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
            assert not answer.joint_trajectory.points
            if number == malformed // 2:
                halfway = holdings(planner.process.pid)
        _assert_no_growth(halfway, holdings(planner.process.pid))
        assert client.plan(scene.complete_request()).status.code == Status.SOLVED


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
            request.start_state.header.stamp = client.node.get_clock().now().to_msg()
            spoil = dice.choice([_array("joint_positions"), _frame("start_state")])
            field = spoil(dice, request).replace("start_state", "chaser_state")
            _refused(client, scene.request(), request.start_state, request.obstacles, field)
        for _ in range(each):
            request = scene.complete_request()
            request.start_state.header.stamp = client.node.get_clock().now().to_msg()
            field = dice.choice([_twice, _frame("obstacles")])(dice, request)
            _refused(client, scene.request(), request.start_state, request.obstacles, field)
        sound = scene.state(client.now_ns())
        client.publish_obstacles(scene.obstacles())

        def solved(response: PlanTrajectory.Response) -> bool:
            client.publish_state(sound)
            return response.status.code == Status.SOLVED

        client.plan_until(scene.request(), solved)


def _refused(
    client: Client,
    request: PlanTrajectory.Request,
    state: ChaserState,
    obstacles: ObstacleSphereArray,
    field: str,
) -> None:
    """Publish until the planner refuses to plan from or around it, and names the field."""
    client.publish_obstacles(obstacles)

    def named(response: PlanTrajectory.Response) -> bool:
        client.publish_state(state)
        return field in response.status.message

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


def _later(client: Client, request: PlanTrajectory.Request) -> PlanTrajectory.Request:
    """Let a plan begin when the busiest machine has it ready."""
    request.start_time = client.node.get_clock().now().to_msg()
    request.start_time.sec += 120
    return request


def test_a_flood_of_states_and_spheres_starves_no_plan(planner: PlannerProcess) -> None:
    """What floods is a process of its own, and keeps its rate whatever the planner does."""
    scene = Scene(resting_capture())
    with connected_client() as client, running("flood.py"):
        client.wait_for_planner()

        def crowded(response: PlanTrajectory.Response) -> bool:
            return response.status.code == Status.SOLVED

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
    probe = PlanTrajectory.Request(duration=-1.0)
    with connected_client() as client:
        client.wait_for_planner()
        with running("doomed_client.py", door) as doomed:
            client.plan_until(probe, lambda response: response.status.code == Status.BUSY)
            doomed.kill()
            doomed.wait()
        client.wait_until(
            lambda: any(len(one.points) == POINTS for one in client.received["joint_trajectory"]),
            "the dead client's plan",
        )
        answer = client.plan_until(
            _later(client, scene.complete_request()),
            lambda response: response.status.code != Status.BUSY,
        )
        assert answer.status.code == Status.SOLVED, answer.status
    assert "a callback failed" not in planner.log


@pytest.mark.ci
def test_many_plans_leave_nothing_behind_and_the_node_ends_well(
    planner: PlannerProcess, tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    """Last of all, since it ends the node."""
    scene, plans = Scene(load_scenario(quick_capture(tmp_path))), times(60, 500)
    with connected_client() as client:
        client.wait_for_planner()
        # It is the node that is tested: the straight way to a goal nearby will do.
        manager = Manager(client)
        assert manager.set("planner.max_iterations", 1).successful
        assert manager.set("planning_allowance", 5.0).successful  # the chaser drifts away
        request, seconds = scene.complete_request(), []
        request.points = 12
        for number in range(plans):
            answer = client.plan(request)
            assert answer.status.code == Status.SOLVED, answer.status
            seconds.append(answer.solver.solve_time)
            if number == plans // 3:
                warm = holdings(planner.process.pid)
    _assert_no_growth(warm, holdings(planner.process.pid))
    # A clock is no judge of a test; what it says is for the reader of the log.
    half = plans // 2
    print(f"median of the first half of the plans {median(seconds[:half]):.3f} s")
    print(f"median of the second half of the plans {median(seconds[half:]):.3f} s")
    assert planner.stop() == 0


def _assert_no_growth(warm: Holdings, last: Holdings) -> None:
    assert last.memory - warm.memory <= GROWTH, (warm, last)
    # Threads of pools begin when they are needed, descriptors come and go: few, not one a plan.
    assert last.files - warm.files <= FEW, (warm, last)
    assert last.threads - warm.threads <= FEW, (warm, last)
