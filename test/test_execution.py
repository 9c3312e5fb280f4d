"""What becomes of published plans, by the clock and by what a controller says, without a node."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import Mock

import pytest
from action_msgs.msg import GoalStatus
from changed_parameters import replaced
from ff_planner_msgs.msg import PlanEvent
from rclpy.lifecycle import LifecycleNode
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.ros.messages.foreign import FollowJointTrajectory
from ff_planner_ros.ros.messages.to_messages import controller_goal
from ff_planner_ros.ros.outputs import controller, execution
from ff_planner_ros.ros.outputs.controller import ControllerClient, Ended, ended_by
from ff_planner_ros.ros.outputs.execution import Event, Execution

PUBLISHED, STARTED, AT_GOAL, ABORTED, SUPERSEDED = Event
REPLACED = Ended("the controller has another goal", error_code=-1, is_replaced=True)
LEAD = load_parameters().controller.hand_over_lead


class Controller:
    """A controller that is told everything and says what the test wants."""

    off: ClassVar[dict[str, float]] = {}

    def __init__(self, *arguments: Any) -> None:
        *_, self.group = arguments
        self.sent: list[tuple[str, Any, Any]] = []
        self.cancelled = 0

    def send(self, trajectory: JointTrajectory, accepted: Any, ended: Any) -> None:
        self.sent.append((trajectory.joint_names[0], accepted, ended))

    def cancel(self) -> None:
        self.cancelled += 1


class Watch:
    """What is asked of the watch of the controller's state."""

    complaint = ""

    def __init__(self, *arguments: Any) -> None:
        *_, self.broken = arguments
        self.followed: list[str] = []
        self.replaced, self.leave = Mock(), Mock()

    def follow(self, plan_id: str, *_: Any) -> None:
        self.followed.append(plan_id)


class World:
    """An execution whose clock is set, and whose events are kept."""

    def __init__(self, hand_over: str, patch: pytest.MonkeyPatch) -> None:
        self.now, self.heard = 0.0, list[Any]()
        node = Mock(spec=LifecycleNode)
        node.get_clock.return_value.now = lambda: SimpleNamespace(
            nanoseconds=round(self.now * NANOSECONDS)
        )
        node.create_lifecycle_publisher.return_value.publish = self.heard.append
        patch.setattr(execution, "ControllerClient", Controller)
        patch.setattr(execution, "ControllerWatch", Watch)
        self.lost: list[str] = []
        parameters = replaced(load_parameters(), "controller.hand_over", hand_over)
        self.execution = Execution(node, parameters.controller, self.lost.append)
        self.node, self.timer = node, node.create_timer.return_value

    @property
    def controller(self) -> Any:
        return self.execution.controller

    @property
    def lead(self) -> float:
        """How long before its start a plan is handed over [s]."""
        return LEAD if self.controller else 0.0

    @property
    def wakes(self) -> float:
        """When the timer looks next."""
        return self.now + float(self.timer.timer_period_ns) / NANOSECONDS

    def publish(self, plan_id: str, start: float, goal: float) -> None:
        trajectory = JointTrajectory(joint_names=[plan_id])  # by which it is known
        times = (round(time * NANOSECONDS) for time in (start, goal))
        self.execution.published(plan_id, *times, trajectory)

    def look(self, now: float) -> None:
        self.now = now
        self.execution.look()

    @property
    def events(self) -> list[tuple[str, Event]]:
        return [(one.plan_id, Event(one.event)) for one in self.heard]


@pytest.fixture
def by_topic(monkeypatch: pytest.MonkeyPatch) -> World:
    return World("topic", monkeypatch)


@pytest.fixture
def by_action(monkeypatch: pytest.MonkeyPatch) -> World:
    return World("action", monkeypatch)


def test_the_events_are_those_of_the_message() -> None:
    assert {one.name: int(one) for one in Event} == {
        name: getattr(PlanEvent, name)
        for name in ("PUBLISHED", "STARTED", "AT_GOAL", "ABORTED", "SUPERSEDED")
    }


