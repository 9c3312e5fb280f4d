"""When the node read a request, and which of its inputs the answer names."""

from __future__ import annotations

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.ros.inputs.input_topics import heard_with
from ff_planner_ros.runs.installed import PlanExchange
from ff_planner_ros.runs.recorded_inputs import Moment
from ff_planner_ros.runs.recorded_parameters import RecordedParameters


def moment(exchange: PlanExchange, recorded: RecordedParameters) -> tuple[int, Moment]:
    """Return when the node read a request, by its own clock [ns] and by the recorder's."""
    response, now_ns = exchange.response, exchange.received_ns or exchange.logged_ns
    if response is not None and nanoseconds(response.inputs.received_stamp):
        now_ns = nanoseconds(response.inputs.received_stamp)
    # The request may have waited for another one.
    waited_ns = now_ns - exchange.received_ns if exchange.received_ns else 0
    stamps_ns = _stamps(exchange, recorded.at(now_ns))
    # Zero: not named, the message heard last was used.
    named = {name: stamp_ns for name, stamp_ns in stamps_ns.items() if stamp_ns}
    return now_ns, Moment(exchange.logged_ns + waited_ns, named, tuple(stamps_ns))


def _stamps(exchange: PlanExchange, parameters: NodeParameters) -> dict[str, int]:
    """Return the stamp of every input that was used; zero if the response lacks it."""
    request, response = exchange.request, exchange.response
    if request is None or response is None:
        return {}
    stamps_ns = {
        topic.name: nanoseconds(value_at(response.inputs, topic.stamp))
        for topic in heard_with(parameters.state_source)
        if topic.is_used_by(request)
    }
    # The recorder may have an input that the node did not have yet.
    said = response.status.message
    return {
        name: stamp_ns
        for name, stamp_ns in stamps_ns.items()
        if not said.startswith(f"{name} is missing")
    }
