"""How near a robot's parts are to obstacles where its base is elsewhere: each part measured.

Distances of lines by geometry, of bodies by Coal, all of them at all times; nothing is left out.
"""

from __future__ import annotations

import itertools

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance
from scipy.spatial.transform import Rotation
from straight_arms import ball, straight_arm

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion, Target
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.robust.nearness import Nearness, nearness
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.model import Robot

LINES = straight_arm(0.4, 1.0, 0.6)
BODIES = straight_arm(
    0.4,
    1.0,
    0.6,
    solids=(("chaser", ball(0.2, 0.0)), ("link_1", ball(0.05, 1.0)), ("link_2", ball(0.1, 0.6))),
)
CASES = pytest.mark.parametrize("robot", [LINES, BODIES], ids=["lines", "bodies"])
TIMES = np.linspace(0.0, 5.0, 6)
SPHERES = (
    Obstacle.sphere("rock", [1.5, 1.0, 0.2], 0.3),
    Obstacle.sphere("debris", [-2.0, 1.0, 0.5], 0.2, [0.8, 0.1, 0.0]),
    Obstacle.sphere("mast", [0.3, -1.5, -0.6], 0.1, [0.0, 0.2, 0.0]),
)


# A plate that moves, a cone that turns, a hull that does both, and what is nobody's nearest.
PLATE = Obstacle(
    "plate",
    Solid("box", np.array([1.5, 2.0, 0.01])),
    RigidMotion([0.5, 1.2, 0.9], [0.5, 0.5, -0.5, 0.5], [0.1, -0.1, 0.0]),
)
OTHERS = (
    PLATE,
    Obstacle(
        "cone",
        Solid("cone", np.array([0.3, 0.8])),
        RigidMotion([-1.2, -0.9, 0.2], [0.0, 0.6, 0.0, 0.8], angular_velocity=[0.3, 0.1, -0.5]),
    ),
    Obstacle(
        "wedge",
        hull_of_vertices(
            "wedge", np.array([[0.9, 0, 0], [1.7, 0, 0], [0.9, 0.7, 0], [1.0, 0.1, 0.6]], float)
        ),
        RigidMotion([0.4, -1.9, -0.5], velocity=[0.0, 0.05, 0.1], angular_velocity=[0.0, 0.0, 0.2]),
    ),
    Obstacle("moon", Solid("cylinder", np.array([2.0, 3.0])), RigidMotion([40.0, 0.0, 0.0])),
)
OBSTACLES = (*SPHERES, *OTHERS)
BOX = Solid("box", np.array([0.5, 0.5, 0.5]))


def drawn(seed: int) -> Array:
    """Configurations far from the origin of angles and turns. Shape (times, 7 + joints)."""
    rng = np.random.default_rng(seed)
    q = np.hstack([0.3 * rng.normal(size=(6, 3)), rng.normal(size=(6, 4)), rng.normal(size=(6, 2))])
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    return q


def elsewhere(q: Array, turn: Array, way: Array) -> Array:
    """A configuration whose base is turned about the inertial origin, and then moved."""
    placed = pin.SE3(pin.exp3(turn), way) * pin.XYZQUATToSE3(q[:7])
    return np.concatenate([pin.SE3ToXYZQUAT(placed), q[7:]])


def distances(robot: Robot, q: Array, time: float) -> Array:
    """Of every part from every obstacle. Shape (parts, obstacles)."""
    return np.hstack([from_spheres(robot, q, time), from_others(robot, q, time)])


def from_others(robot: Robot, q: Array, time: float) -> Array:
    """A line is a capsule without thickness to Coal."""
    if robot.bodies:
        parts = zip([body.solid for body in robot.bodies], body_placements(robot, q), strict=True)
    else:
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        ends = [data.oMi[2].translation, data.oMi[3].translation, tip.translation]
        capsules, places = [], []
        for start, end in itertools.pairwise(ends):
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start)
            capsules.append(coal.Capsule(0.0, float(np.linalg.norm(end - start))))
            places.append(pin.SE3(turn.toRotationMatrix(), (start + end) / 2))
        parts = zip(capsules, places, strict=True)
    found = list[list[float]]()
    for solid, at in parts:
        found.append([])
        for one in OTHERS:
            start = Rotation.from_quat(one.motion.quaternion_xyzw)
            turned = Rotation.from_rotvec(time * one.motion.angular_velocity) * start
            place = pin.SE3(turned.as_matrix(), one.motion.position + time * one.motion.velocity)
            found[-1].append(coal_distance(solid, at, one.solid.geometry, place))
    return np.array(found)


