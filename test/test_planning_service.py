"""The planning service where the real node cannot be brought to fail."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest
import rclpy
from rclpy.node import Node
from ros_processes import Scene, private_domain

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.ros.parameters import declare_parameters
from ff_planner_ros.ros.planning_service import PlanningService
from ff_planner_ros.ros.worker import Worker


def test_an_error_that_nobody_foresaw_is_answered_and_logged_with_its_traceback(
    lemur_capture: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    with private_domain():
        rclpy.init(args=[])
        node = Node("test")
        logger = Mock()
        monkeypatch.setattr(node, "get_logger", lambda: logger)
        worker = Mock(spec=Worker)
        worker.solve.side_effect = ZeroDivisionError("nobody foresaw this")
        service = PlanningService(
            node, declare_parameters(node), lemur_capture.robot, worker, "run"
        )
        response = service._answer(Scene(lemur_capture).complete_request(), Mock())
        rclpy.shutdown()
    assert response.status.code == Status.INTERNAL_ERROR
    assert response.status.message == "ZeroDivisionError: nobody foresaw this"
    assert response.plan_id == "run.1"
    (logged,) = logger.error.call_args.args
    assert f'File "{Path(__file__).parent.parent}' in logged
