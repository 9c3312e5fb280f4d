"""When a recorded node read a request, and what it had heard by then."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from ff_planner_msgs.msg import (
    ChaserState,
    Goal,
    Phase,
    PlanAnswer,
    PlanInputs,
    PlanRequest,
    Scene,
    TargetBody,
)

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.runs.installed import PlanExchange
from ff_planner_ros.runs.moments import moment
from ff_planner_ros.runs.recorded_inputs import Moment

RECEIVED = 1_000 * NANOSECONDS  # by the node's clock
LOGGED = RECEIVED + 3 * NANOSECONDS  # by the recorder's, which is ahead
READ = RECEIVED + round(0.7 * NANOSECONDS)
ALLOWANCE = 2.0
PARAMETERS: NodeParameters = replace(
    load_parameters(), planning_lead_time=ALLOWANCE, state_source="odometry"
)


def found(request: PlanRequest | None, response: Any, **times: int) -> tuple[int, Moment]:
    exchange = PlanExchange(
        "service", "/plan_trajectory", LOGGED, times.get("received", RECEIVED), request, response
    )
    recorded: Any = SimpleNamespace(at=lambda _: PARAMETERS)
    return moment(exchange, recorded)


def answer(code: int = Status.SOLVED, **inputs: Any) -> PlanAnswer:
    found = PlanAnswer(inputs=PlanInputs(**inputs))
    found.status.code = int(code)
    return found


def test_a_request_that_waited_was_read_so_much_later_by_both_clocks() -> None:
    response = answer(received_stamp=time_message(READ))
    now_ns, what = found(PlanRequest(), response)
    assert now_ns == READ
    assert what.logged_ns == LOGGED + round(0.7 * NANOSECONDS)


def test_an_answer_alone_tells_when_its_request_was_read() -> None:
    """Nobody knows how long that waited."""
    now_ns, what = found(None, answer(received_stamp=time_message(READ)), received=0)
    assert (now_ns, what.logged_ns) == (READ, LOGGED)
    assert (what.stamps_ns, what.inputs) == ({}, ())


def test_inputs_are_named_that_the_request_did_not_bring_and_that_counted() -> None:
    stamps: dict[str, Any] = {
        name: time_message(number)
        for number, name in enumerate(
            (
                *("state_stamp", "joint_states_stamp", "obstacles_stamp"),
                *("obstacle_bodies_stamp", "target_body_stamp"),
            ),
            1,
        )
    }
    response = answer(received_stamp=time_message(READ), **stamps)
    _, what = found(PlanRequest(), response)
    heard = {"odometry": 1, "joint_states": 2, "obstacles": 3, "obstacle_bodies": 4}
    assert what.stamps_ns == heard
    _, what = found(PlanRequest(goal=Goal(kind=Goal.CAPTURE)), response)
    assert what.stamps_ns["target_body"] == 5
    then = [Phase(goal=Goal(kind=Goal.CAPTURE))]
    _, what = found(PlanRequest(goal=Goal(kind=Goal.AT_REST), then=then), response)
    assert what.stamps_ns["target_body"] == 5
    brought = PlanRequest(
        start_state=[ChaserState()],
        scene=[Scene()],
        goal=Goal(kind=Goal.CAPTURE),
        target_body=[TargetBody()],
    )
    assert found(brought, response)[1].inputs == ()
    response.inputs.obstacles_stamp = time_message(0)
    _, what = found(PlanRequest(), response)
    assert "obstacles" not in what.stamps_ns
    assert set(what.inputs) == heard.keys(), "the last one heard"


def test_what_the_node_had_not_heard_is_no_input_though_the_recorder_heard_it() -> None:
    response = answer(Status.NO_OBSTACLES, received_stamp=time_message(READ))
    response.status.message = "obstacles is missing: none were received yet"
    _, what = found(PlanRequest(), response)
    assert set(what.inputs) == {"odometry", "joint_states", "obstacle_bodies"}
