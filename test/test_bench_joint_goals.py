"""The laws of the problems of held chasers and of goals of the joints: each witness keeps them."""

from __future__ import annotations

import numpy as np
import pytest

from ff_planner_ros.bench.success import joint_goals_measurement
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.problems import joint_goals
from ff_planner_ros.problems.joint_goals import FAR, NEAR, ROBOTS, JointGoal
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.wheels import momenta_of


@pytest.fixture(scope="module", params=range(8))
def held(request: pytest.FixtureRequest) -> JointGoal:
    return joint_goals.problem("held", request.param)


def test_a_witness_of_a_held_chaser_comes_to_the_goal_past_the_spheres(held: JointGoal) -> None:
    problem, robot = held.problem, held.problem.robot
    assert robot.base is Base.ATTITUDE_HELD
    times, way, velocities, _ = joint_goals.way_of(robot, problem, held.witness)
    assert not velocities[:, 3:6].any()
    assert np.abs(miss(robot, way[-1], problem.target)).max() < 1e-9
    assert times[-1] == pytest.approx(problem.duration)
    points = arm_points(robot, way)
    if problem.spheres:
        near = clearances(points, times, segments(points), problem.spheres)
        assert near.distance.min() > 0.0


def test_a_witness_keeps_the_limits_of_the_wheels_near_or_far(held: JointGoal) -> None:
    problem, robot = held.problem, held.problem.robot
    wheels = robot.wheels
    assert wheels is not None
    stored = momenta_of(wheels, problem.start)
    _, q, v, accelerations = joint_goals.way_of(robot, problem, held.witness)
    momenta, torques = wheels_along(robot, wheels, stored, q, v, accelerations)
    number = next(k for k in range(8) if joint_goals.problem("held", k) is held)
    factor = (NEAR, FAR)[number // len(ROBOTS) % 2]
    for rows, limits in ((momenta, wheels.momentum), (torques, wheels.torque)):
        assert limits is not None
        np.testing.assert_allclose(np.abs(rows).max(axis=0) * factor, limits, rtol=1e-9)


@pytest.mark.parametrize("number", range(4))
def test_a_witness_of_a_stow_ends_in_the_posture_and_one_of_a_stop_at_rest(number: int) -> None:
    stow, stop = (joint_goals.problem(kind, number) for kind in ("stow", "stop"))
    posture = stow.problem.posture
    assert posture is not None
    np.testing.assert_array_equal(stow.witness.positions[-1], posture.positions)
    assert not stow.witness.velocities[-1].any()
    limits, window = stop.problem.limits.joint_accelerations, stop.problem.duration_range
    assert limits is not None
    assert window is not None
    assert not stop.witness.velocities[-1].any()
    np.testing.assert_array_equal(stop.witness.velocities[0], stop.problem.start.joint_velocities)
    (lowest, highest), _ = stop.witness.extremes(2)
    assert (np.maximum(-lowest, highest) <= limits).all()
    assert window.minimum < stop.witness.time[-1] < window.maximum


def test_one_problem_of_each_kind_is_planned() -> None:
    measured = joint_goals_measurement(1, load_parameters().planner)
    (table,) = measured.tables
    assert [row[:3] for row in table.rows] == [(kind, "1", "100.0%") for kind in joint_goals.KINDS]