def test_a_plan_on_the_topic_is_published_starts_and_is_at_its_goal(by_topic: World) -> None:
    by_topic.publish("run.1", start=5.0, goal=15.0)
    for now in (4.999, 5.0, 10.0, 14.999, 15.0, 20.0):
        by_topic.look(now)
    assert by_topic.events == [("run.1", PUBLISHED), ("run.1", STARTED), ("run.1", AT_GOAL)]
    stamps = [nanoseconds(one.header.stamp) / NANOSECONDS for one in by_topic.heard]
    assert stamps == [0.0, 5.0, 15.0]
    by_topic.timer.cancel.assert_called()  # nobody looks at the clock for nothing


def test_a_plan_that_takes_over_supersedes_the_one_that_runs_when_it_starts(
    by_topic: World,
) -> None:
    by_topic.publish("run.1", start=1.0, goal=9.0)
    by_topic.look(2.0)
    by_topic.publish("run.2", start=4.0, goal=9.0)
    by_topic.look(3.9)
    assert by_topic.events[-1] == ("run.2", PUBLISHED)
    by_topic.look(4.0)
    assert by_topic.events[-2:] == [("run.1", SUPERSEDED), ("run.2", STARTED)]
    assert by_topic.heard[-2].successor == "run.2"
    by_topic.look(9.0)
    assert by_topic.events[-1] == ("run.2", AT_GOAL)


def test_however_late_the_clock_is_looked_at_things_are_told_in_their_order(
    by_topic: World,
) -> None:
    by_topic.publish("run.1", start=1.0, goal=2.0)
    by_topic.publish("run.2", start=3.0, goal=4.0)
    by_topic.look(9.0)
    assert by_topic.events[2:] == [
        *(("run.1", STARTED), ("run.1", AT_GOAL)),
        *(("run.2", STARTED), ("run.2", AT_GOAL)),
    ]


