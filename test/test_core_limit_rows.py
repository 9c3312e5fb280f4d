"""Rows of limits on both sides by the compiled core, against what is written out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled

POINTS, JOINTS, VARIABLES, STEP = 9, 4, 3, 0.4
SIZE = 6 + JOINTS

every_seed = pytest.mark.parametrize("seed", range(5))
both = pytest.mark.parametrize("order", [0, 1])


def drawn(seed: int) -> dict[str, Any]:
    """Joints that turn round in about every interval, and limits that leave some rows out."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(POINTS, 7 + JOINTS))
    v = rng.normal(scale=3.0, size=(POINTS, SIZE))
    return {
        "q": q,
        "v": v,
        "q_by_x": rng.normal(size=(POINTS, SIZE, VARIABLES)),
        "v_by_x": rng.normal(size=(POINTS, SIZE, VARIABLES)),
        "step": STEP,
        "has_duration": bool(seed % 2),
        "lower": rng.uniform(-1.5, -0.5, JOINTS),
        "upper": rng.uniform(0.5, 1.5, JOINTS),
        "interest": rng.uniform(0.5, 2.0, JOINTS),
    }


def rows_of(order: int, arguments: dict[str, Any]) -> tuple[Array, Array, Array]:
    return (compiled.position_rows, compiled.rate_rows)[order](**arguments)


def extremes(arguments: dict[str, Any], order: int) -> Iterator[tuple[int, int, float]]:
    """Yield interval, joint and value of each extreme of the cubics between the points."""
    for joint in range(JOINTS):
        rows = arguments["q"][:, 7 + joint], arguments["v"][:, 6 + joint]
        spline = CubicHermiteSpline(STEP * np.arange(POINTS), *rows)
        for interval, coefficients in enumerate(spline.c.T):
            curve = np.polyder(np.poly1d(coefficients), order)
            for root in np.polyder(curve).roots:
                if abs(root.imag) < 1e-12 and 0.0 < root.real < STEP:
                    yield interval, joint, curve(root.real)


def expected(arguments: dict[str, Any], order: int) -> list[tuple[int, float]]:
    """Return names, and what is left, at the later points and at extremes where they are near."""
    values, later = (arguments["q"][1:, 7:], arguments["v"][1:, 6:])[order], POINTS - 1
    # By joint: the value, the name of its upper limit, and how far that of the lower one is.
    places = [(j, at, i * JOINTS + j, later * JOINTS) for (i, j), at in np.ndenumerate(values)]
    for interval, joint, value in extremes(arguments, order):
        places.append((joint, value, -1 - interval * JOINTS - joint, -POINTS * JOINTS))
    rows = []
    for joint, value, name, to_lower in places:
        limits = arguments["upper"][joint] - value, value - arguments["lower"][joint]
        for left, named in zip(limits, (name, name + to_lower), strict=True):
            if left < arguments["interest"][joint]:
                rows.append((named, left))
    return sorted(rows)


@every_seed
@both
def test_what_is_left_at_points_and_extremes_is_that_of_the_cubics(order: int, seed: int) -> None:
    """One joint rests: it has no extremes."""
    arguments = drawn(seed)
    arguments["q"][:, 7], arguments["v"][:, 6] = 0.2, 0.0
    values, _, names = rows_of(order, arguments)
    found, wanted = sorted(zip(names, values, strict=True)), expected(arguments, order)
    assert len([name for name, _ in wanted if name < 0]) > 10
    assert len({name for name, _ in wanted}) < 2 * (2 * POINTS - 1) * JOINTS, "all are near"
    assert [name for name, _ in found] == [name for name, _ in wanted]
    np.testing.assert_allclose(
        [value for _, value in found], [value for _, value in wanted], rtol=0.0, atol=1e-12
    )


@every_seed
@both
def test_rows_have_the_derivatives_of_differences(order: int, seed: int) -> None:
    """The last variable of every other seed is the duration, of which the step is a part."""
    arguments = drawn(seed) | {"interest": np.full(JOINTS, 1e3)}
    _, jacobian, names = rows_of(order, arguments)

    def aside(column: int, by: float) -> tuple[Array, Array]:
        by_q = np.pad(arguments["q_by_x"][..., column], [(0, 0), (1, 0)])
        is_duration = arguments["has_duration"] and column == VARIABLES - 1
        values, _, there = rows_of(
            order,
            arguments
            | {"q": arguments["q"] + by * by_q}
            | {"v": arguments["v"] + by * arguments["v_by_x"][..., column]}
            | {"step": STEP + (by / (POINTS - 1) if is_duration else 0.0)},
        )
        return values, there

    step = 1e-6
    for column in range(VARIABLES):
        (ahead, names_ahead), (behind, names_behind) = (aside(column, by) for by in (step, -step))
        assert names.tolist() == names_ahead.tolist() == names_behind.tolist()
        slope = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:, column], slope, rtol=1e-6, atol=1e-6)


@every_seed
def test_quantities_at_points_have_a_row_where_they_are_near_a_limit(seed: int) -> None:
    """In the order of the names: upper limits first, then by point."""
    arguments = drawn(seed)
    values, by_x = arguments["q"][:, 7:], arguments["q_by_x"][:, 6:]
    limits = {name: arguments[name] for name in ("lower", "upper", "interest")}
    rows = []
    for sign, limit in ((-1.0, limits["upper"]), (1.0, -limits["lower"])):
        for i, at in enumerate(values):
            for j, value in enumerate(at):
                left = limit[j] + sign * value
                if left < limits["interest"][j]:
                    rows.append((left, sign * by_x[i, j], (sign > 0.0, i, j)))
    found = compiled.limit_rows(values=values, by_x=by_x, **limits)
    np.testing.assert_array_equal(found[0], [left for left, _, _ in rows])
    np.testing.assert_array_equal(found[1], [gradient for _, gradient, _ in rows])
    shape = 2, POINTS, JOINTS
    assert found[2].tolist() == [np.ravel_multi_index(where, shape) for _, _, where in rows]
    assert 0 < len(rows) < values.size * 2


@every_seed
def test_joints_stop_at_the_height_of_their_cubics(seed: int) -> None:
    """By a jerk against the motion: p + v t - jerk t^3 / 6, as high as between all times."""
    arguments, jerk = drawn(seed), 10.0
    last = {name: arguments[name][-1:] for name in ("q", "v", "q_by_x", "v_by_x")}
    limits = {name: arguments[name] for name in ("lower", "upper")}
    values, jacobian, names = compiled.stop_rows(
        **last, jerk=jerk, **limits, interest=np.full(JOINTS, 1e3)
    )
    time = np.linspace(0.0, 2.0, 400_001)
    for joint, (value, gradient) in enumerate(zip(values, jacobian, strict=True)):
        position, rate = last["q"][0, 7 + joint], last["v"][0, 6 + joint]
        way = abs(rate) * time - jerk * time**3 / 6.0
        upward = rate > 0.0
        left = limits["upper"][joint] - position if upward else position - limits["lower"][joint]
        assert value == pytest.approx(left - way.max(), abs=1e-9)
        assert names[joint] == joint + JOINTS * upward
        stop = time[way.argmax()]
        by_x = last["q_by_x"][0, 6 + joint] + stop * last["v_by_x"][0, 6 + joint]
        np.testing.assert_allclose(gradient, (-1.0 if upward else 1.0) * by_x, atol=1e-4)
    assert len(values) == JOINTS
    none = compiled.stop_rows(**last, jerk=jerk, **limits, interest=values)
    assert [len(each) for each in none] == [0, 0, 0]
