"""Plans in a second engine, Drake, beside MuJoCo; skipped where Drake is not installed."""

import numpy as np
import pytest

from ff_planner_benchmark.bench.executed import _flown
from ff_planner_benchmark.problems import captured, joint_goals
from ff_planner_benchmark.problems.classes import BODIES, SCENARIOS, STILL, TUMBLING
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import PlanningTask, perform

pytestmark = pytest.mark.ci

pytest.importorskip("pydrake", reason="pip install './benchmark[drake]' brings Drake")
pytest.importorskip("mujoco")

OF_DATA_SET = [*SCENARIOS, BODIES, TUMBLING[0], *STILL]
LARGEST_MISS = 1e-3  # [m]
# That a motion of joint goals, or after a grasp, is executed in.
PARTS = 4


@pytest.mark.sampled
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize("one", OF_DATA_SET, ids=lambda one: one.name)
def test_three_plans_of_each_class_arrive_in_both_engines(one, times):
    for number in range(times(1, 3)):
        for row in _flown(one, number, load_parameters().planner):
            assert row["passed"], number
            assert row["position_mujoco"] < LARGEST_MISS, number
            assert row["position_drake"] < LARGEST_MISS, number


@pytest.mark.sampled
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize("kind", joint_goals.KINDS)
def test_wheels_rails_stows_and_stops_come_true_in_both_engines(kind, times):
    """The torque that holds a base is the one that the plan's wheels give."""
    from ff_planner_ros.simulation.verification import verify

    settings = load_parameters().planner
    for number in range(times(1, 5)):
        problem = joint_goals.problem(kind, number).problem
        motion = perform(PlanningTask(problem, settings)).trajectory
        first = verify(problem.robot, motion)
        assert first.passed, number
        assert first.deviation.final_position_error < 1e-4
        second = require_reproduced_in_drake(problem.robot, motion, number)
        if problem.robot.wheels is not None:
            assert first.holding_torque_error < 1e-6
            assert second.holding_torque < 1e-6


@pytest.mark.sampled
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize("kind", captured.KINDS)
def test_what_follows_a_grasp_comes_true_in_both_engines(kind, times):
    """With the body as a payload, which has shapes, of the robot."""
    from ff_planner_ros.simulation.verification import verify

    for number in range(times(1, 5)):
        task = captured.problem(kind, number).task(load_parameters().planner)
        for one, plan in phase_tasks(task, perform(task)):
            robot, motion = one.problem.robot, plan.trajectory
            first = verify(robot, motion)
            assert first.passed, number
            require_reproduced_in_drake(robot, motion, number)


def require_reproduced_in_drake(robot, motion, number):
    """Execute a motion in parts, in Drake, and return the sum of their deviations.

    Each part begins on the plan: without feedback some of these motions are unstable, in any
    engine. The sum is multiplied by the number of parts, as `verify` does and for its reason.
    """
    from ff_planner_benchmark.beside_mujoco import parts_of
    from ff_planner_benchmark.second_engine import Miss, flown_in_drake

    parts = [flown_in_drake(robot, part) for _, part in parts_of(motion, PARTS)]
    missed = Miss(*(len(parts) * np.sum(parts, axis=0)))
    assert missed.position < 1e-4, number
    assert missed.orientation < np.deg2rad(0.01), number
    assert missed.chaser < 1e-4, number
    return missed
