"""Robots with solids of every kind, and their distances as Coal and Pinocchio have them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin
from robots import LEMUR_URDF, coupled_urdf, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion, attached
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text


def collision(kind: str, sizes: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """Write a `<collision>` element."""
    geometry = f"<geometry><{kind} {sizes}/></geometry>"
    return f'<collision><origin xyz="{xyz}" rpy="{rpy}"/>{geometry}</collision>'


def with_solids(urdf: str, solids: dict[str, str]) -> str:
    """Return a URDF whose links have solids."""
    for link, elements in solids.items():
        if f'<link name="{link}"/>' in urdf:
            urdf = urdf.replace(f'<link name="{link}"/>', f'<link name="{link}">{elements}</link>')
            continue
        urdf = re.sub(
            rf'(<link name="{link}">.*?)(</link>)',
            rf"\g<1>{elements}\g<2>",
            urdf,
            count=1,
            flags=re.DOTALL,
        )
    return urdf


def pinocchio_geometry(robot: Robot, spheres: Sequence[Obstacle]) -> pin.GeometryModel:
    """Return bodies, then spheres, and all pairs that must not touch: bodies', then spheres'."""
    model = pin.GeometryModel()
    for k, body in enumerate(robot.bodies):
        model.addGeometryObject(
            pin.GeometryObject(f"b{k}", body.joint, body.placement_in_joint, body.solid)
        )
    for k, sphere in enumerate(spheres):
        ball, place = coal.Sphere(sphere.radius), pin.SE3(np.eye(3), sphere.center)
        model.addGeometryObject(pin.GeometryObject(f"s{k}", 0, place, ball))
    count = len(robot.bodies)
    with_spheres = [(a, count + b) for a in range(count) for b in range(len(spheres))]
    for pair in (*robot.pairs, *with_spheres):
        model.addCollisionPair(pin.CollisionPair(*pair))
    return model


@cache
def lemur_with_bodies() -> Robot:
    """Return the Lemur as its URDF's solids have it."""
    return load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.SHAPES)


@cache
def random_robot(seed: int, joints: int = 6) -> Robot:
    """Return an arm with one or two solids on every link, hulls among them.

    From seed 20 on, its joints 2 and 5 slide; from 40 on, it is a `coupled_urdf`.
    """
    rng = np.random.default_rng(seed)
    links = ["bus", "antenna", "tool", *(f"link_{number + 1}" for number in range(joints))]
    links += ["of_rod", "of_far_rod", "of_a_panel", "of_finger"] * (seed >= 40)
    solids = {
        link: "".join(_random_solid(rng) for _ in range(rng.integers(1, 3))) for link in links
    }
    urdf = random_urdf(joints, seed, (2, 5) if seed >= 20 else ())
    urdf = coupled_urdf(joints, seed) if seed >= 40 else urdf
    robot = robot_from_urdf_text(with_solids(urdf, solids), "bus", "tool")
    return replace(robot, bodies=tuple(_some_as_hulls(robot.bodies, rng)))


def _random_solid(rng: np.random.Generator) -> str:
    kind = str(rng.choice(["box", "capsule", "cylinder", "sphere"]))
    sizes = {
        "box": f'size="{_words(rng.uniform(0.05, 0.4, 3))}"',
        "sphere": f'radius="{rng.uniform(0.03, 0.2)}"',
    }
    round_ = f'radius="{rng.uniform(0.03, 0.1)}" length="{rng.uniform(0.05, 0.5)}"'
    place, turn = rng.uniform(-0.2, 0.2, 3), rng.uniform(-1.5, 1.5, 3)
    return collision(kind, sizes.get(kind, round_), _words(place), _words(turn))