@pytest.mark.parametrize("hand_over", ["topic", "action"])
def test_a_plan_that_begins_before_the_one_published_before_it_leaves_that_no_turn(
    hand_over: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller drops what it has for what it is sent; of the first nothing is heard again."""
    world = World(hand_over, monkeypatch)
    world.publish("run.1", start=5.0, goal=15.0)
    assert world.wakes == pytest.approx(5.0 - world.lead)
    world.publish("run.2", start=3.0, goal=9.0)
    assert world.wakes == pytest.approx(3.0 - world.lead)
    if hand_over == "action":
        world.look(3.0 - world.lead)
        assert world.wakes == pytest.approx(5.0 - world.lead)
        ((sent, accepted, ended),) = world.controller.sent
        assert sent == "run.2"
        accepted()
        assert world.wakes == pytest.approx(3.0)
    world.look(3.0)
    assert world.events[2:] == [("run.1", SUPERSEDED), ("run.2", STARTED)]
    assert world.heard[2].successor == "run.2"
    for now in (5.0 - world.lead, 5.0, 9.0):
        world.look(now)
    if hand_over == "action":
        ended(Ended("done", succeeded=True))
        assert len(world.controller.sent) == 1
    assert world.events[4:] == [("run.2", AT_GOAL)]
    assert not world.lost


def test_of_two_plans_that_wait_each_is_handed_over_in_its_own_time(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=2.0)
    by_action.publish("run.2", start=3.0, goal=4.0)
    by_action.look(1.0)
    _, accepted, ended = by_action.controller.sent[0]
    accepted()
    by_action.look(1.1)
    assert by_action.wakes == pytest.approx(3.0 - LEAD)
    ended(Ended("done", succeeded=True))
    by_action.look(3.0 - LEAD)
    assert [sent for sent, *_ in by_action.controller.sent] == ["run.1", "run.2"]


@pytest.mark.law("NODE-20")
def test_a_goal_is_sent_just_in_time_and_the_controller_says_when_it_is_over(
    by_action: World,
) -> None:
    by_action.publish("run.1", start=5.0, goal=15.0)
    by_action.look(5.0 - LEAD - 0.001)
    assert not by_action.controller.sent
    by_action.look(5.0 - LEAD)
    by_action.look(5.0)  # once
    ((sent, accepted, ended),) = by_action.controller.sent
    assert sent == "run.1"
    assert by_action.events == [("run.1", PUBLISHED)]  # nobody has taken it
    accepted()
    by_action.look(5.01)
    assert by_action.events[-1] == ("run.1", STARTED)
    by_action.look(30.0)
    assert by_action.events[-1] == ("run.1", STARTED)
    ended(Ended("done", succeeded=True))
    assert by_action.events[-1] == ("run.1", AT_GOAL)
    assert not by_action.lost


def test_a_refused_and_an_aborted_goal_are_no_plan_that_runs(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=2.0)
    by_action.look(1.0)
    by_action.controller.sent[0][2](Ended("refused"))
    by_action.publish("run.2", start=3.0, goal=9.0)
    by_action.look(3.0)
    _, accepted, ended = by_action.controller.sent[1]
    accepted()
    by_action.look(3.1)
    ended(Ended("path tolerance", error_code=-4))
    assert by_action.events[1:] == [
        ("run.1", ABORTED),
        *(("run.2", PUBLISHED), ("run.2", STARTED), ("run.2", ABORTED)),
    ]
    assert (by_action.heard[-1].error_code, by_action.heard[-1].message) == (-4, "path tolerance")
    assert by_action.lost == ["run.1", "run.2"]


@pytest.mark.parametrize("first", ["the result", "the start"])
def test_the_controller_drops_the_running_goal_for_a_new_one(by_action: World, first: str) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.controller.sent[0][1]()
    by_action.look(1.1)
    by_action.publish("run.2", start=4.0, goal=9.0)
    by_action.look(4.0)
    by_action.controller.sent[1][1]()
    if first == "the result":
        by_action.controller.sent[0][2](REPLACED)
    by_action.look(4.1)
    if first == "the start":
        by_action.controller.sent[0][2](REPLACED)
    assert by_action.events[3:] == [("run.1", SUPERSEDED), ("run.2", STARTED)]
    assert by_action.heard[3].successor == "run.2"
    assert not by_action.lost


def test_a_goal_that_somebody_else_replaces_is_aborted(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.controller.sent[0][1]()
    by_action.look(1.1)
    by_action.controller.sent[0][2](REPLACED)
    assert by_action.events[-1] == ("run.1", ABORTED)


def test_a_goal_that_fails_just_when_a_new_one_is_sent_is_aborted(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.controller.sent[0][1]()
    by_action.look(1.1)
    by_action.publish("run.2", start=4.0, goal=9.0)
    by_action.look(4.0 - LEAD)
    by_action.controller.sent[0][2](Ended("path tolerance", error_code=-4))
    assert by_action.events[-1] == ("run.1", ABORTED)


def test_a_controller_that_does_not_answer_has_not_taken_it(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.look(9.1)
    assert by_action.events == [("run.1", PUBLISHED), ("run.1", ABORTED)]


def test_a_node_that_is_deactivated_hands_nothing_over_and_leaves_what_runs(
    by_action: World,
) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.controller.sent[0][1]()
    by_action.publish("run.2", start=5.0, goal=9.0)
    by_action.execution.withdraw("the planner is not active any more")
    by_action.look(6.0)
    assert len(by_action.controller.sent) == 1
    assert by_action.events[2:] == [("run.2", ABORTED), ("run.1", STARTED)]
    assert by_action.lost == ["run.2"]
    assert not by_action.controller.cancelled


def test_plans_of_before_a_jump_of_the_clock_are_void(by_action: World) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0)
    by_action.controller.sent[0][1]()
    by_action.execution.forget("the clock jumped")
    assert by_action.events[-1] == ("run.1", ABORTED)
    assert by_action.controller.cancelled == 1
    by_action.controller.sent[0][2](Ended("cancelled"))
    assert by_action.events[-1] == ("run.1", ABORTED)
    assert len(by_action.heard) == 2


def broken(world: World, may_have_ended: bool) -> None:
    """Have a plan that begins at 1 s run until 2 s, when its controller does not keep it."""
    world.publish("run.1", start=1.0, goal=9.0)
    world.look(1.0 - LEAD)
    world.controller.sent[0][1]()
    world.look(1.0)
    watch: Any = world.execution.watch
    assert watch.followed == ["run.1"]
    world.look(2.0)
    watch.broken("run.1", "it stands", may_have_ended)
    assert world.lost == ["run.1"]


def test_a_plan_that_the_controller_does_not_keep_is_aborted_and_forgotten(
    by_action: World,
) -> None:
    broken(by_action, may_have_ended=False)
    assert by_action.heard[-1].message == "broken: it stands"
    by_action.controller.sent[0][2](Ended("done", succeeded=True))
    assert by_action.events[-1] == ("run.1", ABORTED)


@pytest.mark.parametrize(
    ("ended", "message", "code"),
    [
        (Ended("it was cancelled"), "it was cancelled", 0),
        (Ended("off its path", error_code=-4), "off its path", -4),
        (Ended("done", succeeded=True), "broken: it stands", 0),
        (None, "broken: it stands", 0),  # and runs on
    ],
)
def test_whether_a_controller_that_left_a_plan_has_ended_it_is_waited_for(
    by_action: World, ended: Ended | None, message: str, code: int
) -> None:
    broken(by_action, may_have_ended=True)
    assert by_action.events[-1] == ("run.1", STARTED)
    assert by_action.wakes == 3.0
    if ended is None:
        by_action.look(2.999)
        assert by_action.events[-1] == ("run.1", STARTED)
        by_action.look(3.0)
    else:
        by_action.controller.sent[0][2](ended)
    told = by_action.heard[-1]
    assert (told.event, told.message, told.error_code) == (ABORTED, message, code)
    assert by_action.lost == ["run.1"]
    by_action.look(9.0)
    assert by_action.heard[-1] is told


def test_a_plan_that_is_left_and_then_replaced_is_aborted(by_action: World) -> None:
    broken(by_action, may_have_ended=True)
    by_action.publish("run.2", start=2.5, goal=9.0)
    by_action.look(2.5)
    by_action.controller.sent[1][1]()
    by_action.look(2.6)
    assert by_action.events[-2:] == [("run.1", ABORTED), ("run.2", STARTED)]
    assert (by_action.heard[-2].message, by_action.heard[-2].successor) == ("broken: it stands", "")


def test_the_reference_is_not_compared_once_the_controller_has_another_plan(
    by_action: World,
) -> None:
    by_action.publish("run.1", start=1.0, goal=9.0)
    by_action.look(1.0 - LEAD)
    watch: Any = by_action.execution.watch
    watch.replaced.reset_mock()
    by_action.publish("run.2", start=4.0, goal=9.0)
    by_action.look(3.0)
    watch.replaced.assert_not_called()
    by_action.look(4.0 - LEAD)
    watch.replaced.assert_called_once_with(round((4.0 - LEAD) * NANOSECONDS))


class Reached:
    """A client of an action whose server is there or not, and answers when the test wants."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now, self.node, self.told = 0.0, Mock(), list[Ended]()
        self.action, self.handle = Mock(), Mock(accepted=True)
        patch.setattr(controller, "ActionClient", self.action)
        patch.setattr(controller, "time", SimpleNamespace(monotonic=lambda: self.now))
        self.group = Mock()
        client = ControllerClient(self.node, load_parameters().controller, self.group)
        self.client, self.timer = client, self.node.create_timer.return_value
        _, self.look, *_ = self.node.create_timer.call_args.args
        client.send(JointTrajectory(), lambda: None, self.told.append)
        (answered,) = self.action.return_value.send_goal_async.return_value.method_calls[0].args
        answered(Mock(result=lambda: self.handle))

    def pass_time(self, seconds: float, is_there: bool = True) -> None:
        self.action.return_value.server_is_ready.return_value = is_there
        for _ in range(round(4 * seconds)):
            self.now += 0.25
            self.look()

    def answer(self, status: int) -> None:
        asked = self.handle.get_result_async.return_value.add_done_callback.call_args_list[-1]
        result = SimpleNamespace(error_code=0, error_string="")
        asked.args[0](Mock(result=lambda: SimpleNamespace(status=status, result=result)))


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch) -> Reached:
    return Reached(monkeypatch)


