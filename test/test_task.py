"""Planning ahead of a snapshot, against a drift in closed form and an independent engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import robots

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.settings import PlannerSettings, load_settings
from ff_planner_ros.planning.tail import EndBehaviour
from ff_planner_ros.planning.task import PlanningTask, perform
from ff_planner_ros.planning.watch import Progress
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import execute
from ff_planner_ros.simulation.feed_forward import feed_forward

WAIT = 3.0  # [s] from the measurement to the start of the plan
DRIFT = np.array([0.02, 0.0, 0.05])  # [m/s] the paper's chaser


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_settings(robots.CONFIG / "planner.yaml")


@pytest.fixture(scope="module")
def drifting(lemur_capture: PlanningProblem) -> PlanningProblem:
    """The capture by a chaser that drifts and does not turn, its arm held."""
    return replace(lemur_capture, start=_drifted(lemur_capture.start, 0.0))


def _drifted(state: SystemState, seconds: float) -> SystemState:
    """Nothing turns and nothing bends: everything moves on by v t."""
    return replace(
        state,
        position_chaser_in_inertial=state.position_chaser_in_inertial + seconds * DRIFT,
        linear_velocity_chaser_in_inertial=DRIFT,
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(7),
    )


def _plan(problem: PlanningProblem, ahead: float, settings: PlannerSettings) -> Plan:
    task = PlanningTask(problem, ahead, None, EndBehaviour.AS_PLANNED, 0.0)
    return perform(task, settings, lambda: None, lambda _: None)


def _reached(problem: PlanningProblem, plan: Plan) -> Array:
    """Where the end effector comes to when the plan is executed from where the chaser then is."""
    robot = problem.robot
    there = _drifted(problem.start, WAIT)
    start = replace(
        there,
        linear_velocity_chaser_in_inertial=plan.trajectory.chaser_linear_velocities[0],
        angular_velocity_chaser_in_inertial=plan.trajectory.chaser_angular_velocities[0],
        joint_velocities=plan.trajectory.joint_velocities[0],
    )
    run = execute(Engine(robot), start, feed_forward(robot, plan.trajectory, 8))
    return run.ee_positions[-1]


def test_a_plan_from_the_snapshot_itself_misses_by_what_the_chaser_drifts_meanwhile(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    miss = _reached(drifting, _plan(drifting, 0.0, settings)) - drifting.target.position
    np.testing.assert_allclose(miss, WAIT * DRIFT, atol=1e-3)
    assert np.linalg.norm(miss) > 0.15


def test_a_plan_from_where_the_chaser_will_be_reaches_the_goal(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    plan = _plan(drifting, WAIT, settings)
    np.testing.assert_allclose(plan.trajectory.chaser_positions[0], WAIT * DRIFT, atol=1e-9)
    miss = _reached(drifting, plan) - drifting.target.position
    assert np.linalg.norm(miss) < 1e-3


def test_the_tail_is_part_of_the_plan(drifting: PlanningProblem, settings: PlannerSettings) -> None:
    task = PlanningTask(drifting, 0.0, None, EndBehaviour.STOP_JOINTS, 2.0)
    plan = perform(task, settings, lambda: None, lambda _: None)
    assert plan.trajectory.time[-1] == pytest.approx(drifting.duration + 2.0)
    np.testing.assert_allclose(plan.trajectory.joint_velocities[-1], 0.0, atol=1e-9)


def test_progress_is_told_and_the_search_ends_when_it_is_told_to(
    drifting: PlanningProblem, settings: PlannerSettings
) -> None:
    told: list[Progress] = []

    def keep_going() -> None:
        if len(told) >= 3:
            raise OutOfTime("enough")

    task = PlanningTask(drifting, 0.0, None, EndBehaviour.AS_PLANNED, 0.0)
    with pytest.raises(Exception, match="enough"):
        perform(task, settings, keep_going, told.append)
    assert [progress.iterations for progress in told] == [1, 2, 3]
    assert {progress.phase for progress in told} == {"searching"}
    assert all(progress.starts == 1 and progress.violation >= 0.0 for progress in told)