def _some_as_hulls(bodies: tuple[Body, ...], rng: np.random.Generator) -> list[Body]:
    """Return bodies of which every third is a hull of random points in the sphere around it."""
    found = []
    for number, body in enumerate(bodies):
        if number % 3 == 2:
            points = coal.StdVec_Vec3s()
            directions = rng.normal(size=(20, 3))
            directions /= np.linalg.norm(directions, axis=1)[:, None]
            center = body.placement_in_joint.actInv(body.center_in_joint)
            for direction in directions:
                points.append(center + body.radius * direction)
            hull = coal.Convex.convexHull(points, True, "Qt")
            body = replace(body, solid=hull)
        found.append(body)
    return found


def body_placements(robot: Robot, q: Array) -> list[pin.SE3]:
    """Return where Pinocchio's own kinematics puts each solid, in the inertial frame."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return [data.oMi[body.joint] * body.placement_in_joint for body in robot.bodies]


def coal_distance(
    first: coal.CollisionGeometry, at: pin.SE3, second: coal.CollisionGeometry, there: pin.SE3
) -> float:
    """Return the signed distance of two solids."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance = 1e-8  # its own, 1e-6, is 2 micrometres off at 1.5 m
    places = [coal.Transform3s(place.rotation, place.translation) for place in (at, there)]
    return float(coal.distance(first, places[0], second, places[1], request, result))


def moving_pairs(robot: Robot) -> list[tuple[int, int]]:
    """Return all pairs of bodies that move against each other."""
    bodies = range(len(robot.bodies))
    joint = [body.joint for body in robot.bodies]
    return [(a, b) for a, b in itertools.combinations(bodies, 2) if joint[a] != joint[b]]


def _words(vector: Array) -> str:
    return " ".join(str(float(number)) for number in vector)


def tumbling_spheres(rng: np.random.Generator, around: Array, count: int) -> tuple[Obstacle, ...]:
    """Spheres that are fixed to a body which drifts and tumbles, about a metre from a place."""
    moments = rng.uniform(1.0, 2.0, 3)
    body = TargetBody(
        position=around + 0.3 * rng.normal(size=3),
        quaternion_xyzw=Rotation.random(random_state=rng).as_quat(),
        inertia=np.diag(np.clip(moments, None, 0.9 * (moments.sum() - moments))),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        linear_velocity=0.05 * rng.normal(size=3),
        angular_velocity=0.3 * rng.normal(size=3),
        obstacles=tuple(
            AttachedObstacle.sphere(f"part_{number}", rng.normal(size=3), rng.uniform(0.05, 0.15))
            for number in range(count)
        ),
    )
    return tuple(attached(body))


def random_solid(rng: np.random.Generator, kind: str) -> Solid:
    """Return a solid of a kind, some of them thin, some long."""
    if kind == "mesh":
        points = rng.normal(size=(int(rng.integers(5, 60)), 3)) * rng.uniform(0.05, 0.4, 3)
        return hull_of_vertices("vertices", points + rng.normal(0.0, 0.1, 3))
    sizes = {"box": 3, "sphere": 1}.get(kind, 2)
    return Solid(kind, np.exp(rng.uniform(np.log(0.01), np.log(1.0), sizes)))


def random_obstacles(rng: np.random.Generator, around: Array, count: int) -> tuple[Obstacle, ...]:
    """Obstacles of all kinds near a place, which rest, move, turn, or tumble with a body."""
    kinds = ("box", "cylinder", "capsule", "cone", "mesh")
    found: list[Obstacle] = []
    (fixed,) = {one.body for one in tumbling_spheres(rng, around, 1)}
    assert fixed is not None
    held = []
    for number in range(count):
        solid = random_solid(rng, kinds[number % 5])
        place = np.asarray(around + rng.normal(scale=0.7, size=3))
        turn = Rotation.random(random_state=rng).as_quat()
        velocity = rng.normal(0.0, 0.05, 3) * (number % 3 > 0)
        rate = rng.normal(0.0, 0.2, 3) * (number % 3 > 1)
        if number % 4 == 3:
            held.append(AttachedObstacle(str(number), solid, place - fixed.position, turn))
        else:
            found.append(Obstacle(str(number), solid, RigidMotion(place, turn, velocity, rate)))
    return (*found, *attached(replace(fixed, obstacles=tuple(held))))
