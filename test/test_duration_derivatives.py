"""Derivatives of motions by their duration: against differences, on random chains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from reference_joint_spline import hulls
from reference_load_rows import (
    accelerations_at_points,
    accelerations_by_x,
    position_rows,
    rate_rows,
)
from robots import random_path, random_state
from test_core import FREE, PLANAR, chain_robot
from test_core_driven_motion import drawn_splines

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.path_family import GoalMotion, Motion, Sensitivity
from ff_planner_ros.planning.paths.polynomial import EndEffectorMotion
from ff_planner_ros.planning.paths.start_motion import NullSpaceFade
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem, Target, TargetBody
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.rotation import (
    euler_rate_map_derivative,
    euler_rate_map_second_derivative,
)

DURATION, POINTS = 5.0, 9
EXACT = 1e-8  # of the largest entry, or of 1 where that is greater
STEP = 2e-3 * DURATION


def slope(of: Callable[[float], Array]) -> Array:
    """Return a derivative by the duration: fourth-order differences, extrapolated once."""
    a, b, c, d, e, f = (of(DURATION + k * STEP) for k in (-4, -2, -1, 1, 2, 4))
    fine = (b - 8.0 * c + 8.0 * d - e) / (12.0 * STEP)
    coarse = (a - 8.0 * b + 8.0 * e - f) / (24.0 * STEP)
    return (16.0 * fine - coarse) / 15.0


def agree(found: Array, expected: Array, what: str) -> None:
    assert found.shape == expected.shape, what
    largest = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=EXACT * largest, err_msg=what)


def drawn_body(robot: Robot, rng: np.random.Generator) -> TargetBody:
    """Draw a body that tumbles; on a table one that turns about z."""
    planar = robot.base is Base.PLANAR
    grasp, attitude = rng.normal(size=4), rng.normal(size=4)
    if planar:
        attitude[:2] = grasp[:2] = 0.0
    return TargetBody(
        position=rng.normal(size=3),
        quaternion_xyzw=attitude / np.linalg.norm(attitude),
        inertia=np.diag([2.0, 3.0, 4.0]),
        grasp_position=0.5 * rng.normal(size=3),
        grasp_quaternion_xyzw=grasp / np.linalg.norm(grasp),
        linear_velocity=0.05 * rng.normal(size=3) * ([1.0, 1.0, 0.0] if planar else 1.0),
        angular_velocity=0.1 * rng.normal(size=3) * ([0.0, 0.0, 1.0] if planar else 1.0),
    )


def body_goal(body: TargetBody) -> GoalMotion:
    grasp = body.grasp(np.array([DURATION]))
    return GoalMotion(grasp.twists[0], grasp.accelerations[0], grasp.jerks[0])


def end_at(body: TargetBody, duration: float) -> EndEffectorMotion:
    grasp = body.grasp(np.array([duration]))
    return EndEffectorMotion(
        grasp.positions[0], grasp.rotations[0], grasp.twists[0], grasp.accelerations[0]
    )


def require_motion_agrees(
    robot: Robot, sensitivity: Sensitivity, motions: Callable[[float], Motion]
) -> None:
    """Require that the last column is the derivative by the duration."""
    here = motions(DURATION)

    def steps(what: str) -> Callable[[float], Array]:
        """Return configurations as tangent steps from those of the duration."""

        def at(duration: float) -> Array:
            there = getattr(motions(duration), what)
            pairs = zip(getattr(here, what), there, strict=True)
            return np.array([pin.difference(robot.model, *pair) for pair in pairs])

        return at

    agree(sensitivity.q[..., -1], slope(steps("q")), "q")
    agree(sensitivity.q_half_way[..., -1], slope(steps("q_half_way")), "q half-way")
    agree(sensitivity.v[..., -1], slope(lambda duration: motions(duration).v), "v")
    goal_error = slope(lambda duration: motions(duration).goal_error)
    agree(sensitivity.goal_error[:, -1], goal_error, "goal")


@pytest.mark.parametrize("name", FREE[::2] + FREE[5:6])
def test_motions_of_the_papers_paths_by_their_duration(name: str) -> None:
    robot = chain_robot(name)
    rng = np.random.default_rng(robot.joints)
    state = random_state(robot, rng)
    polynomial = random_path(robot, state, rng, DURATION, reach=0.1)
    q, v = configuration(robot, state)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    fade = NullSpaceFade(*rng.normal(scale=0.1, size=(2, robot.joints)), seconds=0.6 * DURATION)
    family = EndEffectorPaths(robot, q, momentum, polynomial, fade)
    end = polynomial.components(np.zeros((6, 3)), np.array([1.0]))
    _, rotation = polynomial.pose(np.zeros((6, 3)), np.array([1.0]))
    grip = replace(drawn_body(robot, rng), grasp_position=np.zeros(3))
    place = grip.grasp(np.array([DURATION]))
    # The body is where the path ends, and the path comes to its motion.
    turn = pin.Quaternion(place.rotations[0].T @ rotation[0])
    body = replace(
        grip,
        position=grip.position + end[0][0, :3] - place.positions[0],
        grasp_quaternion_xyzw=(pin.Quaternion(grip.grasp_quaternion_xyzw) * turn)
        .normalized()
        .coeffs(),
    )
    x, damping = rng.normal(scale=0.05, size=18), 0.3

    def lasting(duration: float, goal: GoalMotion | None = None) -> EndEffectorPaths:
        target = body.target(duration)
        problem = SimpleNamespace(duration=duration, target=target, approach=None, path=None)
        return family.lasting(cast(PlanningProblem, problem), goal)

    free = lasting(DURATION, body_goal(body))
    found = free.motion(x, POINTS, damping)
    if found.singular_at is not None:
        assert lasting(DURATION).motion(x, POINTS, damping).singular_at == found.singular_at
        return
    sensitivity = sensitivity_of(free, found, damping)
    given = lasting(DURATION)
    motion = given.motion(x, POINTS, damping)
    assert (motion.q == found.q).all()
    agree(sensitivity.q[..., :-1], sensitivity_of(given, motion, damping).q, "q by x")
    require_motion_agrees(
        robot, sensitivity, lambda duration: lasting(duration).motion(x, POINTS, damping)
    )
    quintic = slope(lambda duration: lasting(duration).polynomial.quintic)
    agree(free.quintic_by_duration, quintic, "quintic")


@pytest.mark.parametrize("orientation", list(Orientation))
@pytest.mark.parametrize("name", FREE[::3] + PLANAR)
def test_motions_of_joint_splines_by_their_duration(name: str, orientation: Orientation) -> None:
    family, x = drawn_splines(name, False, orientation)
    robot = family.robot
    body = drawn_body(robot, np.random.default_rng(7))
    drawn: Any = family.problem

    def target(duration: float) -> Target:
        there = body.target(duration)
        if orientation is not Orientation.FIXED:  # no turn is wanted where it is free
            there = replace(there, angular_velocity=np.zeros(3), angular_acceleration=np.zeros(3))
        axis = drawn.target.free_axis_in_ee
        return replace(there, orientation=orientation, free_axis_in_ee=axis)

    goal = body_goal(body)
    if orientation is not Orientation.FIXED:
        still = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        goal = GoalMotion(goal.place, goal.twist * still, goal.acceleration * still)

    def lasting(duration: float, goal: GoalMotion | None = None) -> Any:
        read = SimpleNamespace(**{**vars(drawn), "duration": duration, "target": target(duration)})
        return family.lasting(cast(PlanningProblem, read), goal)

    free = lasting(DURATION, goal)
    motion = free.motion(x, POINTS)
    sensitivity = sensitivity_of(free, motion)
    require_motion_agrees(robot, sensitivity, lambda duration: lasting(duration).motion(x, POINTS))
    for order, (_, by_x) in enumerate(hulls(free, x)):
        hull = slope(lambda duration, k=order: hulls(lasting(duration), x)[k][0])
        agree(by_x[..., -1], hull, f"hull of order {order}")
    require_extremes_agree(lasting, goal, x)


def require_extremes_agree(lasting: Callable[..., Any], goal: GoalMotion, x: Array) -> None:
    """Require the same of accelerations, and of joints that turn back or are fastest."""

    def step(duration: float) -> float:
        return duration / (POINTS - 1)

    def accelerations(duration: float) -> Array:
        there = lasting(duration).motion(x, POINTS)
        return accelerations_at_points(there.q[:, 7:], there.v[:, 6:], step(duration))

    here = lasting(DURATION, goal)
    motion = here.motion(x, POINTS)
    by_x = accelerations_by_x(motion, sensitivity_of(here, motion), step(DURATION))
    agree(by_x[..., -1], slope(accelerations), "accelerations")
    one = np.ones(motion.q.shape[1] - 7)
    for rows in (position_rows, rate_rows):

        def margins(duration: float, rows: Callable[..., Rows] = rows) -> Rows:
            there = lasting(duration, goal)
            moved = there.motion(x, POINTS)
            by_x = sensitivity_of(there, moved)
            path = moved.q, moved.v, by_x.q, by_x.v
            return rows(*path, step(duration), True, -one, one, 1e9 * one)

        # One that is about to come or to go is left out, and two in one interval have one name.
        known = [margins(DURATION + k * STEP).names for k in range(-4, 5)]
        once = [names[counts == 1] for names, counts in map(counted, known)]
        names = reduce(np.intersect1d, once)

        def value(duration: float, names: Array = names, of: Any = margins) -> Array:
            return in_order(of(duration), names).values

        found = in_order(margins(DURATION), names).jacobian[:, -1]
        agree(found, slope(value), rows.__name__)


def counted(names: Array) -> tuple[Array, Array]:
    return np.unique(names, return_counts=True)


def in_order(rows: Rows, names: Array) -> Rows:
    """Return the rows of some names, in the order of the names."""
    at = np.flatnonzero(np.isin(rows.names, names))
    at = at[np.argsort(rows.names[at])]
    return Rows(rows.values[at], rows.jacobian[at], rows.names[at])


def test_euler_rates_are_differentiated_twice() -> None:
    rng = np.random.default_rng(5)
    for euler, rate, change in rng.uniform(-1.0, 1.0, (20, 3, 3)):

        def bent(part: float, at: tuple[Array, ...] = (euler, rate, change)) -> Array:
            return euler_rate_map_derivative(at[0] + (part - DURATION) * at[2], at[1]) @ at[1]

        found = euler_rate_map_second_derivative(euler, rate) @ change
        agree(found, slope(bent), "second derivative")
