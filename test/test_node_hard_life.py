"""What a mission does to the planner node in the worst of its days, in real processes."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path

import pytest
from ff_planner_msgs.msg import ChaserState, ObstacleSphere, ObstacleSphereArray
from ff_planner_msgs.srv import PlanTrajectory
from ros_processes import (
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem import PlanningProblem

MALFORMED = 300
SEED = 20260102
NO_NUMBERS = (float("nan"), float("inf"), float("-inf"))
HUGE = 3_000
# What a process may grow by, once it has seen everything [kB]; a leaked request is 10 times that.
GROWTH = 20_000


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = ("-p", "planning_allowance:=5.0", "-p", "state_max_age:=60.0")
    directory = tmp_path_factory.mktemp("hard_life")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


def memory(process: int) -> int:
    """Resident memory [kB]."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0])


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


SPOILS: tuple[Spoil, ...] = (
    *(_number("target_pose.pose.position", axis) for axis in "xyz"),
    *(_number("target_twist.angular", axis) for axis in "xyz"),
    *(_number("start_state.pose.position", axis) for axis in "xyz"),
    *(_number("start_state.twist.linear", axis) for axis in "xyz"),
    *(_number("obstacles.spheres.0.center", axis) for axis in "xyz"),
    _number("obstacles.spheres.0", "radius", 1),
    _number("obstacles.spheres.0.twist.linear", "x", 1),
    *(
        _number("", name, 1)
        for name in (
            "duration",
            "weight_joint_path_length",
            "weight_chaser_attitude",
            "time_budget",
        )
    ),
    *(_quaternion(pose) for pose in ("target_pose.pose", "start_state.pose")),
    *(_array(name) for name in ("joint_names", "joint_positions", "joint_velocities")),
    *(_frame(path) for path in ("target_pose", "start_state", "obstacles")),
    *(_twice, _points, _word),
)


def test_malformed_requests_are_refused_by_name_and_leave_nothing_behind(
    planner: PlannerProcess, lemur_capture: PlanningProblem
) -> None:
    scene, dice = Scene(lemur_capture), random.Random(SEED)
    with connected_client() as client:
        client.wait_for_planner()
        assert client.plan(scene.complete_request()).status.code == Status.SOLVED
        halfway = 0
        for number in range(MALFORMED):
            request = scene.complete_request()
            field = dice.choice(SPOILS)(dice, request)
            answer = client.plan(request)
            status = Status(answer.status.code)
            assert Status.NOT_FINITE <= status <= Status.UNSUPPORTED, (field, answer.status)
            assert field in answer.status.message, answer.status
            assert not answer.joint_trajectory.points
            if number == MALFORMED // 2:
                halfway = memory(planner.process.pid)
        assert memory(planner.process.pid) - halfway <= GROWTH
        assert client.plan(scene.complete_request()).status.code == Status.SOLVED


@pytest.mark.usefixtures("planner")
def test_malformed_messages_on_the_topics_are_refused_by_name(
    lemur_capture: PlanningProblem,
) -> None:
    scene, dice = Scene(lemur_capture), random.Random(SEED)
    with connected_client() as client:
        client.wait_for_planner()
        for _ in range(30):
            request = scene.complete_request()
            request.start_state.header.stamp = client.node.get_clock().now().to_msg()
            spoil = dice.choice([_array("joint_positions"), _frame("start_state")])
            field = spoil(dice, request).replace("start_state", "chaser_state")
            _refused(client, scene.request(), request.start_state, request.obstacles, field)
        for _ in range(30):
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


@pytest.mark.usefixtures("planner")
def test_a_flood_of_states_and_spheres_starves_no_plan(
    lemur_capture: PlanningProblem,
) -> None:
    """A thousand states a second, two thousand spheres ten times a second, far from the arm."""
    scene = Scene(lemur_capture)
    far = [ObstacleSphere(id=f"far {i}", radius=0.1) for i in range(2000)]
    for i, sphere in enumerate(far):
        sphere.center.x, sphere.center.y = 50.0 + i % 50, 50.0 + i // 50
    crowd = scene.obstacles()
    crowd.spheres = [*crowd.spheres, *far]
    with connected_client() as client:
        client.wait_for_planner()
        stop = threading.Event()

        def flood() -> None:
            count = 0
            while not stop.wait(0.001):
                client.publish_state(scene.state(client.now_ns()))
                if count % 100 == 0:
                    client.publish_obstacles(crowd)
                count += 1

        flooding = threading.Thread(target=flood)
        flooding.start()
        try:
            client.plan_until(
                scene.request(), lambda response: response.status.code == Status.SOLVED
            )
            for _ in range(5):
                answer = client.plan(scene.request())
                assert answer.status.code == Status.SOLVED, answer.status
        finally:
            stop.set()
            flooding.join()


def test_many_plans_leave_nothing_behind_and_the_node_ends_well(
    planner: PlannerProcess, lemur_capture: PlanningProblem
) -> None:
    """Last of all, since it ends the node."""
    scene = Scene(lemur_capture)
    with connected_client() as client:
        client.wait_for_planner()
        sizes = []
        for _ in range(60):
            assert client.plan(scene.complete_request()).status.code == Status.SOLVED
            sizes.append(memory(planner.process.pid))
    assert sizes[-1] - sizes[30] <= GROWTH, sizes
    assert planner.stop() == 0
