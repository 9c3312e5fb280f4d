"""The planning service where the real node cannot be brought to fail."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import rclpy
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from heard_inputs import HeardScenes
from rclpy.action import CancelResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from ros_processes import DEADLINE, Scene, private_domain
from unique_identifier_msgs.msg import UUID

from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.inputs import scene_input as scene_input_module
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.outputs.preview import Preview
from ff_planner_ros.ros.parameters import ParameterServer
from ff_planner_ros.ros.requests.planning_service import PlanningService
from ff_planner_ros.ros.requests.solver import Solver


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
        logger, worker, scenes = Mock(), Mock(spec=Solver), HeardScenes()
        monkeypatch.setattr(scene_input_module, "_DISCOVERY", 0.0)  # nothing is waited for
        monkeypatch.setattr(node, "get_logger", lambda: logger)
        answering = PlanningService(
            node,
            ParameterServer(node).fix(),
            problem.robot,
            worker,
            Mock(spec=StateInput),
            scenes,
            Mock(spec=PlanOutput, published=None, preview=Mock(spec=Preview)),
            Mock(spec=Exchanges),
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
        monkeypatch.setattr(answering._scenes.middleware, "names", ["/mapper"])
        for patience in ("_DISCOVERY", "_MATCHED"):
            monkeypatch.setattr(scene_input_module, patience, 10.0 * DEADLINE)
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


def test_each_request_is_told_when_it_comes_and_with_its_task_and_answer_at_its_end(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = Scene(lemur_capture).complete_request()
    spoilt = deepcopy(request)
    spoilt.start_state[0].joint_names = []
    spoilt.requester = "tester"
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked", effort=7)
        answers = [answer(answering, one) for one in (request, spoilt)]
        goal = a_goal(lemur_capture)
        answering._action._cancel(goal)
        answers.append(answering._action._execute(goal).answer)
        told = answering._exchanges.tell.call_args_list
    assert [call.args for call in told] == [
        ("received", "run.1", "service", "plan_trajectory"),
        ("answered", "run.1", "service", "plan_trajectory"),
        ("received", "run.2", "service", "tester"),
        ("answered", "run.2", "service", "tester"),
        ("received", "run.3", "action", "plan_trajectory_action"),
        ("cancelled", "run.3", "action", "plan_trajectory_action"),
    ]
    requests = [call.kwargs["request"] for call in told]
    assert requests[:4] == [request, request, spoilt, spoilt]
    first, second, third = (call.kwargs for call in told[1::2])
    assert [one["answer"] for one in (first, second, third)] == answers
    assert first["task"].effort == 7
    assert [one.task_digest for one in answers] == [first["task"].digest, "", ""]
    assert second["task"] is third["task"] is None


def a_goal(problem: PlanningProblem) -> Mock:
    goal = PlanTrajectoryAction.Goal(request=Scene(problem).complete_request())
    return Mock(goal_id=UUID(uuid=[7] * 16), request=goal, is_cancel_requested=True, status=5)


def test_a_goal_reserves_the_planner_when_it_is_accepted(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        worker.solve.side_effect = NoPlanFound(Status.COLLISION, "blocked")
        goal = a_goal(lemur_capture)
        answering._action._accept(goal)
        request = Scene(lemur_capture).complete_request()
        assert answer(answering, request).status.code == Status.BUSY
        assert answering._action._execute(goal).answer.status.code == Status.COLLISION
        assert answer(answering, request).status.code == Status.COLLISION
        assert answering._action._goals == {}
    goal.abort.assert_called_once_with()


def test_a_goal_that_cannot_be_taken_is_aborted_with_its_answer(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, logger):
        answering.deactivate(Status.NOT_ACTIVE, "the planner is not active any more", 0.0)
        goal = a_goal(lemur_capture)
        answering._action._accept(goal)
        answering.activate()
        told = answering._action._execute(goal).answer
        assert answering._action._goals == {}
        assert (answering.last.plan_id, answering.last.status) == ("run.1", Status.NOT_ACTIVE)
    goal.abort.assert_called_once_with()
    assert told.status.message == "the planner is not active any more"
    (logged,) = logger.warning.call_args.args
    assert logged == "run.1: NOT_ACTIVE: the planner is not active any more"
    worker.solve.assert_not_called()


def test_a_goal_that_is_cancelled_before_rclpy_hands_it_over_is_not_planned(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        goal = a_goal(lemur_capture)
        assert answering._action._cancel(goal) is CancelResponse.ACCEPT
        answering._action._accept(goal)
        result = answering._action._execute(goal).answer
        goal.is_active = False
        assert answering._action._cancel(goal) is CancelResponse.REJECT
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
                scenes.hear(Scene(lemur_capture).obstacles())
            waits.append(not waits)
            return waits[-1]

        monkeypatch.setattr(scenes, "may_come", comes)
        assert answer(answering, request).status.code == Status.COLLISION
        waits.clear()
        request = Scene(lemur_capture).complete_request()
        assert answer(answering, request).status.code == Status.COLLISION
        assert waits == [True], "its own scene is there"
