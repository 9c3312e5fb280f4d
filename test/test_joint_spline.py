"""Joint splines: the motion against textbook laws, its derivatives against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from reference_joint_spline import hulls
from robots import CONFIG, random_state, random_urdf

from ff_planner_benchmark.problems import joint_goals
from ff_planner_benchmark.problems.joint_goals import ROBOTS
from ff_planner_benchmark.problems.witnessed import drawn as witnessed
from ff_planner_benchmark.problems.witnessed import drawn_problem
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.joint_spline import JointSplines, joint_splines
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.grid import grids_of
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum

SETTINGS = load_parameters().planner
DURATION, POINTS = 9.0, 21
SPLINES = Parametrisation.JOINT_SPLINE
AXIS = np.array([0.48, -0.6, 0.64])
BOTH = Objective(1.0, 1.0)


def tumbling_problem(robot: Robot, orientation: Orientation, seed: int = 0) -> PlanningProblem:
    """A tumbling, drifting start with known accelerations, and a moving target."""
    rng = np.random.default_rng(seed)
    start = random_state(robot, rng)
    start = replace(start, joint_accelerations=rng.normal(scale=0.02, size=robot.joints))
    quaternion = rng.normal(size=4)
    small = rng.normal(scale=0.03, size=(4, 3))
    # No turn can be wanted where it is free.
    if orientation is Orientation.FREE:
        small[[1, 3]] = 0.0
    elif orientation is Orientation.ABOUT_AXIS:
        axis = pin.Quaternion(quaternion).normalized().toRotationMatrix() @ AXIS
        small[[1, 3]] -= np.outer(small[[1, 3]] @ axis, axis)
    target = Target(
        rng.uniform(-3.0, 3.0, 3),
        quaternion / np.linalg.norm(quaternion),
        *small,
        orientation=orientation,
        free_axis_in_ee=AXIS if orientation is Orientation.ABOUT_AXIS else None,
    )
    return PlanningProblem(robot, start, target, DURATION, 50, (), Objective(1.0, 0.0))


def drawn_splines(
    orientation: Orientation = Orientation.FIXED, joints: int = 7
) -> tuple[JointSplines, Array]:
    robot = robot_from_urdf_text(random_urdf(joints, seed=1), "bus", "tool")
    family = joint_splines(tumbling_problem(robot, orientation), SETTINGS)
    count = family.variables // joints
    hold = np.tile(family.fixed[2][:, None], count)
    rng = np.random.default_rng(2)
    return family, (hold + rng.normal(scale=0.2, size=(joints, count))).ravel()


def planar_splines() -> tuple[JointSplines, Array]:
    family = joint_splines(witnessed("planar", 1).problem, SETTINGS)
    return family, np.random.default_rng(2).normal(scale=0.5, size=family.variables)


@pytest.mark.law("PLAN-27")
@pytest.mark.parametrize("which", [*Orientation, "planar"])
def test_all_derivatives_are_those_of_finite_differences(which: str) -> None:
    family, x = planar_splines() if which == "planar" else drawn_splines(Orientation(which))
    model, step = family.robot.model, 1e-5
    way = np.random.default_rng(3).normal(size=len(x))
    sensitivity = sensitivity_of(family, family.motion(x, POINTS))
    before, after = (family.motion(x + side * step * way, POINTS) for side in (-1.0, 1.0))

    def moved(q: Array, to: Array) -> Array:
        return np.array([pin.difference(model, *at) for at in zip(q, to, strict=True)])

    for exact, differences in (
        (sensitivity.q, moved(before.q, after.q)),
        (sensitivity.q_half_way, moved(before.q_half_way, after.q_half_way)),
        (sensitivity.v, after.v - before.v),
        (sensitivity.goal_error, after.goal_error - before.goal_error),
        *(
            (by_x, above - below)
            for (_, by_x), (below, _), (above, _) in zip(
                *(hulls(family, x + side * step * way) for side in (0.0, -1.0, 1.0)), strict=True
            )
        ),
    ):
        expected = differences / (2.0 * step)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(exact @ way, expected, rtol=0.0, atol=1e-8 * scale)


@pytest.mark.parametrize("which", ["joints and goal", "planar"])
def test_what_the_solver_learns_along_any_directions_is_that_of_finite_differences(
    which: str,
) -> None:
    """All that is linearised, the goal's equalities too, and constraints by their names."""
    family, x = planar_splines() if which == "planar" else drawn_splines()
    program = path_program(replace(family.problem, objective=BOTH), family, SETTINGS)
    # Between fewer points there are rows at quarters, too, with the derivatives of parabolas.
    program, step = replace(program, points=41), 1e-5
    rng = np.random.default_rng(4)
    directions, aside = rng.normal(size=(len(x), len(x))), rng.normal(size=len(x))
    at_x, along = program.linearise(x).by(directions), np.linalg.solve(directions, aside)
    before, after = (program.linearise(x + side * step * aside) for side in (-1.0, 1.0))
    assert len(at_x.equalities) > 0
    assert len(set(at_x.names)) == len(at_x.names) == len(at_x.constraints) > 0
    kept = [np.intersect1d(at_x.names, other.names) for other in (before, after)]
    assert min(len(names) for names in kept) > 0.9 * len(at_x.names)
    common = np.intersect1d(*kept)

    def constraints(at: Linearisation, values: Array) -> Array:
        numbers = {name: row for row, name in enumerate(at.names)}
        return values[[numbers[name] for name in common]]

    for exact, higher, lower in (
        (at_x.gradient[None], np.array([after.value]), np.array([before.value])),
        (at_x.max_terms_jacobian, after.max_terms, before.max_terms),
        (at_x.equalities_jacobian, after.equalities, before.equalities),
        (
            constraints(at_x, at_x.constraints_jacobian),
            constraints(after, after.constraints),
            constraints(before, before.constraints),
        ),
    ):
        expected = (higher - lower) / (2.0 * step)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(exact @ along, expected, rtol=0.0, atol=1e-7 * scale)


