"""Requests in a bag to publish or reject a waiting plan, with their answers."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.bag.answers import Cell
from ff_planner_ros.bag.exchanges import publication_exchanges
from ff_planner_ros.bag.plans import status_name
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.messages.exchange_words import Event


@dataclass(frozen=True)
class Publication:
    """A request to publish or reject a plan, and its answer."""

    plan_id: str
    requester: str
    asked_ns: int  # when the request was received, by the node's clock
    answered_ns: int  # when the answer went out, by the node's clock
    status: str  # its name
    message: str
    published: bool
    # Age of the state that the plan had to fit, at the request [s]; None: there was none
    state_age_s: float | None
    previous_plan_id: str  # id of the plan published before; empty: none was

    def row(self) -> dict[str, Cell]:
        """Return the publication as a row of a table, with units in the names of its columns."""
        return {name: None if value == "" else value for name, value in vars(self).items()}


def publications(bag: Bag) -> list[Publication]:
    """Return every answered request to publish or reject a plan, in the order of the answers.

    Args:
        bag: An open bag, which gets a note for each exchange that cannot be understood.

    Raises:
        BagError: The disk fails.
    """
    found = list[Publication]()
    for one in publication_exchanges(bag):
        if one.answer is None:
            continue
        status, inputs = one.answer.status, one.answer.inputs
        state_ns, read_ns = nanoseconds(inputs.state_stamp), nanoseconds(inputs.received_stamp)
        found.append(
            Publication(
                one.plan_id,
                one.requester,
                one.asked_ns,
                one.answered_ns,
                status_name(int(status.code)),
                str(status.message),
                one.event == Event.PUBLISHED,
                (read_ns - state_ns) / NANOSECONDS if state_ns else None,
                str(inputs.previous_plan_id),
            )
        )
    return found
