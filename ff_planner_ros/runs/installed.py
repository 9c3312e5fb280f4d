"""Recorded messages, copied into the message classes that are installed here."""

from __future__ import annotations

import array
import math
from collections.abc import Container, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics, PlanRequest, PublishedPlan
from rosidl_parser.definition import AbstractNestedType, NamespacedType
from trajectory_msgs.msg import JointTrajectoryPoint

from ff_planner_ros.bag.exchanges import Exchange, answer_in, exchanges
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.messages.interfaces import class_of, type_name

T = TypeVar("T")
_MOTION = (
    "joint_trajectory",
    "chaser_path",
    "chaser_twists",
    "end_effector_path",
    "end_effector_twists",
    "target_path",
    "target_twists",
)
_NUMBERS = ("positions", "velocities", "accelerations", "effort")  # of a point
PlanExchange: TypeAlias = Exchange[PlanRequest, PlanAnswer]


def installed_exchanges(bag: Bag) -> list[PlanExchange]:
    """Return every request in a bag with its response, in the order of the requests.

    Raises:
        BagError: A field was recorded as another type than is installed here.
    """
    return exchanges(
        bag,
        lambda request: as_installed(request, PlanRequest),
        lambda _, answer: as_installed(answer, PlanAnswer),
    )


def brief_exchanges(bag: Bag) -> list[PlanExchange]:
    """Return the `installed_exchanges` without the motion; of its points only the times.

    That takes a tenth of the time and of the memory; `with_motion` brings the rest.

    Raises:
        BagError: A field was recorded as another type than is installed here.
    """
    return exchanges(
        bag,
        lambda request: as_installed(request, PlanRequest),
        lambda _, answer: _brief(answer),
    )


def with_motion(bag: Bag, exchange: PlanExchange) -> PlanExchange:
    """Return one of the `brief_exchanges` with its whole answer.

    Raises:
        BagError: A field was recorded as another type than is installed here.
    """
    if exchange.answered_by is None:
        return exchange
    answer = answer_in(bag.decode(exchange.answered_by))
    return replace(exchange, response=as_installed(answer, PlanAnswer))


def _brief(answer: Any) -> PlanAnswer:
    brief = as_installed(answer, PlanAnswer, without=("plans",))
    brief.plans = [_brief_plan(plan) for plan in value_at(answer, "plans", ())]
    return brief


def _brief_plan(plan: Any) -> PlanMessage:
    brief = as_installed(plan, PlanMessage, without=_MOTION)
    for name in ("joint_trajectory", "chaser_path"):
        copied = value_at(brief, name)
        recorded = value_at(plan, name, copied)
        setattr(brief, name, as_installed(recorded, type(copied), without=("points", "poses")))
    points = value_at(plan, "joint_trajectory.points", ())
    brief.joint_trajectory.points = [
        as_installed(p, JointTrajectoryPoint, _NUMBERS) for p in points
    ]
    return brief


def never_published(bag: Bag, found: Sequence[PlanExchange]) -> frozenset[str]:
    """Return the ids of the plans that were requested with `plan_only` and never published.

    Raises:
        BagError: The disk fails.
    """
    waiting = {
        one.response.plan_id
        for one in found
        if one.request is not None and one.request.plan_only and one.response is not None
    }
    if waiting:  # or else there is no need to look through the bag
        messages = bag.decoded(type_name(PublishedPlan))
        waiting -= {str(value_at(message, "plan_id", "")) for _, message in messages}
    return frozenset(waiting)


def as_installed(decoded: Any, message_class: type[T], without: Container[str] = ()) -> T:
    """Copy a decoded message, or a part of a service or an action, into an installed class.

    Fields that were not recorded, and those in `without`, keep their default, but metrics are NaN
    then. Unknown fields are dropped.

    Raises:
        BagError: A field was recorded as another type than is installed here.
    """
    kind: Any = message_class
    message: T = kind(check_fields=True)  # otherwise rosidl takes anything for anything
    for name, slot_type in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        if name not in without and hasattr(decoded, name):
            try:
                value = _value(getattr(decoded, name), getattr(message, name), slot_type, kind)
                setattr(message, name, value)
            except (AssertionError, AttributeError, TypeError, ValueError):
                raise BagError(
                    f"{kind.__name__}.{name} was recorded as another type than is installed here"
                ) from None
        elif kind is PlanMetrics and isinstance(getattr(message, name), float):
            setattr(message, name, math.nan)  # not known, which no default says
    return message


def _value(recorded: Any, default: Any, slot_type: Any, owner: Any) -> Any:
    match slot_type:
        case NamespacedType() if hasattr(recorded, "__msgtype__"):
            return as_installed(recorded, type(default))
        case AbstractNestedType(value_type=NamespacedType() as element):
            element_class = class_of(element, owner)
            return [as_installed(one, element_class) for one in recorded]
        case AbstractNestedType() if isinstance(default, array.array):
            return array.array(default.typecode, np.asarray(recorded).tolist())
        case AbstractNestedType() if isinstance(default, np.ndarray):
            return np.asarray(recorded, dtype=default.dtype)
        case AbstractNestedType(value_type=element) if _is_octet(element):
            return [_octet(one) for one in recorded]
        case AbstractNestedType():
            return recorded.tolist() if isinstance(recorded, np.ndarray) else list(recorded)
        case _ if _is_octet(slot_type):
            return _octet(recorded)
    return recorded


def _is_octet(slot_type: Any) -> bool:
    return getattr(slot_type, "typename", None) == "octet"


def _octet(number: int) -> bytes:
    return bytes([int(number) & 0xFF])  # rosbags takes it for signed
