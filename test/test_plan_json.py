"""The answer in JSON: what is read back is what was planned, and what is missing is named."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from ff_planner_ros.analysis.plan_document import plan_document, planned_motion
from ff_planner_ros.analysis.plan_json import plan_dictionary, refusal_dictionary
from ff_planner_ros.common.arrays import frozen
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask


@pytest.fixture
def answer(lemur_capture: PlanningProblem, lemur_plan: Plan) -> dict[str, Any]:
    """What a file gives back."""
    task = PlanningTask(lemur_capture, load_parameters().planner)
    return json.loads(json.dumps(plan_dictionary(lemur_plan, task, 0.5)))


def test_robot_and_motion_come_back_to_the_last_bit(
    answer: dict[str, Any], lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    robot, motion = planned_motion(answer)
    assert robot.urdf == lemur_capture.robot.urdf
    assert (robot.base_link, robot.tip_link) == ("chaser", "end_effector")
    for item in fields(motion):
        wanted = getattr(lemur_plan.trajectory, item.name)
        assert getattr(motion, item.name).tolist() == wanted.tolist()


def test_a_refusal_has_no_motion_and_tells_its_cause() -> None:
    refusal = refusal_dictionary(NoPlanFound(Status.COLLISION, "c1 is in the way"), 0.1)
    with pytest.raises(InvalidInput, match=r"status is collision \(c1 is in the way\)"):
        planned_motion(refusal)


@pytest.mark.parametrize("name", ["status", "robot", "joint_names", "joint_torques", "time"])
def test_what_is_missing_is_named(answer: dict[str, Any], name: str) -> None:
    del answer[name]
    with pytest.raises(InvalidInput, match=f"^{name} is missing"):
        planned_motion(answer)


@pytest.mark.parametrize("name", ["urdf", "base_link", "tip_link"])
def test_what_is_missing_of_the_robot_is_named(answer: dict[str, Any], name: str) -> None:
    del answer["robot"][name]
    with pytest.raises(InvalidInput, match=rf"^robot\.{name} is missing"):
        planned_motion(answer)


@pytest.mark.parametrize("other", [[], "solved", 3, None])
def test_other_json_is_no_answer(other: object) -> None:
    with pytest.raises(InvalidInput, match="status is missing"):
        planned_motion(other)


@pytest.mark.parametrize("rows", [[[1.0], [1.0, 2.0]], "many", [{}], [[1.0, "1"]], [[True, 1.0]]])
def test_rows_that_are_no_array_are_named(answer: dict[str, Any], rows: object) -> None:
    answer["joint_torques"] = rows
    with pytest.raises(InvalidInput, match="joint_torques is no array"):
        planned_motion(answer)


def test_joints_of_another_robot_are_refused(answer: dict[str, Any]) -> None:
    answer["joint_names"].reverse()
    with pytest.raises(InvalidInput, match=r"joint_names is .*joint_1, joint_2"):
        planned_motion(answer)


@pytest.mark.parametrize(
    ("orientation", "free_axis"),
    [("fixed", None), ("free", None), ("about_axis", [0.0, 0.6, 0.8])],
)
def test_the_target_comes_back(
    orientation: str,
    free_axis: list[float] | None,
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
) -> None:
    axis = None if free_axis is None else frozen(free_axis)
    target = replace(
        lemur_capture.target, orientation=Orientation(orientation), free_axis_in_ee=axis
    )
    task = PlanningTask(replace(lemur_capture, target=target), load_parameters().planner)
    found = plan_document(json.loads(json.dumps(plan_dictionary(lemur_plan, task, 0.5)))).scene.goal
    assert found is not None
    assert found.orientation is target.orientation
    assert found.position.tolist() == target.position.tolist()
    assert found.quaternion_xyzw.tolist() == target.quaternion_xyzw.tolist()
    assert (found.free_axis_in_ee is None) == (free_axis is None)
    if free_axis is not None:
        np.testing.assert_array_equal(found.free_axis_in_ee, free_axis)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ([1, 2], "target is .* it must hold position, quaternion_xyzw"),
        ({"position": [1, 2, 3]}, "target.quaternion_xyzw is missing"),
        ({"position": [1, 2], "quaternion_xyzw": [0, 0, 0, 1]}, "must have 3 entries"),
        ({"position": [1, 2, 3], "quaternion_xyzw": [0, 0, 0, 0]}, "its norm must be 1"),
        (
            {"position": [1, 2, 3], "quaternion_xyzw": [0, 0, 0, 1], "orientation": [1]},
            "it must be fixed, free or about_axis",
        ),
    ],
)
def test_a_target_that_makes_no_sense_is_refused(
    target: object, message: str, answer: dict[str, Any]
) -> None:
    with pytest.raises(InvalidInput, match=message):
        plan_document(answer | {"target": target})
