"""What `/diagnostics` says in every situation: level, words and figures."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from robots import random_urdf

from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.ros.outputs.clock_health import ClockHealth
from ff_planner_ros.ros.outputs.diagnostics import LastRequest, NodeHealth, diagnostics
from ff_planner_ros.ros.outputs.execution import ControllerHealth, Event, Execution
from ff_planner_ros.ros.outputs.prediction import Deviation
from ff_planner_ros.ros.recorder.recorder import RecorderHealth

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
PARTS = (
    *("chaser state", "obstacles", "target body", "last request", "solver"),
    *("solve time", "other planners", "recorder", "tracking", "controller", "clock"),
)


def off(position: float, angle: float) -> list[Deviation]:
    """Deviations of a chaser from its plan."""
    return [
        Deviation("the chaser's position", "max_position", position, "m"),
        Deviation("its attitude", "max_angle", angle, "rad"),
    ]


RECORDING = RecorderHealth("/data/bags/run", messages=12, dropped={}, failure="")
WELL = NodeHealth(
    state_age=0.012,
    state_max_age=0.5,
    state_refusal="",
    obstacles=3,
    obstacles_age=61.25,
    obstacles_refusal="",
    target_age=4.5,
    target_max_age=60.0,
    target_refusal="",
    last=LastRequest("run.7", Status.SOLVED, "converged"),
    solve_times=(0.5, 0.25, 1.5),
    solver_is_warm=True,
    namesakes=(),
    recorder=RECORDING,
    tracking=off(0.004, 0.01),
    allowed=load_parameters().tracking,
)


SENT = ControllerHealth(
    action="arm/follow", last=("run.7", Event.STARTED, "now"), furthest=("wrist", 0.002, "rad")
)


def part(health: NodeHealth, name: str) -> tuple[bytes, str, dict[str, str]]:
    """Level, words and figures of one part."""
    (status,) = (
        status
        for status in diagnostics(health, "/chaser/ff_planner", Time()).status
        if status.name == f"/chaser/ff_planner: {name}"
    )
    return status.level, status.message, {item.key: item.value for item in status.values}


def test_a_node_that_is_well_says_so_in_every_part() -> None:
    stamp = Time(sec=12, nanosec=34)
    message = diagnostics(WELL, "ff_planner", stamp)
    assert message.header.stamp == stamp
    assert [status.name for status in message.status] == [f"ff_planner: {name}" for name in PARTS]
    assert [status.level for status in message.status] == [OK] * len(PARTS)


@pytest.mark.parametrize(
    ("name", "changes", "level", "words"),
    [
        ("chaser state", {"state_age": None}, ERROR, "no chaser state received yet"),
        (
            *("chaser state", {"state_age": None, "state_since": "since the clock jumped"}, ERROR),
            "no chaser state received since the clock jumped",
        ),
        ("chaser state", {"state_age": 0.5}, OK, "0.500 s old"),
        ("chaser state", {"state_age": 0.501}, ERROR, "allowed are 0.5 s"),
        ("chaser state", {"state_age": -0.02}, OK, "-0.020 s old"),
        ("chaser state", {"state_refusal": "frame is map"}, ERROR, "planned from: frame is map"),
        (
            "chaser state",
            {"state_age": 2.0, "state_clock_offset": -2.0},
            ERROR,
            "its publisher's clock is so much behind this node's",
        ),
        (
            "chaser state",
            {"state_age": 2.0, "state_clock_offset": 0.0},
            ERROR,
            "has its publisher died?",
        ),
        (
            "target body",
            {"target_age": 70.0, "target_clock_offset": -70.0},
            WARN,
            "stamps 70.000 s behind",
        ),
        ("obstacles", {"obstacles": None}, ERROR, "none received yet: publish them, or an empty"),
        ("obstacles", {"obstacles": 0}, OK, "0 spheres, 61.2 s old"),
        ("obstacles", {"obstacles_age": None}, OK, "3 spheres, not stamped"),
        ("obstacles", {"obstacle_bodies": 1}, OK, "3 spheres and 1 body, 61.2 s old"),
        ("obstacles", {"obstacles": 1}, OK, "1 sphere, 61.2 s old"),
        ("obstacles", {"obstacles_refusal": "radius is 0"}, ERROR, "around: radius is 0"),
        (
            "obstacles",
            {"obstacles": None, "unheard": {"obstacles": ["/mapper offers durability volatile"]}},
            ERROR,
            "not heard: obstacles: /mapper offers durability volatile",
        ),
        ("obstacles", {"unheard": {"obstacles": ["/m offers"]}}, WARN, "old; not heard: "),
        ("chaser state", {"unheard": {"joint_states": ["/arm offers"]}}, WARN, "/arm offers"),
        ("obstacles", {"obstacles_are_published": False}, WARN, "their publisher is gone"),
        ("target body", {"target_age": None}, OK, "none received: only a request that brings one"),
        ("target body", {"target_age": 60.0}, OK, "the newest is 60.0 s old"),
        ("target body", {"target_age": 60.1}, WARN, "is 60.1 s old, allowed are 60 s"),
        ("target body", {"target_refusal": "frame is map"}, WARN, "be captured: frame is map"),
        ("last request", {"last": None}, OK, "no request yet"),
        (
            "last request",
            {"last": LastRequest("run.8", Status.COLLISION, "c1 is in the way")},
            WARN,
            "run.8 got no plan, COLLISION: c1 is in the way",
        ),
        (
            "last request",
            {"last": LastRequest("run.8", Status.NO_STATE, "none")},
            WARN,
            "run.8 got no plan, NO_STATE: none",
        ),
        (
            "last request",
            {"last": LastRequest("run.9", Status.INTERNAL_ERROR, "the solver died")},
            ERROR,
            "run.9 got no plan, INTERNAL_ERROR: the solver died",
        ),
        ("solve time", {"solve_times": ()}, OK, "no answer yet"),
        ("solve time", {"solve_times": (2.0,)}, OK, "median 2.00 s, 95 % within 2.00 s"),
        (
            "recorder",
            {"recorder": replace(RECORDING, failure="disk full")},
            ERROR,
            "recording has stopped, planning goes on: disk full",
        ),
        (
            "recorder",
            {"recorder": replace(RECORDING, dropped={"/a": 3, "/b": 20})},
            WARN,
            "but was too slow for 23 messages, 20 of them of /b",
        ),
        ("solver", {"solver_is_warm": False}, WARN, "a request waits for it"),
        (
            "other planners",
            {"namesakes": ("/ff_planner", "/spare")},
            ERROR,
            "are answered by /ff_planner, /spare, too",
        ),
        ("tracking", {"tracking": ()}, OK, "no plan runs"),
        ("tracking", {"tracking": off(0.02, 0.02)}, OK, "20.0 mm and 1.15 deg"),
        (
            "tracking",
            {"tracking": off(0.0201, 0.0)},
            WARN,
            "leaves the plan: the chaser's position by 0.0201 m, more than tracking.max_position",
        ),
        (
            "tracking",
            {"tracking": off(0.0, 0.0201)},
            WARN,
            "leaves the plan: its attitude by 0.0201 rad, more than tracking.max_angle, 0.02 rad",
        ),
        ("tracking", {"tracking": off(float("nan"), 0.0)}, WARN, "leaves the plan"),
        ("controller", {}, OK, "plans go out on the topic joint_trajectory"),
        ("controller", {"controller": SENT}, OK, "plans are sent to arm/follow; run.7: STARTED"),
        ("controller", {"controller": replace(SENT, is_there=False)}, WARN, "at arm/follow"),
        (
            "controller",
            {"controller": replace(SENT, last=("run.7", Event.ABORTED, "PATH_TOLERANCE"))},
            ERROR,
            "run.7: ABORTED: PATH_TOLERANCE",
        ),
        ("clock", {}, OK, "the system's"),
        ("clock", {"clock": ClockHealth(1.9)}, OK, "simulated: /clock ticks"),
        ("clock", {"clock": ClockHealth(2.1)}, WARN, "/clock has not ticked for 2.1 s"),
        (
            *("clock", {"clock": ClockHealth(0.0, 1, 2.5, ["/sim"])}, WARN),
            "/clock has jumped back once in the last 10 s, by 2.500 s at most: states and plans of",
        ),
        (
            *("clock", {"clock": ClockHealth(0.0, 7, 5.0, ["/bag", "/sim"])}, WARN),
            "void each time; it is published by /bag and /sim: stop all but one",
        ),
    ],
)
def test_each_part_turns_to_its_level_with_words_that_say_why(
    name: str, changes: dict[str, object], level: bytes, words: str
) -> None:
    health = replace(WELL, **changes)
    found, message, _ = part(health, name)
    assert words in message
    assert found == level
    others = [other for other in PARTS if other != name]
    assert [part(health, other) for other in others] == [part(WELL, other) for other in others]


def test_the_figures_are_there_for_machines() -> None:
    assert part(WELL, "chaser state")[2] == {"age [s]": "0.012", "allowed age [s]": "0.5"}
    measured = part(replace(WELL, state_clock_offset=0.0411), "chaser state")[2]
    assert measured["clock offset [s]"] == "0.041"
    assert part(WELL, "obstacles")[2] == {"spheres": "3", "age [s]": "61.2"}
    named = part(replace(WELL, obstacles_source="mapper"), "obstacles")[2]
    assert named["source"] == "mapper"
    assert part(WELL, "last request")[2] == {"plan id": "run.7", "code": "0", "status": "SOLVED"}
    assert part(WELL, "recorder")[2] == {
        "bag": "/data/bags/run",
        "messages": "12",
        "dropped": "0",
    }
    failed = replace(RECORDING, dropped={"/b": 20, "/a": 3}, failure="disk full")
    assert part(replace(WELL, recorder=failed), "recorder")[2] == {
        "bag": "/data/bags/run",
        "messages": "12",
        "dropped": "23",
        "dropped /a": "3",
        "dropped /b": "20",
        "failure": "disk full",
    }
    assert part(WELL, "tracking")[2] == {
        "position [m]": "0.004000",
        "allowed position [m]": "0.02",
        "angle [rad]": "0.010000",
        "allowed angle [rad]": "0.02",
    }
    assert part(WELL, "solve time")[2] == {
        "median [s]": "0.500",
        "95 % [s]": "1.400",
        "worst [s]": "1.500",
        "answers": "3",
    }


def test_the_controllers_figures_are_there_for_machines() -> None:
    figures = part(replace(WELL, controller=SENT), "controller")[2]
    told = {"plan id": "run.7", "event": "STARTED", "joint": "wrist", "off by [rad]": "0.002000"}
    assert figures == {"hand-over": "action"} | told


def test_a_controller_whose_state_is_not_seen_is_a_warning() -> None:
    unwatched = replace(SENT, unwatched="nobody publishes /arm/controller_state")
    level, words, _ = part(replace(WELL, controller=unwatched), "controller")
    assert level == WARN
    assert words.endswith("is not seen: nobody publishes /arm/controller_state")


def test_what_a_prismatic_joint_is_off_by_is_told_in_metres() -> None:
    robot = robot_from_urdf_text(random_urdf(2, 1, sliding=(2,)), "bus", "tool")
    for joint, unit in (("joint_1", "rad"), ("joint_2", "m"), ("another", "rad")):
        client = SimpleNamespace(action="arm/follow", is_there=True, off={joint: 0.5})
        execution: Any = SimpleNamespace(controller=client, watch=None, last=None)
        health = Execution.health(execution, robot)
        assert part(replace(WELL, controller=health), "controller")[2][f"off by [{unit}]"]


def test_the_joint_that_is_off_most_is_found_with_the_weight_of_prismatic_joints() -> None:
    urdf = random_urdf(2, 1, sliding=(2,))
    off = {"joint_1": 0.02, "joint_2": 0.01, "another": 0.015}
    client = SimpleNamespace(action="arm/follow", is_there=True, off=off)
    execution: Any = SimpleNamespace(controller=client, watch=None, last=None)
    for weight, told in ((1.0, ("joint_1", 0.02, "rad")), (10.0, ("joint_2", 0.01, "m"))):
        robot = robot_from_urdf_text(urdf, "bus", "tool", slide_weight=weight)
        assert Execution.health(execution, robot).furthest == told


def test_percentiles_are_those_of_a_list_that_everybody_can_sort() -> None:
    times = tuple(float(number) for number in range(100, -1, -1))
    values = part(replace(WELL, solve_times=times), "solve time")[2]
    assert (values["median [s]"], values["95 % [s]"]) == ("50.000", "95.000")
    assert values["worst [s]"] == "100.000"


def test_the_clearances_of_the_last_plan_are_told() -> None:
    near = {"self-clearance": "4.2 mm, chaser/link_7 at 3.46 s"}
    last = LastRequest("run.7", Status.SOLVED, "converged", near)
    (part,) = (
        one
        for one in diagnostics(replace(WELL, last=last), "planner", Time()).status
        if one.name.endswith("last request")
    )
    assert {"self-clearance": near["self-clearance"]}.items() <= {
        value.key: value.value for value in part.values
    }.items()
