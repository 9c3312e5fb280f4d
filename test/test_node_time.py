"""Time as the planner node sees it: plans ahead, simulated time, and a clock that jumps back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from managed_node import Manager
from rclpy.publisher import Publisher
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)
from rosgraph_msgs.msg import Clock

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem

NOW = 100  # [s] simulated
ALLOWANCE = 3
# Of the paper's chaser, which is pushed by nobody, not even by its own arm at rest.
DRIFT = np.array([0.02, 0.0, 0.05])


class SimulatedTime:
    """A clock that stands still until it is told to go on."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._publisher: Publisher = client.node.create_publisher(Clock, "/clock", 10)

    def set(self, seconds: int, probe: PlanRequest, status: Status) -> None:
        """Set it, until a probing request tells that the planner knows."""

        def arrived(answer: PlanAnswer) -> bool:
            self._publisher.publish(Clock(clock=Time(sec=seconds)))
            return answer.status.code == status

        self._client.plan_until(probe, arrived)


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = (
        *("-p", "use_sim_time:=true", "-p", f"planning_lead_time:={ALLOWANCE}.0"),
        *("-p", "state_max_age:=5.0"),
    )
    with private_domain():
        directory: Path = tmp_path_factory.mktemp("time")
        with running_planner(directory, *arguments) as planner:
            yield planner


def drifting(scene: Scene) -> PlanRequest:
    """A request from a chaser that drifts and does not turn, its arm held, as of NOW."""
    request = scene.complete_request()
    (state,) = request.start_state
    state.header.stamp = Time(sec=NOW)
    state.twist.angular.y = state.twist.angular.z = 0.0
    state.joint_velocities = [0.0] * 7
    return request


def at(seconds: int, scene: Scene) -> PlanRequest:
    """A request that is refused as out of range at a time, and for its stamp at all others."""
    request = scene.complete_request()
    request.start_state[0].header.stamp = Time(sec=seconds)
    request.duration = -1.0
    return request


@pytest.mark.ci
def test_another_clock_at_run_time_makes_it_forget_and_is_not_told_as_a_jump_of_minus_decades(
    planner: PlannerProcess, lemur_capture: PlanningProblem
) -> None:
    scene = Scene(lemur_capture)
    with connected_client() as client:
        client.wait_for_planner()
        client.publish_obstacles(scene.obstacles())
        manager = Manager(client)
        assert manager.set("use_sim_time", False).successful
        client.publish_and_wait(scene.state(client.now_ns()))
        assert client.plan(scene.request()).status.code != Status.NO_STATE
        assert manager.set("use_sim_time", True).successful
        forgotten = client.plan(scene.request())
        assert forgotten.status.code == Status.NO_STATE
        assert "since the clock has jumped back or changed" in forgotten.status.message
    assert "the node's clock is the system's from now on: states and plans of" in planner.log
    assert "the node's clock is the simulated one from now on: states and plans of" in planner.log
    assert "jumped back by" not in planner.log


@pytest.mark.law("NODE-15")
@pytest.mark.ci
@pytest.mark.usefixtures("planner")
def test_a_simulated_clock_that_stands_still_is_told() -> None:
    """The diagnostics have a clock of their own, and do not stand still with it."""
    with connected_client() as client:
        client.wait_for_planner()
        assert Manager(client).set("use_sim_time", True).successful
        heard = client.hear(DiagnosticArray, "/diagnostics")

        def words() -> str:
            found = [one for one in heard[-1].status if one.name.endswith("ff_planner: clock")]
            return found[0].message if found else ""

        client.wait_until(lambda: heard and "/clock has not ticked" in words(), "a still clock")
        assert [one.level for one in heard[-1].status if one.name.endswith("clock")] == [
            DiagnosticStatus.WARN
        ]


@pytest.mark.law("NODE-15")
def test_time_goes_on_and_jumps_back(
    planner: PlannerProcess, lemur_capture: PlanningProblem
) -> None:
    scene = Scene(lemur_capture)
    with connected_client() as client:
        time = SimulatedTime(client)
        client.wait_for_planner()
        time.set(NOW, at(NOW, scene), Status.OUT_OF_RANGE)

        # A plan starts after the allowance, where the chaser will be by then.
        request = drifting(scene)
        answer = client.plan(request)
        assert answer.status.code == Status.SOLVED, answer.status
        start = answer.plans[0].joint_trajectory.header.stamp
        assert (start.sec, start.nanosec) == (NOW + ALLOWANCE, 0)
        _assert_first_point(answer, ALLOWANCE * DRIFT)
        assert answer.inputs.state_stamp == Time(sec=NOW)

        # Or when it is told to, where the published plan has brought the chaser by then; but not in
        # the past, nor before its own start state.
        then = answer.plans[0].chaser_path.poses[8]
        request.start_time = then.header.stamp
        place = then.pose.position
        _assert_first_point(client.plan(request), np.array([place.x, place.y, place.z]))
        request.start_time = Time(sec=NOW - 1)
        past = client.plan(request)
        assert past.status.code == Status.START_IN_PAST
        assert "1.000 s ago" in past.status.message

        # The clock jumps back in the midst of a plan: that plan is void.
        client.publish_obstacles(scene.obstacles())
        state = scene.state(NOW * 1_000_000_000)
        client.publish_and_wait(state)
        long = drifting(scene)
        long.search.points = 5000
        goal = client.send_goal(long)
        assert goal.progress.wait(DEADLINE)
        time.set(50, at(50, scene), Status.BUSY)
        _, result = goal.result()
        assert result.status.code == Status.CLOCK_JUMPED
        assert "jumped back by 50.000 s" in result.status.message

        # The state of before is forgotten; a new one will do.
        forgotten = client.plan(scene.request())
        assert forgotten.status.code == Status.NO_STATE
        assert "since the clock has jumped back" in forgotten.status.message
        client.publish_and_wait(scene.state(50_000_000_000))
        assert client.plan(scene.request()).status.code == Status.SOLVED
    assert planner.stop() == 0


def _assert_first_point(answer: PlanAnswer, expected: np.ndarray) -> None:
    position = answer.plans[0].chaser_path.poses[0].pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], expected, atol=1e-9)
