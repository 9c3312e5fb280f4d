"""The planning service where the real node cannot be brought to fail."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.action import CancelResponse, GoalResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from ros_processes import DEADLINE, FRAME, Scene, private_domain
from unique_identifier_msgs.msg import UUID

from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.obstacles import ObstacleBody
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.ros.inputs import scene_input
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.messages.interfaces import SEND_GOAL
from ff_planner_ros.ros.messages.to_messages import bodies_message
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.outputs.preview import Preview
from ff_planner_ros.ros.parameters import LiveParameters
from ff_planner_ros.ros.requests.planning_service import PlanningService
from ff_planner_ros.ros.requests.worker import Worker


@contextmanager
def service(
    problem: PlanningProblem, monkeypatch: pytest.MonkeyPatch, **overrides: Any
) -> Iterator[tuple[PlanningService, Mock, Mock]]:
    """The service on a node in this process, its worker, its logger."""
    with private_domain():
        rclpy.init(args=[])
        node = LifecycleNode(
            "test",
            parameter_overrides=[
                Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()
            ],
        )
        executor = SingleThreadedExecutor()  # which the node knows only as long as it is held here
        executor.add_node(node)
        logger, worker = Mock(), Mock(spec=Worker)
        monkeypatch.setattr(node, "get_logger", lambda: logger)
        answering = PlanningService(
            node,
            LiveParameters(node),
            problem.robot,
            worker,
            Mock(spec=StateInput),
            SceneInput("inertial"),
            Mock(spec=PlanOutput, published=None, preview=Mock(spec=Preview)),
            "run",
            None,
        )
        answering.activate()
        yield answering, worker, logger
        rclpy.shutdown()


def answer(answering: PlanningService, request: PlanRequest) -> PlanAnswer:
    asked = PlanTrajectory.Request(request=request)
    return answering._serve(asked, PlanTrajectory.Response()).answer


@pytest.mark.law("NODE-01")
def test_an_error_that_nobody_foresaw_is_answered_and_logged_with_its_traceback(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, logger):
        worker.solve.side_effect = ZeroDivisionError("nobody foresaw this")
        response = answer(answering, Scene(lemur_capture).complete_request())
    assert response.status.code == Status.INTERNAL_ERROR
    assert response.status.message == "ZeroDivisionError: nobody foresaw this"
    assert response.plan_id == "run.1"
    (logged,) = logger.error.call_args.args
    assert f'File "{Path(__file__).parent.parent}' in logged


@pytest.mark.parametrize(("asked", "granted"), [(0.0, 7.5), (2.5, 2.5)])
def test_the_budget_is_the_requests_or_else_the_parameters(
    lemur_capture: PlanningProblem,
    monkeypatch: pytest.MonkeyPatch,
    asked: float,
    granted: float,
) -> None:
    with service(lemur_capture, monkeypatch, time_budget=7.5) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.TIMED_OUT, "too slow")
        request = Scene(lemur_capture).complete_request()
        request.search.time_budget = asked
        assert answer(answering, request).status.code == Status.TIMED_OUT
        task, budget, *_ = worker.solve.call_args.args
    assert budget == Budget(granted)
    assert task.problem.duration == request.duration


def test_a_budget_covers_the_waiting_for_obstacles(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        mapper = Mock(heard=lambda _: ["/mapper"], unheard=lambda _: [])
        monkeypatch.setattr(answering._scenes, "_publishers", mapper)
        for patience in ("_DISCOVERY", "_MATCHED"):
            monkeypatch.setattr(scene_input, patience, 10.0 * DEADLINE)
        request = Scene(lemur_capture).complete_request()
        request.search.time_budget = 0.2
        request.scene = []
        assert answer(answering, request).status.code == Status.NO_OBSTACLES
        worker.solve.assert_not_called()


@pytest.mark.parametrize("asked", [0.0, 2.5])
def test_the_attitude_has_a_budget_of_its_own_unless_the_request_says(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch, asked: float
) -> None:
    with service(lemur_capture, monkeypatch, attitude_time_budget=1.5) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.TIMED_OUT, "too slow")
        request = Scene(lemur_capture).complete_request()
        request.objective.chaser_attitude, request.search.time_budget = 0.5, asked
        answer(answering, request)
        _, budget, *_ = worker.solve.call_args.args
    assert budget.with_plan == (np.inf if asked else 1.5)


@pytest.mark.parametrize(
    ("overrides", "limited"), [({}, True), ({"limits__velocity": "none"}, False)]
)
def test_joint_rates_are_limited_unless_the_parameter_says_otherwise(
    lemur_capture: PlanningProblem,
    monkeypatch: pytest.MonkeyPatch,
    overrides: dict[str, Any],
    limited: bool,
) -> None:
    with service(lemur_capture, monkeypatch, **overrides) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked")
        answer(answering, Scene(lemur_capture).complete_request())
        (task, *_) = worker.solve.call_args.args
    assert task.problem.limits.joint_velocities is limited


def a_goal(problem: PlanningProblem) -> Mock:
    goal = PlanTrajectoryAction.Goal(request=Scene(problem).complete_request())
    return Mock(goal_id=UUID(uuid=[7] * 16), request=goal, is_cancel_requested=True, status=5)


def asked(goal: Mock) -> SEND_GOAL.Request:
    """Return what the goal's client has sent, with the very request that rclpy hands on."""
    request = SEND_GOAL.Request(goal_id=goal.goal_id, goal=goal.request)
    assert request.goal is goal.request
    return request