def test_a_controller_that_is_gone_has_ended_its_goal(reached: Reached) -> None:
    reached.pass_time(30.0)
    for _ in range(5):  # discovery loses it for a moment
        reached.pass_time(2.0, is_there=False)
        reached.pass_time(0.5)
    assert not reached.told
    reached.pass_time(4.0, is_there=False)
    (ended,) = reached.told
    assert "its controller is gone from joint_trajectory_controller" in ended.words
    assert not ended.succeeded
    reached.answer(GoalStatus.STATUS_SUCCEEDED)
    assert len(reached.told) == 1


def test_a_controller_that_was_started_anew_is_asked_and_knows_no_such_goal(
    reached: Reached,
) -> None:
    reached.pass_time(3600.0)
    assert not reached.told
    asked = reached.handle.get_result_async.call_count
    assert 3600 / 60 <= asked <= 3600 / 60 + 8, "it keeps every question until the goal's end"
    reached.answer(GoalStatus.STATUS_UNKNOWN)
    (ended,) = reached.told
    assert "knows no such goal" in ended.words
    reached.timer.reset_mock()
    reached.pass_time(0.25)
    reached.timer.cancel.assert_called_once_with()
    assert reached.handle.get_result_async.call_count == asked


def test_the_controller_is_asked_only_in_the_callbacks_that_take_its_answers(
    reached: Reached, by_action: World
) -> None:
    """From elsewhere, an answer could come before rclpy knows of the question, and is lost."""
    reached.handle.get_result_async.assert_not_called()  # by the callback of a future
    assert reached.action.call_args.kwargs["callback_group"] is reached.group
    assert reached.node.create_timer.call_args.args[2] is reached.group
    reached.client.cancel()
    reached.handle.cancel_goal_async.assert_not_called()
    reached.pass_time(0.25)
    reached.handle.get_result_async.assert_called_once_with()
    reached.handle.cancel_goal_async.assert_called_once_with()
    sends = by_action.node.create_timer.call_args.args[2]
    assert by_action.controller.group is sends


