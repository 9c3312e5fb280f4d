"""Basilisk, a third engine; skipped where it is not installed."""

from dataclasses import replace

import numpy as np
import pytest
from robots import LEMUR_SCENARIO

from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform

pytestmark = pytest.mark.ci

pytest.importorskip("Basilisk", reason="pip install './benchmark[basilisk]' brings Basilisk")


@pytest.fixture(scope="module")
def capture():
    problem = load_scenario(LEMUR_SCENARIO)
    return problem.robot, perform(PlanningTask(problem, load_parameters().planner)).trajectory


@pytest.mark.parametrize(
    ("step", "turn", "digits"), [(0.2, 11.6831, 2e-4), (0.01, 11.746464, 1e-6)]
)
def test_its_own_robotic_arm_turns_the_hub_as_published(step, turn, digits):
    from ff_planner_benchmark.gallery.recomputed import (
        BASILISK_ACCELERATIONS,
        BASILISK_GOALS,
        model,
    )
    from ff_planner_benchmark.third_engine import robotic_arm

    robot = model("basilisk_arm", root="hub")
    moved = robotic_arm(robot, BASILISK_GOALS, BASILISK_ACCELERATIONS, 300.0, step)
    assert moved.turn == pytest.approx(turn, abs=digits)
    assert moved.q[-1, 7:] == pytest.approx(BASILISK_GOALS, abs=1e-6)


@pytest.mark.parametrize("parts", [1, 4])
def test_a_plan_comes_true_open_loop(capture, parts):
    from ff_planner_benchmark.third_engine import flown

    found = flown(*capture, Scene(), parts)
    assert found.passed
    assert found.engine.startswith("Basilisk 2.")
    assert found.deviation.final_position_error < 1e-5
    assert found.deviation.max_chaser_orientation_error < 1e-5


def test_other_torques_do_not_come_true(capture):
    from ff_planner_benchmark.third_engine import flown

    robot, motion = capture
    more = motion.joint_torques + 0.5 * np.cos(np.arange(robot.joints))
    found = flown(robot, replace(motion, joint_torques=more), Scene(), 1)
    assert not found.passed


def test_a_held_base_is_refused(capture):
    from ff_planner_benchmark.third_engine import flown
    from ff_planner_ros.robot.model import Base

    robot, motion = capture
    with pytest.raises(FfPlannerError, match="free bases and revolute joints alone"):
        flown(replace(robot, base=Base.ATTITUDE_HELD), motion, Scene(), 1)
