"""A report of a long run: it decodes what it shows, and of each plan the states while it ran."""

from __future__ import annotations

import random
import struct
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from answers import EXCHANGES, FRAME, answer_with, exchange
from ff_planner_msgs.msg import ChaserState, Exchange, PlanRequest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.report.run_page import save_page
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.runs import measured
from ff_planner_ros.runs.measured import Window, fill_windows

T0, SECOND, RATE = 1_760_000_000_000_000_000, 1_000_000_000, 100
PLANS = 3
MANY = 3_000_000  # messages
PATIENCE = 60.0  # [s] of one processor, for a report of them


Record: TypeAlias = Callable[[Path, int], None]


@pytest.fixture(scope="module")
def long_run(lemur_capture: PlanningProblem, lemur_plan: Plan) -> Record:
    """Record one plan again and again, in a run of many chaser states at 100 Hz."""
    text = task_json(PlanningTask(lemur_capture, load_parameters().planner))
    names = lemur_capture.robot.joint_names
    state = bytearray(encode(state_message(lemur_capture.start, names, 0, FRAME)))

    def record(directory: Path, messages: int) -> None:
        with BagWriter(directory, flush_interval=10.0) as writer:
            writer.attach("parameters.yaml", "application/yaml", b"{}")
            writer.add_topic("/chaser_state", type_name(ChaserState), [])
            writer.add_topic(EXCHANGES, type_name(Exchange), [])
            for number in range(messages):
                now = T0 + number * SECOND // RATE
                if number % (messages // PLANS) == 0:
                    answer = answer_with(lemur_plan, f"plan.{number}", now)
                    told = exchange(answer, PlanRequest(), now, task=text)
                    writer.write(EXCHANGES, encode(told), now, now)
                struct.pack_into("<iI", state, 4, now // SECOND, now % SECOND)
                writer.write("/chaser_state", bytes(state), now, now)

    return record


@pytest.mark.ci
def test_a_report_decodes_the_states_of_the_plans_that_it_shows_and_no_others(
    long_run: Record,
    tmp_path: Path,
    times: Callable[[int, int], int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    messages = times(6_000, MANY)
    long_run(tmp_path / "run", messages)
    decoded = []
    decode = Bag.decode
    monkeypatch.setattr(Bag, "decode", lambda bag, one: (decoded.append(1), decode(bag, one))[1])
    begun = time.process_time()
    report = report_of_bag(tmp_path / "run", most_plans=2)
    save_page(report, tmp_path / "page.html")
    taken = time.process_time() - begun
    assert [one.plan is not None for one in report.requests] == [False, True, True]
    for request in report.requests[1:]:
        plan = request.plan
        duration = plan.motion.time[-1]
        expected = np.arange(duration * RATE + 1) / RATE
        np.testing.assert_allclose(plan.measured.time, expected, rtol=0.0, atol=1e-6)
        assert not any("are compared" in remark for remark in plan.remarks)
    assert len(decoded) == sum(len(one.plan.measured.time) for one in report.requests[1:])
    if messages >= MANY:
        assert taken < PATIENCE


def test_of_more_states_than_a_figure_shows_some_are_compared_evenly_in_time(
    long_run: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = 60
    monkeypatch.setattr(measured, "MOST_STATES", most)
    long_run(tmp_path / "run", 6_000)
    report = report_of_bag(tmp_path / "run", most_plans=1)
    plan = report.requests[-1].plan
    assert len(plan.measured.time) == most
    assert np.diff(plan.measured.time).max() < 2 * plan.motion.time[-1] / most
    said = f"Of {round(plan.motion.time[-1] * RATE) + 1} measured states {most} are compared"
    assert any(said in remark for remark in plan.remarks)


@pytest.mark.parametrize("most", [measured.MOST_STATES, 20])
def test_odometry_goes_with_the_joint_states_nearest_in_time_whatever_comes_first(
    lemur: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(measured, "MOST_STATES", most)
    chance = random.Random(5)
    bodies = sorted(chance.sample(range(10**9), 200))
    arms = chance.sample(range(10**9), 300)
    with BagWriter(tmp_path / "run", flush_interval=1.0) as writer:
        writer.add_topic("/odometry", "nav_msgs/msg/Odometry", [])
        writer.add_topic("/joint_states", "sensor_msgs/msg/JointState", [])
        heard: list[tuple[str, Any]] = []
        for stamp in bodies:
            odometry = Odometry(child_frame_id="sensor")
            odometry.header.frame_id, odometry.header.stamp = "inertial", time_message(T0 + stamp)
            heard.append(("/odometry", odometry))
        for stamp in arms:
            joints = JointState(name=list(lemur.joint_names), velocity=[0.0] * lemur.joints)
            joints.position = [stamp * 1e-9] * lemur.joints
            joints.header.stamp = time_message(T0 + stamp)
            heard.append(("/joint_states", joints))
        chance.shuffle(heard)
        for number, (topic, message) in enumerate(heard):
            writer.write(topic, encode(message), number, number)
    parameters = load_parameters()
    sensor = replace(parameters.odometry, child_frame_id="sensor")
    changes = {"state_source": "odometry", "odometry": sensor, "state_synchronization": 1.0}
    parameters = replace(parameters, **changes)
    window = Window("", "inertial", T0, T0 + 10**9)
    with open_bag(tmp_path / "run") as bag:
        fill_windows(bag, lemur, parameters, [window])
    assert 0 < len(window.states) <= most
    assert window.left_out == len(bodies) - len(window.states)
    assert window.unusable == []
    for stamp_ns, state in window.states.items():
        nearest = min(arms, key=lambda arm: abs(T0 + arm - stamp_ns))
        assert state.joint_positions.tolist() == [nearest * 1e-9] * lemur.joints
