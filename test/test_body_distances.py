"""Distances of bodies against textbook formulas, Coal, Pinocchio's kinematics and differences."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import (
    body_placements,
    coal_distance,
    moving_pairs,
    random_robot,
    tumbling_spheres,
)
from core_rows import CoreRows, distances_of_core, pair_distances_of_core, rows_along
from near_bodies import sphere_distances
from robots import random_state

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import (
    obstacle_gradients,
    pair_distances,
    pair_gradients,
)
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

SEEDS = (1, 2, 3, 23, 41)  # from 20 on there are joints that slide, from 40 on some mimic others


def a_body(solid: coal.CollisionGeometry) -> Body:
    return Body("body", "body", 1, solid, pin.SE3.Identity(), np.zeros(3), 10.0)


def all_pairs(seed: int) -> Robot:
    """A random robot of which every pair of moving bodies must not touch."""
    robot = random_robot(seed)
    return replace(robot, pairs=tuple(moving_pairs(robot)))


def configurations(robot: Robot, count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.array([configuration(robot, random_state(robot, rng))[0] for _ in range(count)])


def spheres_around(
    robot: Robot, q: Array, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Centres near the bodies of each configuration, and radii."""
    near = rng.integers(len(robot.bodies), size=count)
    bodies = [[body_placements(robot, at)[body].translation for body in near] for at in q]
    return bodies + rng.normal(scale=0.2, size=(len(q), count, 3)), rng.uniform(0.05, 0.4, count)


def every_row(*counts: int) -> tuple[Array, ...]:
    return tuple(row.ravel() for row in np.indices(counts))


