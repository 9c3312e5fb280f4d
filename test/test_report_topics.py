"""A bag that holds no exchanges is shown all the same: the trajectories that were published."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from read_page import Page

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.report.from_topics import published_motions
from ff_planner_ros.report.run_page import save_page
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import plan_message

START = 1_795_000_000 * 10**9


@pytest.fixture(scope="module")
def bag(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """What a recorder of others has of a plan, and of one for another robot."""
    directory = tmp_path_factory.mktemp("bags") / "run"
    message = plan_message(lemur_plan, START, "inertial")
    others = plan_message(replace(lemur_plan, joint_names=("a",) * 7), START + 10**9, "inertial")
    with BagWriter(directory, flush_interval=0.0) as opened:
        opened.attach("robot.urdf", "application/xml", lemur_capture.robot.drawn_urdf.encode())
        for topic, told in (
            ("/sat1/joint_trajectory", [message.joint_trajectory, others.joint_trajectory]),
            ("/sat1/predicted_chaser_path", [message.chaser_path, others.chaser_path]),
        ):
            opened.add_topic(topic, type_name(type(told[0])), [])
            for one in told:
                opened.write(topic, encode(one), START, START)
    return directory


def test_the_motion_is_that_of_the_plan_and_twists_are_near(bag: Path, lemur_plan: Plan) -> None:
    with open_bag(bag) as opened:
        (found,) = published_motions(opened)
    assert (found.topic, found.frame, found.start_ns) == (
        "/sat1/joint_trajectory",
        "inertial",
        START,
    )
    motion, planned = found.motion, lemur_plan.trajectory
    for name in ("joint_positions", "joint_velocities", "chaser_positions", "ee_positions"):
        np.testing.assert_allclose(getattr(motion, name), getattr(planned, name), atol=1e-9)
    for name in ("chaser_linear_velocities", "chaser_angular_velocities"):
        truth = getattr(planned, name)
        off = np.abs(getattr(motion, name) - truth)[1:-1].max()
        assert off < 0.02 * np.abs(truth).max(), name


def test_its_page_draws_it_and_says_why_nothing_can_be_planned_again(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = report_of_bag(bag, 20)
    save_page(report, tmp_path / "page.html")
    page = Page((tmp_path / "page.html").read_text())
    assert "it holds no ff_planner_msgs/msg/Exchange" in page.words
    assert "differences of its path" in page.words
    assert [request.plan is not None for request in report.requests] == [True]
    assert main(["replay", str(bag)]) == 2
    assert "cannot be planned again" in capsys.readouterr().err