def test_a_motion_begins_exactly_as_the_start_moves() -> None:
    family, x = drawn_splines()
    motion = family.motion(x, POINTS)
    q, v = configuration(family.robot, family.problem.start)
    assert np.abs(pin.difference(family.robot.model, motion.q[0], q)).max() < 1e-12
    np.testing.assert_allclose(motion.v[0], v, rtol=0.0, atol=1e-12)
    begun = sensitivity_of(family, motion).acceleration[0, 6:]
    np.testing.assert_allclose(begun, family.problem.start.joint_accelerations, atol=1e-12)


def test_momentum_is_constant_and_the_base_is_where_an_independent_integration_puts_it() -> None:
    family, x = drawn_splines()
    robot, points = family.robot, 121
    motion = family.motion(x, points)
    data = robot.model.createData()
    momenta = [total_momentum(robot, data, *at) for at in zip(motion.q, motion.v, strict=True)]
    np.testing.assert_allclose(momenta, momenta[:1] * points, rtol=0.0, atol=1e-10)
    time = np.linspace(0.0, DURATION, points)
    accelerations = sensitivity_of(family, motion).acceleration[:, 6:]
    joints = JointMotion(time, motion.q[:, 7:], motion.v[:, 6:], accelerations)
    q, v, _ = driven(robot, motion.q[0], momenta[0], joints, np.linspace(0.0, DURATION, 961))
    apart = pin.difference(robot.model, motion.q[-1], q[-1])
    assert np.abs(apart).max() < 1e-6
    np.testing.assert_allclose(motion.v[-1], v[-1], rtol=0.0, atol=1e-6)


def test_on_a_table_height_roll_and_pitch_stay_and_the_rest_of_the_momentum_is_constant() -> None:
    family, x = planar_splines()
    motion, robot = family.motion(x, 41), family.robot
    data = robot.model.createData()
    rows = zip(motion.q, motion.v, strict=True)
    momenta = np.array([total_momentum(robot, data, *row) for row in rows])[:, [0, 1, 5]]
    np.testing.assert_allclose(momenta, momenta[:1].repeat(41, 0), rtol=0.0, atol=1e-11)
    assert np.abs(motion.v[:, [2, 3, 4]]).max() == 0.0
    assert np.ptp(motion.q[:, 2]) == 0.0
    assert np.abs(motion.q[:, 3:5]).max() < 1e-15


