"""What a configured planner tells of itself and forgets, without a node and its topics."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from ff_planner_msgs.msg import TargetBody
from heard_inputs import HeardScenes, HeardStates
from rclpy.clock import ClockChange, ROSClock
from robots import LEMUR_URDF
from ros_processes import FRAME, Scene
from test_diagnostics import WELL

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.ros import session
from ff_planner_ros.ros.messages.to_messages import target_body_message, time_message
from ff_planner_ros.ros.outputs.clock_health import ClockWatch
from ff_planner_ros.ros.outputs.diagnostics import NodeHealth, diagnostics
from ff_planner_ros.ros.session import Session

NOW = 1_000 * NANOSECONDS
# No two limits that are compared may be alike.
_USUAL = load_parameters()
PARAMETERS = replace(_USUAL, tracking=replace(_USUAL.tracking, max_position=0.04, max_angle=0.07))


class Configured:
    """A session with inputs that are fed, and a clock that stands still."""

    def __init__(self, problem: PlanningProblem, patch: pytest.MonkeyPatch) -> None:
        robot, self.scene = problem.robot, Scene(problem)
        self.now_ns = NOW
        self.states = HeardStates(robot, PARAMETERS, lambda: self.now_ns)
        self.scenes = HeardScenes(lambda: self.now_ns)
        self.output, self.service, self.node = (
            Mock(tracking=(), execution=Mock(last=None, controller=None)),
            Mock(last=None),
            Mock(),
        )
        self.output.execution = Mock(last=None, controller=None)
        self.service.solve_times = []
        self.node.get_clock.return_value.now.return_value = SimpleNamespace(
            nanoseconds=NOW, to_msg=lambda: time_message(NOW)
        )
        self.health: list[NodeHealth] = []
        patch.setattr(session, "diagnostics", lambda health, *_: self.health.append(health))
        patch.setattr(session, "namesakes", lambda _: [])
        self.session = Session.__new__(Session)
        vars(self.session).update(
            _node=self.node,
            _parameters=PARAMETERS,
            _solver=Mock(is_warm=True),
            _states=self.states,
            _robots=None,
            _scenes=self.scenes,
            _output=self.output,
            _service=self.service,
            _recorder=Mock(),
            _diagnostics=Mock(),
            _robot=problem.robot,
            _controller=Mock(read=None, controller="", complaint=""),
            _namesakes=[],
            _clock=ClockWatch(self.node),
            _middleware=Mock(heard=lambda _: ["/mapper"], unheard=lambda _: []),
        )

    def diagnosed(self) -> NodeHealth:
        self.session._diagnose()
        return self.health[-1]

    def hear(self, age: float, x: float = 0.0) -> None:
        stamp_ns = NOW - round(age * NANOSECONDS)
        state = self.scene.state(stamp_ns)
        state.pose.position.x += x
        self.states.hear("chaser_state", state)
        obstacles = self.scene.obstacles()
        obstacles.header.stamp, obstacles.source = time_message(stamp_ns), "mapper"
        self.scenes.hear(obstacles)

    def hear_body(self, age: float, **changes: Any) -> None:
        body = tumbling.problem("tumbling", 0).target_body
        assert body is not None
        message: TargetBody = target_body_message(body, NOW - round(age * NANOSECONDS), FRAME)
        for name, value in changes.items():
            setattr(message, name, value)
        self.scenes.hear_body(message)


@pytest.fixture
def configured(lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch) -> Configured:
    return Configured(lemur_capture, monkeypatch)


def test_a_question_for_the_description_is_answered_as_soon_as_it_can_be_asked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The executor runs while the node is configured."""
    asked = list[bool]()

    def described(_node: Any, _robot: Any, _parameters: Any, is_active: Any) -> Any:
        asked.append(is_active())
        return nullcontext()

    for name in ("ClockWatch", "PlanOutput", "PlanningService", "Middleware"):
        monkeypatch.setattr(session, name, Mock())
    monkeypatch.setattr(session, "recording", lambda *_: nullcontext(Mock()))
    monkeypatch.setattr(session, "description_service", described)
    session.PlanningService.return_value.is_active = False
    monkeypatch.chdir(tmp_path)
    Session(Mock(), PARAMETERS, Mock())
    assert asked == [False]


@pytest.mark.parametrize("listens", [True, False])
def test_its_own_recorder_is_no_viewer_and_one_that_hears_nothing_is_none(
    configured: Configured, listens: bool
) -> None:
    vars(configured.session)["_recorder"].listens = listens
    configured.diagnosed()
    configured.output.preview.look_for_viewers.assert_called_once_with(1 if listens else 0)


def test_what_was_not_received_yet_has_no_age(configured: Configured) -> None:
    health = configured.diagnosed()
    assert (health.state_age, health.obstacles, health.target_age) == (None, None, None)
    assert (health.state_refusal, health.obstacles_refusal, health.target_refusal) == ("", "", "")


def shown(health: NodeHealth) -> Any:
    """What diagnostics say of inputs."""
    names = ("state_age", "obstacles", "obstacles_age", "target_age", "target_max_age")
    given = {name: getattr(health, name) for name in names}
    return diagnostics(replace(WELL, **given), "ff_planner", time_message(0)).status[:3]