def from_spheres(robot: Robot, q: Array, time: float) -> Array:
    """Of every part from every sphere. Shape (parts, spheres)."""
    centers = [sphere.center + time * sphere.motion.velocity for sphere in SPHERES]
    if robot.bodies:
        return np.array(
            [
                [
                    coal_distance(
                        body.solid, at, coal.Sphere(ball.radius), pin.SE3(np.eye(3), center)
                    )
                    for ball, center in zip(SPHERES, centers, strict=True)
                ]
                for body, at in zip(robot.bodies, body_placements(robot, q), strict=True)
            ]
        )
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    ends = [data.oMi[2].translation, data.oMi[3].translation, tip.translation]
    found = np.empty((2, len(SPHERES)))
    for part, sphere in np.ndindex(found.shape):
        along, way = ends[part + 1] - ends[part], centers[sphere] - ends[part]
        foot = min(max(float(way @ along / (along @ along)), 0.0), 1.0) * along
        found[part, sphere] = np.linalg.norm(way - foot) - SPHERES[sphere].radius
    return found


def near(robot: Robot, q: Array) -> Nearness:
    return nearness(robot, q, TIMES, Scene(OBSTACLES))


@CASES
def test_every_part_is_as_far_from_every_obstacle_as_geometry_says(robot: Robot) -> None:
    """What is far from an obstacle that is no sphere is known to be far."""
    q = drawn(1)
    found = near(robot, q)
    expected = np.array([distances(robot, *at) for at in zip(q, TIMES, strict=True)])
    others = (slice(None), slice(None), slice(len(SPHERES), None))
    assert found.distance[:, :, : len(SPHERES)] == pytest.approx(
        expected[:, :, : len(SPHERES)], abs=1e-6
    )
    told, true = found.distance[others], expected[others]
    close = true <= true.min() + 0.5
    assert close.sum() > 3
    assert told[close] == pytest.approx(true[close], abs=1e-6)
    assert (told <= true + 1e-6).all()
    assert (told[~close] > true.min()).all()
    assert not close[:, :, -1].any()
    assert not found.is_empty
    assert nearness(robot, q, TIMES, Scene()).is_empty


@CASES
@pytest.mark.parametrize("size", [0.01, 0.4])
@pytest.mark.parametrize("seed", range(4))
def test_the_least_of_each_run_is_that_of_all_parts_at_all_times(
    robot: Robot, seed: int, size: float
) -> None:
    """Runs that go astray by centimetres and by more than a metre, now and then by much less."""
    rng, q, runs = np.random.default_rng(seed), drawn(seed), 5
    rotations, positions = np.empty((6, runs, 3, 3)), np.empty((6, runs, 3))
    expected = np.full(runs, np.inf)
    for time, run in np.ndindex(6, runs):
        astray = size * rng.choice([0.1, 3.0]) * rng.normal(size=(2, 3))
        moved = elsewhere(q[time], *astray)
        placed = pin.XYZQUATToSE3(moved[:7])
        rotations[time, run], positions[time, run] = placed.rotation, placed.translation
        least = distances(robot, moved, float(TIMES[time])).min()
        expected[run] = min(expected[run], float(least))
    found = near(robot, q).least(rotations, positions)
    assert found == pytest.approx(expected, abs=1e-6)


def test_a_turn_about_the_middle_of_a_long_body_brings_its_end_near() -> None:
    """Its middle stays where it is seen, and so does the ball that was nearest before."""
    middle = np.array([1.0, 2.2, 0.0])
    rod = Obstacle("rod", Solid("box", np.array([4.0, 0.02, 0.02])), RigidMotion(middle))
    scene = Scene((Obstacle.sphere("ball", middle, 0.95), rod))
    q = np.zeros((6, 9))
    q[:, 6] = 1.0
    about = pin.SE3(np.eye(3), middle)
    turned = about * pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.8])), np.zeros(3)) * about.inverse()
    there = q.copy()
    there[:, :7] = pin.SE3ToXYZQUAT(turned)
    (expected,) = {float(nearness(LINES, there, TIMES, scene).distance.min())}
    before = nearness(LINES, q, TIMES, scene)
    assert expected < before.distance.min() - 0.1
    found = before.least(
        np.broadcast_to(turned.rotation, (6, 1, 3, 3)),
        np.broadcast_to(turned.translation, (6, 1, 3)),
    )
    assert found == pytest.approx(expected, abs=1e-6)


def test_far_from_nothing_every_run_is_infinitely_far() -> None:
    q = drawn(1)
    empty = nearness(LINES, q, TIMES, Scene())
    found = empty.least(np.broadcast_to(np.eye(3), (6, 2, 3, 3)), np.zeros((6, 2, 3)))
    assert (found == np.inf).all()


