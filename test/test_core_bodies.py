"""The search's certificate of bodies against the check's, and how far joints move bodies."""

from __future__ import annotations

import re
from functools import cache
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, random_robot
from core_rows import distances_of_core
from near_bodies import least_distance
from test_body_clearance import random_motion
from test_body_distances import all_pairs, configurations, every_row, spheres_around
from test_core import SLIDING, chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, obstacles_of
from ff_planner_ros.planning.distance import search_certificate
from ff_planner_ros.planning.distance.bodies import kinds_and_sizes, placed_bodies
from ff_planner_ros.planning.distance.body_certificate import least_pair_distance
from ff_planner_ros.planning.distance.body_distances import pair_distances
from ff_planner_ros.planning.distance.body_reaches import base_reaches, body_reaches, pair_reaches
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.search_certificate import CERTIFICATE_GAP
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.obstacles import RigidMotion
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.primitives import Kind
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot


def require_near(certified: float, least: float, part: float, where: str) -> None:
    """Hold a certificate against what another one found, each known to its gap alone."""
    lowest = least - max(CERTIFICATE_GAP, part * least)
    assert lowest - CERTIFICATE_GAP <= certified <= least + CERTIFICATE_GAP, where


class Checked(NamedTuple):
    """A motion with spheres on its way, and the least distances that the check finds of each."""

    robot: Robot
    motion: FollowedMotion
    last: int
    spheres: list[Obstacle]
    of_pairs: Array
    of_spheres: Array


@cache
def checked(seed: int) -> Checked:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    motion = random_motion(robot, seed, points=(4, 30)[seed % 2])
    last = len(motion.time) - 1 - seed
    (centers,), radii = spheres_around(robot, motion.q[:1], 4, rng)
    spheres = [
        Obstacle.sphere(
            str(k), place + k * rng.normal(scale=0.3, size=3), radius, rng.normal(0.0, 0.05, 3)
        )
        for k, (place, radius) in enumerate(zip(centers, radii, strict=True))
    ]
    of_pairs = [
        least_pair_distance(robot, motion, np.array([k]), last).found
        for k in range(len(robot.pairs))
    ]
    of_spheres = [
        least_distance(robot, motion, spheres, np.array([k]), last).found
        for k in range(len(robot.bodies) * len(spheres))
    ]
    return Checked(robot, motion, last, spheres, np.array(of_pairs), np.array(of_spheres))


@pytest.mark.sampled
@pytest.mark.parametrize("part", [0.02, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3, 21, 23])
def test_the_search_certifies_what_the_check_does(seed: int, part: float) -> None:
    """Both are below the truth by so much at most; where two are deep in each other, as deep."""
    robot, motion, last, spheres, of_pairs, of_spheres = checked(seed)
    touching = 0
    for each, found in (
        (of_pairs, search_certificate.search_pair_distance),
        (
            of_spheres,
            lambda *asked: search_certificate.search_distance(*asked[:2], spheres, *asked[2:]),
        ),
    ):
        apart = np.flatnonzero(each > 0.01)
        assert len(apart) > 3
        touching += len(each) - len(apart)
        certified = found(robot, motion, apart, last, part)
        require_near(certified, each[apart].min(), part, f"seed {seed}")
        of_all = found(robot, motion, np.arange(len(each)), last, part)
        require_near(of_all, each.min(), part, f"seed {seed}")
        assert found(robot, motion, apart[:0], last, part) == np.inf
        assert found(robot, motion, apart, -1, part) == np.inf
    assert touching > 0


@pytest.mark.parametrize("seed", [1, 2, 3, 21, 23])
def test_no_joint_moves_two_bodies_against_each_other_faster_than_is_said(seed: int) -> None:
    robot, step = all_pairs(seed), 1e-4
    angles, rows = configurations(robot, 10, seed)[:, 7:], every_row(10, len(robot.pairs))
    here = pair_distances(robot, placed_bodies(robot, angles), rows).distance
    reaches, fast = pair_reaches(robot), []
    for joint in range(robot.joints):
        turned = angles + step * np.eye(robot.joints)[joint]
        there = pair_distances(robot, placed_bodies(robot, turned), rows).distance
        rate, most = np.abs(there - here) / step, reaches[joint, rows[1]]
        apart = (here > 1e-3) & (there > 1e-3)
        assert (rate[apart] <= most[apart] + 1e-3).all(), f"seed {seed}, joint {joint}"
        fast.append((rate / np.maximum(most, 1e-3))[apart].max())
    assert max(fast) > 0.7, "the bound is hardly more than what happens"