def test_what_is_not_stamped_has_no_age_and_limits_that_are_told_are_those_in_force(
    configured: Configured,
) -> None:
    """By the clock of a real day, which is not 1,000 s after the first of January 1970."""
    now_ns = configured.now_ns = 1_793_000_000 * NANOSECONDS
    configured.node.get_clock.return_value.now.return_value = SimpleNamespace(
        nanoseconds=now_ns, to_msg=lambda: time_message(now_ns)
    )
    configured.hear(NOW / NANOSECONDS)  # all stamps are zero
    configured.hear_body(NOW / NANOSECONDS)
    health = configured.diagnosed()
    assert health.obstacles == len(configured.scene.obstacles().spheres)
    assert (health.obstacles_age, health.obstacles_refusal) == (None, "")
    told = shown(health)
    assert not any("1793000000" in one.message or "e+0" in one.message for one in told)
    said = [one.message for one in told if "not stamped" in one.message]
    assert len(said) == 3
    assert f"may be {PARAMETERS.state_max_age:g} s old" in said[0]
    assert f"may be {PARAMETERS.target_max_age:g} s old" in said[2]
    configured.hear(-1.5e9)  # nine years old
    part = shown(configured.diagnosed())[0]
    assert "s old, allowed" in part.message
    assert f"allowed are {PARAMETERS.state_max_age:g} s" in part.message


@pytest.mark.parametrize("age", [0.0, 0.3, 7.0, -0.01])
def test_each_age_is_how_long_ago_that_was_measured(configured: Configured, age: float) -> None:
    """However old: that it is too old to plan from, the diagnostics say."""
    configured.hear(age)
    configured.hear_body(2.0 * age)
    health = configured.diagnosed()
    assert health.state_age == pytest.approx(age)
    assert health.obstacles_age == pytest.approx(age)
    assert health.obstacles_source == "mapper"
    assert health.target_age == pytest.approx(2.0 * age)
    assert health.obstacles == len(configured.scene.obstacles().spheres)
    assert (health.state_max_age, health.target_max_age) == (
        PARAMETERS.state_max_age,
        PARAMETERS.target_max_age,
    )
    assert health.allowed is PARAMETERS.tracking


def test_what_cannot_be_used_is_told_with_its_reason(configured: Configured) -> None:
    configured.hear(0.0, x=float("nan"))
    obstacles = configured.scene.obstacles()
    obstacles.header.frame_id = "elsewhere"
    configured.scenes.hear(obstacles)
    configured.hear_body(-5.0)
    health = configured.diagnosed()
    assert "chaser_state.pose.position" in health.state_refusal
    assert "obstacles.header.frame_id" in health.obstacles_refusal
    assert "5.000 s ahead of its arrival" in health.target_refusal


def test_a_locked_joint_that_is_measured_elsewhere_is_told_with_what_to_set(
    configured: Configured, lemur_capture: PlanningProblem
) -> None:
    robot = load_robot(LEMUR_URDF, "chaser", "end_effector", held_at={"joint_1": 0.3})
    states = HeardStates(robot, PARAMETERS, lambda: NOW)
    vars(configured.session).update(_states=states)
    state = Scene(lemur_capture).state(NOW)
    state.joint_positions[0], state.joint_velocities[0] = 0.3, 0.0
    states.hear("chaser_state", state)
    assert configured.diagnosed().state_refusal == ""
    state.joint_positions[0] = 1.2
    states.hear("chaser_state", state)
    refusal = configured.diagnosed().state_refusal
    assert 'robot.locked_joints to "joint_1: 1.2"' in refusal
    assert f"{PARAMETERS.locked_joint_tolerance:g} rad are allowed" in refusal
    configured.session._stream()  # where the chaser is can be told all the same
    (measured,) = configured.output.stream.call_args.args
    assert measured is not None


def test_only_a_state_that_may_be_planned_from_is_held_against_the_plan(
    configured: Configured,
) -> None:
    configured.session._stream()
    configured.hear(PARAMETERS.state_max_age + 0.1)
    configured.session._stream()
    assert [call.args for call in configured.output.stream.call_args_list] == [(None,), (None,)]
    configured.hear(PARAMETERS.state_max_age - 0.1)
    configured.session._stream()
    (measured,) = configured.output.stream.call_args.args
    assert measured.stamp_ns == NOW - round((PARAMETERS.state_max_age - 0.1) * NANOSECONDS)


@pytest.mark.law("NODE-15")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (ClockChange.ROS_TIME_NO_CHANGE, "has jumped back by 2.500 s"),
        (ClockChange.ROS_TIME_ACTIVATED, "is the simulated one from now on"),
        (ClockChange.ROS_TIME_DEACTIVATED, "is the system's from now on"),
    ],
)
def test_when_the_clock_jumps_states_plans_and_requests_are_forgotten_but_not_the_scene(
    configured: Configured, change: ClockChange, words: str
) -> None:
    configured.hear(0.0)
    jump: Any = SimpleNamespace(
        clock_change=change, delta=SimpleNamespace(nanoseconds=-2_500_000_000)
    )
    is_jump = change == ClockChange.ROS_TIME_NO_CHANGE
    configured.node.get_publishers_info_by_topic.return_value = [
        SimpleNamespace(node_namespace="/", node_name=name) for name in ("sim", "bag")
    ]
    clock = configured.node.get_clock.return_value
    clock.__class__, clock.ros_time_is_active = ROSClock, True
    configured.session._forget(jump)
    health = configured.diagnosed()
    told = health.clock.jumps, health.clock.furthest, health.clock.publishers
    assert told == ((1, 2.5, ["/bag", "/sim"]) if is_jump else (0, 0.0, []))
    assert health.state_age is None
    assert health.state_since == "since the clock has jumped back or changed"
    assert health.obstacles is not None
    configured.output.forget.assert_called_once_with(f"the node's clock {words}")
    status, message = configured.service.give_up.call_args.args
    assert status is Status.CLOCK_JUMPED
    assert words in message
