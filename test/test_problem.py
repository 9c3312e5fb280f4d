"""What may be asked of the planner."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Objective, Obstacle, PlanningProblem, Target

TARGET: dict[str, Any] = {
    "position": [1.0, 2.0, 3.0],
    "quaternion_xyzw": [0.0, 0.6, 0.0, 0.8],
    "linear_velocity": [0.1, 0.2, 0.3],
    "angular_velocity": [0.4, 0.5, 0.6],
    "linear_acceleration": [0.7, 0.8, 0.9],
    "angular_acceleration": [1.0, 1.1, 1.2],
}


def test_a_target_holds_what_it_was_given() -> None:
    target = Target(**TARGET)
    for name, value in TARGET.items():
        np.testing.assert_allclose(getattr(target, name), value, rtol=1e-15)


def test_a_target_is_at_rest_unless_told_otherwise() -> None:
    target = Target(TARGET["position"], TARGET["quaternion_xyzw"])
    for name in list(TARGET)[2:]:
        np.testing.assert_array_equal(getattr(target, name), np.zeros(3))


@pytest.mark.parametrize("name", TARGET)
@pytest.mark.parametrize(
    ("spoil", "status"),
    [
        (lambda value: [np.nan, *value[1:]], Status.NOT_FINITE),
        (lambda value: value[1:], Status.WRONG_SIZE),
        (lambda _: "here", Status.WRONG_SIZE),
    ],
)
def test_a_target_that_is_no_place_is_refused_by_name(
    name: str, spoil: Any, status: Status
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        Target(**{**TARGET, name: spoil(TARGET[name])})
    assert (refusal.value.status, refusal.value.field) == (status, f"target.{name}")


def test_a_target_quaternion_that_is_not_of_unit_length_is_refused() -> None:
    with pytest.raises(InvalidInput) as refusal:
        Target(**{**TARGET, "quaternion_xyzw": [0.0, 0.0, 0.0, 2.0]})
    assert refusal.value.status is Status.BAD_QUATERNION


@pytest.mark.parametrize("name", TARGET)
def test_a_target_cannot_be_written_to(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(Target(**TARGET), name)[0] = 0.0


@pytest.mark.parametrize(
    ("center", "radius", "status", "field"),
    [
        ([0.0, 0.0], 0.2, Status.WRONG_SIZE, "obstacles[mast].center"),
        ([0.0, np.inf, 0.0], 0.2, Status.NOT_FINITE, "obstacles[mast].center"),
        ([0.0, 0.0, 0.0], 0.0, Status.OUT_OF_RANGE, "obstacles[mast].radius"),
        ([0.0, 0.0, 0.0], -0.2, Status.OUT_OF_RANGE, "obstacles[mast].radius"),
        ([0.0, 0.0, 0.0], np.nan, Status.NOT_FINITE, "obstacles[mast].radius"),
    ],
)
def test_a_sphere_that_is_none_is_refused_by_its_id(
    center: list[float], radius: float, status: Status, field: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        Obstacle.sphere("mast", center, radius)
    assert (refusal.value.status, refusal.value.field) == (status, field)


def test_a_sphere_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Obstacle.sphere("mast", np.zeros(3), 1.0).motion.position[0] = 1.0


@pytest.mark.parametrize(("length", "attitude"), [(1.0, 0.0), (0.0, 1.0), (0.3, 7.0)])
def test_an_objective_needs_one_positive_weight(length: float, attitude: float) -> None:
    objective = Objective(length, attitude)
    assert (objective.joint_path_length, objective.chaser_attitude) == (length, attitude)


@pytest.mark.parametrize(
    ("length", "attitude", "status", "field"),
    [
        (0.0, 0.0, Status.OUT_OF_RANGE, "objective"),
        (-1.0, 1.0, Status.OUT_OF_RANGE, "objective.joint_path_length"),
        (1.0, -1.0, Status.OUT_OF_RANGE, "objective.chaser_attitude"),
        (np.nan, 1.0, Status.NOT_FINITE, "objective.joint_path_length"),
        (1.0, np.inf, Status.NOT_FINITE, "objective.chaser_attitude"),
    ],
)
def test_weights_that_mean_nothing_are_refused(
    length: float, attitude: float, status: Status, field: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        Objective(length, attitude)
    assert (refusal.value.status, refusal.value.field) == (status, field)


@pytest.mark.parametrize(
    ("name", "value", "status"),
    [
        ("duration", 0.0, Status.OUT_OF_RANGE),
        ("duration", -10.0, Status.OUT_OF_RANGE),
        ("duration", np.nan, Status.NOT_FINITE),
        ("duration", np.inf, Status.NOT_FINITE),
        ("points", 4, Status.OUT_OF_RANGE),
        ("points", 10_001, Status.OUT_OF_RANGE),
    ],
)
def test_a_problem_out_of_range_is_refused_by_name(
    lemur_capture: PlanningProblem, name: str, value: float, status: Status
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        replace(lemur_capture, **{name: value})
    assert (refusal.value.status, refusal.value.field) == (status, name)


@pytest.mark.parametrize("points", [5, 10_000])
def test_the_fewest_and_the_most_points_pass(lemur_capture: PlanningProblem, points: int) -> None:
    assert replace(lemur_capture, points=points).points == points


def test_a_start_with_another_number_of_joints_is_refused(lemur_capture: PlanningProblem) -> None:
    six = replace(lemur_capture.start, joint_positions=np.zeros(6), joint_velocities=np.zeros(6))
    with pytest.raises(InvalidInput) as refusal:
        replace(lemur_capture, start=six)
    assert refusal.value.status is Status.WRONG_SIZE
    assert refusal.value.field == "joints.position"
