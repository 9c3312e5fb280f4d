"""The laws of the problems of held chasers and of goals of the joints: each witness keeps them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from recorded_requests import only_request

from ff_planner_benchmark.bench.plans import JOINT_GOAL_PLANS
from ff_planner_benchmark.problems import joint_goals
from ff_planner_benchmark.problems.joint_goals import FAR, NEAR, ROBOTS
from ff_planner_benchmark.problems.witnessed import way_of
from ff_planner_ros.bag import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.wheel_motion import wheels_along
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.wheels import momenta_of
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify


@pytest.fixture(scope="module", params=range(8))
def held(request: pytest.FixtureRequest) -> Drawn[JointMotion]:
    return joint_goals.problem("held", request.param)


def test_a_witness_of_a_held_chaser_comes_to_the_goal_past_the_spheres(
    held: Drawn[JointMotion],
) -> None:
    problem, robot = held.problem, held.problem.robot
    assert robot.base is Base.ATTITUDE_HELD
    times, way, velocities, _ = way_of(robot, problem.start, held.witness)
    assert not velocities[:, 3:6].any()
    assert np.abs(miss(robot, way[-1], problem.target)).max() < 1e-9
    # The joints rest at the end, and the chaser does not turn: all drift as its origin does.
    np.testing.assert_allclose(problem.target.linear_velocity, velocities[-1, :3], atol=1e-9)
    np.testing.assert_allclose(problem.target.angular_velocity, 0.0, atol=1e-9)
    assert times[-1] == pytest.approx(problem.duration)
    points = arm_points(robot, way)
    if problem.obstacles:
        near = clearances(points, times, segments(points), problem.obstacles)
        assert near.distance.min() > 0.0


def test_a_witness_keeps_the_limits_of_the_wheels_near_or_far(held: Drawn[JointMotion]) -> None:
    problem, robot = held.problem, held.problem.robot
    wheels = robot.wheels
    assert wheels is not None
    stored = momenta_of(wheels, problem.start)
    _, q, v, accelerations = way_of(robot, problem.start, held.witness)
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
    rows = list(JOINT_GOAL_PLANS.rows(1, load_parameters().planner))
    assert [row[:3] for row in JOINT_GOAL_PLANS.table(rows).rows] == [
        (kind, "1", "100.0%") for kind in joint_goals.KINDS
    ]


@pytest.mark.parametrize("number", range(3))
def test_random_starts_are_clear_of_the_spheres_and_share_goal_and_centre_of_mass(
    number: int,
) -> None:
    first, other = (joint_goals.problem("random start", n).problem for n in (0, number + 1))
    assert first.robot is other.robot
    assert first.robot.joints == 8
    np.testing.assert_array_equal(first.target.position, other.target.position)
    assert not np.allclose(first.start.joint_positions, other.start.joint_positions)
    q, v = configuration(other.robot, other.start)
    data = other.robot.model.createData()
    np.testing.assert_allclose(pin.centerOfMass(other.robot.model, data, q), 0.0, atol=1e-12)
    assert not v.any()
    points = arm_points(other.robot, q[None])
    away = clearances(points, np.zeros(1), segments(points), other.obstacles).distance.min()
    assert away >= 0.02


@pytest.mark.parametrize("number", range(4))
def test_a_witness_of_a_rail_slides_and_comes_to_the_goal_past_the_spheres(number: int) -> None:
    drawn = joint_goals.problem("rail", number)
    problem, robot = drawn.problem, drawn.problem.robot
    assert drawn.witness is not None
    assert robot.slides(0)
    assert abs(np.ptp(drawn.witness.positions[:, 0])) > 0.01
    times, way, velocities, _ = way_of(robot, problem.start, drawn.witness)
    assert np.abs(miss(robot, way[-1], problem.target)).max() < 1e-7
    # The joints rest at the end: all turn with the chaser.
    turning = pin.Quaternion(way[-1, 3:7]) * velocities[-1, 3:6]
    np.testing.assert_allclose(problem.target.angular_velocity, turning, atol=1e-9)
    lever = problem.target.position - way[-1, :3]
    moving = pin.Quaternion(way[-1, 3:7]) * velocities[-1, :3] + np.cross(turning, lever)
    np.testing.assert_allclose(problem.target.linear_velocity, moving, atol=1e-7)
    points = arm_points(robot, way)
    near = clearances(points, times, segments(points), problem.obstacles)
    assert near.distance.min(initial=1.0) > 0.0


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("kind", joint_goals.KINDS)
def test_a_plan_of_each_kind_is_flown_recorded_replayed_and_read_in_a_report(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = PlanningTask(joint_goals.problem(kind, 1).problem, load_parameters().planner)
    plan = perform(task)
    assert verify(task.problem.robot, plan.trajectory).passed
    record_answer(tmp_path / "bag", task, plan, 0.1)
    recorded = only_request(tmp_path / "bag")
    assert replay(recorded).verdict is Verdict.IDENTICAL
    (read,) = read_plans(tmp_path / "bag")
    columns = read.columns()
    assert ("rail_position_m" in columns) == (kind == "rail")
    assert ("wheel_1_momentum_Nms" in columns) == (task.problem.robot.wheels is not None)
    monkeypatch.chdir(tmp_path)
    assert main(["report", "bag"]) == 0
    (page,) = tmp_path.rglob("*.html")
    text = page.read_text(encoding="utf-8")
    if kind == "rail":
        assert "rail [m]" in text
        assert " mm/s" in text
    assert ("wheel momenta" in text.lower()) == (task.problem.robot.wheels is not None)
