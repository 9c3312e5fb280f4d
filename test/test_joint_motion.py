"""Joints between the points of a trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion, steady_motion
from ff_planner_ros.planning.motion.plan import Plan

TIME = np.array([0.5, 1.0, 2.5])


def polynomial(coefficients: Array, time: Array) -> tuple[Array, Array, Array]:
    """Two joints, each on one polynomial of time: positions, rates and accelerations."""
    of_time = np.polynomial.polynomial
    first, second = (of_time.polyder(coefficients, order, axis=0) for order in (1, 2))
    value, rate, acceleration = (of_time.polyval(time, c).T for c in (coefficients, first, second))
    return value, rate, acceleration


def test_quintics_are_reproduced_at_between_and_beyond_the_points() -> None:
    coefficients = np.random.default_rng(0).normal(size=(6, 2))
    motion = JointMotion(TIME, *polynomial(coefficients, TIME))
    between = np.linspace(0.45, 2.55, 50)
    for found, expected in zip(motion.at(between), polynomial(coefficients, between), strict=True):
        assert found.shape == (50, 2)
        assert found == pytest.approx(expected, abs=1e-9)


def test_what_is_no_quintic_is_met_at_the_points_and_smooth_there() -> None:
    rng = np.random.default_rng(1)
    asked = rng.normal(size=(3, 3, 4))
    motion = JointMotion(TIME, *asked)
    for nearly in (TIME - 1e-9, TIME, TIME + 1e-9):
        for found, wanted in zip(motion.at(nearly), asked, strict=True):
            assert found == pytest.approx(wanted, abs=1e-6)


def test_a_plan_begins_when_the_caller_says(lemur_plan: Plan) -> None:
    motion = lemur_plan.trajectory
    positions, rates, accelerations = joint_motion(motion, start=3.0).at(3.0 + motion.time)
    assert positions == pytest.approx(motion.joint_positions, abs=1e-12)
    assert rates == pytest.approx(motion.joint_velocities, abs=1e-11)
    assert accelerations == pytest.approx(motion.joint_accelerations, abs=1e-10)
    assert np.array_equal(joint_motion(motion).time, motion.time)


@pytest.mark.parametrize(
    ("begin", "end", "points"),
    [
        *((1.5, 2.2, 3), (1.5, 1.6, 2), (2.0, 3.0, 3), (2.0, 2.0, 2), (-1.0, 0.5, 2)),
        *((-1.0, -0.5, 2), (4.5, 9.0, 2), (7.0, 9.0, 2), (-1.0, 9.0, 6), (4.0, 5.0, 2)),
    ],
)
def test_a_part_of_a_motion_is_the_same_to_the_last_bit(
    begin: float, end: float, points: int
) -> None:
    motion = JointMotion(np.arange(6.0), *np.random.default_rng(1).normal(size=(3, 6, 2)))
    part = motion.between(begin, end)
    assert len(part.time) == points
    times = np.array([begin, *np.linspace(begin, end, 50), *np.arange(np.ceil(begin), end), end])
    for ours, theirs in zip(part.at(times), motion.at(times), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_steady_motion_keeps_its_rates_however_short_it_is() -> None:
    positions, rates = np.array([0.3, -1.0]), np.array([0.2, 0.05])
    for end in (4.0, 4.0 + 1e-12, 4.5, 30.0):
        motion = steady_motion(4.0, end, positions, rates)
        assert motion.time[0] == 4.0
        for time in (4.0, max(end, 4.7)):
            found, speed, acceleration = motion.at(np.array([time]))
            assert found[0] == pytest.approx(positions + (time - 4.0) * rates, abs=1e-12)
            assert speed[0] == pytest.approx(rates, abs=1e-12)
            assert acceleration[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_extremes_are_those_of_dense_samples_with_their_times() -> None:
    rng = np.random.default_rng(4)
    motion = JointMotion(np.cumsum(rng.uniform(0.2, 1.0, 12)), *rng.normal(size=(3, 12, 5)))
    dense = np.linspace(motion.time[0], motion.time[-1], 200_001)
    for order in (0, 1):
        samples = motion.at(dense)[order]
        (lowest, highest), times = motion.extremes(order)
        assert lowest == pytest.approx(samples.min(axis=0), abs=1e-6)
        assert highest == pytest.approx(samples.max(axis=0), abs=1e-6)
        assert (lowest <= samples.min(axis=0) + 1e-8).all()
        assert (highest >= samples.max(axis=0) - 1e-8).all()
        for at, values in zip(times, (lowest, highest), strict=True):
            there = np.diagonal(motion.at(at)[order])
            assert there == pytest.approx(values, abs=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_least_distance_is_that_of_the_joint_that_comes_nearest_to_a_limit(order: int) -> None:
    rng = np.random.default_rng(order)
    for _ in range(20):
        motion = JointMotion(np.cumsum(rng.uniform(0.1, 1.0, 6)), *rng.normal(size=(3, 6, 4)))
        lower, upper = -rng.uniform(0.5, 9.0, 4), rng.uniform(0.5, 9.0, 4)
        lower[0] = -np.inf  # no limit
        (lowest, highest), _ = motion.extremes(order)
        found = motion.least_distance(lower, upper, order)
        assert found == pytest.approx(
            min((lowest - lower).min(), (upper - highest).min()), abs=2e-9
        )
        dense = motion.at(np.linspace(motion.time[0], motion.time[-1], 5000))[order]
        assert found <= min((dense - lower).min(), (upper - dense).min()) + 1e-8
    unlimited = np.full(4, np.inf)
    assert motion.least_distance(-unlimited, unlimited, order) == np.inf