def test_velocities_and_accelerations_are_those_of_the_configurations() -> None:
    """The motion on very many points, differentiated once and twice in time."""
    family, x = drawn_splines()
    points = 2001
    motion, step = family.motion(x, points), DURATION / (points - 1)
    pairs = zip(motion.q[:-2], motion.q[2:], strict=True)
    rates = np.array([pin.difference(family.robot.model, *pair) for pair in pairs]) / (2.0 * step)
    # The base's difference is in axes of its first point: half a step's turn off.
    np.testing.assert_allclose(rates[:, 6:], motion.v[1:-1, 6:], rtol=0.0, atol=1e-4)
    acceleration = sensitivity_of(family, motion).acceleration
    changes = (motion.v[2:] - motion.v[:-2]) / (2.0 * step)
    np.testing.assert_allclose(changes, acceleration[1:-1], rtol=0.0, atol=1e-4)


def tip_along(family: JointSplines, x: Array, points: int) -> list[pin.SE3]:
    robot, data = family.robot, family.robot.model.createData()
    poses = []
    for q in family.motion(x, points).q:
        pin.forwardKinematics(robot.model, data, q)
        poses.append(pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy())
    return poses


def test_the_goal_error_is_what_the_end_effector_misses_in_inertial_axes() -> None:
    """Twist and acceleration by differences in time of the pose, scaled with T/4 and its square."""
    family, x = drawn_splines()
    points = 1801
    poses, step = tip_along(family, x, points)[-7:], DURATION / (points - 1)
    positions = np.array([pose.translation for pose in poses])
    last = poses[-1].rotation
    turns = np.array([pin.log3(pose.rotation @ last.T) for pose in poses])
    time = step * np.arange(-6.0, 1.0)
    curves = [np.polynomial.polynomial.polyfit(time, rows, 5) for rows in (positions, turns)]
    target, scale = family.problem.target, DURATION / 4.0
    wanted = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    error = family.motion(x, points).goal_error
    np.testing.assert_allclose(error[:3], positions[-1] - target.position, atol=1e-12)
    np.testing.assert_allclose(pin.exp3(error[3:6]), wanted.T @ last, atol=1e-12)
    for order, rows in ((1, error[6:12]), (2, error[12:18])):
        moving = order * curves[0][order] - (
            target.linear_velocity if order == 1 else target.linear_acceleration
        )
        turning = order * curves[1][order] - (
            target.angular_velocity if order == 1 else target.angular_acceleration
        )
        expected = scale**order * np.concatenate([moving, turning])
        np.testing.assert_allclose(rows, expected, rtol=0.0, atol=2e-4)


