"""What goes on after the goal as its target does: the laws of that motion, and holds that slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm, null_space
from scipy.spatial.transform import Rotation
from shared_plans import planned

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.paths.holding import holding_in_part, poses_held
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem
from ff_planner_ros.planning.task import tail
from ff_planner_ros.planning.task.tail import EndBehaviour, with_tail
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import base_twist, total_momentum
from ff_planner_ros.robot.rotation import skew

SETTINGS = load_parameters().planner
TAIL, GOAL = 4.0, 49  # [s], and the point at the goal
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])
FREE_AXIS = np.array([0.6, 0.0, -0.8])


def moving(problem: PlanningProblem, sign: float) -> PlanningProblem:
    target = replace(
        problem.target,
        linear_velocity=sign * np.array([0.01, -0.02, 0.015]),
        angular_velocity=sign * np.array([0.02, 0.01, -0.03]),
    )
    return replace(problem, target=target, obstacles=())


@pytest.fixture(scope="module")
def problem(lemur_capture: PlanningProblem) -> PlanningProblem:
    return moving(lemur_capture, 1.0)


@pytest.fixture(scope="module")
def held(problem: PlanningProblem) -> Plan:
    """A plan whose hold is sound."""
    return with_tail(
        problem, planned(problem, SETTINGS), EndBehaviour.HOLD_END_EFFECTOR, TAIL, SETTINGS
    )


def findings(problem: PlanningProblem, motion: Trajectory) -> dict[str, str]:
    found = [failure.finding for failure in tail._lost_hold(problem, motion, SETTINGS)]
    return {finding.partition("'s ")[2].partition(" is ")[0]: finding for finding in found}


def shifted(motion: Trajectory, point: int, off: float) -> Trajectory:
    places = motion.chaser_positions.copy()
    places[point, 1] += off
    return replace(motion, chaser_positions=places)


def turned(motion: Trajectory, point: int, off: float) -> Trajectory:
    attitudes = motion.chaser_quaternions_xyzw.copy()
    turn = Rotation.from_rotvec([0.0, 0.0, off]) * Rotation.from_quat(attitudes[point])
    attitudes[point] = turn.as_quat()
    return replace(motion, chaser_quaternions_xyzw=attitudes)


def swung(motion: Trajectory, point: int, off: float) -> Trajectory:
    """Where the points are stays: only between two of them the joints are elsewhere."""
    rates = motion.joint_velocities.copy()
    rates[point, 1] += 100.0 * off
    return replace(motion, joint_velocities=rates)


def test_a_sound_hold_is_found_sound(problem: PlanningProblem, held: Plan) -> None:
    assert findings(problem, held.trajectory) == {}


@SIGNS
@pytest.mark.parametrize("point", [GOAL, GOAL + 1, GOAL + 9, -2, -1])
@pytest.mark.parametrize(("name", "spoil"), [("position", shifted), ("orientation", turned)])
def test_a_hold_that_slips_at_one_point_alone_is_refused_wherever_that_is(
    problem: PlanningProblem,
    held: Plan,
    name: str,
    spoil: Callable[[Trajectory, int, float], Trajectory],
    point: int,
    sign: float,
) -> None:
    motion = spoil(held.trajectory, point, 0.02 * sign)
    found = findings(problem, motion)
    assert f"{motion.time[point] - 10.0:.2f} s after the goal" in found[name]
    assert name == "orientation" or "0.02 m off" in found[name]


@pytest.mark.law("PLAN-17")
@SIGNS
@pytest.mark.parametrize("point", [GOAL + 1, GOAL + 9, -1])
@pytest.mark.parametrize("name", ["position", "orientation"])
def test_a_hold_that_slips_between_its_points_alone_is_refused(
    problem: PlanningProblem, held: Plan, name: str, point: int, sign: float
) -> None:
    motion = swung(held.trajectory, point, 0.02 * sign)
    found = findings(problem, motion)[name]
    after = float(found.rpartition(" off the target ")[2].partition(" s ")[0])
    near = np.abs(motion.time[point] - 10.0 - after)
    assert 0.0 < near < motion.time[-1] - motion.time[-2], (found, near)


def test_what_is_off_before_the_goal_is_no_matter_of_the_hold(
    problem: PlanningProblem, held: Plan
) -> None:
    assert findings(problem, shifted(held.trajectory, GOAL - 1, 0.02)) == {}


def test_a_hold_that_stays_where_the_target_was_is_refused(
    problem: PlanningProblem, held: Plan
) -> None:
    """And one whose target goes the other way is not the same."""
    for other in (
        replace(problem, target=replace(problem.target, **{name: np.zeros(3)}))
        for name in ("linear_velocity", "angular_velocity")
    ):
        found = findings(other, held.trajectory)
        assert list(found) == (
            ["position"] if other.target.angular_velocity.any() else ["orientation"]
        )
        assert f"{TAIL:.2f} s after the goal" in next(iter(found.values()))
    assert set(findings(moving(problem, -1.0), held.trajectory)) == {"position", "orientation"}


@SIGNS
def test_the_target_goes_on_with_its_twist_about_inertial_axes(
    lemur_capture: PlanningProblem, sign: float
) -> None:
    problem, times = moving(lemur_capture, sign), np.array([0.0, 1.3, 40.0])
    target = problem.target
    positions, quaternions = poses_held(problem, times)
    first = Rotation.from_quat(target.quaternion_xyzw).as_matrix()
    for time, position, quaternion in zip(times, positions, quaternions, strict=True):
        np.testing.assert_allclose(position, target.position + time * target.linear_velocity)
        turn = expm(time * skew(target.angular_velocity)) @ first
        np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), turn, atol=1e-12)


def test_a_body_goes_on_from_the_capture() -> None:
    problem, times = tumbling.problem("tumbling", 0), np.array([0.0, 0.7, 3.0])
    body = problem.target_body
    assert body is not None
    positions, quaternions = poses_held(problem, times)
    for time, position, quaternion in zip(times, positions, quaternions, strict=True):
        there = body.after(problem.duration + time)
        attitude = Rotation.from_quat(there.quaternion_xyzw)
        grasp = attitude * Rotation.from_quat(there.grasp_quaternion_xyzw)
        place = there.position + attitude.as_matrix() @ there.grasp_position
        np.testing.assert_allclose(position, place, atol=1e-9)
        assert (grasp.inv() * Rotation.from_quat(quaternion)).magnitude() < 1e-9


def ee_pose(problem: PlanningProblem, q: Array) -> tuple[Array, Array]:
    robot = problem.robot
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    return tip.translation.copy(), tip.rotation.copy()


@pytest.fixture(params=[(kind, sign) for kind in Orientation for sign in (1.0, -1.0)], ids=str)
def in_part(
    request: pytest.FixtureRequest, lemur_capture: PlanningProblem
) -> tuple[PlanningProblem, Array, Array, Array]:
    """A problem whose target goes on as the end effector does, and configuration and rates."""
    orientation, sign = request.param
    robot = lemur_capture.robot
    data = robot.model.createData()
    q, _ = configuration(robot, lemur_capture.start)
    rng = np.random.default_rng(3)
    rates = sign * rng.uniform(0.02, 0.06, robot.joints) * rng.choice([-1.0, 1.0], robot.joints)
    momentum = sign * np.array([1.0, -2.0, 1.5, 0.5, -0.8, 0.3])
    v = np.concatenate([base_twist(robot, data, q, momentum, rates), rates])
    pin.forwardKinematics(robot.model, data, q, v)
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    position, rotation = ee_pose(lemur_capture, q)
    axis, turning = rotation @ FREE_AXIS, twist.angular.copy()
    if orientation is Orientation.FREE:
        turning = np.zeros(3)
    elif orientation is Orientation.ABOUT_AXIS:
        turning -= axis * (axis @ turning)
    target = replace(
        lemur_capture.target,
        position=position,
        quaternion_xyzw=Rotation.from_matrix(rotation).as_quat(),
        linear_velocity=twist.linear.copy(),
        angular_velocity=turning,
        orientation=orientation,
        free_axis_in_ee=FREE_AXIS if orientation is Orientation.ABOUT_AXIS else None,
    )
    return replace(lemur_capture, target=target, obstacles=()), q, rates, momentum


def test_of_the_target_what_is_said_is_held_and_the_rest_fades_while_nothing_pushes(
    in_part: tuple[PlanningProblem, Array, Array, Array],
) -> None:
    problem, q_goal, rates, momentum = in_part
    robot, target, time = problem.robot, problem.target, np.linspace(0.0, 2.0, 41)
    q, v, dv = holding_in_part(problem, q_goal, rates, momentum, time)
    data = robot.model.createData()
    for at, moving_at in zip(q, v, strict=True):
        assert total_momentum(robot, data, at, moving_at) == pytest.approx(momentum, abs=1e-9)
    # Nothing jumps where it begins.
    np.testing.assert_allclose(v[0, 6:], rates, atol=1e-9)
    # It is one motion: configurations, velocities and their rates belong together.
    step = time[1]
    ways = np.array([pin.difference(robot.model, a, b) for a, b in zip(q[:-2], q[2:], strict=True)])
    np.testing.assert_allclose(ways[:, 6:] / (2 * step), v[1:-1, 6:], atol=1e-4)
    np.testing.assert_allclose((v[2:] - v[:-2])[:, 6:] / (2 * step), dv[1:-1, 6:], atol=5e-4)
    poses = [ee_pose(problem, at) for at in q]
    wanted = target.position + np.outer(time, target.linear_velocity)
    np.testing.assert_allclose([position for position, _ in poses], wanted, atol=1e-6)
    first = poses[0][1]
    for seconds, (_, rotation) in zip(time, poses, strict=True):
        there = expm(seconds * skew(target.angular_velocity)) @ first
        if target.orientation is Orientation.FIXED:
            np.testing.assert_allclose(rotation, there, atol=1e-6)
    # At the end nothing moves but what the target says: the least rates that make its twist.
    moves = ee_moves(problem, q[-1], momentum)
    conditions = moves[:3]
    if target.orientation is Orientation.FIXED:
        conditions = moves
    elif target.orientation is Orientation.ABOUT_AXIS:
        across = null_space((poses[-1][1] @ FREE_AXIS)[None]).T
        conditions = np.vstack([moves[:3], across @ moves[3:]])
    assert np.abs(v[-1, 6:] @ null_space(conditions)).max() < 1e-6


def test_what_moves_only_the_arm_fades_without_a_jerk_at_either_end(
    lemur_capture: PlanningProblem,
) -> None:
    """Slow rates, which change by nothing else: half of them are left half-way."""
    q, _ = configuration(lemur_capture.robot, lemur_capture.start)
    target = replace(
        lemur_capture.target, orientation=Orientation.FREE, linear_velocity=np.zeros(3)
    )
    problem = replace(lemur_capture, target=target, obstacles=())
    moves = ee_moves(problem, q, np.zeros(6))[:3]
    rates = 1e-4 * null_space(moves) @ np.array([1.0, -2.0, 1.5, -0.5])
    _, v, dv = holding_in_part(problem, q, rates, np.zeros(6), np.linspace(0.0, 2.0, 21))
    np.testing.assert_allclose(v[[0, 10, -1], 6:], [rates, rates / 2, 0 * rates], atol=1e-7)
    np.testing.assert_allclose(dv[[0, -1], 6:], 0.0, atol=1e-6)
    np.testing.assert_allclose(dv[10, 6:], -0.75 * rates, atol=1e-6)


def ee_moves(problem: PlanningProblem, q: Array, momentum: Array) -> Array:
    """How the end effector's twist changes with each joint's rate while nothing pushes, (6, n)."""
    robot = problem.robot
    data = robot.model.createData()

    def twist(rates: Array) -> Array:
        v = np.concatenate([base_twist(robot, data, q, momentum, rates), rates])
        pin.forwardKinematics(robot.model, data, q, v)
        found: Array = pin.getFrameVelocity(
            robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED
        ).vector.copy()
        return found

    rest = twist(np.zeros(robot.joints))
    return np.column_stack([twist(row) - rest for row in np.eye(robot.joints)])


def test_a_hold_in_part_that_would_need_a_stretched_arm_is_refused(
    lemur_capture: PlanningProblem,
) -> None:
    """The target goes where the arm can hardly follow: it would take rates of thousands."""
    q = configuration(lemur_capture.robot, lemur_capture.start)[0].copy()
    q[7:] = 1e-5
    directions, sizes, _ = np.linalg.svd(ee_moves(lemur_capture, q, np.zeros(6)))
    assert sizes[-1] < 1e-4
    for sign in (1.0, -1.0):
        twist = 0.05 * sign * directions[:, -1]
        target = replace(
            lemur_capture.target, linear_velocity=twist[:3], angular_velocity=twist[3:]
        )
        problem = replace(lemur_capture, target=target)
        with pytest.raises(NoPlanFound, match=r"t = 10\.00 s") as refused:
            holding_in_part(problem, q, np.zeros(7), np.zeros(6), np.linspace(0.0, 1.0, 11))
        assert refused.value.status is Status.SINGULAR
