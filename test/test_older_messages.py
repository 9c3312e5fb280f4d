"""Requests and answers of version 0.2 as those of version 0.3: nothing gets lost or is made up."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from ff_planner_msgs.msg import Goal, PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rosbags.highlevel import AnyReader

from ff_planner_ros.bag.older_messages import (
    ANSWER_FIELDS,
    REQUEST_FIELDS,
    present_answer,
    present_request,
)
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.service_events import SERVICE_EVENT
from ff_planner_ros.ros.messages.interfaces import entry_of
from ff_planner_ros.runs.installed import as_installed

NODE = Path(__file__).parent / "golden_bags" / "node_0_2"
# They said whether another field counts, which is there or not now.
SWITCHES = ("use_start_state", "use_obstacles", "use_target_body")
WORDS = ("capture", "orientation", "end_behaviour")  # are called otherwise now
with open_bag(NODE) as bag:
    EVENTS = [event for _, event in bag.decoded(SERVICE_EVENT)]


def old_request(**fields: Any) -> Any:
    """A request of version 0.2 for state and scene of the topics, but for what is given."""
    request = deepcopy(EVENTS[0].request[0])
    for name, value in fields.items():
        setattr(request, name, value)
    return request


def now(request: Any) -> PlanRequest:
    return as_installed(present_request(request), PlanRequest)


def old_answer(status: Status) -> Any:
    found = (event.response[0] for event in EVENTS if event.response)
    return deepcopy(next(answer for answer in found if answer.status.code == status))


@pytest.mark.parametrize(
    ("part", "table"), [("Request", REQUEST_FIELDS), ("Response", ANSWER_FIELDS)]
)
def test_every_field_of_the_recorded_definition_has_a_place(
    part: str, table: Mapping[str, str]
) -> None:
    with AnyReader([NODE]) as reader:
        _, fields = reader.typestore.fielddefs[f"ff_planner_msgs/srv/PlanTrajectory_{part}"]
    assert sorted(table) == sorted(name for name, _ in fields)


@pytest.mark.parametrize(
    ("table", "present"), [(REQUEST_FIELDS, PlanRequest), (ANSWER_FIELDS, PlanAnswer)]
)
def test_every_place_is_in_the_messages_of_this_version_and_is_that_of_one_field(
    table: Mapping[str, str], present: Any
) -> None:
    for place in table.values():
        holder, (*parts, last) = present(), place.split(".")
        for part_of_place in parts:
            array, is_entry, _ = part_of_place.partition("[0]")
            holder = entry_of(holder, array) if is_entry else value_at(holder, array)
        array, is_entry, _ = last.partition("[0]")
        kind = holder.get_fields_and_field_types()[array]
        assert not is_entry or kind.startswith("sequence<"), place
    assert len(set(table.values())) == len(table)


def test_every_value_of_a_request_arrives() -> None:
    old = old_request(
        **dict.fromkeys(SWITCHES, True),
        limit_chaser_attitude=0.3,
        limit_chaser_rotation=0.4,
        allowed_at_goal=["link_7/bracket"],
        approach_distance=0.2,
    )
    present = present_request(old)
    for name, place in REQUEST_FIELDS.items():
        if name not in (*SWITCHES, *WORDS):
            assert value_at(present, place) is value_at(old, name), name
    as_installed(present, PlanRequest)  # of the types of this version


@pytest.mark.law("BAG-03")
def test_every_value_of_an_answer_with_a_plan_arrives() -> None:
    old = old_answer(Status.SOLVED)
    old.first_guess = old.xi
    present = present_answer(old)
    for name, place in ANSWER_FIELDS.items():
        assert value_at(present, place) is value_at(old, name), name
    assert present.plans[0].first_guess is old.first_guess
    answer = as_installed(present, PlanAnswer)
    assert len(answer.plans[0].joint_trajectory.points) == len(old.joint_trajectory.points) > 0


@pytest.mark.parametrize(("status", "attempts"), [(Status.NO_STATE, 0), (Status.COLLISION, 1)])
def test_a_refusal_has_no_plan_and_has_metrics_if_there_was_an_attempt(
    status: Status, attempts: int
) -> None:
    old = old_answer(status)
    answer = as_installed(present_answer(old), PlanAnswer)
    assert (len(answer.plans), len(answer.metrics)) == (0, attempts)
    assert (answer.status.code, answer.status.message) == (status, old.status.message)
    assert answer.inputs.received_stamp.sec == old.taken_up.sec > 0
    assert [metrics.min_clearance for metrics in answer.metrics] == [
        *attempts * [old.metrics.min_clearance]
    ]


@pytest.mark.parametrize("part", ["start_state", "obstacles", "target_body"])
def test_what_a_request_brings_is_what_its_switch_says(part: str) -> None:
    """Whatever is in the field itself: obstacles that are used and empty are a free scene."""
    place = REQUEST_FIELDS[f"use_{part}"]
    for used in (False, True):
        request = now(old_request(**{f"use_{part}": used}))
        found = {
            one: len(value_at(request, one)) for one in ("start_state", "scene", "target_body")
        }
        assert found == {one: int(used and one == place) for one in found}


@pytest.mark.parametrize("name", ["chaser_attitude", "chaser_rotation"])
@pytest.mark.parametrize(("asked", "limit"), [(0.0, []), (0.3, [0.3]), (-0.1, [-0.1])])
def test_an_angle_of_zero_was_the_parameter(name: str, asked: float, limit: list[float]) -> None:
    """What was refused is refused still."""
    limits = now(old_request(**{f"limit_{name}": asked})).limits
    other = {"chaser_attitude", "chaser_rotation"} - {name}
    assert value_at(limits, name).tolist() == limit
    assert not any(len(value_at(limits, one)) for one in other)


@pytest.mark.parametrize("name", ["approach_direction", "approach_distance", "approach_cone"])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_one_number_other_than_zero_asks_for_an_approach(name: str, axis: str) -> None:
    old = old_request()
    assert not now(old).goal.approach
    if name == "approach_direction":
        setattr(old.approach_direction, axis, -2.0)
    else:
        setattr(old, name, 0.25)
    (approach,) = now(old).goal.approach
    assert value_at(approach.direction, axis) == value_at(old.approach_direction, axis)
    assert (approach.distance, approach.half_angle) == (old.approach_distance, old.approach_cone)


@pytest.mark.parametrize(
    ("pairs", "distance"), [(["link_7/bracket"], 0.0), (["link_7/bracket"], 0.2), ([], 0.2)]
)
def test_what_may_touch_is_there_if_anything_was_said_of_it(
    pairs: list[str], distance: float
) -> None:
    assert not now(old_request(contact_distance=0.0)).goal.allowed_collisions
    goal = now(old_request(allowed_at_goal=pairs, contact_distance=distance)).goal
    (allowed,) = goal.allowed_collisions
    assert (allowed.pairs, allowed.distance) == (pairs, distance)


@pytest.mark.parametrize(
    ("then", "word"),
    [
        ("as_planned", "none"),
        ("hold_end_effector",) * 2,
        ("stop_joints",) * 2,
        ("", ""),
        ("x", "x"),
    ],
)
def test_an_arm_that_did_as_planned_does_nothing_more(then: str, word: str) -> None:
    assert now(old_request(end_behaviour=then)).end_behaviour == word


@pytest.mark.parametrize(
    ("word", "number"),
    [("", Goal.FIXED), ("fixed", Goal.FIXED), ("free", Goal.FREE), ("about_axis", Goal.ABOUT_AXIS)],
)
def test_orientations_are_numbers(word: str, number: int) -> None:
    assert now(old_request(orientation=word)).goal.orientation == number


def test_an_orientation_that_was_refused_is_none_of_this_version() -> None:
    number = now(old_request(orientation="sideways")).goal.orientation
    assert number not in (Goal.FIXED, Goal.FREE, Goal.ABOUT_AXIS)


@pytest.mark.parametrize(("captures", "kind"), [(False, Goal.POSE), (True, Goal.CAPTURE)])
def test_a_capture_is_a_kind_of_goal(captures: bool, kind: int) -> None:
    assert now(old_request(capture=captures)).goal.kind == kind


def test_messages_of_this_version_are_as_they_are() -> None:
    request, answer = PlanRequest(), PlanAnswer()
    assert present_request(PlanTrajectory.Request(request=request)) is request
    assert present_answer(PlanTrajectory.Response(answer=answer)) is answer
