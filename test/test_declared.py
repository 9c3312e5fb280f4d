"""Fields that are declared once: their places in messages, both ways."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import Approach as ApproachMessage
from ff_planner_msgs.msg import ChaserState, ObstacleSphere, PlanRequest
from ff_planner_msgs.msg import Obstacle as ObstacleMessage
from ff_planner_msgs.msg import TargetBody as TargetBodyMessage

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.declared import DeclaredField, declared
from ff_planner_ros.common.declared_messages import (
    names_in,
    places_in,
    value_at,
    values_in,
    write_object,
    write_value,
)
from ff_planner_ros.errors import Faults, InvalidInput, fields_named
from ff_planner_ros.planning.problem.approach import HALF_ANGLE, Approach
from ff_planner_ros.planning.problem.obstacles import SphereEntry
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Obstacle,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.problem.target_body import (
    AttachedObstacle,
    AttachedSphereEntry,
    TargetBody,
)
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.interfaces import entry_of
from ff_planner_ros.ros.messages.to_messages import target_body_message

MESSAGE_OF = [
    (SystemState, ChaserState),
    (SphereEntry, ObstacleSphere),
    (AttachedSphereEntry, ObstacleSphere),
    (Obstacle, ObstacleMessage),
    (AttachedObstacle, ObstacleMessage),
    (TargetBody, TargetBodyMessage),
    (PlanningProblem, PlanRequest),
    (PlanningTask, PlanRequest),
]


@pytest.mark.parametrize(("kind", "message"), MESSAGE_OF, ids=lambda kind: kind.__name__)
def test_every_declared_place_is_in_the_message(kind: type[Any], message: type[Any]) -> None:
    places = list(places_in(kind))
    assert places
    for key, place, one in places:
        # What is in an entry is a message of its own if it has slots.
        at = place if one.form.slots else place.removesuffix("[0]")
        found = value_at(with_entries(message(), f"{at}."), at)
        for slot in one.form.slots:
            assert isinstance(value_at(found, slot), float), key


def with_entries(message: Any, place: str) -> Any:
    """Return a message with an entry in every array that leads to a place."""
    holder = message
    for part in place.split(".")[:-1]:
        array, is_entry, _ = part.partition("[0]")
        if is_entry:
            setattr(holder, array, [entry_of(holder, array)])
        holder = value_at(holder, part)
    return message


def test_zero_no_text_and_no_entries_stand_for_the_default() -> None:
    request = PlanRequest(duration=1.0)
    request.objective.joint_path_length = request.goal.pose.pose.orientation.w = 1.0
    values = values_in(PlanningProblem, request)
    assert values.keys() == {"target", "duration", "points", "objective"}
    assert values["target"].free_axis_in_ee is None
    request.goal.approach = [ApproachMessage(distance=0.1)]
    request.goal.approach[0].direction.x = 2.0
    assert values_in(PlanningProblem, request)["approach"].half_angle == HALF_ANGLE


def test_entries_that_are_zero_are_entries() -> None:
    """Accelerations of zero are known, and a limit of zero is not the parameter's."""
    state = ChaserState(joint_accelerations=[0.0, 0.0])
    assert len(values_in(SystemState, state)["joint_accelerations"]) == 2
    assert "joint_accelerations" not in values_in(SystemState, ChaserState())
    request = PlanRequest()
    request.goal.pose.pose.orientation.w = request.objective.duration = 1.0
    assert "limits" not in values_in(PlanningProblem, request)
    request.limits.accelerations, request.limits.chaser_rotation = [0.0], [0.0]
    assert values_in(PlanningProblem, request)["limits"] == {
        "joint_accelerations": (0.0,),
        "chaser_rotation": 0.0,
    }


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
    values = values_in(PlanningProblem, write_object(asked, PlanRequest(), entry_of))
    assert values.pop("limits") == {
        "chaser_attitude": 0.4,
        "joint_accelerations": asked.limits.joint_accelerations,
    }
    for name, value in values.items():
        assert_same(value, getattr(asked, name))
    body = tumbling.problem("tumbling", 0).target_body
    assert body is not None
    assert body.obstacles
    message = target_body_message(body, 0, "inertial")
    assert_same(TargetBody(**values_in(TargetBody, message)), body)
    state = write_object(asked.start, ChaserState(), entry_of)
    assert_same(SystemState(**values_in(SystemState, state)), asked.start)