@CASES
def test_distances_change_with_the_base_as_their_differences(robot: Robot) -> None:
    """Each error moves the base by zeta_v + zeta_w x p, to either side."""
    q, rng, step = drawn(2), np.random.default_rng(2), 1e-5
    spread, found = rng.normal(size=(6, 6, 4)), near(robot, q)
    least = found.distance[:, :, len(SPHERES) :].min()
    rows = np.nonzero(np.ones_like(found.distance, bool))
    by_errors = found.by_errors(spread, rows).reshape(*found.distance.shape, 4)
    for time, error in np.ndindex(6, 4):
        way, turn = np.split(spread[time, :, error], 2)
        sides = [
            distances(robot, elsewhere(q[time], sign * turn, sign * way), float(TIMES[time]))
            for sign in (step, -step)
        ]
        expected = (sides[0] - sides[1]) / (2 * step)
        exact = np.ones(expected.shape, bool)
        exact[:, len(SPHERES) :] = found.distance[time, :, len(SPHERES) :] < least + 0.45
        assert by_errors[time, :, :, error][exact] == pytest.approx(expected[exact], abs=2e-3)
    sigmas = np.linalg.norm(by_errors, axis=-1)
    assert found.sigmas(spread) == pytest.approx(sigmas, rel=1e-12)


@CASES
def test_whatever_errors_within_ten_deviations_make_the_nearest_is_among_the_near(
    robot: Robot,
) -> None:
    """And some never can be: those are left out."""
    rng, found = np.random.default_rng(3), near(robot, drawn(3))
    spread = 0.02 * rng.normal(size=(6, 6, 3))
    everything = np.nonzero(np.ones_like(found.distance, bool))
    by_errors = found.by_errors(spread, everything)
    rows = set(zip(*found.rows_near(spread), strict=True))
    errors = rng.normal(size=(3000, 3))
    errors *= 9.9 / np.linalg.norm(errors, axis=1)[:, None]
    least = (found.distance[everything] + errors @ by_errors.T).argmin(axis=1)
    ever = {tuple(int(of[k]) for of in everything) for k in np.unique(least)}
    assert len(ever) > 1
    assert ever <= {tuple(int(number) for number in row) for row in rows}
    assert len(rows) < found.distance.size


def test_a_part_may_touch_a_body_at_the_goal_as_a_sphere() -> None:
    """From the second time on the tip is at a goal that rests."""
    goal = Target(position=[2.0, 0.0, 0.0], quaternion_xyzw=[0.0, 0.0, 0.0, 1.0])
    scene = Scene(OBSTACLES, ("link_2/plate",), 0.25, goal, capture_time=5.0)
    q = np.zeros((6, 9))
    q[:, 6] = 1.0
    q[0, 0] = 1.0
    found = nearness(BODIES, q, TIMES, scene).distance
    touching = np.zeros(found.shape, bool)
    touching[1:, 2, len(SPHERES)] = True
    assert (np.isinf(found) == touching).all()


def test_an_allowed_contact_counts_until_the_tool_stays_at_the_goal() -> None:
    """It is near at the second time, away at the third, and there from the fourth on.

    The target drifts along x, and at the capture, at 5 s, it is at 5 m.
    """
    goal = Target(
        position=[5.0, 0.0, 0.0],
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        linear_velocity=[0.5, 0.0, 0.0],
    )
    scene = Scene(SPHERES, ("link_2/rock",), 0.25, goal, capture_time=5.0)
    q = np.zeros((6, 9))
    q[:, 6] = 1.0
    away = np.array([1.0, 0.2, 0.3, 0.2, -0.2, 0.0])
    q[:, 0] = 2.5 + 0.5 * TIMES - 2.0 + away  # the stretched arm's tip is 2 m before the base
    found = nearness(BODIES, q, TIMES, scene).distance
    plain = nearness(BODIES, q, TIMES, Scene(SPHERES)).distance
    touching = np.zeros(found.shape, bool)
    touching[3:, 2, 0] = True
    assert (np.isinf(found) == touching).all()
    assert found[~touching] == pytest.approx(plain[~touching], abs=1e-12)
    for unknown in (
        Scene(SPHERES, ("link_2/rock",), 0.25),
        Scene(SPHERES, ("link_2/moon",), 0.25, goal, capture_time=5.0),
    ):
        assert np.isfinite(nearness(BODIES, q, TIMES, unknown).distance).all()


@pytest.mark.parametrize(
    "held",
    [
        Obstacle.sphere("rock", [2.3, 0.0, 0.0], 0.25, [0.1, 0.0, 0.0]),
        Obstacle("rock", BOX, RigidMotion([2.3, 0.0, 0.0], velocity=[0.1, 0.0, 0.0])),
    ],
)
def test_an_allowed_contact_of_the_start_counts_once_the_tool_was_away(
    held: Obstacle | Obstacle,
) -> None:
    """The tip touches what drifts along x, is 0.3 m back at the fourth time, and comes again."""
    q = np.zeros((6, 9))
    q[:, 6] = 1.0
    q[:, 0] = 0.1 * TIMES - np.array([0.0, 0.1, 0.2, 0.3, 0.1, 0.0])
    scene = Scene((held, SPHERES[1]), ("link_2/rock", "link_1/rock"), 0.25)
    found = nearness(BODIES, q, TIMES, scene).distance
    touching = np.zeros(found.shape, bool)
    touching[:3, 2, [one.id == "rock" for one in scene.obstacles]] = True
    assert (np.isinf(found) == touching).all()
    assert found.min() == pytest.approx(-0.05, abs=1e-6)
