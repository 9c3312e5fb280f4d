"""What the states of a controller say of the plan that it is to follow, without a node."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from rclpy.serialization import serialize_message
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.ros.messages.foreign import JointTrajectoryControllerState
from ff_planner_ros.ros.outputs import controller
from ff_planner_ros.ros.outputs.controller import ControllerWatch

SETTINGS = replace(load_parameters().controller, state_topic="arm/controller_state")
START = 5  # [s]
RATES = {"elbow": -0.2, "shoulder": 0.1}  # steady, from zero, for 10 s


def trajectory() -> JointTrajectory:
    rates = list(RATES.values())
    points = [
        JointTrajectoryPoint(
            positions=[seconds * rate for rate in rates],
            velocities=rates,
            accelerations=[0.0] * len(rates),
            time_from_start=Duration(sec=seconds),
        )
        for seconds in (0, 4, 10)
    ]
    return JointTrajectory(joint_names=list(RATES), points=points)


def state(at: float, own: float, pace: float = 1.0, **fields: object) -> bytes:
    """A state at a time, of a reference at another one, whose joints have another order [s]."""
    joints = ["gripper", "shoulder", "elbow"]
    rates = np.array([0.0, RATES["shoulder"], RATES["elbow"]])
    told = {
        "joint_names": joints,
        "reference": JointTrajectoryPoint(positions=own * rates, velocities=pace * rates),
        "speed_scaling_factor": 1.0,
    }
    stamp = Time(sec=START + int(at), nanosec=round((at - int(at)) * 1e9))
    return bytes(
        serialize_message(
            JointTrajectoryControllerState(header=Header(stamp=stamp), **told | fields)
        )
    )


class Watched:
    """A watch whose controller says what the test wants."""

    def __init__(self) -> None:
        self.broken: list[tuple[str, str, bool]] = []
        self.node = Mock()
        self.node.resolve_topic_name = lambda name: f"/{name}"
        self.watch = ControllerWatch(self.node, SETTINGS, lambda *words: self.broken.append(words))
        _, self.look, *_ = self.node.create_timer.call_args.args
        self.follow()

    def follow(self, taken: int = 0) -> None:
        """Watch the plan, which the controller has taken at a time [s]."""
        self.watch.follow("run.1", START * 10**9, taken * 10**9, trajectory())

    def hear(self, message: bytes | None) -> list[tuple[str, str, bool]]:
        handle = self.node.create_subscription.return_value.handle
        handle.__enter__, handle.__exit__ = Mock(), Mock(return_value=None)
        handle.take_message.side_effect = [message and (message, {}), None]
        self.look()
        return self.broken


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    monkeypatch.setattr(controller, "Clock", Mock())
    return Watched()


@pytest.mark.parametrize(
    "kept",
    [
        state(3.0, 3.0),
        state(3.0, 3.0, speed_scaling_factor=0.0),  # a controller before 4.39
        state(3.0, 2.995),  # a tick later
        state(-1.0, 0.0, pace=0.0),  # before the start
        state(10.5, 10.0, pace=0.0),  # after the end
        None,
    ],
)
def test_a_reference_on_the_plan_keeps_it(watched: Watched, kept: bytes | None) -> None:
    assert not watched.hear(kept)
    assert watched.hear(state(3.0, 2.9))  # it is watched on


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (state(3.0, 3.0, speed_scaling_factor=0.95), "at 0.95 of its speed"),
        (state(3.0, 3.0, speed_scaling_factor=1.5), "at 1.5 of its speed"),
        (state(3.0, 3.0, speed_scaling_factor=float("nan")), "at nan of its speed"),
        (state(3.0, 2.95), "wants elbow at -0.590000"),  # it was slower before
        (state(3.0, 2.9, speed_scaling_factor=0.0), "wants elbow"),  # it pauses
        (state(3.0, 3.0, pace=0.0), "has stopped"),
        (state(3.0, 3.0, pace=0.9), "wants elbow"),  # it begins to stop
    ],
)
def test_one_state_is_enough_to_see_that_a_plan_is_not_kept(
    watched: Watched, broken: bytes, words: str
) -> None:
    ((plan_id, why, may_have_ended),) = watched.hear(broken)
    assert plan_id == "run.1"
    assert words in why
    assert may_have_ended is ("of its speed" not in why)
    assert len(watched.hear(broken)) == 1  # told once


def test_a_reference_on_the_way_to_another_plan_is_not_compared(watched: Watched) -> None:
    watched.watch.replaced((START + 2) * 10**9)
    assert not watched.hear(state(3.0, 0.0))
    assert watched.hear(state(3.0, 3.0, speed_scaling_factor=0.5))


def test_a_reference_is_not_compared_before_the_controller_has_the_plan(watched: Watched) -> None:
    watched.follow(taken=START + 2)
    assert not watched.hear(state(1.9, 0.0, pace=0.0))
    assert watched.hear(state(2.1, 0.0, pace=0.0))


def test_a_plan_that_has_ended_is_not_watched(watched: Watched) -> None:
    watched.watch.leave("run.1")
    assert not watched.hear(state(3.0, 0.0))
    watched.node.create_timer.return_value.cancel.assert_called_with()


@pytest.mark.parametrize(
    "strange",
    [
        bytes(serialize_message(String(data="another type"))),
        state(3.0, 3.0, joint_names=["wheel"]),
        state(3.0, 3.0, reference=JointTrajectoryPoint()),
    ],
)
def test_a_state_that_says_nothing_of_the_plan_is_told_and_breaks_nothing(
    watched: Watched, strange: bytes
) -> None:
    assert not watched.hear(strange)
    watched.node.count_publishers.return_value = 1
    assert watched.watch.complaint.startswith("/arm/controller_state cannot be read: ")
    watched.hear(state(3.0, 3.0))
    assert not watched.watch.complaint


def test_a_controller_that_says_nothing_is_told(watched: Watched) -> None:
    watched.node.count_publishers.return_value = 0
    assert watched.watch.complaint == "nobody publishes /arm/controller_state"


def test_a_state_of_an_older_control_msgs_has_no_scaling(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads = controller.deserialize_message

    def older(message: bytes, kind: type) -> Mock:
        newer = reads(message, kind)
        return Mock(
            spec=["header", "joint_names", "reference"],
            **{name: getattr(newer, name) for name in ("header", "joint_names", "reference")},
        )

    monkeypatch.setattr(controller, "deserialize_message", older)
    assert not watched.hear(state(3.0, 3.0, speed_scaling_factor=0.5))
    assert watched.hear(state(3.0, 2.5))