def test_a_goal_that_rclpy_does_not_hand_over_leaves_the_planner_free(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked")
        goal = a_goal(lemur_capture)
        answering._action._arrive(arrived := asked(goal))
        assert answering._action._decide(goal.request) is GoalResponse.ACCEPT
        request = Scene(lemur_capture).complete_request()
        assert answer(answering, request).status.code == Status.BUSY
        answering._action._depart(arrived)
        assert answer(answering, request).status.code == Status.COLLISION
        assert answering._action._goals == {}


def test_a_goal_that_cannot_be_taken_is_refused_and_its_answer_told(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, logger):
        answering._action._events = events = Mock()
        answering.deactivate(Status.NOT_ACTIVE, "the planner is not active any more", 0.0)
        goal = a_goal(lemur_capture)
        answering._action._arrive(arrived := asked(goal))
        assert answering._action._decide(goal.request) is GoalResponse.REJECT
        answering._action._depart(arrived)
        assert answering._action._goals == {}
        result, status, told = events.result_sent.call_args.args
        assert (answering.last.plan_id, answering.last.status) == ("run.1", Status.NOT_ACTIVE)
    events.goal_received.assert_called_once_with(arrived)
    assert (result.goal_id, status) == (goal.goal_id, GoalStatus.STATUS_UNKNOWN)
    assert told.status.message == "the planner is not active any more"
    (logged,) = logger.warning.call_args.args
    assert logged == "run.1: NOT_ACTIVE: the planner is not active any more"
    worker.solve.assert_not_called()


def test_a_goal_that_is_cancelled_before_rclpy_hands_it_over_is_not_planned(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        goal = a_goal(lemur_capture)
        answering._action._arrive(asked(goal))
        assert answering._action._cancel(goal) is CancelResponse.ACCEPT
        answering._action._accept(goal)
        result = answering._action._execute(goal).answer
    assert (result.status.code, result.plan_id) == (Status.CANCELLED, "run.1")
    goal.canceled.assert_called_once_with()
    worker.solve.assert_not_called()


def test_a_goal_that_is_cancelled_while_rclpy_begins_it_is_begun_all_the_same(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or else nobody would ever answer it."""
    with service(lemur_capture, monkeypatch) as (answering, _, _):
        goal = a_goal(lemur_capture)
        illegal = rclpy_implementation.RCLError("goal_handle attempted invalid transition")
        goal.execute.side_effect = [illegal, None]
        answering._action._arrive(asked(goal))
        answering._action._accept(goal)
    assert goal.execute.call_count == 2


@pytest.mark.ci
def test_a_refused_request_leaves_nothing_to_the_garbage_collector(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What hangs together in a circle stays until a full collection, huge arrays and all."""

    def blocked(*_: object) -> None:
        raise NoPlanFound(Status.COLLISION, "blocked")

    sound, spoilt = (Scene(lemur_capture).complete_request() for _ in range(2))
    spoilt.start_state[0].joint_names = []
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = blocked
        for request, status in ((sound, Status.COLLISION), (spoilt, Status.UNKNOWN_JOINT)):
            gc.collect()
            gc.set_debug(gc.DEBUG_SAVEALL)
            assert answer(answering, request).status.code == status
            gc.collect()
            gc.set_debug(0)
            left = [one for one in gc.garbage if isinstance(one, FfPlannerError)]
            gc.garbage.clear()
            assert left == []


def test_the_first_request_waits_for_obstacles_that_may_come_and_no_longer(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, waits = Scene(lemur_capture).complete_request(), list[bool]()
    request.scene = []
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked")
        scenes = answering._scenes

        def may_come() -> bool:
            waits.append(len(waits) < 5)
            return waits[-1]

        monkeypatch.setattr(scenes, "may_come", may_come)
        assert answer(answering, request).status.code == Status.NO_OBSTACLES
        assert waits[:6] == [True] * 5 + [False]
        waits.clear()

        def comes() -> bool:
            """They arrive after the request was read without them, before anybody asks again."""
            if waits:
                scenes.keep(Scene(lemur_capture).obstacles())
            waits.append(not waits)
            return waits[-1]

        monkeypatch.setattr(scenes, "may_come", comes)
        assert answer(answering, request).status.code == Status.COLLISION


def test_the_first_request_waits_for_bodies_that_are_on_their_way_but_not_beside_its_own_scene(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody needs to publish them: planned without, those that come a moment later are hit."""
    request, waits = Scene(lemur_capture).complete_request(), list[bool]()
    panel = ObstacleBody("panel", Solid("box", np.ones(3)), np.array([30.0, 0.0, 0.0]))
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked")
        scenes = answering._scenes
        scenes.keep(Scene(lemur_capture).obstacles())

        def may_come() -> bool:
            """They arrive after the request was read without them, before anybody asks again."""
            if waits:
                scenes.callbacks()["obstacle_bodies"](bodies_message((panel,), 0, FRAME))
            waits.append(not waits)
            return waits[-1]

        monkeypatch.setattr(scenes, "may_come", may_come)
        assert answer(answering, request).status.code == Status.COLLISION
        assert waits == [True]
        waits.clear()
        request.scene = []
        assert answer(answering, request).status.code == Status.COLLISION
        task = worker.solve.call_args.args[0]
        assert [one.id for one in task.problem.obstacle_bodies] == ["panel"]