@pytest.mark.parametrize(
    ("status", "code", "ended"),
    [
        (GoalStatus.STATUS_SUCCEEDED, 0, Ended("the controller: so", succeeded=True)),
        (GoalStatus.STATUS_CANCELED, 0, Ended("the controller's goal was cancelled")),
        (
            GoalStatus.STATUS_ABORTED,
            FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED,
            Ended("the controller aborted it: PATH_TOLERANCE_VIOLATED: so", error_code=-4),
        ),
        (
            GoalStatus.STATUS_ABORTED,
            FollowJointTrajectory.Result.INVALID_GOAL,
            Ended("the controller aborted it: INVALID_GOAL: so", False, -1, is_replaced=True),
        ),
    ],
)
def test_a_result_is_told_in_the_actions_words(status: int, code: int, ended: Ended) -> None:
    result = SimpleNamespace(error_code=code, error_string="so")
    assert ended_by(SimpleNamespace(status=status, result=result)) == ended


@pytest.mark.parametrize("position", [0.0, 0.05])
def test_a_joint_that_is_to_move_at_the_end_need_not_have_stopped(position: float) -> None:
    """The controller would want its rate and its place for ever: those of the last point."""
    points = [JointTrajectoryPoint(velocities=[9.0, 9.0]), JointTrajectoryPoint()]
    points[1].velocities = [0.0, -0.02]
    trajectory = JointTrajectory(joint_names=["shoulder", "elbow"], points=points)
    settings = replaced(load_parameters(), "controller.goal_tolerance", position).controller
    told = {one.name: one for one in controller_goal(trajectory, settings).goal_tolerance}
    assert (told["elbow"].position, told["elbow"].velocity) == (position, -1.0)
    assert told.keys() == ({"elbow", "shoulder"} if position else {"elbow"})
    assert not position or told["shoulder"].velocity == 0.0


def test_tolerances_that_are_not_given_are_the_controllers() -> None:
    trajectory = JointTrajectory(joint_names=["shoulder", "elbow"])
    silent = controller_goal(trajectory, load_parameters().controller)
    assert silent == FollowJointTrajectory.Goal(trajectory=trajectory)
    settings = load_parameters()
    for name, value in (("path", 0.05), ("goal", -1.0), ("goal_time", -1.0)):
        settings = replaced(settings, f"controller.{name}_tolerance", value)
    told = controller_goal(trajectory, settings.controller)
    for tolerances, value in ((told.path_tolerance, 0.05), (told.goal_tolerance, -1.0)):
        assert [one.name for one in tolerances] == ["shoulder", "elbow"]
        assert {one.position for one in tolerances} == {value}
        assert {(one.velocity, one.acceleration) for one in tolerances} == {(0.0, 0.0)}
    # As the controller reads it: seconds and nanoseconds together.
    assert told.goal_time_tolerance.sec + told.goal_time_tolerance.nanosec / 1e9 == -1.0
