"""The lifecycle of the planner node: what it does in which state, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import State, Transition
from managed_node import Manager, holdings
from quick_capture import resting_capture
from rclpy.lifecycle import TransitionCallbackReturn
from ros_processes import (
    DEADLINE,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.ros.planner_node import PlannerNode
from ff_planner_ros.ros.requests.solver import Solver

CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEANUP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
# What the process may grow by in each loop after the first ones [kB]. Each loop makes the
# recorder's node, and of every node that is destroyed rclpy 7.1 keeps about 100 kB, in a program of
# ten lines, too; the limit is somewhat more than twice that.
GROWTH = 260
FEW = 8


@pytest.fixture
def planner(tmp_path: Path) -> Iterator[PlannerProcess]:
    arguments = ("-p", "autostart:=false", "-p", "planning_lead_time:=60.0")
    with private_domain(), running_planner(tmp_path, *arguments) as planner:
        yield planner


@pytest.mark.law("NODE-14")
def test_it_plans_only_while_it_is_active(
    planner: PlannerProcess,
) -> None:
    request = Scene(resting_capture()).complete_request()
    with connected_client() as client:
        manager = Manager(client)
        assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
        assert manager.change(CONFIGURE) == [True]
        client.wait_for_planner()
        refused = client.plan(request)
        assert refused.status.code == Status.NOT_ACTIVE
        assert "not active yet" in refused.status.message
        assert manager.change(ACTIVATE) == [True]
        assert client.plan(request).status.code == Status.SOLVED
        client.wait_until(lambda: client.received["joint_trajectory"], "the trajectory")
        assert manager.change(DEACTIVATE) == [True]
        assert client.plan(request).status.code == Status.NOT_ACTIVE
        assert manager.change(ACTIVATE) == [True]
        assert client.plan(request).status.code == Status.SOLVED
        assert manager.change(DEACTIVATE, CLEANUP) == [True, True]
        assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
        # The bag is complete as soon as the node is clean.
        assert len(read_bag(planner.bag)["/joint_trajectory"]) == 2
        assert manager.change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN) == [True]
        assert manager.state() == State.PRIMARY_STATE_FINALIZED
    assert planner.stop() == 0


@pytest.mark.ci
def test_a_goal_that_is_being_planned_is_given_up_when_the_node_is_deactivated(
    planner: PlannerProcess,
) -> None:
    request = Scene(resting_capture()).complete_request()
    request.search.points = 5000
    with connected_client() as client:
        manager = Manager(client)
        assert manager.change(CONFIGURE, ACTIVATE) == [True, True]
        goal = client.send_goal(request)
        assert goal.progress.wait(DEADLINE)
        assert manager.change(DEACTIVATE) == [True]
        _, result = goal.result()
        assert result.status.code == Status.NOT_ACTIVE
        assert "not active any more" in result.status.message
        status, refused = client.send_goal(request).result()
        assert (status, refused.status.code) == (GoalStatus.STATUS_ABORTED, Status.NOT_ACTIVE)
        assert "not active" in refused.status.message
    assert planner.stop() == 0


# What nav2's lifecycle manager does, and the states that it then asks for.
STARTUP, PAUSE, RESET = (CONFIGURE, ACTIVATE), (DEACTIVATE,), (DEACTIVATE, CLEANUP)
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
LEADS_TO = {
    (UNCONFIGURED, CONFIGURE): INACTIVE,
    (INACTIVE, ACTIVATE): ACTIVE,
    (INACTIVE, CLEANUP): UNCONFIGURED,
    (ACTIVE, DEACTIVATE): INACTIVE,
    (UNCONFIGURED, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN): FINALIZED,
    (INACTIVE, Transition.TRANSITION_INACTIVE_SHUTDOWN): FINALIZED,
    (ACTIVE, Transition.TRANSITION_ACTIVE_SHUTDOWN): FINALIZED,
}
TRANSITIONS = sorted({transition for _, transition in LEADS_TO})


@pytest.mark.parametrize(
    "way",
    [
        pytest.param((*STARTUP, *PAUSE, ACTIVATE, *RESET, *STARTUP, *RESET), id="as nav2 does"),
        pytest.param(STARTUP, id="from active", marks=pytest.mark.ci),
        pytest.param((CONFIGURE,), id="from inactive", marks=pytest.mark.ci),
    ],
)
def test_in_each_state_it_takes_the_transitions_that_lead_on_and_refuses_all_others(
    planner: PlannerProcess, way: tuple[int, ...]
) -> None:
    with connected_client() as client:
        manager, state = Manager(client), UNCONFIGURED
        for transition in way:
            others = [one for one in TRANSITIONS if (state, one) not in LEADS_TO]
            assert not any(manager.change(*others, 99))
            assert manager.change(transition) == [True]
            state = LEADS_TO[state, transition]
            assert manager.state() == state
        (shutdown,) = (one for one in TRANSITIONS if LEADS_TO.get((state, one)) == FINALIZED)
        assert manager.change(shutdown) == [True]
        assert not any(manager.change(*TRANSITIONS))
        assert manager.state() == FINALIZED
    assert planner.stop() == 0


@pytest.mark.ci
def test_a_robot_that_cannot_be_loaded_leaves_it_unconfigured_and_can_be_set_right(
    planner: PlannerProcess,
) -> None:
    with connected_client() as client:
        manager = Manager(client)
        assert manager.set("robot.tip_link", "finger").successful
        assert manager.change(CONFIGURE) == [False]
        assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
        assert manager.set("robot.tip_link", "end_effector").successful
        assert manager.change(CONFIGURE, ACTIVATE) == [True, True]
        refused = manager.set("planner.starts", 3)
        assert not refused.successful
        assert "planner.starts is 3: it stays 20, which is fixed while" in refused.reason
        assert manager.change(DEACTIVATE, CLEANUP) == [True, True]
        assert manager.set("planner.starts", 3).successful
        elsewhere = manager.set("bag.directory", "/tmp")
        assert not elsewhere.successful
        assert "as the process was started" in elsewhere.reason
        assert manager.change(CONFIGURE, ACTIVATE) == [True, True]
        client.wait_for_planner()
        request = Scene(resting_capture()).complete_request()
        assert client.plan(request).status.code == Status.SOLVED
    assert planner.stop() == 0
    assert "finger" in planner.log


@pytest.mark.nightly
@pytest.mark.law("NODE-14")
def test_it_goes_through_its_states_again_and_again_without_growing(
    planner: PlannerProcess, times: Callable[[int, int], int]
) -> None:
    loops = times(60, 200)  # the first ones fill the pools of the allocator
    with connected_client() as client:
        manager = Manager(client)
        held = []
        for _ in range(loops):
            assert manager.change(CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP) == [True] * 4
            held.append(holdings(planner.process.pid))
        warm, last = held[loops // 4], held[-1]
        assert last.memory - warm.memory <= GROWTH * (loops - loops // 4), held
        # Threads of pools begin when they are needed, descriptors come and go: few, not one a loop.
        assert last.threads - warm.threads <= FEW, held
        assert last.files - warm.files <= FEW, held
        assert manager.change(CONFIGURE, ACTIVATE) == [True, True]
        client.wait_for_planner()
        request = Scene(resting_capture()).complete_request()
        assert client.plan(request).status.code == Status.SOLVED
    assert planner.stop() == 0


def test_clean_up_and_shutdown_have_codes_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the one the same request may be sent again, after the other it may not."""
    with private_domain():
        rclpy.init(args=[])
        node = PlannerNode(Mock(spec=Solver))
        for transition, status in (
            (node.on_cleanup, Status.NOT_ACTIVE),
            (node.on_error, Status.NOT_ACTIVE),
            (node.on_shutdown, Status.SHUT_DOWN),
        ):
            session = Mock()
            monkeypatch.setattr(node, "_session", session)
            assert transition(Mock()) == TransitionCallbackReturn.SUCCESS
            ((told, _),) = [call.args for call in session.stop_planning.call_args_list]
            assert told is status
            session.close.assert_called_once_with()
        rclpy.shutdown()


@pytest.mark.law("NODE-14")
@pytest.mark.usefixtures("planner")
def test_after_clean_up_configure_activate_the_first_request_waits_for_latched_obstacles(
    times: Callable[[int, int], int],
) -> None:
    request = Scene(resting_capture()).complete_request()
    request.scene = []
    with connected_client() as client:
        manager = Manager(client)
        client.publish_obstacles(Scene(resting_capture()).obstacles())
        assert manager.change(CONFIGURE, ACTIVATE) == [True] * 2
        for _ in range(times(3, 20)):
            answer = client.plan(request)
            assert answer.status.code == Status.SOLVED, answer.status
            assert manager.change(DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE) == [True] * 4
        client.node.destroy_publisher(client._obstacles)
        assert manager.change(DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE) == [True] * 4
        assert client.plan(request).status.code == Status.NO_OBSTACLES
