"""Distances of bodies from obstacles of any shape: Coal, differences, and what lies between."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_obstacles, random_robot, random_solid
from core_rows import EACH, CoreRows, distances_of_core, rows_of_motion
from near_bodies import bounds_from, distances_from, least_distance
from scipy.spatial.transform import Rotation
from test_body_clearance import random_motion
from test_body_distances import configurations, every_row
from test_clearance_by_hand import reaching_out
from test_core_bodies import require_near
from test_limits_by_hand import POSTURE
from test_search_keeps_both_ways import POINTS, motion_of

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance import search_certificate
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP
from ff_planner_ros.planning.distance.body_distances import obstacle_gradients
from ff_planner_ros.planning.distance.solids_apart import Distances
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

KINDS = ("box", "cylinder", "capsule", "cone", "mesh")
FAR = 1e3  # [m] all of it is of interest


def pose_of(one: Obstacle, time: float) -> pin.SE3:
    rotations, positions = one.motion.poses(np.array([time]))
    return pin.SE3(rotations[0], positions[0])


def exact_distance(
    first: coal.CollisionGeometry, at: pin.SE3, second: coal.CollisionGeometry, there: pin.SE3
) -> float:
    """The signed distance of two solids, in round ones to a hundredth of a micrometre."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = 1e-9, 1e-6
    places = [coal.Transform3s(place.rotation, place.translation) for place in (at, there)]
    return float(coal.distance(first, places[0], second, places[1], request, result))


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("other", ["box", "cylinder", "capsule", "sphere", "mesh"])
def test_random_solids_are_as_far_apart_as_coal_says(
    kind: str, other: str, times: Callable[[int, int], int]
) -> None:
    """Ten thousand pairs in CI, touching and deep ones among them."""
    rng = np.random.default_rng([KINDS.index(kind), len(other)])
    arm, deep, cases = random_robot(1), 0, times(20, 20)
    for case in range(cases):
        bodies = []
        for number in range(4):
            solid = random_solid(rng, other)
            turn = Rotation.random(random_state=rng).as_matrix()
            place = pin.SE3(turn, rng.normal(0.0, 0.5, 3))
            center = place.act(solid.center)
            bodies.append(Body(str(number), "bus", 1, solid.geometry, place, center, solid.radius))
        robot = replace(arm, bodies=tuple(bodies), pairs=())
        obstacles = tuple(
            Obstacle(
                str(number),
                random_solid(rng, kind),
                RigidMotion(rng.normal(0.0, 0.6, 3), Rotation.random(random_state=rng).as_quat()),
            )
            for number in range(5)
        )
        q = configurations(robot, 1, case)
        q[0, :7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        distances, _, names, *_ = distances_of_core(robot, q, np.zeros(1), obstacles, FAR)
        rows, now = every_row(1, 4, 5), np.zeros(1)
        placed = placed_bodies(robot, q[:, 7:])
        checked = distances_from(robot, placed, q, now, obstacles, rows).distance
        bounds = bounds_from(robot, placed, q, np.zeros(1), obstacles)[rows]
        assert (bounds <= checked + 1e-9).all()
        for name, (_, body, number) in enumerate(zip(*rows, strict=True)):
            at, there = bodies[body].placement_in_joint, pose_of(obstacles[number], 0.0)
            truth = exact_distance(bodies[body].solid, at, obstacles[number].solid.geometry, there)
            where = f"{kind} {other} {case} {body} {number}"
            deep += truth < 0.0
            exact = 1e-6 + 0.01 * max(0.0, -truth)
            # Coal is wrong here; test_deep_and_touching_shapes.py knows the truth.
            if truth > 0.0 or {kind, other} != {"sphere", "cylinder"}:
                assert checked[name] == pytest.approx(truth, abs=exact), where
                assert distances[names == name] == pytest.approx(truth, abs=exact), where
    assert deep > 3 or cases < 20


def test_solids_that_touch_or_are_deep_in_each_other_have_their_depths() -> None:
    """Textbook cases: faces, an edge, an apex and a rim, each by hand."""
    box, up = Solid("box", np.array([2.0, 2.0, 2.0])), np.array([0.0, 0.0, 0.0, 1.0])
    tipped = Rotation.from_euler("x", 45, degrees=True).as_quat()
    down = Rotation.from_euler("x", 180, degrees=True).as_quat()
    flat = Rotation.from_euler("y", 90, degrees=True).as_quat()
    cone, tube = Solid("cone", np.array([0.5, 2.0])), Solid("cylinder", np.array([0.5, 2.0]))
    cases = [
        (Solid("box", np.ones(3)), [0.0, 0.0, 1.75], up, 0.25),
        (Solid("box", np.ones(3)), [0.0, 0.0, 1.5], up, 0.0),
        (Solid("box", np.ones(3)), [0.0, 0.0, 1.25], up, -0.25),
        (Solid("box", np.ones(3)), [0.0, 0.0, 2.0], tipped, 1.0 - np.sqrt(0.5)),
        (cone, [0.0, 0.0, 2.5], down, 0.5),
        (cone, [0.0, 0.0, 1.9], down, -0.1),
        (cone, [0.3, 0.0, 2.3], up, 0.3),
        (tube, [0.0, 0.0, 1.7], flat, 0.2),
        (tube, [0.0, 0.0, 1.4], flat, -0.1),
        (Solid("capsule", np.array([0.5, 2.0])), [0.2, 0.2, 2.6], up, 0.1),
        (Solid("capsule", np.array([0.5, 2.0])), [0.2, 0.2, 2.4], up, -0.1),
    ]
    body = Body("box", "bus", 1, box.geometry, pin.SE3.Identity(), box.center, box.radius)
    robot = replace(random_robot(1), bodies=(body,), pairs=())
    q = configurations(robot, 1, 1)
    q[0, :7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    for solid, place, turn, truth in cases:
        one = (Obstacle("one", solid, RigidMotion(place, turn)),)
        rows = every_row(1, 1, 1)
        placed = placed_bodies(robot, q[:, 7:])
        found = distances_from(robot, placed, q, np.zeros(1), one, rows)
        assert found.distance[0] == pytest.approx(truth, abs=2e-6), (solid.kind, place)
        distances = distances_of_core(robot, q, np.zeros(1), one, FAR).values
        assert distances[0] == pytest.approx(truth, abs=2e-8), (solid.kind, place)


def approach_speeds(
    q: Array,
    times: Array,
    obstacles: Sequence[Obstacle],
    found: Distances,
    rows: tuple[Indices, ...],
) -> Array:
    """Return the rates of distances because of the obstacles' motion. Shape (rows,) [m/s]."""
    configurations, _, which = rows
    to_inertial = rotation_from_quaternion(q[configurations, 3:7])
    points = q[configurations, :3] + np.einsum("rij,rj->ri", to_inertial, found.point)
    normals = np.einsum("rij,rj->ri", to_inertial, found.normal)
    speeds = np.zeros(len(which))
    for number in np.unique(which).tolist():
        of = np.flatnonzero(which == number)
        at, one = times[configurations[of]], obstacles[number]
        twists, (_, origins) = one.motion.twists(at), one.motion.poses(at)
        moving = twists[:, :3] + np.cross(twists[:, 3:], points[of] - origins)
        speeds[of] = np.einsum("ri,ri->r", normals[of], moving)
    return speeds


@pytest.mark.law("PLAN-27")
@pytest.mark.parametrize("lines", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_derivatives_by_base_joints_and_time_are_those_of_differences(
    seed: int, lines: bool
) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    robot = with_bodies(replace(robot, bodies=(), pairs=()) if lines else robot)
    q, times = configurations(robot, 5, seed), np.linspace(0.0, 4.0, 5)
    obstacles = random_obstacles(rng, q[2, :3], 12)
    _, jacobian, names, _, by_x = distances_of_core(robot, q, times, obstacles, FAR, lasting=True)
    shape = 5, len(robot.bodies), len(obstacles)
    assert len(names) == np.prod(shape)
    rows, step = np.unravel_index(names, shape), 1e-6

    def measured(moved: Array, later: float) -> Array:
        placed = placed_bodies(robot, moved[:, 7:])
        return distances_from(robot, placed, moved, times + later, obstacles, rows).distance

    differences = []
    for column in range(6 + robot.joints):
        v = np.zeros(6 + robot.joints)
        v[column] = step
        ends = [[pin.integrate(robot.model, at, sign * v) for at in q] for sign in (1.0, -1.0)]
        later, before = (measured(np.array(end), 0.0) for end in ends)
        differences.append((later - before) / (2 * step))
    differences.append((measured(q, step) - measured(q, -step)) / (2 * step))

    def off_from(by_base_joints_and_time: Array) -> Array:
        """How far the derivatives of each row are off, for a way of one by each variable."""
        at, (by_q, by_time) = rows[0], np.split(by_base_joints_and_time, [-1], axis=1)
        expected = np.einsum("rj,rjx->rx", by_q, by_x[at])
        expected[:, -1] += by_time[:, 0] * (times / times[-1])[at]  # of the duration
        ways = np.maximum(
            np.linalg.norm(by_x[at], axis=1), np.append(np.zeros(EACH * robot.joints), 1.0)
        )
        return (np.abs(expected - jacobian) / ways).max(axis=1)

    # Near an edge that is parallel to another a nearest point jumps, and Coal is exact to 1e-8.
    off = off_from(np.array(differences).T)
    smooth = off < 0.02
    assert smooth.mean() > 0.97
    assert np.median(off) < 1e-5
    assert {obstacles[number].moves for number in rows[2][smooth]} == {False, True}
    placed = placed_bodies(robot, q[:, 7:])
    found = distances_from(robot, placed, q, times, obstacles, rows)
    of_coal = np.column_stack(
        [
            obstacle_gradients(robot, placed, found, rows),
            approach_speeds(q, times, obstacles, found, rows),
        ]
    )
    far = found.distance > 0.01
    assert np.quantile(off_from(of_coal)[far], 0.97) < 1e-3


class Certified(NamedTuple):
    """A motion among obstacles, what the check certifies of each, and what Coal alone measures."""

    robot: Robot
    motion: FollowedMotion
    obstacles: tuple[Obstacle, ...]
    each: list[Least]
    dense: Array


@cache
def certified_motion(seed: int) -> Certified:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    if seed == 4:
        robot = with_bodies(replace(robot, bodies=(), pairs=()))
    motion = random_motion(robot, seed, points=(4, 30)[seed % 2])
    last = len(motion.time) - 1
    obstacles = random_obstacles(rng, motion.q[last // 2, :3] + rng.normal(size=3), 9)
    count = len(robot.bodies) * len(obstacles)
    each = [least_distance(robot, motion, obstacles, np.array([k]), last) for k in range(count)]
    # Between the points: the same motion at sixteen times as many, measured by Coal alone.
    finer = followed(robot, motion.q[0], motion.v[0], motion.joints, multiple=32)
    shape = len(finer.q), len(robot.bodies), len(obstacles)
    dense = distances_from(
        robot,
        placed_bodies(robot, finer.q[:, 7:]),
        finer.q,
        finer.time,
        obstacles,
        every_row(*shape),
    ).distance.reshape(len(finer.q), -1)
    return Certified(robot, motion, obstacles, each, dense.min(axis=0))


@pytest.mark.sampled
@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("part", [0.02, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_certificate_holds_between_the_points_and_the_search_finds_the_same(
    seed: int, part: float
) -> None:
    robot, motion, obstacles, each, dense = certified_motion(seed)
    last, count = len(motion.time) - 1, len(each)
    found = np.array([least.found for least in each])
    for least, truth in zip(each, dense, strict=True):
        assert least.found - CHECK_GAP <= least.certified <= least.found
        assert least.certified <= truth + 2e-5, f"seed {seed}: {least}, Coal {truth}"
        if truth > -0.05:
            assert least.found >= truth - 3e-3, f"seed {seed}: {least}, Coal {truth}"
    apart = np.flatnonzero(found > 0.01)
    assert len(apart) > 3
    certified = search_certificate.search_distance
    least = certified(robot, motion, obstacles, apart, last, part)
    require_near(least, found[apart].min(), part, f"seed {seed}")
    of_all = certified(robot, motion, obstacles, np.arange(count), last, part)
    require_near(of_all, found.min(), part, f"seed {seed}")
    assert certified(robot, motion, obstacles, apart[:0], last, part) == np.inf
    assert certified(robot, motion, obstacles, apart, -1, part) == np.inf


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_no_point_of_an_obstacle_is_faster_than_its_highest_speed(seed: int) -> None:
    rng, times = np.random.default_rng(seed), np.linspace(0.0, 30.0, 3001)
    panel = Solid("box", np.array([4.0, 2.0, 0.005]))
    turning = Obstacle(
        "panel", panel, RigidMotion(np.zeros(3), angular_velocity=rng.normal(0.0, 0.3, 3))
    )
    for one in (turning, *random_obstacles(rng, np.zeros(3), 12)):
        solid = one.solid
        rotations, positions = one.motion.poses(times)
        reach = 0.0
        for _ in range(20):
            way = rng.normal(size=3)
            point = solid.center + solid.radius * way / np.linalg.norm(way)
            reach = max(reach, float(np.linalg.norm(point)))
            speeds = np.linalg.norm(np.diff(positions + rotations @ point, axis=0), axis=1) / 0.01
            assert speeds.max() <= one.highest_speed + 1e-9, one.id
        assert reach <= solid.reach + 1e-12
        inside = solid.geometry.computeVolume() if solid.kind == "mesh" else 1.0
        assert inside > 0.0


def test_interest_and_spheres_around_leave_nothing_out_that_is_near() -> None:
    robot, rng = random_robot(5), np.random.default_rng(5)
    q, times = configurations(robot, 4, 5), np.linspace(0.0, 3.0, 4)
    obstacles = random_obstacles(rng, q[1, :3], 25)
    everything, jacobian, names, *_ = distances_of_core(robot, q, times, obstacles, FAR)
    near, of_near, near_names, *_ = distances_of_core(robot, q, times, obstacles, 0.3)
    chosen = np.flatnonzero(everything < 0.3)
    assert 10 < len(chosen) < len(everything)
    assert set(near_names.tolist()) == set(names[chosen].tolist())
    order = np.argsort(near_names)
    np.testing.assert_allclose(
        near[order], everything[chosen][np.argsort(names[chosen])], atol=1e-8
    )
    assert of_near.shape[1] == jacobian.shape[1]


@pytest.mark.parametrize("turning", [0.0, 0.1])
def test_what_flies_past_is_near_in_the_middle_of_its_way(turning: float) -> None:
    robot, times = random_robot(5), np.linspace(0.0, 20.0, 41)
    q = np.repeat(configurations(robot, 1, 5), len(times), axis=0)
    ahead, rate = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, turning])
    begin, turn = q[0, :3] - 10.0 * ahead, np.array([0.0, 0.0, 0.0, 1.0])
    cube = Obstacle("cube", Solid("box", np.full(3, 0.8)), RigidMotion(begin, turn, ahead, rate))
    everything, _, names, *_ = distances_of_core(robot, q, times, (cube,), FAR)
    near = distances_of_core(robot, q, times, (cube,), 0.3).names
    at = near // len(robot.bodies)
    assert 0 < at.min() <= at.max() < len(times) - 1
    np.testing.assert_array_equal(near, names[everything < 0.3])


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_how_deep_something_is_changes_with_time_as_it_moves_and_turns(seed: int) -> None:
    """Also of what GJK knows nothing of: all of an arm is in a wall that comes along."""
    rng = np.random.default_rng(seed)
    problem = replace(reaching_out("start", True)[0].problem, points=POINTS, duration=4.0)
    moving, turning = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 0.05, 3)
    place, turn = np.zeros(3), Rotation.random(random_state=rng)
    solid = Solid("box", np.array([9.0, 8.0, 7.0]))
    wall = Obstacle("wall", solid, RigidMotion(place, turn.as_quat(), moving, turning))
    motion = motion_of(np.tile(POSTURE, (POINTS, 1)), np.zeros((POINTS, 6)))

    def rows_after(time: float) -> CoreRows:
        rotations, positions = wall.motion.poses(np.array([time]))
        attitude = pin.Quaternion(rotations[0]).coeffs()
        later = wall.with_motion(position=positions[0], quaternion_xyzw=attitude)
        asked = ClearOfObstacles().in_core(replace(problem, obstacles=(later,)), POINTS, 0.0)
        return rows_of_motion(problem.robot, asked, motion, lasting=True)

    found, step = rows_after(0.0), 1e-4  # in a longer one, another corner may be the deepest
    assert (found.values < -1.0).all()
    assert len(found.values) > 100
    grown = (rows_after(step).values - rows_after(-step).values) / (2 * step)
    shares = found.jacobian[:, -1] / grown  # of the duration, when each is looked at
    assert shares.min() == pytest.approx(shares.max() / (2 * (POINTS - 1)), rel=0.02)
    assert shares.max() == pytest.approx(1.0, rel=0.02)
