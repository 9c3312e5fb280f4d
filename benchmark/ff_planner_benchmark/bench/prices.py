"""What shapes cost: planning time with them beside that with lines, and among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import Experiment, Row, timed_plans
from ff_planner_benchmark.bench.times import APART, CUBE, flown, repeated, shipped
from ff_planner_benchmark.problems.classes import BODIES
from ff_planner_benchmark.problems.placing import gap_of, random_turn
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    RigidMotion,
    attached,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.problems.bodies import Swept, sphere_gap
from ff_planner_ros.problems.drawn import first_sound
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.configuration import eigen_quaternion

# A cube of a sphere's volume has this edge, in radii. A hull of so many corners is nearly a box: of
# points whose coordinates' powers sum to one. A target has so many parts.
_EDGE = (4 * np.pi / 3) ** (1 / 3)
_CORNERS, _NEARLY_A_BOX, _PARTS = 200, 8, 20


def _beside(
    of: Sequence[PlanningProblem], beside: Sequence[PlanningProblem], settings: PlannerSettings
) -> Row:
    """Return median times and rollouts of problems beside those of others; the first warm up."""
    row: Row = {}
    for name, problems in (("", of), ("_beside", beside)):
        plans, row[f"seconds{name}"] = timed_plans(problems, settings, warm_up=1)
        # Runs of one problem are all alike
        alike = plans[:1] if problems[-1] is problems[0] else plans[1:]
        row[f"rollouts{name}"] = sum(one.solver.rollouts for one in alike)
    return row | {"ratio": row["seconds"] / row["seconds_beside"]}


def crowds(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Compare times with shapes and with lines, among few and many spheres."""
    drawn = BODIES.draw(1).problem
    problems = {name: shipped(name) for name in ("lemur_capture_bodies", "canadarm2_capture")}
    problems["arm6"] = replace(drawn, obstacles=drawn.obstacles[:3])
    for name, problem in problems.items():
        q, _ = flown(problem, settings)
        sizes = (3, 30) if count == 1 else (3, 200)
        spheres = _more_spheres(problem, Swept(problem.robot, q), max(sizes))
        for size in sizes:
            of_shapes = replace(problem, obstacles=spheres[:size])
            lines = replace(problem.robot, geometry=Geometry.LINES, bodies=(), pairs=())
            of_lines = replace(of_shapes, robot=lines)
            both = repeated(of_shapes, count), repeated(of_lines, count)
            yield {"problem": name, "spheres": size} | _beside(*both, settings)


def _more_spheres(problem: PlanningProblem, way: Swept, count: int) -> tuple[Obstacle, ...]:
    """Return a problem's spheres and others around the robot, clear of its bodies on the way."""
    rng, spheres = np.random.default_rng(0), list(problem.obstacles)
    middle, reach = way.centers.mean(axis=(0, 1)), np.ptp(way.centers, axis=(0, 1)).max()

    def draw() -> Obstacle | None:
        center = middle + rng.uniform(-1.5 * reach, 1.5 * reach, 3)
        sphere = Obstacle.sphere(f"far{len(spheres)}", center, reach * rng.uniform(0.02, 0.08))
        return sphere if sphere_gap(way, sphere, APART) > APART else None

    while len(spheres) < count:
        spheres.append(first_sound("sphere", problem.robot.model.name, draw))
    return tuple(spheres)


CROWDS = Experiment(
    "crowds",
    "Processor time with lines and with shapes, min(L)",
    crowds,
    {"problem": "problem", "spheres": "spheres"},
    {
        "lines [s]": columns.value("seconds_beside"),
        "shapes [s]": columns.value("seconds"),
        "shapes / lines": columns.value("ratio", form=".2f"),
        "lines: rollouts": columns.value("rollouts_beside", max, "d"),
        "shapes: rollouts": columns.value("rollouts", max, "d"),
    },
    most=5,
)


