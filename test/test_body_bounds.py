"""What bounds of bodies are made of: spheres around them, and how far joints and base move them.

Exact for balls, whose sphere is the body; elsewhere against the farthest points by geometry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from near_bodies import sphere_bounds, sphere_distances
from straight_arms import ball, straight_arm
from test_body_distances import all_pairs, configurations, every_row, spheres_around

from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import pair_bounds, pair_distances
from ff_planner_ros.planning.distance.body_reaches import base_reaches, body_reaches, pair_reaches
from ff_planner_ros.planning.distance.solids_apart import between_spheres

ARM = straight_arm(
    0.4,
    1.0,
    0.6,
    solids=(("chaser", ball(0.2, -0.1)), ("link_1", ball(0.05, 0.9)), ("link_2", ball(0.1, 0.5))),
)


def test_bounds_of_balls_are_their_distances() -> None:
    """Folded by a right angle: link 1 ends at (0.4, 1), and link 2 goes on along x."""
    placed = placed_bodies(ARM, np.array([[np.pi / 2, -np.pi / 2]]))
    apart = np.hypot(1.0, 1.0) - 0.2 - 0.1
    assert pair_bounds(ARM, placed) == pytest.approx(np.array([[apart]]), abs=1e-12)
    found = pair_distances(ARM, placed, every_row(1, 1))
    assert found.distance == pytest.approx([apart], abs=1e-7)
    centers, radius = np.array([[[0.9, 3.0, 0.0], [0.4, 0.9, -0.3]]]), np.array([0.4, 0.15])
    bounds = sphere_bounds(ARM, placed, centers, radius)
    measured = sphere_distances(ARM, placed, centers, radius, every_row(1, 3, 2))
    assert bounds.ravel() == pytest.approx(measured.distance, abs=1e-12)
    assert bounds[0, 2, 0] == pytest.approx(2.0 - 0.1 - 0.4, abs=1e-12)
    assert bounds[0, 1, 1] == pytest.approx(0.3 - 0.05 - 0.15, abs=1e-12)


def test_the_sphere_around_a_body_is_about_its_own_centre() -> None:
    """A hull need not be centred in its frame; link 2 is folded to the chaser's side."""
    bodies = list(ARM.bodies)
    center = bodies[2].center_in_joint + np.array([0.1, 0.2, 0.3])
    bodies[2] = replace(bodies[2], center_in_joint=center)
    placed = placed_bodies(replace(ARM, bodies=tuple(bodies)), np.array([[0.0, np.pi / 2]]))
    assert placed.centers[0, 2] == pytest.approx([1.4 - 0.2, 0.6, 0.3], abs=1e-12)
    assert placed.positions[0, 2] == pytest.approx([1.4, 0.5, 0.0], abs=1e-12)
    assert placed.origins[0] == pytest.approx(np.array([[0.4, 0.0, 0.0], [1.4, 0.0, 0.0]]))
    assert placed.axes[0] == pytest.approx(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_distance_is_below_its_bound(seed: int) -> None:
    """By as much at most as the sphere is larger than the body, and so of some within 5 cm."""
    robot, rng = all_pairs(seed), np.random.default_rng(seed)
    q = configurations(robot, 5, seed)
    centers, radius = spheres_around(robot, q, 6, rng)
    placed, seen = placed_bodies(robot, q[:, 7:]), centers_in_base(q, centers)
    of_pairs = pair_distances(robot, placed, every_row(5, len(robot.pairs))).distance
    over = of_pairs - pair_bounds(robot, placed).ravel()
    assert -1e-6 < over.min() < 0.05
    rows = every_row(5, len(robot.bodies), 6)
    of_spheres = sphere_distances(robot, placed, seen, radius, rows).distance
    over = of_spheres - sphere_bounds(robot, placed, seen, radius).ravel()
    assert -1e-6 < over.min() < 0.02


def test_where_coal_fails_the_spheres_around_both_stand_for_them() -> None:
    ends = np.zeros(3), np.array([1.9, 0.0, 0.0])
    distance, point, normal = between_spheres(*ends, 0.2, 0.1)
    assert distance == pytest.approx(1.9 - 0.3, abs=1e-12)
    assert point == pytest.approx([1.9, 0.0, 0.0], abs=1e-12)
    assert normal == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    # One in the middle of the other has no direction, and is as deep as both radii.
    distance, _, normal = between_spheres(np.zeros(3), np.zeros(3), 0.2, 0.1)
    assert (distance, float(np.linalg.norm(normal))) == (pytest.approx(-0.3), 1.0)


def test_reaches_of_a_straight_arm_of_balls_are_exact() -> None:
    """The farthest point of each ball, from base, joints and their axes."""
    assert base_reaches(ARM) == pytest.approx([0.3, 1.35, 2.0], abs=1e-12)
    expected = [[0.0, 0.95, 1.6], [0.0, 0.0, 0.6]]
    assert body_reaches(ARM) == pytest.approx(np.array(expected), abs=1e-12)
    # Seen from the joints the chaser is 0.7 m and 1.7 m away, and the nearer body decides.
    assert ARM.pairs == ((0, 2),)
    assert pair_reaches(ARM) == pytest.approx(np.array([[0.7], [0.6]]), abs=1e-12)


@pytest.mark.parametrize(
    ("solid", "around", "about_z", "away"),
    [
        ('<box size="0.2 0.4 0.6"/>', np.sqrt(0.14), np.hypot(0.6, 0.2), np.sqrt(0.36 + 0.13)),
        ('<sphere radius="0.3"/>', 0.3, 0.8, 0.8),
        ('<capsule radius="0.1" length="0.8"/>', 0.5, 0.6, np.hypot(0.5, 0.4) + 0.1),
        # A prism of sixteen sides around it is thicker by less than two per cent.
        ('<cylinder radius="0.1" length="0.8"/>', np.hypot(0.1, 0.4), 0.6, np.hypot(0.6, 0.4)),
        ('<cone radius="0.1" length="0.8"/>', np.hypot(0.1, 0.4), 0.6, np.hypot(0.6, 0.4)),
    ],
    ids=["box", "sphere", "capsule", "cylinder", "cone"],
)
def test_reaches_of_every_kind_of_solid_are_those_of_its_farthest_point(
    solid: str, around: float, about_z: float, away: float
) -> None:
    """Upright, half a metre behind the last joint."""
    # Between two of the prism's edges, where it is thinnest.
    has_rim = "cylinder" in solid or "cone" in solid
    turn = np.pi / 16 if has_rim else 0.0
    origin = f'<origin xyz="0.5 0 0" rpy="0 0 {turn}"/>'
    place = f"<collision>{origin}<geometry>{solid}</geometry></collision>"
    arm = straight_arm(0.4, 1.0, 0.6, solids=(("link_2", place),))
    assert arm.bodies[0].radius == pytest.approx(around, abs=1e-12)
    for found, exact in (
        (body_reaches(arm)[1, 0], about_z),
        (body_reaches(arm)[0, 0], 1.0 + away),
        (base_reaches(arm)[0], 1.4 + away),
    ):
        assert exact - 1e-12 <= found <= exact + 0.0021
        assert has_rim or found == pytest.approx(exact, abs=1e-12)


def test_a_body_seen_from_the_joints_behind_it_is_as_far_as_its_farthest_point() -> None:
    """Of a box on the chaser: from the axis of the joint next to it, and along the arm beyond."""
    box = '<geometry><box size="0.4 0.6 0.2"/></geometry>'
    box = f'<collision><origin xyz="-0.2 0 0"/>{box}</collision>'
    arm = straight_arm(
        0.4,
        0.3,
        5.0,
        9.0,
        solids=(("chaser", box), ("link_1", ball(0.1, 0.0)), ("link_3", ball(0.1, 8.0))),
    )
    (pair,) = [k for k, pair in enumerate(arm.pairs) if pair == (0, 2)]
    to_corner = np.array([0.8, 0.3, 0.1])
    expected = [
        np.hypot(0.8, 0.3),
        0.3 + np.linalg.norm(to_corner),
        5.3 + np.linalg.norm(to_corner),
    ]
    assert pair_reaches(arm)[:, pair] == pytest.approx(expected, abs=1e-12)
