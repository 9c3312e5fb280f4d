"""How far and how sharply an arm moves at most: exact where geometry says how far it moves.

A bound that is too low lets a collision through; one that is too high refuses what is feasible.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from reference_clearance import way_and_bend
from robots import random_state
from straight_arms import straight_arm
from test_core import chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.certificate import (
    _lower_bounds,
    bend_bounds,
    cubics_between,
    slides,
    way_bounds,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

FIRST, LENGTHS = 0.4, (1.0, 0.7, 0.3)
ARM = straight_arm(FIRST, *LENGTHS)
HOME = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
# From each joint on, and from the chaser's origin.
BEYOND, REACH = np.array([2.0, 1.0, 0.3]), 2.4
ENTRIES = 6 + len(LENGTHS)


def corners(robot: Robot, q: Array) -> Array:
    """Joint origins and end effector by Pinocchio's kinematics. Shape (joints + 1, 3)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    return np.array([*(data.oMi[2 + k].translation for k in range(robot.joints)), tip.translation])


def fastest(robot: Robot, q: Array, cubic: Array, order: int) -> float:
    """The largest first or second difference quotient of any corner along a cubic."""
    part = np.linspace(0.0, 1.0, {1: 4001, 2: 401}[order])
    ways = part[:, None] ** np.array([1, 2, 3]) @ cubic
    places = np.array([corners(robot, pin.integrate(robot.model, q, way)) for way in ways])
    quotients = np.diff(places, order, axis=0) / np.diff(part)[0] ** order
    return float(np.linalg.norm(quotients, axis=2).max())


def bounds_of(cubic: Array) -> tuple[float, float]:
    """Both bounds of the straight arm."""
    points = corners(ARM, HOME)
    told = slides(ARM), points, HOME, cubic[None]
    (way,), (bend,) = (of(*told) for of in (way_bounds, bend_bounds))
    return float(way), float(bend)