@pytest.mark.parametrize(
    ("solid", "point", "distance"),
    [
        (coal.Sphere(0.3), [0.0, 3.0, 4.0], 4.7),
        (coal.Sphere(0.3), [0.0, 0.0, 0.1], -0.2),
        (coal.Capsule(0.1, 1.0), [0.3, 0.4, 0.2], 0.4),
        (coal.Capsule(0.1, 1.0), [0.3, 0.0, 0.9], 0.4),
        (coal.Capsule(0.1, 1.0), [0.05, 0.0, 0.2], -0.05),
        (coal.Box(2.0, 4.0, 6.0), [1.5, 0.0, 0.0], 0.5),
        (coal.Box(2.0, 4.0, 6.0), [1.3, -2.4, 1.0], 0.5),
        (coal.Box(2.0, 4.0, 6.0), [-3.0, -4.0, 4.0], 3.0),
        (coal.Box(2.0, 4.0, 6.0), [0.8, 1.9, 0.0], -0.1),
        (coal.Cylinder(0.5, 2.0), [0.6, 0.8, 0.3], 0.5),
        (coal.Cylinder(0.5, 2.0), [0.0, 0.1, -1.4], 0.4),
        (coal.Cylinder(0.5, 2.0), [0.8, 0.0, 1.4], 0.5),
        (coal.Cylinder(0.5, 2.0), [0.0, 0.3, 0.95], -0.05),
        (coal.Cylinder(0.5, 2.0), [0.45, 0.0, 0.5], -0.05),
    ],
)
def test_a_point_is_as_far_from_a_solid_as_geometry_says(
    solid: coal.CollisionGeometry, point: list[float], distance: float
) -> None:
    robot = replace(random_robot(1), bodies=(a_body(solid),), pairs=())
    placed = placed_bodies(robot, np.zeros((1, robot.joints)))
    center = (placed.positions[0, 0] + placed.rotations[0, 0] @ point)[None, None]
    found = sphere_distances(robot, placed, center, np.array([0.1]), every_row(1, 1, 1))
    assert found.distance == pytest.approx([distance - 0.1], abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_body_is_as_far_from_every_sphere_as_coal_says(seed: int) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    q = configurations(robot, 4, seed)
    centers, radius = spheres_around(robot, q, 6, rng)
    placed = placed_bodies(robot, q[:, 7:])
    rows = every_row(4, len(robot.bodies), 6)
    found = sphere_distances(robot, placed, centers_in_base(q, centers), radius, rows).distance
    deep = 0
    for at, body, sphere, distance in zip(*rows, found, strict=True):
        place = pin.SE3(np.eye(3), centers[at, sphere])
        solid = robot.bodies[body].solid
        truth = coal_distance(
            solid, body_placements(robot, q[at])[body], coal.Sphere(radius[sphere]), place
        )
        deep += truth < 0.0
        # Coal closes in on the depth in what is round by flat faces.
        exact = 2e-5 + 0.01 * max(0.0, -truth)
        assert distance == pytest.approx(truth, abs=exact), (robot.bodies[body].name, sphere)
    assert deep > 5


@pytest.mark.parametrize("seed", SEEDS)
def test_every_pair_is_as_far_apart_as_coal_says_where_pinocchio_puts_it(seed: int) -> None:
    robot = all_pairs(seed)
    q = configurations(robot, 3, seed)
    rows = every_row(3, len(robot.pairs))
    found = pair_distances(robot, placed_bodies(robot, q[:, 7:]), rows)
    for at, pair, distance, normal in zip(*rows, found.distance, found.normal, strict=True):
        first, second = robot.pairs[pair]
        places = body_placements(robot, q[at])
        truth = coal_distance(
            robot.bodies[first].solid, places[first], robot.bodies[second].solid, places[second]
        )
        assert distance == pytest.approx(truth, abs=2e-5), robot.pairs[pair]
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
    assert (found.distance < 0.0).sum() > 3


def test_two_capsules_are_as_far_apart_as_their_axes_less_their_radii() -> None:
    rng = np.random.default_rng(4)
    robot = all_pairs(1)
    pair = robot.pairs[0]
    for _ in range(20):
        ends, radii = rng.normal(size=(2, 2, 3)), rng.uniform(0.02, 0.2, 2)
        places, solids = [], []
        for (start, end), radius in zip(ends, radii, strict=True):
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start)
            places.append(pin.SE3(turn.toRotationMatrix(), (start + end) / 2))
            solids.append(coal.Capsule(radius, np.linalg.norm(end - start)))
        bodies = list(robot.bodies)
        for number, place, solid in zip(pair, places, solids, strict=True):
            bodies[number] = replace(bodies[number], joint=1, placement_in_joint=place, solid=solid)
        capsules = replace(robot, bodies=tuple(bodies), pairs=(pair,))
        placed = placed_bodies(capsules, np.zeros((1, robot.joints)))
        found = pair_distances(capsules, placed, every_row(1, 1)).distance[0]
        assert found == pytest.approx(axes_apart(*ends) - radii.sum(), abs=1e-5)


def axes_apart(one: Array, other: Array) -> float:
    """Distance of two segments: a convex function of where on each, on finer and finer grids."""
    low, high = np.zeros(2), np.ones(2)
    for _ in range(25):
        s, t = np.meshgrid(*np.linspace(low, high, 9).T, indexing="ij")
        apart = (1 - s)[..., None] * one[0] + s[..., None] * one[1]
        apart = np.linalg.norm(
            apart - (1 - t)[..., None] * other[0] - t[..., None] * other[1], axis=-1
        )
        best = np.array(np.unravel_index(apart.argmin(), apart.shape))
        at, step = low + best * (high - low) / 8, (high - low) / 8
        low, high = np.maximum(at - step, 0.0), np.minimum(at + step, 1.0)
    return float(apart.min())


STEP = 1e-6
# Where a nearest point jumps from one place to another, there is no derivative: differences to both
# sides differ. So few of many random configurations are there.
MOST_KINKS = 0.03


