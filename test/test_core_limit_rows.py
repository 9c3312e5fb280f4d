"""Rows of limits on both sides by the compiled core, against what is written out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest
from core_rows import EACH, CoreRows, rows_along
from scipy.interpolate import CubicHermiteSpline
from test_core import chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.robot.model import Robot

POINTS, JOINTS, STEP, JERK = 9, 4, 0.4, 10.0
FAR = 1e3  # [rad, rad/s] all of it is of interest

every_seed = pytest.mark.parametrize("seed", range(5))
both = pytest.mark.parametrize("order", [0, 1])


class Drawn(NamedTuple):
    """Joints that turn round in about every interval, and limits that leave some rows out."""

    robot: Robot
    q: Array
    v: Array
    lower: Array
    upper: Array
    interest: float

    def rows(self, order: int, stop_interest: float = -FAR, aside: Array | None = None) -> CoreRows:
        """Return rows of positions, order 0, or of rates, whose limits are the upper ones."""
        asked = compiled.positions_within(
            self.lower, self.upper, 0.0, 0.0, self.interest, stop_interest, JERK
        )
        if order == 1:
            # As parts of limits, which are alike.
            of_limits = self.interest / self.upper[0]
            asked = compiled.rates_within(self.upper, 0.0, 0.0, of_limits)
        return rows_along(self.robot, [asked], self.q, self.q[1:], self.v, step=STEP, aside=aside)


def drawn(order: int, seed: int) -> Drawn:
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=(POINTS, 7 + JOINTS)), rng.normal(scale=3.0, size=(POINTS, 6 + JOINTS))
    q[:, :3], q[:, 3:7] = 0.0, [0.0, 0.0, 0.0, 1.0]
    q[0, 7:], v[0, 6:] = 0.1, 0.1  # a start beyond its limits would move them
    lower, upper = rng.uniform(-1.5, -0.5, JOINTS), rng.uniform(0.5, 1.5, JOINTS)
    if order == 1:
        upper = np.full(JOINTS, 1.0)
        lower = -upper
    return Drawn(chain_robot("free4"), q, v, lower, upper, rng.uniform(0.5, 2.0))


def extremes(of: Drawn, order: int) -> Iterator[tuple[int, int, int, float]]:
    """Yield interval, joint, number there and value of each extreme of the cubics, late ones first.

    The number is that among those of the joint in the interval.
    """
    for joint in range(JOINTS):
        rows = of.q[:, 7 + joint], of.v[:, 6 + joint]
        spline = CubicHermiteSpline(STEP * np.arange(POINTS), *rows)
        for interval, coefficients in enumerate(spline.c.T):
            curve = np.polyder(np.poly1d(coefficients), order)
            roots = np.polyder(curve).roots
            within = [root.real for root in roots if abs(root.imag) < 1e-12]
            within = sorted((root for root in within if 0.0 < root < STEP), reverse=True)
            for number, root in enumerate(within):
                yield interval, joint, number, curve(root)


def expected(of: Drawn, order: int) -> list[tuple[int, float]]:
    """Return names, and what is left, at the later points and at extremes where they are near."""
    values, later = (of.q[1:, 7:], of.v[1:, 6:])[order], POINTS - 1
    # By joint: the value, the name of its upper limit, and how far that of the lower one is.
    places = [(j, at, i * JOINTS + j, later * JOINTS) for (i, j), at in np.ndenumerate(values)]
    for interval, joint, number, value in extremes(of, order):
        name = -1 - (2 * number * POINTS + interval) * JOINTS - joint
        places.append((joint, value, name, -POINTS * JOINTS))
    rows = []
    for joint, value, name, to_lower in places:
        limits = of.upper[joint] - value, value - of.lower[joint]
        for left, named in zip(limits, (name, name + to_lower), strict=True):
            if left < of.interest:
                rows.append((named, left))
    return sorted(rows)


@every_seed
@both
def test_what_is_left_at_points_and_extremes_is_that_of_the_cubics(order: int, seed: int) -> None:
    """One joint rests: it has no extremes."""
    of = drawn(order, seed)
    of.q[:, 7], of.v[:, 6] = 0.2, 0.0
    values, _, names, *_ = of.rows(order)
    found, wanted = sorted(zip(names, values, strict=True)), expected(of, order)
    assert len([name for name, _ in wanted if name < 0]) > 10
    assert len({name for name, _ in wanted}) < 2 * (2 * POINTS - 1) * JOINTS, "all are near"
    assert [name for name, _ in found] == [name for name, _ in wanted]
    assert len(set(names)) == len(names)
    np.testing.assert_allclose(
        [value for _, value in found], [value for _, value in wanted], rtol=0.0, atol=1e-12
    )


@every_seed
@both
def test_rows_have_the_derivatives_of_differences(order: int, seed: int) -> None:
    """Those of joints that stop after the last point, too."""
    of, step = drawn(order, seed)._replace(interest=FAR), 1e-6
    here = of.rows(order, stop_interest=FAR)
    for column, unit in enumerate(step * np.eye(EACH * JOINTS)):
        ahead, behind = (of.rows(order, FAR, sign * unit) for sign in (1.0, -1.0))
        assert here.names.tolist() == ahead.names.tolist() == behind.names.tolist()
        slope = (ahead.values - behind.values) / (2.0 * step)
        np.testing.assert_allclose(here.jacobian[:, column], slope, rtol=1e-6, atol=1e-6)


@every_seed
def test_joints_stop_at_the_height_of_their_cubics(seed: int) -> None:
    """By a jerk against the motion: p + v t - jerk t^3 / 6, as high as between all times."""
    of = drawn(0, seed)._replace(interest=-FAR)
    values, _, names, *_ = of.rows(0, stop_interest=FAR)
    assert len(values) == JOINTS
    below = -2 - 4 * POINTS * JOINTS  # the names of turns
    time = np.linspace(0.0, 2.0, 400_001)
    for joint, value in enumerate(values):
        position, rate = of.q[-1, 7 + joint], of.v[-1, 6 + joint]
        way = abs(rate) * time - JERK * time**3 / 6.0
        upward = rate > 0.0
        left = of.upper[joint] - position if upward else position - of.lower[joint]
        assert value == pytest.approx(left - way.max(), abs=1e-9)
        assert names[joint] == below - (joint + JOINTS * upward)
    assert len(of.rows(0, stop_interest=float(values.min())).values) == 0
