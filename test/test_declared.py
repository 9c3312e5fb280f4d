"""Fields that are declared once: their places in messages, both ways, and what older ones lack."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState, ObstacleSphere
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
from ff_planner_msgs.srv import PlanTrajectory

from ff_planner_ros.bench import tumbling
from ff_planner_ros.declared import (
    declared,
    names_in,
    places_in,
    value_at,
    values_in,
    write_object,
    write_value,
)
from ff_planner_ros.errors import Faults, InvalidInput, fields_named
from ff_planner_ros.planning.approach import CONE, Approach
from ff_planner_ros.planning.problem import (
    Limits,
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Sphere,
    Target,
)
from ff_planner_ros.planning.target_body import AttachedSphere, TargetBody
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.robot.state import SystemState

MESSAGE_OF = [
    (SystemState, ChaserState),
    (Sphere, ObstacleSphere),
    (AttachedSphere, ObstacleSphere),
    (TargetBody, TargetBodyMessage),
    (PlanningProblem, PlanTrajectory.Request),
    (PlanningTask, PlanTrajectory.Request),
]
# Of a request, what version 0.1 had, as a bag of that time is decoded.
FIRST_REQUEST = {
    "target_pose": SimpleNamespace(
        pose=SimpleNamespace(
            position=SimpleNamespace(x=1.0, y=2.0, z=3.0),
            orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
        )
    ),
    "target_twist": SimpleNamespace(
        linear=SimpleNamespace(x=0.0, y=0.0, z=0.1), angular=SimpleNamespace(x=0.0, y=0.0, z=0.0)
    ),
    "duration": 9.0,
    "weight_joint_path_length": 1.0,
    "weight_chaser_attitude": 0.0,
    "points": 21,
}


@pytest.mark.parametrize(("kind", "message"), MESSAGE_OF, ids=lambda kind: kind.__name__)
def test_every_declared_place_is_in_the_message(kind: type[Any], message: type[Any]) -> None:
    places = list(places_in(kind))
    assert places
    for key, place, one in places:
        found = value_at(message(), place)
        for slot in one.form.slots:
            assert isinstance(value_at(found, slot), float), key


def test_what_a_message_of_an_older_version_lacks_is_the_default_of_the_field() -> None:
    values = values_in(PlanningProblem, SimpleNamespace(**FIRST_REQUEST))
    assert values.keys() == {"target", "duration", "points", "objective"}
    assert values["objective"] == Objective(1.0, 0.0)
    assert values["target"].orientation is Orientation.FIXED
    assert values["target"].linear_velocity.tolist() == [0.0, 0.0, 0.1]


def test_a_message_that_lacks_what_every_version_had_is_none() -> None:
    del (request := SimpleNamespace(**FIRST_REQUEST)).weight_joint_path_length
    with pytest.raises(AttributeError, match="weight_joint_path_length"):
        values_in(PlanningProblem, request)
    assert value_at(request, "weight_joint_path_length", 2.0) == 2.0


def test_zero_no_text_and_no_entries_stand_for_the_default() -> None:
    request = PlanTrajectory.Request(duration=1.0, weight_joint_path_length=1.0)
    request.target_pose.pose.orientation.w = 1.0
    values = values_in(PlanningProblem, request)
    assert values.keys() == {"target", "duration", "points", "objective", "allowed_at_goal"}
    assert values["target"].free_axis_in_ee is None
    request.approach_distance, request.approach_direction.x = 0.1, 2.0
    assert values_in(PlanningProblem, request)["approach"].cone == CONE


def test_entries_that_are_zero_are_entries() -> None:
    """Accelerations of zero are known, and a limit of zero is not the parameter's."""
    state = ChaserState(joint_accelerations=[0.0, 0.0])
    assert len(values_in(SystemState, state)["joint_accelerations"]) == 2
    assert "joint_accelerations" not in values_in(SystemState, ChaserState())
    request = PlanTrajectory.Request(limit_accelerations=[0.0])
    request.target_pose.pose.orientation.w = request.weight_duration = 1.0
    assert values_in(PlanningProblem, request)["limits"] == {"joint_accelerations": (0.0,)}
    first = SimpleNamespace(**FIRST_REQUEST, limit_chaser_attitude=0.2)
    assert values_in(PlanningProblem, first)["limits"] == {"chaser_attitude": 0.2}


def test_what_is_said_in_a_message_comes_back_out_of_it_to_the_last_bit(
    lemur_capture: PlanningProblem,
) -> None:
    """Every declared field has a value of its own that is not its default."""
    asked = replace(
        lemur_capture,
        target=Target(
            np.array([0.1, 0.2, 0.3]),
            np.array([0.1, -0.2, 0.3, 0.9]) / np.sqrt(0.95),
            np.array([0.01, 0.02, -0.0]),
            orientation=Orientation.ABOUT_AXIS,
            free_axis_in_ee=np.array([0.6, 0.8, 0.0]),
        ),
        points=33,
        objective=Objective(0.5, 0.25, 0.125),
        limits=Limits(chaser_attitude=0.4, joint_accelerations=tuple(0.1 * n for n in range(1, 8))),
        parametrisation=Parametrisation.JOINT_SPLINE,
        contact_distance=0.07,
        approach=Approach(np.array([0.6, 0.8, 0.0]), 0.1, 0.3),
    )
    values = values_in(PlanningProblem, write_object(asked, PlanTrajectory.Request()))
    assert values.pop("limits") == {
        "chaser_attitude": 0.4,
        "joint_accelerations": asked.limits.joint_accelerations,
    }
    for name, value in values.items():
        assert_same(value, getattr(asked, name))
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    assert body.obstacles
    message = write_object(body, TargetBodyMessage(), ObstacleSphere)
    assert_same(TargetBody(**values_in(TargetBody, message)), body)
    assert_same(
        SystemState(**values_in(SystemState, write_object(asked.start, ChaserState()))), asked.start
    )


def assert_same(found: Any, wanted: Any) -> None:
    """Compare values, and objects by their declared fields."""
    if isinstance(wanted, tuple):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert_same(one, other)
    elif isinstance(wanted, np.ndarray):
        assert found.tobytes() == wanted.tobytes()
    elif is_dataclass(wanted):
        for one in declared(type(wanted)).values():
            assert_same(getattr(found, one.name), getattr(wanted, one.name))
    else:
        assert found == wanted


def test_all_faults_are_named_as_the_message_names_them() -> None:
    names = names_in(PlanningProblem)
    assert names["approach"] == "approach_direction, approach_distance and approach_cone"
    faults = Faults()
    for field in ("target.position[2]", "objective", "limits.acceleration[1]", "elsewhere"):
        faults.add(field, 0, "it must be something else")
    with pytest.raises(InvalidInput) as refused, fields_named(names):
        faults.refuse()
    assert [one.field for one in refused.value.faults] == [
        "target_pose.pose.position[2]",
        "weight_joint_path_length, weight_chaser_attitude and weight_duration",
        "limit_accelerations[1]",
        "elsewhere",
    ]


def test_what_is_asked_away_is_zero_or_empty_in_the_message() -> None:
    request = PlanTrajectory.Request(limit_chaser_attitude=0.3, limit_accelerations=[0.2])
    for key, _, one in places_in(PlanningProblem):
        if key.startswith("limits."):
            write_value(request, one, "none")
    assert (request.limit_chaser_attitude, len(request.limit_accelerations)) == (0.0, 0)