def require_derivatives(found: Array, ahead: Array, here: Array, behind: Array) -> None:
    """Hold derivatives against differences to both sides where these agree."""
    forward, backward = (ahead - here) / STEP, (here - behind) / STEP
    smooth = np.abs(forward - backward) < 1e-3
    assert smooth.mean() > 1.0 - MOST_KINKS
    error = np.abs(found - (ahead - behind) / (2 * STEP))[smooth]
    assert error.max() < 2e-3, f"{error.max():.1e} m/rad"
    assert np.median(error) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_pairs_move_against_each_other_as_their_derivatives_say(seed: int) -> None:
    robot = all_pairs(seed)
    q = configurations(robot, 6, seed)[:, 7:]
    rows = every_row(6, len(robot.pairs))

    def distance(angles: Array) -> Array:
        return pair_distances(robot, placed_bodies(robot, angles), rows).distance

    placed = placed_bodies(robot, q)
    here = pair_distances(robot, placed, rows)
    gradients = pair_gradients(robot, placed, here, rows)
    assert (here.distance < 0.0).sum() > 10
    for joint, unit in enumerate(np.eye(robot.joints)):
        sides = distance(q + STEP * unit), here.distance, distance(q - STEP * unit)
        require_derivatives(gradients[:, joint], *sides)


@pytest.mark.parametrize("seed", SEEDS)
def test_bodies_move_against_spheres_as_their_derivatives_say(seed: int) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    q = configurations(robot, 5, seed)
    centers, radius = spheres_around(robot, q, 8, rng)
    rows = every_row(5, len(robot.bodies), 8)

    def distance(at: Array) -> Array:
        placed, seen = placed_bodies(robot, at[:, 7:]), centers_in_base(at, centers)
        return sphere_distances(robot, placed, seen, radius, rows).distance

    placed = placed_bodies(robot, q[:, 7:])
    here = sphere_distances(robot, placed, centers_in_base(q, centers), radius, rows)
    gradients = obstacle_gradients(robot, placed, here, rows)
    assert (here.distance < 0.0).sum() > 10
    for number, unit in enumerate(np.eye(robot.model.nv)):
        ahead, behind = (
            np.array([pin.integrate(robot.model, at, step * unit) for at in q])
            for step in (STEP, -STEP)
        )
        sides = distance(ahead), here.distance, distance(behind)
        require_derivatives(gradients[:, number], *sides)


def dense_rows(gradients: Array, sensitivity: Array, at: Array) -> Array:
    return np.einsum("rj,rjx->rx", gradients, sensitivity[at])


def require_rows(
    found: CoreRows, distance: Array, jacobian: Array, interest: float, where: str
) -> None:
    """Hold rows of the core against all distances, by their names, and their derivatives."""
    distances, derivatives, names, *_ = found
    assert set(np.flatnonzero(distance < interest - 1e-6)) <= set(names), where
    np.testing.assert_allclose(distances, distance[names], rtol=0.0, atol=4e-6, err_msg=where)
    # Where nearest points are not the only ones, there are several derivatives.
    error = np.abs(derivatives - jacobian[names]).max(axis=1)
    assert (error > 1e-3).mean() < MOST_KINKS, where
    assert np.median(error) < 1e-6, where
    assert len(names) > 20


@pytest.mark.parametrize("seed", SEEDS)
def test_the_core_finds_the_same_distances_and_derivatives(seed: int) -> None:
    robot, rng = all_pairs(seed), np.random.default_rng(seed)
    q = configurations(robot, 12, seed)
    centers, radius = spheres_around(robot, q[:1], 9, rng)
    velocities, times = rng.normal(scale=0.05, size=(9, 3)), np.linspace(0.0, 3.0, 12)
    interest = 0.3
    placed = placed_bodies(robot, q[:, 7:])
    rows = every_row(12, len(robot.pairs))
    truth = pair_distances(robot, placed, rows)
    gradients = pair_gradients(robot, placed, truth, rows)
    found = pair_distances_of_core(robot, q, interest)
    require_rows(
        found,
        truth.distance,
        dense_rows(gradients, found.q_by_x[:, 6:], rows[0]),
        interest,
        f"pairs, seed {seed}",
    )
    rows = every_row(12, len(robot.bodies), 9)
    seen = centers_in_base(q, centers + times[:, None, None] * velocities)
    truth = sphere_distances(robot, placed, seen, radius, rows)
    gradients = obstacle_gradients(robot, placed, truth, rows)
    spheres = [
        Obstacle.sphere(str(k), *one)
        for k, one in enumerate(zip(centers[0], radius, velocities, strict=True))
    ]
    found = distances_of_core(robot, q, times, spheres, interest)
    require_rows(
        found,
        truth.distance,
        dense_rows(gradients, found.q_by_x, rows[0]),
        interest,
        f"spheres, seed {seed}",
    )


