"""When the node read a request, and which messages it had received by then."""

from __future__ import annotations

from ff_planner_ros.bag.decoding import NANOSECONDS, nanoseconds
from ff_planner_ros.declared import value_at
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.ros.inputs.input_topics import heard_with
from ff_planner_ros.runs.installed import PlanExchange
from ff_planner_ros.runs.recorded_inputs import Moment
from ff_planner_ros.runs.recorded_parameters import RecordedParameters


def moment(exchange: PlanExchange, recorded: RecordedParameters) -> tuple[int, Moment]:
    """Return when the node read a request, by its own clock [ns] and by the recorder's."""
    now_ns = _taken_up(exchange, recorded)
    # The request may have waited for another one.
    waited_ns = now_ns - exchange.received_ns if exchange.received_ns else 0
    stamps_ns = _stamps(exchange, recorded.at(now_ns))
    # Zero: the message heard last was used.
    named = {name: stamp_ns for name, stamp_ns in stamps_ns.items() if stamp_ns}
    return now_ns, Moment(exchange.logged_ns + waited_ns, named, tuple(stamps_ns))


def _taken_up(exchange: PlanExchange, recorded: RecordedParameters) -> int:
    request, response = exchange.request, exchange.response
    if response is not None and nanoseconds(response.taken_up):
        return nanoseconds(response.taken_up)
    received_ns = exchange.received_ns or exchange.logged_ns
    # Responses of versions before `taken_up`: the time follows from other fields.
    if request is not None and response is not None and response.status.code == Status.SOLVED:
        if request.use_start_state and not nanoseconds(request.start_state.header.stamp):
            return nanoseconds(response.state_stamp)
        if not nanoseconds(request.start_time):
            allowance = recorded.at(received_ns).planning_allowance
            start_ns = nanoseconds(response.joint_trajectory.header.stamp)
            return start_ns - round(allowance * NANOSECONDS)
    return received_ns


def _stamps(exchange: PlanExchange, parameters: NodeParameters) -> dict[str, int]:
    """Return the stamp of every input that was used; zero where the response lacks it."""
    request, response = exchange.request, exchange.response
    if request is None or response is None:
        return {}
    stamps_ns = {
        topic.name: nanoseconds(value_at(response, topic.stamp))
        for topic in heard_with(parameters.state_source)
        if not value_at(request, topic.brought_by)
        and (not topic.wanted_by or value_at(request, topic.wanted_by))
    }
    # The recorder may have an input that the node did not have yet.
    said = response.status.message
    return {
        name: stamp_ns
        for name, stamp_ns in stamps_ns.items()
        if not said.startswith(f"{name} is missing")
    }
