"""When the node read a request, and what its answer tells of what the node knew then."""

from __future__ import annotations

from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.ros.messages.from_messages import NANOSECONDS, nanoseconds
from ff_planner_ros.runs.exchanges import Exchange
from ff_planner_ros.runs.recorded_inputs import Moment
from ff_planner_ros.runs.recorded_parameters import RecordedParameters

_STATE_INPUTS = {"chaser_state": ("chaser_state",), "odometry": ("odometry", "joint_states")}


def moment(exchange: Exchange, recorded: RecordedParameters) -> tuple[int, Moment]:
    """Return when the node read a request, by its own clock [ns] and by the recorder's.

    Args:
        recorded: The node's parameters at any time.
    """
    now_ns = _taken_up(exchange, recorded)
    # It may have waited for another one to make room.
    waited_ns = now_ns - exchange.received_ns if exchange.received_ns else 0
    stamps_ns = _stamps(exchange, recorded.at(now_ns))
    # Zero says nothing: what was heard last is it.
    named = {name: stamp_ns for name, stamp_ns in stamps_ns.items() if stamp_ns}
    return now_ns, Moment(exchange.logged_ns + waited_ns, named, tuple(stamps_ns))


def _taken_up(exchange: Exchange, recorded: RecordedParameters) -> int:
    request, response = exchange.request, exchange.response
    if response is not None and nanoseconds(response.taken_up):
        return nanoseconds(response.taken_up)
    received_ns = exchange.received_ns or exchange.logged_ns
    # Answers from before `taken_up` came to be: what depends on it gives it away.
    if request is not None and response is not None and response.status.code == Status.SOLVED:
        if request.use_start_state and not nanoseconds(request.start_state.header.stamp):
            return nanoseconds(response.state_stamp)
        if not nanoseconds(request.start_time):
            allowance = recorded.at(received_ns).planning_allowance
            start_ns = nanoseconds(response.joint_trajectory.header.stamp)
            return start_ns - round(allowance * NANOSECONDS)
    return received_ns


def _stamps(exchange: Exchange, parameters: NodeParameters) -> dict[str, int]:
    """Return the stamp of every input that matters, zero where the answer does not tell it."""
    request, response = exchange.request, exchange.response
    stamps_ns: dict[str, int] = {}
    if request is None or response is None:
        return stamps_ns
    if not request.use_start_state:
        told = (response.state_stamp, response.joint_states_stamp)
        names = _STATE_INPUTS[parameters.state_source]
        stamps_ns |= zip(names, map(nanoseconds, told), strict=False)
    if not request.use_obstacles:
        stamps_ns["obstacles"] = nanoseconds(response.obstacles_stamp)
    # What the node had not heard yet, the recorder may have: they hear at nearly the same time.
    said = response.status.message
    return {
        name: stamp_ns
        for name, stamp_ns in stamps_ns.items()
        if not said.startswith(f"{name} is missing")
    }