def one(entry: int, order: int, size: float) -> Array:
    """A cubic in which one entry of the tangent step goes as a power of s."""
    cubic = np.zeros((3, ENTRIES))
    cubic[order - 1, entry] = size
    return cubic


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize(
    ("entry", "lever"),
    [(0, 1.0), (1, 1.0), (2, 1.0), (4, REACH), (5, REACH), *zip((6, 7, 8), BEYOND, strict=True)],
    ids=["along x", "along y", "along z", "about y", "about z", "joint 1", "joint 2", "joint 3"],
)
def test_the_way_of_one_axis_alone_is_exact(
    entry: int, lever: float, order: int, sign: float
) -> None:
    """A straight arm's tip moves at lever times the rate, which is `order` times the size."""
    way, _ = bounds_of(one(entry, order, sign * 0.3))
    assert way == pytest.approx(order * 0.3 * lever, rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_way_of_all_axes_that_push_the_same_way_is_exact(sign: float) -> None:
    """At the beginning a straight arm's tip gets from each axis what it can get."""
    cubic = np.zeros((3, ENTRIES))
    cubic[0, 1], cubic[0, 5:] = sign * 0.02, sign * np.array([0.1, 0.2, 0.3, 0.4])
    way, _ = bounds_of(cubic)
    at_once = 0.02 + 0.1 * REACH + np.array([0.2, 0.3, 0.4]) @ BEYOND
    assert fastest(ARM, HOME, cubic, 1) == pytest.approx(at_once, rel=2e-3)
    assert way == pytest.approx(at_once + 0.1 * 0.02 / 2, rel=1e-12)


def test_a_base_that_turns_while_it_bends_needs_the_way_of_its_axis() -> None:
    """Without the axis's own way the bound would be below what happens."""
    moved, turn = np.array([np.sqrt(3.0), 1.0, 0.0]), 0.05
    arm = straight_arm(0.01, 0.01)
    cubic = np.zeros((3, 7))
    cubic[0, 0], cubic[2, 1], cubic[0, 5] = moved[0], moved[1], turn
    found = fastest(arm, HOME[:8], cubic, 1)
    (bound,) = way_bounds(slides(arm), corners(arm, HOME[:8]), HOME[:8], cubic[None])
    # The rate alone, and what the turn makes of the arm's own 0.02 m.
    without = np.sqrt(12.0) + turn * 0.02
    assert without + 0.4 * turn < found <= bound
    assert bound == pytest.approx(without + turn * np.linalg.norm(moved) / 2, rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("order", "factor"), [(2, 2.0), (3, 6.0)])
@pytest.mark.parametrize(
    ("entry", "lever"),
    [(0, 1.0), (1, 1.0), (2, 1.0), (4, REACH), (5, REACH), *zip((6, 7, 8), BEYOND, strict=True)],
)
def test_the_bend_of_one_axis_that_hardly_moves_is_its_acceleration(
    entry: int, lever: float, order: int, factor: float, sign: float
) -> None:
    """Centripetal accelerations go with the square of what is small here."""
    cubic = one(entry, order, sign * 1e-3)
    _, bend = bounds_of(cubic)
    happens = fastest(ARM, HOME, cubic, 2)
    assert happens == pytest.approx(1e-3 * factor * lever, rel=0.01)
    assert happens * (1.0 - 1e-6) <= bend <= 1.02 * happens


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("entry", "lever"), [(5, REACH), *zip((6, 7, 8), BEYOND, strict=True)])
def test_the_bend_of_one_steady_turn_is_at_most_half_more_than_what_happens(
    entry: int, lever: float, sign: float
) -> None:
    cubic = one(entry, 1, sign * 0.8)
    _, bend = bounds_of(cubic)
    assert fastest(ARM, HOME, cubic, 2) == pytest.approx(0.8**2 * lever, rel=1e-3)
    assert bend == pytest.approx(1.5 * 0.8**2 * lever, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_the_bend_of_a_base_that_turns_on_its_way_is_nearly_what_happens(order: int) -> None:
    """A steady turn of 0.01 rad on a way of 2 m, and one that gets faster."""
    arm, turn, way = straight_arm(1e-4, 1e-4), 0.01, 2.0
    cubic = np.zeros((3, 7))
    cubic[0, 1], cubic[order - 1, 5] = way, turn
    happens = fastest(arm, HOME[:8], cubic, 2)
    assert happens == pytest.approx({1: 1.0, 2: 3.0}[order] * turn * way, rel=0.02)
    (bend,) = bend_bounds(slides(arm), corners(arm, HOME[:8]), HOME[:8], cubic[None])
    assert happens <= bend <= 1.03 * happens


@pytest.mark.parametrize("name", ["free1", "free7", "planar3"])
def test_both_bounds_are_sums_over_joints_and_links(name: str) -> None:
    robot, rng = chain_robot(name), np.random.default_rng(1)
    q, _ = configuration(robot, random_state(robot, rng))
    cubics, points = rng.normal(size=(5, 3, 6 + robot.joints)), corners(robot, q)
    expected = np.array([way_and_bend(points, q[:3], cubic) for cubic in cubics])
    told = slides(robot), points, q, cubics
    assert way_bounds(*told) == pytest.approx(expected[:, 0], rel=1e-12)
    assert bend_bounds(*told) == pytest.approx(expected[:, 1], rel=1e-12)


@pytest.mark.parametrize("name", ["sliding1", "sliding4", "sliding7"])
def test_no_bound_of_an_arm_that_slides_is_below_what_happens(name: str) -> None:
    """On the second of two cubics, when the joints have slid already."""
    robot, rng = chain_robot(name), np.random.default_rng(1)
    q, _ = configuration(robot, random_state(robot, rng))
    told = slides(robot), corners(robot, q), q
    for size in (0.03, 1.0):
        cubics = size * rng.normal(size=(2, 3, 6 + robot.joints))
        cubics[:, :, :6] = 0.0  # the base's own twist is told in its axes at each begin
        later = pin.integrate(robot.model, q, cubics[0].sum(axis=0))
        happens = [fastest(robot, later, cubics[1], order) for order in (1, 2)]
        bounds = [float(of(*told, cubics)[1]) for of in (way_bounds, bend_bounds)]
        assert np.all(np.array(happens) <= bounds)


def telescope() -> Robot:
    """A joint that turns about z, 0.5 m further one that slides along x, and 0.3 m to the tip."""
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    limit = '<limit lower="-9" upper="9" velocity="9" effort="9"/>'
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in ("chaser", "a", "b"))
    text = (
        f'<robot name="telescope">{links}<link name="tip"/>'
        '<joint name="turn" type="revolute"><parent link="chaser"/><child link="a"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
        '<joint name="out" type="prismatic"><parent link="a"/><child link="b"/>'
        f'<origin xyz="0.5 0 0"/><axis xyz="1 0 0"/>{limit}</joint>'
        '<joint name="hand" type="fixed"><parent link="b"/><child link="tip"/>'
        '<origin xyz="0.3 0 0"/></joint></robot>'
    )
    return robot_from_urdf_text(text, "chaser", "tip")


