"""A running node hands its plans over to a controller's action, and hears what becomes of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import PlanAnswer, PlanEvent, PlanRequest
from quick_capture import resting_capture
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from standin_controller import NAME, StandInController

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.execution import Event

SCENE = Scene(resting_capture())
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
AHEAD = 2.0  # of a plan's start [s]
LEAD = 1.0  # of the handover [s]
LONG = 30.0  # of a plan that is ended before it is at its goal, on a busy machine, too [s]
TRIES = 3
SETTINGS = (
    *("-p", "controller.hand_over:=action", "-p", f"controller.hand_over_lead:={LEAD}"),
    *("-p", "controller.path_tolerance:=0.05"),
    *("-p", "rates.diagnostics:=20.0", "-p", "post_goal_duration:=0.5"),
    *("-p", "state_future_tolerance:=3600.0"),
)
# As config/planner.yaml has it, whatever the tests of other files are run with.
STOPS = (
    *("-p", "end_behaviour:=stop_joints"),
    *("-p", "controller.allow_nonzero_velocity_at_trajectory_end:=false"),
)
MOVES = ("-p", "controller.allow_nonzero_velocity_at_trajectory_end:=true")
ALL = CancelGoal.Request()  # goals, whatever their ids


class Arm:
    """A planner, a controller, and whoever asks."""

    def __init__(self, client: Client, planner: PlannerProcess, **parameters: Any) -> None:
        self.client, self.planner = client, planner
        joints = SCENE.problem.robot.joint_names
        self.controller = StandInController(joints, **parameters)
        client.executor.add_node(self.controller.node)
        self.events = client.hear(PlanEvent, "plan_events", LATCHED)
        self.diagnostics = client.hear(DiagnosticArray, "/diagnostics")
        client.wait_for_planner()

    def request(self, ahead: float = AHEAD, **fields: Any) -> PlanRequest:
        request = SCENE.complete_request()
        start = time_message(self.client.now_ns() + round(ahead * NANOSECONDS))
        request.start_time = request.start_state[0].header.stamp = start
        request.scene[0].spheres, request.duration = [], 4.0
        if fields.get("end_behaviour") == "none":
            request.goal.twist.linear.x = 0.05  # or else the joints would be at rest there
        for name, value in fields.items():
            setattr(request, name, value)
        return request

    def plan(self, **fields: Any) -> PlanAnswer:
        """Have a plan made, which begins later if a busy machine needs the time to make it."""
        ahead = AHEAD
        while True:
            answer = self.client.plan(self.request(ahead, **fields))
            if Status(answer.status.code) is not Status.TOO_LATE or ahead > DEADLINE:
                assert Status(answer.status.code) is Status.SOLVED, answer.status.message
                return answer
            ahead *= 2.0

    def of(self, answer: PlanAnswer) -> list[Event]:
        return [Event(one.event) for one in self.events if one.plan_id == answer.plan_id]

    def wait_for(self, answer: PlanAnswer, event: Event) -> PlanEvent:
        ends = {event, Event.ABORTED}
        self.client.wait_until(lambda: ends & set(self.of(answer)), event.name)
        assert event in self.of(answer), self.events
        (found,) = (
            one for one in self.events if one.plan_id == answer.plan_id and one.event == event
        )
        return found

    def told(self, words: str) -> bool:
        """Whether the newest diagnostics of the controller have these words."""
        part = "ff_planner: controller"
        newest = self.diagnostics[-1].status if self.diagnostics else ()
        return any(part in one.name and words in one.message for one in newest)


@contextmanager
def arm(directory: Path, *arguments: str, **parameters: Any) -> Iterator[Arm]:
    with (
        private_domain(),
        running_planner(directory, *SETTINGS, *STOPS, *arguments) as planner,
        connected_client() as client,
    ):
        found = Arm(client, planner, **parameters)
        try:
            client.wait_until(lambda: found.told("plans "), "the controller")
            yield found
        finally:
            client.executor.remove_node(found.controller.node)
            found.controller.close()


@pytest.mark.law("NODE-20")
def test_a_plan_is_executed_replaced_aborted_and_all_of_it_told(tmp_path: Path) -> None:
    """One life of a node: what an executive sees, and what the bag has."""
    with arm(tmp_path) as at:
        controller = at.controller
        # By default a plan ends at rest, as the controller wants it, and is brought to its end. A
        # machine that is busy for seconds has another try at handing it over before its start.
        for _ in range(TRIES):
            first = at.plan()
            assert not any(first.plans[0].joint_trajectory.points[-1].velocities)
            at.wait_for(first, Event.AT_GOAL)
            assert at.of(first) == [Event.PUBLISHED, Event.STARTED, Event.AT_GOAL]
            taken = controller.trajectories[-1]
            assert taken == at.client.received["joint_trajectory"][-1]
            lead = nanoseconds(taken.header.stamp) - controller.accepted_ns[-1]
            assert lead <= LEAD * NANOSECONDS
            if lead > 0:
                break
        assert lead > 0
        # A new plan replaces the one that runs.
        second = at.plan(duration=LONG)
        at.wait_for(second, Event.STARTED)
        third = at.plan(duration=LONG)
        superseded = at.wait_for(second, Event.SUPERSEDED)
        assert superseded.successor == third.plan_id
        # A controller that gives up is an event, and the plan runs no more.
        at.wait_for(third, Event.STARTED)
        controller.off = 0.1
        aborted = at.wait_for(third, Event.ABORTED)
        assert aborted.error_code == -4
        assert "PATH_TOLERANCE_VIOLATED: Aborted due to path tolerance" in aborted.message
        at.client.wait_until(lambda: at.told("PATH_TOLERANCE_VIOLATED"), "the diagnostics")
        nothing = at.client.plan(at.request(replan_active=True, duration=0.0))
        assert Status(nothing.status.code) is Status.NO_ACTIVE_PLAN
        assert at.planner.stop() == 0
    bag = read_bag(at.planner.bag)
    told = [(one.plan_id, Event(one.event)) for one in bag["/plan_events"]]
    assert told == [(one.plan_id, Event(one.event)) for one in at.events]


@pytest.mark.law("NODE-23")
def test_a_plan_whose_times_the_controller_does_not_keep_is_broken(tmp_path: Path) -> None:
    """A momentum plan holds at its own times: at 0.95 of its speed it leads elsewhere."""
    with arm(tmp_path) as at:
        plan = at.plan(duration=LONG)
        at.wait_for(plan, Event.STARTED)
        at.controller.scaling = 0.95
        assert "at 0.95 of its speed" in at.wait_for(plan, Event.ABORTED).message
        at.client.wait_until(lambda: at.told("at 0.95 of its speed"), "the diagnostics")
        nothing = at.client.plan(at.request(replan_active=True, duration=0.0))
        assert Status(nothing.status.code) is Status.NO_ACTIVE_PLAN


@pytest.mark.law("NODE-23")
def test_a_controller_that_stops_breaks_a_plan_that_went_out_on_the_topic(tmp_path: Path) -> None:
    watched = ("-p", f"controller.state_topic:={NAME}/controller_state")
    topic = ("-r", f"joint_trajectory:={NAME}/joint_trajectory")
    with arm(tmp_path, "-p", "controller.hand_over:=topic", *watched, *topic) as at:
        at.controller.told_scaling = 0.0  # as controllers before 4.39 tell it
        kept = at.plan()
        at.wait_for(kept, Event.AT_GOAL)
        stopped = at.plan(duration=LONG)
        at.wait_for(stopped, Event.STARTED)
        at.controller.hold()
        assert "the controller has stopped" in at.wait_for(stopped, Event.ABORTED).message


@pytest.mark.ci
def test_what_the_controller_refuses_or_ends_is_told(tmp_path: Path) -> None:
    allowed = {"allow_nonzero_velocity_at_trajectory_end": True, "constraints.goal_time": 0.25}
    with arm(tmp_path, *MOVES, **allowed) as at:
        moving = at.plan(end_behaviour="none", duration=LONG)
        assert abs(np.array(moving.plans[0].joint_trajectory.points[-1].velocities)).max() > 1e-3
        at.wait_for(moving, Event.STARTED)
        # Whoever cancels the controller's goal ends the plan, and the executive hears of it.
        at.client.call(CancelGoal, f"/{NAME}/follow_joint_trajectory/_action/cancel_goal", ALL)
        assert "cancelled" in at.wait_for(moving, Event.ABORTED).message
        # A controller that changes its mind is told by its refusal.
        strict = Parameter("allow_nonzero_velocity_at_trajectory_end", value=False)
        at.controller.node.set_parameters([strict])
        refused = at.plan(end_behaviour="none")
        assert "refused" in at.wait_for(refused, Event.ABORTED).message
        assert at.controller.refused == ["moves at its end"]
        assert Event.STARTED not in at.of(refused)


@pytest.mark.ci
def test_a_plan_that_is_to_end_in_motion_is_brought_to_its_end(tmp_path: Path) -> None:
    """By a controller that gives up joints which have not stopped, for the goal says otherwise."""
    sees: dict[str, Any] = {"command_interfaces": ["position", "velocity"]}
    sees |= {"allow_nonzero_velocity_at_trajectory_end": True, "constraints.goal_time": 0.25}
    with arm(tmp_path, *MOVES, **sees) as at:
        moving = at.plan(end_behaviour="none")
        rates = np.abs(moving.plans[0].joint_trajectory.points[-1].velocities)
        assert rates.max() > at.controller.parameter("constraints.stopped_velocity_tolerance")
        at.wait_for(moving, Event.AT_GOAL)


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize(
    ("tolerances", "off", "code"),
    [
        ({}, 0.1, 0),  # the controller has none by default
        ({"constraints.joint_1.trajectory": 0.05}, 0.1, -4),
        ({"constraints.joint_1.goal": 0.05, "constraints.goal_time": 0.1}, 0.1, -5),
    ],
)
def test_the_controllers_tolerances_hold_where_the_planner_names_none(
    tmp_path: Path, tolerances: dict[str, float], off: float, code: int
) -> None:
    with arm(tmp_path, "-p", "controller.path_tolerance:=0.0", **tolerances) as at:
        at.controller.off = off
        plan = at.plan()
        assert at.wait_for(plan, Event.ABORTED if code else Event.AT_GOAL).error_code == code