def test_a_target_free_about_an_axis_does_not_care_for_a_turn_about_it() -> None:
    family, x = drawn_splines(Orientation.ABOUT_AXIS)
    target = family.problem.target
    turned = pin.Quaternion(target.quaternion_xyzw) * pin.Quaternion(pin.exp3(1.1 * AXIS))
    other = replace(target, quaternion_xyzw=turned.coeffs())
    error, of_other = (f.motion(x, POINTS).goal_error for f in (family, family.towards(other)))
    assert len(error) == 15
    np.testing.assert_allclose(of_other, error, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("angle", [1e-7, 0.3, 3.1])
def test_the_error_about_an_axis_is_the_angle_between_both_axes(angle: float) -> None:
    family, x = drawn_splines(Orientation.ABOUT_AXIS)
    last = tip_along(family, x, POINTS)[-1].rotation
    across = np.cross(AXIS, [1.0, 0.0, 0.0])
    off = last @ pin.exp3(angle * across / np.linalg.norm(across))
    target = replace(
        family.problem.target,
        quaternion_xyzw=pin.Quaternion(off).coeffs(),
        angular_velocity=np.zeros(3),
        angular_acceleration=np.zeros(3),
    )
    error = family.towards(target).motion(x, POINTS).goal_error
    assert np.linalg.norm(error[3:5]) == pytest.approx(angle, rel=1e-6)


def test_no_joint_leaves_the_hull_at_any_time() -> None:
    family, x = drawn_splines()
    basis, controls = family.basis, family.control_points(x)
    s = np.linspace(0.0, 1.0, 2001)
    for order in (0, 1, 2):
        values, hull = basis.rows(s, order) @ controls, basis.hull(order) @ controls
        spread = np.ptp(values, axis=0)
        assert (hull.max(axis=0) >= values.max(axis=0) - 1e-9).all()
        assert (hull.min(axis=0) <= values.min(axis=0) + 1e-9).all()
        assert (np.ptp(hull, axis=0) <= 1.5 * spread).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_hull_of_a_motion_holds_all_but_what_the_start_decides_alone(side: float) -> None:
    """One control point after the other is far off: each makes extremes at a place of its own."""
    family, x = drawn_splines()
    basis, s = family.basis, np.linspace(0.0, 1.0, 501)
    hold = np.repeat(family.fixed[-1], len(x) // family.robot.joints)
    for number in range(len(x) // family.robot.joints):
        x = hold.copy()
        x[number] += 3.0 * side  # of the first joint
        controls = family.control_points(x)
        for order, (told, _) in enumerate(hulls(family, x)):
            values = basis.rows(s, order) @ controls
            of_start = basis.hull(order)[: 3 - order] @ controls
            both = np.concatenate([told, of_start])[:, 0]
            assert both.max() >= values[:, 0].max() - 1e-9
            assert both.min() <= values[:, 0].min() + 1e-9
            assert np.ptp(both) <= 2.0 * np.ptp(values[:, 0])


@pytest.mark.parametrize("joints", [6, 10, 14])
def test_arms_of_any_length_of_chain_are_planned_from_any_start(joints: int) -> None:
    robot, rng = bench_robot(f"arm{joints}"), np.random.default_rng(joints)
    posture = rng.uniform(-1.5, 1.5, joints)
    posture[2] = 0.0
    drawn = (drawn_problem(robot, posture, Orientation.FIXED, 2, rng) for _ in range(100))
    problem = next(found.problem for found in drawn if found is not None)
    found = perform(PlanningTask(replace(problem, parametrisation=SPLINES), SETTINGS))
    assert found.family == "joint_spline"
    assert found.metrics.final_position_error < 1e-5
    assert found.coefficients.shape == (8 * joints,)


@pytest.mark.parametrize(
    ("scenario", "parametrisation", "objective", "points"),
    [
        ("lemur_capture", SPLINES, Objective(1.0, 0.0), [13, 50]),
        ("lemur_capture", SPLINES, BOTH, [13, 25, 50]),
        ("lemur_wheels", SPLINES, Objective(1.0, 0.0), [13, 25, 50]),
        (
            "lemur_capture",
            Parametrisation.END_EFFECTOR_POLYNOMIAL,
            Objective(1.0, 0.0),
            [13, 25, 50],
        ),
    ],
)
def test_the_least_joint_path_of_splines_needs_no_grid_between(
    scenario: str, parametrisation: Parametrisation, objective: Objective, points: list[int]
) -> None:
    problem = load_scenario(CONFIG / "scenarios" / f"{scenario}.yaml")
    problem = replace(problem, parametrisation=parametrisation, objective=objective)
    program = path_program(problem, path_families(problem, SETTINGS)[0][0], SETTINGS)
    assert [grid.stage.points for grid in grids_of(program, SETTINGS)] == points


def test_the_first_guess_ends_in_the_goal_posture_that_is_next_to_the_start() -> None:
    """An arm of six joints has few, far from each other; the witness turns no joint by 0.9 rad."""
    ends = []
    for number in range(1, 100, len(ROBOTS)):
        drawn = joint_goals.problem("held", number)
        assert drawn.problem.robot.joints == 6
        assert drawn.problem.robot.base is Base.ATTITUDE_HELD
        assert drawn.witness is not None
        family = joint_splines(drawn.problem, SETTINGS)
        guess = next(family.first_guesses((), POINTS, 0.0))
        ends.append(family.motion(guess, POINTS).q[-1, 7:] - drawn.witness.positions[-1])
    assert (np.abs(ends) < 0.1).all(), ends
