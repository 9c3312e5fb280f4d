"""How sharply bodies move at most, against Pinocchio's places of their points along the motion.

Divided by the square of its step, a second difference is a mean of second derivatives: none may be
above the bound.
"""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import (
    body_placements,
    coal_distance,
    moving_pairs,
    random_obstacles,
    random_robot,
    tumbling_spheres,
)
from robots import random_state
from straight_arms import ball, straight_arm, told
from test_core import chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.body_motion import (
    bends_beside,
    body_ways,
    cubics_between,
    pair_bends,
)
from ff_planner_ros.planning.distance.surroundings import Surroundings, obstacle_place
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

# Of three intervals the second is looked at, and part of it.
TIMES, BEGIN, END = np.array([0.0, 0.5, 1.2, 1.5]), 1.25, 1.75
PARTS = np.linspace(0.0, 1.0, 33)
# That much of a bound comes to pass somewhere.
SHARE = 0.1
SEEDS = (
    1,
    2,
    3,
    4,
    21,
    22,
    23,
    40,
)  # from 20 on there are joints that slide, from 40 on some mimic others
# What the robot does in a second takes it so long [s]: what tumbles goes on in its own time.
PACES = (1.0, 10.0)


def random_cubics(robot: Robot, seed: int, pace: float = 1.0) -> FollowedMotion:
    """Nearly a steady screw of base and joints, some of them fast and some slow."""
    rng = np.random.default_rng(seed)
    q, _ = configuration(robot, random_state(robot, rng))
    v = rng.normal(size=robot.model.nv) * rng.choice([0.01, 0.3, 1.0], size=robot.model.nv)
    points = np.array([pin.integrate(robot.model, q, time * v) for time in TIMES])
    rates = v * rng.uniform(0.8, 1.2, size=(len(TIMES), robot.model.nv))
    rates /= pace
    return told(pace * TIMES, points[:, 7:], rates[:, 6:], points[:, :7], rates[:, :6])


def between(robot: Robot, motion: FollowedMotion) -> tuple[Array, Array]:
    """Return configurations and times on the way."""
    steps = BEGIN + PARTS * (END - BEGIN) - 1.0
    cubic = cubics_between(robot, motion.q, motion.v, np.diff(motion.time))[1]
    ways = steps[:, None] ** np.arange(1, 4) @ cubic
    q = np.array([pin.integrate(robot.model, motion.q[1], way) for way in ways])
    return q, motion.time[1] + steps * (motion.time[2] - motion.time[1])


def surface(solid: coal.CollisionGeometry) -> Array:
    """Points of a solid that are far from its middle. Shape (points, 3)."""
    corners = np.array(np.meshgrid(*3 * [[-1.0, 1.0]])).reshape(3, -1).T
    match solid:
        case coal.Box():
            return corners * solid.halfSide
        case coal.Sphere():
            return np.vstack([np.eye(3), -np.eye(3)]) * solid.radius
        case coal.Capsule() | coal.Cylinder() | coal.Cone():
            ends = corners * [np.sqrt(0.5) * solid.radius, np.sqrt(0.5) * solid.radius, 1.0]
            return ends * [1.0, 1.0, solid.halfLength]
    return np.asarray(solid.points())


