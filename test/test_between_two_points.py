"""What lies between two points of a motion: joints and their limits, attitudes, thinned paths."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from core_rows import sensitivity_of
from scipy.spatial.transform import Rotation
from test_core_driven_motion import DURATION, drawn_splines

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import followed
from ff_planner_ros.planning.motion.followed_path import followed_path, points_per_sample
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.pose_motion import (
    attitudes_between,
    cubics_between,
    poses_between,
)
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem

LOWER, UPPER = np.array([-2.0, -0.5]), np.array([0.7, 3.0])


def swung(begin: float) -> JointMotion:
    """Two joints at rest at both points, that swing between them by 0.3 rad, each to its side.

    Positions are 4.8 s^2 (1 - s)^2 and the negative of it, s being the part of two seconds.
    """
    kick = np.array([9.6, -9.6]) / 4.0
    return JointMotion(
        begin + np.array([0.0, 2.0]),
        np.zeros((2, 2)),
        np.zeros((2, 2)),
        np.array([kick, kick]),
    )


def test_the_distance_to_each_limit_is_that_between_the_points_and_so_is_its_time() -> None:
    """The lower limits come first; a joint that stays on one side is nearest to it at its ends."""
    (lowest, highest), times = swung(1.0).extremes()
    distances = np.array([lowest - LOWER, UPPER - highest])
    assert distances == pytest.approx(np.array([[2.0, 0.2], [0.4, 3.0]]), abs=1e-9)
    assert times[1, 0] == pytest.approx(2.0, abs=1e-4)
    assert times[0, 1] == pytest.approx(2.0, abs=1e-4)
    assert times[0, 0] in (1.0, 3.0)
    assert times[1, 1] in (1.0, 3.0)
    assert swung(1.0).least_distance(LOWER, UPPER) == pytest.approx(0.2, abs=1e-9)


def test_rates_and_accelerations_have_their_own_extremes() -> None:
    """Of 4.8 s^2 (1 - s)^2: fastest where s is (3 - sqrt 3) / 6, and most bent at the ends."""
    s = (3.0 - np.sqrt(3.0)) / 6.0
    fastest = 9.6 * s * (1.0 - s) * (1.0 - 2.0 * s) / 2.0
    (lowest, highest), times = swung(0.0).extremes(1)
    assert highest == pytest.approx([fastest, fastest], abs=1e-9)
    assert lowest == pytest.approx([-fastest, -fastest], abs=1e-9)
    assert times[1] == pytest.approx([2.0 * s, 2.0 * (1.0 - s)], abs=1e-3)
    (lowest, highest), _ = swung(0.0).extremes(2)
    assert highest == pytest.approx([2.4, 1.2], abs=1e-9)
    assert lowest == pytest.approx([-1.2, -2.4], abs=1e-9)
    limits = np.array([2.0, 3.0])
    assert swung(0.0).least_distance(-limits, limits, 2) == pytest.approx(-0.4, abs=1e-9)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_bounds_of_a_motion_hold_its_extremes_and_are_exact_in_a_steady_turn(order: int) -> None:
    rng = np.random.default_rng(order)
    motion = JointMotion(np.cumsum(rng.uniform(0.2, 1.0, 9)), *rng.normal(size=(3, 9, 4)))
    bounds, (extremes, _) = motion.bounds(order), motion.extremes(order)
    assert bounds.shape == (2, 4)
    assert (bounds[0] <= extremes[0] + 1e-9).all()
    assert (bounds[1] >= extremes[1] - 1e-9).all()
    rates, time = np.array([[0.3, -0.2]]), np.array([0.0, 1.0, 3.0])
    steady = JointMotion(time, time[:, None] * rates, np.tile(rates, (3, 1)), np.zeros((3, 2)))
    exact = {0: [[0.0, -0.6], [0.9, 0.0]], 1: [[0.3, -0.2], [0.3, -0.2]], 2: np.zeros((2, 2))}
    assert steady.bounds(order) == pytest.approx(np.array(exact[order]))
    assert steady.extremes(order)[0] == pytest.approx(np.array(exact[order]))


@pytest.mark.parametrize(
    ("points", "samples", "every"),
    [(41, 41, 1), (41, 21, 2), (41, 11, 4), (31, 11, 3), (41, 20, 1), (5, 9, 1)],
)
def test_a_plan_holds_every_so_many_of_a_path_s_points_or_all(
    points: int, samples: int, every: int
) -> None:
    assert points_per_sample(points, samples) == every


@pytest.mark.parametrize("samples", [21, 11])
@pytest.mark.parametrize("name", ["free7", "planar3"])
def test_what_comes_of_a_path_is_what_the_check_makes_of_the_samples_that_are_told(
    name: str, samples: int
) -> None:
    """Every second point, or every fourth: the points between them are not told, and not met."""
    family, x = drawn_splines(name, False, Orientation.FREE)
    motion = family.motion(x, 41)
    acceleration = sensitivity_of(family, motion).acceleration
    read = SimpleNamespace(robot=family.robot, points=samples, duration=DURATION)
    found = followed_path(cast(PlanningProblem, read), motion.q, motion.v, acceleration)
    every = 40 // (samples - 1)
    rows = (part[::every] for part in (motion.q[:, 7:], motion.v[:, 6:], acceleration[:, 6:]))
    joints = JointMotion(np.linspace(0.0, DURATION, samples), *rows)
    expected = followed(family.robot, motion.q[0], motion.v[0], joints, multiple=2 * every)
    assert found.pieces == expected.pieces
    assert found.pieces % (2 * every) == 0
    np.testing.assert_allclose(found.time, expected.time, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(found.q), np.abs(expected.q), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(found.v, expected.v, rtol=0.0, atol=1e-7)


POINTS = np.array([0.0, 0.5, 2.0, 3.0])
DENSE = np.linspace(0.0, 3.0, 61)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_constant_spin_and_a_cubic_are_met_exactly_between_the_points(sign: float) -> None:
    """About an axis of no frame, by up to 1.2 rad from point to point."""
    spin, begin = sign * np.array([0.4, -0.6, 0.3]), Rotation.from_rotvec([1.0, 0.4, -2.0])
    of_time = np.polynomial.polynomial
    cubic = sign * np.random.default_rng(1).normal(size=(4, 3))

    def turned(times: Array) -> Rotation:
        return Rotation.from_rotvec(times[:, None] * spin) * begin

    places, turns = poses_between(
        POINTS,
        of_time.polyval(POINTS, cubic).T,
        turned(POINTS).as_quat(),
        of_time.polyval(POINTS, of_time.polyder(cubic)).T,
        np.tile(spin, (4, 1)),
        DENSE,
    )
    assert places == pytest.approx(of_time.polyval(DENSE, cubic).T, abs=1e-12)
    assert (turned(DENSE).inv() * Rotation.from_quat(turns)).magnitude().max() < 1e-12


def test_a_cubic_and_its_slopes_are_met_exactly_at_unequal_steps() -> None:
    times, at = np.array([0.0, 0.3, 1.1, 2.0]), np.linspace(0.0, 2.0, 41)
    cubics = [
        np.polynomial.Polynomial(one) for one in ([1.0, -2.0, 0.5, 3.0], [0.2, 4.0, -1.0, 0.7])
    ]

    def at_times(when: Array, order: int) -> Array:
        return np.stack([(one.deriv() if order else one)(when) for one in cubics], axis=1)

    values, slopes = cubics_between(times, at_times(times, 0), at_times(times, 1), at)
    np.testing.assert_allclose(values, at_times(at, 0), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(slopes, at_times(at, 1), rtol=0.0, atol=1e-13)


def test_any_other_turn_is_met_with_the_fourth_power_of_the_step() -> None:
    """A frame that nutates and precesses; its rates are those of differences."""

    def turned(times: Array) -> Rotation:
        angles = np.column_stack([0.9 * times, 0.5 + 0.3 * np.sin(times), -1.3 * times])
        return Rotation.from_euler("zxz", angles)

    def rates(times: Array) -> Array:
        step = 1e-5
        turn = turned(times + step) * turned(times - step).inv()
        return np.asarray(turn.as_rotvec() / (2 * step))

    errors = []
    for count in (9, 17):
        times = np.linspace(0.0, 3.0, count)
        found = attitudes_between(times, turned(times).as_quat(), rates(times), DENSE)
        errors.append((turned(DENSE).inv() * Rotation.from_quat(found)).magnitude().max())
        at_points = attitudes_between(times, turned(times).as_quat(), rates(times), times)
        assert (turned(times).inv() * Rotation.from_quat(at_points)).magnitude().max() < 1e-7
    assert 1e-6 < errors[1] < errors[0] / 10.0 < 1e-3


@pytest.mark.parametrize("turn", [1e-6, 1e-3, 0.1, 1.0, 3.0])
def test_an_interpolated_frame_turns_at_the_rates_of_its_points(turn: float) -> None:
    """The rates are those of differences, exact to the second order, at the ends of an interval."""
    rng, step = np.random.default_rng(6), 1e-4
    times, aside = np.array([0.0, 2.0]), step * np.array([0.0, 1.0, 2.0])
    for _ in range(10):
        first, axis = Rotation.random(random_state=rng), rng.normal(size=3)
        after = first * Rotation.from_rotvec(turn * axis / np.linalg.norm(axis))
        attitudes = np.array([first.as_quat(), after.as_quat()])
        rates = rng.normal(size=(2, 3))
        for at, way, rate in ((aside, 1.0, rates[0]), (2.0 - aside, -1.0, rates[1])):
            there, *near = (
                Rotation.from_quat(q) for q in attitudes_between(times, attitudes, rates, at)
            )
            once, twice = ((each * there.inv()).as_rotvec() for each in near)
            assert (4 * once - twice) / (2 * way * step) == pytest.approx(rate, abs=1e-6)