def test_a_distance_does_not_depend_on_what_was_measured_before() -> None:
    robot = all_pairs(2)
    placed = placed_bodies(robot, configurations(robot, 4, 2)[:, 7:])
    rows = every_row(4, len(robot.pairs))
    order = np.random.default_rng(2).permutation(len(rows[0]))
    once = pair_distances(robot, placed, rows)
    again = pair_distances(robot, placed, tuple(row[order] for row in rows))
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one[order], other)


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_the_core_knows_where_spheres_are_that_are_fixed_to_a_tumbling_body(seed: int) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    q, times = configurations(robot, 12, seed), np.linspace(0.0, 3.0, 12)
    q[:, :3] = q[:1, :3]
    spheres = tumbling_spheres(rng, q[0, :3], 9)
    rows = every_row(12, len(robot.bodies), 9)
    placed, radius = placed_bodies(robot, q[:, 7:]), np.array([one.radius for one in spheres])
    seen = centers_in_base(q, centers_at(times, spheres))
    truth = sphere_distances(robot, placed, seen, radius, rows)
    gradients = obstacle_gradients(robot, placed, truth, rows)
    found = distances_of_core(robot, q, times, spheres, 0.6)
    require_rows(
        found,
        truth.distance,
        dense_rows(gradients, found.q_by_x, rows[0]),
        0.6,
        f"seed {seed}",
    )


ASKED_FIRST = """
import coal, numpy as np, pinocchio as pin, sys
from ff_planner_ros.robot.collision import bodies
def distance(one, other, turn):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-8
    there = coal.Transform3s(turn, np.array([3.0, 2.0, 1.0]))
    return coal.distance(one, coal.Transform3s(), other, there, request, result)
box, tube = coal.Box(1.0, 1.0, 1.0), coal.Cylinder(0.2, 0.5)
distance(tube, box, pin.rpy.rpyToMatrix(*map(float, sys.argv[1:])))
print(distance(box, box, pin.rpy.rpyToMatrix(0.4, 0.5, 0.6)).hex())
"""


def test_what_was_asked_of_coal_first_changes_no_distance() -> None:
    """In processes of their own: Coal keeps along which direction it first looked in a box."""
    found = set()
    for turn in (("0", "0", "0"), ("0.1", "0.2", "0.3")):
        asked = [sys.executable, "-c", ASKED_FIRST, *turn]
        found.add(subprocess.run(asked, capture_output=True, text=True, check=True).stdout)
    assert len(found) == 1, found


def test_requirements_of_other_bodies_or_other_times_have_rows_of_their_own() -> None:
    """Whichever is asked first, at quarters of the intervals or not."""
    robot, points = all_pairs(1), 4
    fewer = replace(robot, bodies=robot.bodies[:2], pairs=((0, 1),))
    q = configurations(robot, 2 * points - 1, 5)
    asked = [
        compiled.pairs_apart(bodies_of(of), np.zeros(len(of.pairs)), 1e3, quarter_way, None)
        for of in (robot, fewer)
        for quarter_way in (False, True)
    ]
    alone = [rows_along(robot, [one], q[:points], q[points:]) for one in asked]
    assert len({len(one.values) for one in alone}) == len(asked)
    for order in ([0, 1, 2, 3], [3, 2, 1, 0], [1, 3, 0, 2]):
        found = rows_along(robot, [asked[k] for k in order], q[:points], q[points:])
        np.testing.assert_array_equal(
            found.values, np.concatenate([alone[k].values for k in order])
        )