def sharpest(points: Array, of: list[pin.SE3], seen_from: list[pin.SE3]) -> float:
    """The largest second derivative by the part of the way that points of one show another."""
    poses = [there.actInv(here) for here, there in zip(of, seen_from, strict=True)]
    places = np.array([points @ pose.rotation.T + pose.translation for pose in poses])
    second = np.diff(places, 2, axis=0) / PARTS[1] ** 2
    return float(np.linalg.norm(second, axis=-1).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_no_point_of_a_body_bends_more_as_its_pair_sees_it(seed: int) -> None:
    robot = random_robot(seed)
    # In either order.
    some = [(b, a) if (a + b) % 2 else (a, b) for a, b in moving_pairs(robot)]
    robot = replace(robot, pairs=tuple(some))
    motion, count = random_cubics(robot, seed), len(some)
    places = [body_placements(robot, q) for q in between(robot, motion)[0]]
    ends = np.full(count, BEGIN), np.full(count, END)
    bends = pair_bends(robot, motion, np.arange(count), *ends)
    shares = []
    for (first, second), (of_second, of_first) in zip(robot.pairs, bends.T, strict=True):
        here, there = ([at[body] for at in places] for body in (first, second))
        for happens, bound in (
            (sharpest(surface(robot.bodies[second].solid), there, here), of_second),
            (sharpest(surface(robot.bodies[first].solid), here, there), of_first),
        ):
            assert happens <= bound + 1e-9
            shares.append(happens / bound)
    assert max(shares) > SHARE


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("seed", SEEDS)
def test_neither_obstacle_nor_body_bends_more_as_the_other_sees_it(seed: int, pace: float) -> None:
    """Obstacles that rest, move, turn and tumble; of spheres the centre counts."""
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    motion = random_cubics(robot, seed, pace)
    q, times = between(robot, motion)
    obstacles: tuple[Obstacle, ...] = (
        Obstacle.sphere("flying", rng.normal(size=3), 0.2, rng.normal(size=3)),
        *tumbling_spheres(rng, q[0, :3], 2),
        *random_obstacles(rng, q[0, :3], 8),
    )
    bodies, around = [body_placements(robot, at) for at in q], Surroundings(obstacles)
    shares = []
    for number, obstacle in enumerate(obstacles):
        there = [obstacle_place(obstacle, float(time)) for time in times]
        shape = obstacle.solid.geometry
        points = np.zeros((1, 3)) if obstacle.is_sphere else surface(shape)
        for body in range(len(robot.bodies)):
            solid, here = robot.bodies[body].solid, [at[body] for at in bodies]
            ends = zip(here, there, strict=True)
            apart = max(0.0, *(coal_distance(solid, at, shape, other) for at, other in ends))
            which = np.array([body * len(obstacles) + number])
            step = np.array([BEGIN]), np.array([END])
            (of_obstacle,), (of_body,) = bends_beside(
                robot, motion, around, which, *step, np.array([apart])
            )
            for happens, bound in (
                (sharpest(points, there, here), of_obstacle),
                (sharpest(surface(solid), here, there), of_body),
            ):
                assert happens <= bound + 1e-9
                shares.append(happens / bound)
    assert max(shares) > SHARE


def ends_of_lines(robot: Robot, q: Array) -> Array:
    """Where joints and end effector are, by Pinocchio. Shape (configurations, joints + 1, 3)."""
    data, found = robot.model.createData(), []
    for at in q:
        pin.forwardKinematics(robot.model, data, at)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).translation.copy()
        found.append([*(data.oMi[2 + k].translation.copy() for k in robot.tree.to_tip), tip])
    return np.array(found)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_point_of_a_line_moves_or_bends_more_though_its_end_slides(seed: int) -> None:
    """A line grows and shrinks: a point of it is a part of the way from its begin to its end."""
    of_bodies, rng = random_robot(seed), np.random.default_rng(seed)
    robot = with_bodies(replace(of_bodies, bodies=(), pairs=()))
    motion = random_cubics(robot, seed)
    q, times = between(robot, motion)
    obstacles = random_obstacles(rng, q[0, :3], 4)
    ends, shares, data = ends_of_lines(robot, q), [], robot.model.createData()
    axes = []
    for at in q:
        pin.forwardKinematics(robot.model, data, at)
        axes.append([frame.rotation.copy() for frame in data.oMi])
    ways = body_ways(robot, motion)[1] * (END - BEGIN)
    for number, body in enumerate(robot.bodies):
        start = robot.tree.to_tip.index(body.joint - 2)
        parts = np.linspace(0.0, 1.0, 5)[:, None, None]
        line = (1.0 - parts) * ends[:, start] + parts * ends[:, start + 1]  # (parts, times, 3)
        speed = np.linalg.norm(np.diff(line, axis=1), axis=-1).max() / PARTS[1]
        assert speed <= ways[number] + 1e-9
        to_link = np.array(axes)[:, body.joint].swapaxes(1, 2)
        for index, obstacle in enumerate(obstacles):
            there = [obstacle_place(obstacle, float(time)) for time in times]
            (of_obstacle,), (of_line,) = bends_beside(
                robot,
                motion,
                Surroundings(obstacles),
                np.array([number * len(obstacles) + index]),
                np.array([BEGIN]),
                np.array([END]),
                np.array([5.0]),
            )
            seen = np.array(
                [[at.actInv(p) for at, p in zip(there, one, strict=True)] for one in line]
            )
            origin = np.array([at.translation for at in there])
            off = np.einsum("tij,ptj->pti", to_link, origin - line)
            for points, bound in ((seen, of_line), (off, of_obstacle)):
                second = np.diff(points, 2, axis=1) / PARTS[1] ** 2
                happens = float(np.linalg.norm(second, axis=-1).max())
                assert happens <= bound + 1e-9
                shares.append(happens / bound)
    assert max(shares) > SHARE / 2