def points_of(robot: Robot, body: int) -> Array:
    """Points of a solid in its own frame, the farthest from any axis among them."""
    kinds, sizes = kinds_and_sizes(robot)
    size, solid = sizes[body], robot.bodies[body].solid
    if kinds[body] == Kind.HULL:
        return np.asarray(solid.points())
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    if kinds[body] == Kind.BOX:
        return np.sign(directions) * size
    ends = np.outer(np.sign(directions[:, 2]), [0.0, 0.0, size[1]])
    if kinds[body] == Kind.CYLINDER:
        directions[:, 2] = 0.0
    return ends + size[0] * directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize("seed", [1, 2, 3, 21, 23])
def test_no_point_of_a_body_comes_further_from_joints_and_base_than_is_said(seed: int) -> None:
    robot = random_robot(seed)
    data = robot.model.createData()
    for q in configurations(robot, 20, seed):
        placements = body_placements(robot, q)
        pin.forwardKinematics(robot.model, data, q)
        for number, body in enumerate(robot.bodies):
            points = points_of(robot, number) @ placements[number].rotation.T
            points = points + placements[number].translation
            assert (
                np.linalg.norm(points - q[:3], axis=1).max() <= base_reaches(robot)[number] + 1e-9
            )
            for joint in range(body.joint - 1):
                at = data.oMi[2 + joint]
                lever = np.cross(points - at.translation, at.rotation @ robot.joint_axes[joint])
                farthest = np.linalg.norm(lever, axis=1).max()
                if robot.slides(joint):
                    assert body_reaches(robot)[joint, number] == 1.0
                    continue
                assert farthest <= body_reaches(robot)[joint, number] + 1e-9
                if joint == body.joint - 2:  # a cylinder is taken for a prism
                    assert farthest > 0.97 * body_reaches(robot)[joint, number]


@pytest.mark.parametrize("name", SLIDING)
def test_lines_that_slide_out_are_as_far_from_boxes_as_coal_measures(name: str) -> None:
    robot, rng = chain_robot(name), np.random.default_rng(4)
    q = configurations(robot, 6, 4)
    arm = arm_points(robot, q)
    box = Obstacle("box", Solid("box", rng.uniform(0.2, 0.6, 3)), RigidMotion(arm[0, 1] + 0.4))
    found = distances_of_core(robot, q, np.arange(6.0), [box], 1e3)
    lines = [body.joint - 2 for body in with_bodies(robot).bodies]
    assert len(found.values) == 6 * len(lines)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for name_of_row, value in zip(found.names.tolist(), found.values.tolist(), strict=True):
        at, line = divmod(name_of_row, len(lines))
        begin, end = arm[at, lines[line]], arm[at, lines[line] + 1]
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - begin)
        place = coal.Transform3s(turn.toRotationMatrix(), (begin + end) / 2)
        seen = coal.Capsule(0.0, float(np.linalg.norm(end - begin)))
        there = coal.Transform3s(np.eye(3), box.motion.position)
        truth = coal.distance(seen, place, box.solid.geometry, there, request, result)
        assert value == pytest.approx(truth, abs=1e-6) or (value < 0.0 and truth <= 1e-6)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"chosen": np.array([-1])}, "number -1 is chosen"),
        ({"chosen": np.array([10**6])}, "number 1000000 is chosen"),
        ({"last": 2}, "last is no point"),
        ({"gap": 0.0}, "gap must be positive"),
        ({"part": 1.0}, "part must be at least 0 and below 1"),
    ],
)
def test_a_certificate_of_wrong_sizes_or_of_nan_is_refused_by_name(
    change: dict[str, Any], said: str
) -> None:
    robot = random_robot(1)
    q = np.zeros((2, 13))
    q[:, 6] = 1.0
    motion = chain_of(robot), q, np.zeros((2, 12)), np.arange(2.0)
    of_both = {"motion": compiled.CubicMotion(*motion), "bodies": bodies_of(robot)}
    of_both |= {"chosen": np.arange(1), "last": 1, "gap": 1e-3, "part": 0.0}
    far = obstacles_of([Obstacle.sphere("far", [9.0, 9.0, 9.0], 1.0)], 1.0)
    for ask, arguments in (
        (compiled.certified_pairs, of_both),
        (compiled.certified_obstacles, of_both | {"obstacles": far}),
    ):
        assert ask(**arguments) < 20.0  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=re.escape(said)):
            ask(**(arguments | change))  # type: ignore[arg-type]