def test_a_turn_moves_an_arm_that_has_slid_out_by_all_of_its_length() -> None:
    robot, q = telescope(), HOME[:9]
    cubics = np.zeros((2, 3, 8))
    cubics[0, 0, 7], cubics[1, 0, 6] = 1.0, 0.2
    told = slides(robot), corners(robot, q), q, cubics
    later = pin.integrate(robot.model, q, cubics[0].sum(axis=0))
    assert fastest(robot, later, cubics[1], 1) == pytest.approx(0.2 * 1.8, rel=1e-6)
    assert way_bounds(*told)[1] == pytest.approx(0.2 * 1.8, rel=1e-12)
    assert fastest(robot, later, cubics[1], 2) == pytest.approx(0.2**2 * 1.8, rel=1e-3)
    assert bend_bounds(*told)[1] == pytest.approx(1.5 * 0.2**2 * 1.8, rel=1e-12)


def test_a_rail_alone_moves_the_arm_as_fast_as_it_slides() -> None:
    robot = chain_robot("sliding1")
    cubic = np.zeros((1, 3, 7))
    cubic[0, 0, 6], cubic[0, 1, 6] = 0.3, -0.1
    told = slides(robot), corners(robot, HOME[:8]), HOME[:8], cubic
    assert way_bounds(*told) == pytest.approx([0.3 + 2 * 0.1], rel=1e-12)
    assert bend_bounds(*told) == pytest.approx([2 * 0.1], rel=1e-12)
    beside = cubic.copy()
    beside[0, 0, 5] = 0.2  # a turn makes what slides out bend: 2 W u
    (bend,) = bend_bounds(slides(robot), corners(robot, HOME[:8]), HOME[:8], beside)
    assert bend > 2 * 0.1 + 2 * 0.2 * (0.3 + 2 * 0.1)


@pytest.mark.parametrize("name", ["free3", "planar3"])
def test_cubics_go_through_both_configurations_at_both_velocities(name: str) -> None:
    """Far apart, and turned by more than a radian between two points."""
    robot, rng = chain_robot(name), np.random.default_rng(2)
    model, tiny = robot.model, 1e-6
    q, _ = configuration(robot, random_state(robot, rng))
    rows = [q]
    for way in rng.normal(scale=0.7, size=(3, model.nv)):
        rows.append(pin.integrate(model, rows[-1], way))
    v, steps = rng.normal(size=(4, model.nv)), np.array([0.3, 1.0, 2.0])
    for k, cubic in enumerate(cubics_between(robot, np.array(rows), v, steps)):

        def at(part: float, k: int = k, cubic: Array = cubic) -> Array:
            return np.asarray(pin.integrate(model, rows[k], part ** np.arange(1, 4) @ cubic))

        for end, part in enumerate((0.0, 1.0)):
            away = pin.difference(model, rows[k + end], at(part))
            assert np.abs(away).max() < 1e-9
            rate = pin.difference(model, at(part - tiny), at(part + tiny)) / (2 * tiny)
            assert rate == pytest.approx(steps[k] * v[k + end], abs=1e-6)


@pytest.mark.parametrize("part", [0.1, 0.5, 0.8])
@pytest.mark.parametrize("away", [0.05, 1.0, 40.0])
def test_what_flies_straight_past_is_not_nearer_than_the_parabola_says(
    away: float, part: float
) -> None:
    """A way of 1 m, nearest at a part of it; far away the parabola is the truth."""
    radius = 0.02
    ends = np.hypot([part, 1.0 - part], away) - radius
    (found,) = _lower_bounds(*ends[:, None], np.ones(1), np.zeros(1), np.array([radius]))
    assert found <= away - radius + 1e-12
    if away == 40.0:
        sag = ends.max() - (away - radius)
        assert found >= away - radius - 0.05 * sag
    assert found >= ends.min() - 0.5


@pytest.mark.parametrize("rise", [0.0, 0.3, -0.3, 0.9, -0.9, 2.0, -2.0])
def test_what_comes_straight_near_and_turns_back_is_where_the_parabola_says(rise: float) -> None:
    """It is at far + rise s + s (s - 1), and bends by 2; beyond a rise of 1 an end is nearest."""
    far, s = 1e4, np.linspace(0.0, 1.0, 10_001)
    distance = far + rise * s + s * (s - 1.0)
    ends, way = distance[[0, -1], None], np.abs(rise) + 1.0
    (found,) = _lower_bounds(*ends, np.array([way]), np.array([2.0]), np.array([1.0]))
    assert found <= distance.min() + 1e-9
    assert found == pytest.approx(distance.min(), abs=2e-3)