def declaration_at(place: str) -> DeclaredField:
    (found,) = (one for _, at, one in places_in(PlanningProblem) if at == place)
    return found


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("limits.chaser_attitude[0]", "limits.chaser_attitude"),
        ("goal.approach[0].distance", "goal.approach"),
        ("goal.allowed_collisions[0].pairs", "goal.allowed_collisions"),
    ],
)
def test_an_entry_that_is_absent_is_what_an_older_message_lacks(place: str, message: str) -> None:
    """Neither reading nor asking makes it."""
    request = PlanRequest()
    with pytest.raises(AttributeError, match=rf"{message.split('.')[-1]} is empty"):
        value_at(request, place)
    assert value_at(request, place, 2.0) == 2.0
    assert not len(value_at(request, message))


def test_an_entry_that_is_present_is_read_however_it_is_made() -> None:
    """A message's array of numbers and list of messages, and what a bag is decoded to."""
    request = PlanRequest()
    request.limits.chaser_attitude = [0.0]
    assert value_at(request, "limits.chaser_attitude[0]", 2.0) == 0.0
    request.goal.approach = [ApproachMessage(distance=0.25)]
    assert value_at(request, "goal.approach[0].distance") == 0.25
    assert value_at(request, "goal.approach[0]") is request.goal.approach[0]
    decoded = SimpleNamespace(goal=SimpleNamespace(approach=(SimpleNamespace(distance=0.5),)))
    assert value_at(decoded, "goal.approach[0].distance") == 0.5
    decoded.limits = SimpleNamespace(chaser_attitude=np.zeros(1))
    assert value_at(decoded, "limits.chaser_attitude[0]", 2.0) == 0.0
    with pytest.raises(AttributeError, match="half_angle"):
        value_at(decoded, "goal.approach[0].half_angle")


def test_an_entry_that_leads_to_a_value_is_made_once_and_keeps_what_it_has() -> None:
    request, approach = PlanRequest(), "goal.approach[0]"
    for name, value in (("distance", 0.25), ("half_angle", 0.5)):
        place = f"{approach}.{name}"
        write_value(request, declaration_at(place), value, entry_of, place)
    (made,) = request.goal.approach
    assert (made.distance, made.half_angle) == (0.25, 0.5)
    place = f"{approach}.direction"
    write_value(request, declaration_at(place), [1.0, 2.0, 3.0], entry_of, place)
    assert request.goal.approach[0] is made
    assert (made.direction.x, made.direction.y, made.direction.z) == (1.0, 2.0, 3.0)
    assert request.goal.allowed_collisions == []


def test_a_number_that_may_be_absent_is_written_as_an_entry_and_none_takes_it_away() -> None:
    request, place = PlanRequest(), "limits.chaser_attitude[0]"
    for value, left in ((0.3, [0.3]), (0.0, [0.0]), ("none", [])):
        write_value(request, declaration_at(place), value, entry_of, place)
        assert list(request.limits.chaser_attitude) == left


def test_an_object_makes_the_entries_that_it_fills_and_no_others(
    lemur_capture: PlanningProblem,
) -> None:
    bare = write_object(lemur_capture, PlanRequest(), entry_of)
    assert (bare.goal.approach, bare.goal.allowed_collisions) == ([], [])
    assert not len(bare.limits.chaser_attitude)
    full = replace(
        lemur_capture,
        approach=Approach(np.array([0.0, 0.0, 1.0]), 0.2, 0.3),
        limits=Limits(chaser_attitude=0.4),
    )
    written = write_object(full, PlanRequest(), entry_of)
    (approach,) = written.goal.approach
    assert (approach.direction.z, approach.distance, approach.half_angle) == (1.0, 0.2, 0.3)
    assert list(written.limits.chaser_attitude) == [0.4]
    assert written.goal.allowed_collisions == []


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
    assert names["approach"] == "goal.approach"
    faults = Faults()
    for field in ("target.position[2]", "objective", "limits.acceleration[1]", "elsewhere"):
        faults.add(field, 0, "it must be something else")
    with pytest.raises(InvalidInput) as refused, fields_named(names):
        faults.refuse()
    assert [one.field for one in refused.value.faults] == [
        "goal.pose.pose.position[2]",
        "objective",
        "limits.accelerations[1]",
        "elsewhere",
    ]


def test_what_is_asked_away_is_zero_or_empty_in_the_message() -> None:
    request = PlanRequest()
    limits = request.limits
    limits.chaser_attitude, limits.chaser_rotation, limits.accelerations = [0.3], [0.2], [0.2]
    for key, place, one in places_in(PlanningProblem):
        if key.startswith("limits."):
            write_value(request, one, "none", entry_of, place)
    for left in (limits.chaser_attitude, limits.chaser_rotation, limits.accelerations):
        assert not len(left)