# A chaser of 0.2 m in the first joint, a ball in the elbow, and one of 0.1 m at the tip.
ARM = straight_arm(
    0.0,
    1.0,
    0.6,
    solids=(("chaser", ball(0.2, 0.0)), ("link_1", ball(0.05, 1.0)), ("link_2", ball(0.1, 0.6))),
)
TIP = np.array([2])
WHOLE = np.zeros(1), np.ones(1)
FIRST = np.zeros(1, np.intp)


def steady(first: float, second: float) -> FollowedMotion:
    """Both joints turn at constant rates for one second."""
    rates = np.array([first, second])
    return told([0.0, 1.0], np.array([0.0 * rates, rates]), np.array([rates, rates]))


@pytest.mark.parametrize(("first", "second"), [(0.3, 0.0), (0.0, -0.4), (0.3, 0.4), (-0.3, -0.4)])
def test_the_bend_of_a_stretched_arm_is_its_centripetal_acceleration(
    first: float, second: float
) -> None:
    """From the chaser the tip's far side, from the tip the chaser's."""
    of_tip, of_chaser = pair_bends(ARM, steady(first, second), FIRST, *WHOLE)[:, 0]
    both = first + second
    assert of_tip == pytest.approx(1.0 * first**2 + 0.7 * both**2, rel=1e-12)
    assert of_chaser == pytest.approx(0.2 * both**2 + 1.0 * second**2, rel=1e-12)
    half = pair_bends(ARM, steady(first, second), FIRST, WHOLE[0], WHOLE[1] / 2)[:, 0]
    assert half == pytest.approx(np.array([of_tip, of_chaser]) / 4, rel=1e-12)


def test_a_joint_that_gains_speed_bends_the_tip_by_its_acceleration() -> None:
    """From rest to rest it accelerates by 6 and brakes by 6."""
    ends = np.array([[0.0, 0.0], [0.0, 1e-6]])
    (of_tip,), (of_chaser,) = pair_bends(ARM, told([0.0, 1.0], ends, 0 * ends), FIRST, *WHOLE)
    assert of_tip == pytest.approx(6e-6 * 0.7, rel=1e-4)
    assert of_chaser == pytest.approx(6e-6 * 1.2, rel=1e-4)


def test_what_obstacles_do_adds_to_what_the_arm_does() -> None:
    """A sphere of 0.1 m that flies by at 2 m/s, 0.5 m from the tip's near side."""
    rock = Obstacle.sphere("rock", [5.0, 0.0, 0.0], 0.1, [0.0, 2.0, 0.0])
    motion, apart = steady(0.3, 0.0), np.array([0.5])
    of_rock, of_tip = bends_beside(ARM, motion, Surroundings((rock,)), TIP, *WHOLE, apart)[:, 0]
    assert of_tip == pytest.approx(1.7 * 0.3**2, rel=1e-12)
    assert of_rock == pytest.approx((1.7 + 0.6) * 0.3**2 + 2 * 0.3 * 2.0, rel=1e-12)
    # One that turns at 0.2 rad/s shows the tip's far side a place 0.4 + 0.5 + 0.2 m away, at most.
    solid = Solid("capsule", np.array([0.1, 0.6]))
    rod = Obstacle("rod", solid, RigidMotion([5.0, 0.0, 0.0], angular_velocity=[0.0, 0.0, 0.2]))
    of_rod, of_tip = bends_beside(ARM, motion, Surroundings((rod,)), TIP, *WHOLE, apart)[:, 0]
    swung = 2 * 0.2**2 * 0.4
    seen = 2 * 0.2**2 * 1.1 + 2 * 0.2 * (0.08 + 1.7 * 0.3) + 1.7 * 0.3**2 + swung
    assert of_tip == pytest.approx(seen, rel=1e-12)
    moved = (1.7 + 0.5 + 0.8) * 0.3**2 + 2 * 0.3 * 0.08 + swung
    assert of_rod == pytest.approx(moved, rel=1e-12)


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