def prices(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Compare times among boxes with those among spheres, and among hulls with boxes."""
    few, many = (3, 30) if count == 1 else (3, 300)

    def price(
        capture: str, of: str, beside: str, asked: PlanningProblem, other: PlanningProblem
    ) -> Row:
        both = repeated(asked, count), repeated(other, count)
        return {"capture": capture, "of": of, "beside": beside} | _beside(*both, settings)

    for name in ("lemur_capture", "lemur_capture_bodies"):
        spheres = shipped(name)
        boxes = replace(spheres, obstacles=tuple(map(_box, spheres.obstacles)))
        hulls = replace(spheres, obstacles=tuple(map(_hull, boxes.obstacles)))
        fewer, more = (
            replace(boxes, obstacles=_scattered(boxes, settings, size)) for size in (few, many)
        )
        yield price(name, "3 boxes", "3 spheres", boxes, spheres)
        yield price(name, "3 hulls of 200 corners", "3 boxes", hulls, boxes)
        yield price(name, f"{many} boxes", f"{few} boxes", more, fewer)
    name = "lemur_tumbling"
    for geometry in (Geometry.LINES, Geometry.SHAPES):
        given = replace(shipped(name), robot=bench_robot("lemur", geometry))
        of_spheres, of_bodies = _targets(given, settings)
        where = f"{name}, {geometry.value}"
        yield price(where, "target of 20 bodies", "of 20 spheres", of_bodies, of_spheres)
    # A single problem's ratio is chance: another path is another search. The boxes are inside the
    # spheres, so that each problem has a plan.
    for geometry in Geometry:
        among_spheres = [
            replace(BODIES.draw(n).problem, robot=bench_robot(BODIES.robot(n), geometry))
            for n in range(count * len(BODIES.robots))
        ]
        among_boxes = [
            replace(one, obstacles=tuple(map(_box_inside, one.obstacles))) for one in among_spheres
        ]
        where = f"{len(among_spheres)} problems, {geometry.value}"
        row = {"capture": where, "of": "boxes", "beside": "spheres"}
        both = [among_boxes[0], *among_boxes], [among_spheres[0], *among_spheres]
        yield row | _beside(*both, settings)


PRICES = Experiment(
    "prices",
    "What shapes cost, processor time",
    prices,
    {"capture": "capture", "among": "of", "beside": "beside"},
    {
        "time / time": columns.value("ratio", form=".2f"),
        "time [s]": columns.value("seconds"),
        "beside [s]": columns.value("seconds_beside"),
        "rollouts": columns.value("rollouts", max, "d"),
        "rollouts beside": columns.value("rollouts_beside", max, "d"),
    },
    most=20,
)


def _box_inside(sphere: Obstacle) -> Obstacle:
    """Return the cube inscribed in a sphere, with an orientation seeded by the sphere's id."""
    turn = eigen_quaternion(random_turn(np.random.default_rng([*sphere.id.encode()])))
    solid = Solid("box", np.full(3, 2.0 * sphere.radius / np.sqrt(3.0)))
    return Obstacle(sphere.id, solid, RigidMotion(sphere.center, turn, sphere.motion.velocity))


def _box(sphere: Obstacle) -> Obstacle:
    """Return a cube of a sphere's volume in its place."""
    edge = _EDGE * sphere.radius
    return Obstacle(sphere.id, Solid("box", np.full(3, edge)), RigidMotion(sphere.center))


def _hull(box: Obstacle) -> Obstacle:
    """Return a convex hull of 200 corners that nearly is a box: its faces are slightly curved."""
    ways = np.random.default_rng(0).normal(size=(_CORNERS, 3))
    ways /= (np.abs(ways) ** _NEARLY_A_BOX).sum(axis=1, keepdims=True) ** (1 / _NEARLY_A_BOX)
    return replace(box, shape=hull_of_vertices("mesh", ways * box.solid.sizes / 2))


def _scattered(
    problem: PlanningProblem, settings: PlannerSettings, count: int
) -> tuple[Obstacle, ...]:
    """Return a problem's obstacle bodies, and random boxes clear of its plan, `count` in all."""
    q, times = flown(problem, settings)
    way, rng = Swept(with_bodies(problem.robot), q), np.random.default_rng(0)
    found = list[Obstacle]()

    def draw() -> Obstacle | None:
        turn = eigen_quaternion(random_turn(rng))
        solid = Solid("box", rng.uniform(0.1, 0.4, 3))
        center = rng.uniform(-CUBE / 2, CUBE / 2, 3)
        box = Obstacle(f"box{len(found)}", solid, RigidMotion(center, turn))
        return box if gap_of(way, times, box) > APART else None

    while len(found) < count - len(problem.obstacles):
        found.append(first_sound("box", problem.robot.model.name, draw))
    return (*problem.obstacles, *found)


def _targets(
    problem: PlanningProblem, settings: PlannerSettings
) -> tuple[PlanningProblem, PlanningProblem]:
    """Return a capture of a target of 20 spheres, and one with boxes of equal volume instead."""
    body, rng = problem.target_body, np.random.default_rng(0)
    if body is None:
        raise ValueError("there is no target body")
    q, times = flown(problem, settings)
    way, spheres = Swept(with_bodies(problem.robot), q), list[AttachedObstacle]()

    def draw() -> tuple[AttachedObstacle, AttachedObstacle] | None:
        name, center, radius = f"p{len(spheres)}", rng.normal(0.0, 0.5, 3), rng.uniform(0.05, 0.15)
        box = AttachedObstacle(name, Solid("box", np.full(3, _EDGE * radius)), center)
        ball = replace(box, id="b", shape=Solid("capsule", np.array([radius, 1e-3])))
        both = attached(replace(body, obstacles=(ball, box)))
        if min(gap_of(way, times, one) for one in both) <= APART:
            return None
        return AttachedObstacle.sphere(name, center, radius), box

    boxes = list[AttachedObstacle]()
    while len(spheres) < _PARTS:
        sphere, box = first_sound("part of a target", problem.robot.model.name, draw)
        spheres.append(sphere)
        boxes.append(box)
    return (
        with_capture_target(replace(body, obstacles=tuple(spheres)), problem),
        with_capture_target(replace(body, obstacles=tuple(boxes)), problem),
    )
