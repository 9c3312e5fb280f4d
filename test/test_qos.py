"""Quality of service from parameters."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    ReliabilityPolicy,
    qos_check_compatible,
)

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.interfaces import PublisherQos, QosParameters, SubscriptionQos
from ff_planner_ros.ros.qos import qos_profile

EVERY_KIND = [
    (reliability, durability)
    for reliability in ("best_effort", "reliable")
    for durability in ("volatile", "transient_local")
]
PARAMETERS = QosParameters(
    **{
        item.name: {"SubscriptionQos": SubscriptionQos, "PublisherQos": PublisherQos}[item.type](
            reliability="reliable", durability="volatile", depth=3
        )
        for item in fields(QosParameters)
    }
)


@pytest.mark.parametrize(("reliability", "durability"), EVERY_KIND)
def test_a_profile_says_what_the_parameters_say(reliability: str, durability: str) -> None:
    profile = qos_profile(SubscriptionQos(reliability, durability, depth=7))
    assert profile.reliability is ReliabilityPolicy[reliability.upper()]
    assert profile.durability is DurabilityPolicy[durability.upper()]
    assert profile.history is HistoryPolicy.KEEP_LAST
    assert profile.depth == 7


@pytest.mark.parametrize("topic", [item.name for item in fields(QosParameters)])
@pytest.mark.parametrize(
    ("field", "allowed"),
    [("reliability", "best_effort or reliable"), ("durability", "volatile or transient_local")],
)
@pytest.mark.parametrize("word", ["", "Reliable", "system_default"])
def test_a_word_that_is_not_known_is_refused_by_its_parameter(
    topic: str, field: str, allowed: str, word: str
) -> None:
    bad: dict[str, Any] = {topic: replace(getattr(PARAMETERS, topic), **{field: word})}
    with pytest.raises(InvalidInput) as refusal:
        replace(PARAMETERS, **bad)
    assert refusal.value.status is Status.OUT_OF_RANGE
    assert str(refusal.value) == f"qos.{topic}.{field} is {word!r}: it must be {allowed}"


def test_the_descriptions_say_what_does_not_connect() -> None:
    # As the ROS that is installed judges it: who asks for more than is offered hears nothing.
    silent = {("reliable", "best_effort"), ("transient_local", "volatile")}
    for asked in EVERY_KIND:
        for offered in EVERY_KIND:
            verdict, _ = qos_check_compatible(
                qos_profile(PublisherQos(*offered, depth=1)),
                qos_profile(SubscriptionQos(*asked, depth=1)),
            )
            expected = bool(silent & set(zip(asked, offered, strict=True)))
            assert (verdict == QoSCompatibility.ERROR) == expected, (asked, offered)
    for asked, offered in silent:
        assert f"{asked} " in _description(SubscriptionQos, asked)
        assert f"does not connect to publishers that offer {offered}" in _description(
            SubscriptionQos, asked
        )
        assert f"{offered} does not connect to subscribers that ask for {asked}" in _description(
            PublisherQos, asked
        )


def _description(kind: type[SubscriptionQos | PublisherQos], word: str) -> str:
    name = "reliability" if word == "reliable" else "durability"
    (found,) = (item for item in fields(kind) if item.name == name)
    return str(found.metadata["description"])
