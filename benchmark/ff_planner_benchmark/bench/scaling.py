"""Growth of planning time with spheres, points and joints, and its ratio of shapes to spheres."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_benchmark.bench.measurement import Measurement, timed_plans
from ff_planner_benchmark.problems.placing import gap_of, random_turn
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.obstacles import bodies_in
from ff_planner_ros.planning.problem.problem import (
    ObstacleBody,
    PlanningProblem,
    Sphere,
    attached,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.target_body import AttachedBody, AttachedSphere
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.bodies import ROBOTS as ARMS
from ff_planner_ros.problems.bodies import Swept
from ff_planner_ros.problems.bodies import problem as among_spheres
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.configuration import eigen_quaternion

# Added spheres fill a cube of this size around the chaser [m], this far from the arm on its way.
_CUBE, _APART = 8.0, 0.05
# A cube of a sphere's volume has this edge, in radii. A hull of so many corners is nearly a box: of
# points whose coordinates' powers sum to one. A target has so many parts.
_EDGE = (4 * np.pi / 3) ** (1 / 3)
_CORNERS, _NEARLY_A_BOX, _PARTS = 200, 8, 20
_PRICE_HEADER = (
    *("capture", "among", "beside", "time / time", "time [s]", "beside [s]"),
    *("rollouts", "beside"),
)


@dataclass(frozen=True)
class Growth:
    """Planning time at one problem size."""

    of: str  # quantity that grows: spheres, points or joints
    size: int
    seconds: float | None  # median time of a plan; None: no problem has one
    rollouts: float | None  # median


@dataclass(frozen=True)
class Price:
    """Planning time among one kind of obstacles, beside that among another kind."""

    capture: str  # name of the problem
    of: str  # kind of obstacles
    beside: str  # kind of obstacles to compare with
    seconds: float  # median processor time
    seconds_beside: float  # median processor time among the other kind
    rollouts: int  # of the search
    rollouts_beside: int  # of the search among the other kind, which is another task


def measurement(problem: PlanningProblem, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Measure planning times over numbers of spheres, points and joints; if quick, small ones."""
    runs, count = (1, 1) if quick else (5, 20)
    spheres, points = ((3, 30), (50, 100)) if quick else ((3, 30, 100, 1000), (50, 100, 200, 500))
    joints = (7, 6) if quick else (7, 6, 9)
    growths = {
        "spheres: the paper's capture, more that leave the plan as it is": [
            *with_spheres(problem, settings, spheres, runs)
        ],
        "points: the paper's capture": [*with_points(problem, settings, points, runs)],
        f"joints: arms on {count} ordinary scenarios, medians": [
            *with_joints(settings, joints, count)
        ],
    }
    tables = [
        Table(
            f"Time grows with {name}",
            (growth[0].of, f"time / {growth[0].size}", "time [s]", "rollouts"),
            [_cells(one, growth[0].seconds) for one in growth],
        )
        for name, growth in growths.items()
    ]
    return Measurement([each for growth in growths.values() for each in growth], tables)


def _cells(growth: Growth, first: float | None) -> tuple[str, ...]:
    if growth.seconds is None:
        return (f"{growth.size}", "-", "-", "-")
    ratio = f"{growth.seconds / first:.2f}" if first else "-"
    return (f"{growth.size}", ratio, f"{growth.seconds:.3f}", f"{growth.rollouts:g}")


def price_measurement(settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Measure planning times among boxes beside spheres, and among hulls beside boxes."""
    runs, sizes, count = (1, (3, 30), 1) if quick else (5, (3, 300), 20)
    found = [*prices(settings, runs, sizes), *prices_of_many(settings, count)]
    rows = [
        (
            *(each.capture, each.of, each.beside, f"{each.seconds / each.seconds_beside:.2f}"),
            *(f"{each.seconds:.3f}", f"{each.seconds_beside:.3f}"),
            *(f"{each.rollouts}", f"{each.rollouts_beside}"),
        )
        for each in found
    ]
    return Measurement(found, [Table("What shapes cost, processor time", _PRICE_HEADER, rows)])


def prices(
    settings: PlannerSettings, runs: int, sizes: tuple[int, int] = (3, 300)
) -> Iterator[Price]:
    """Yield ratios of planning times among shapes, with the arm's lines and with the whole robot.

    Args:
        runs: Number of timed runs, after one to warm up; the median counts.
        sizes: Numbers of boxes, few and many.
    """
    scenarios = share_directory() / "config" / "scenarios"

    def price(name: str, of: str, beside: str, *pair: PlanningProblem) -> Price:
        (plans, seconds), (plans_beside, seconds_beside) = (
            timed_plans([one] * (1 + runs), settings, warm_up=1) for one in pair
        )
        rollouts = plans[0].solver.rollouts, plans_beside[0].solver.rollouts
        return Price(name, of, beside, seconds, seconds_beside, *rollouts)

    for name in ("lemur_capture", "lemur_capture_bodies"):
        spheres = load_scenario(scenarios / f"{name}.yaml")
        boxes = replace(spheres, obstacles=tuple(map(_box, spheres.spheres)))
        hulls = replace(spheres, obstacles=tuple(map(_hull, boxes.obstacle_bodies)))
        few, many = (replace(boxes, obstacles=_scattered(boxes, settings, size)) for size in sizes)
        yield price(name, "3 boxes", "3 spheres", boxes, spheres)
        yield price(name, "3 hulls of 200 corners", "3 boxes", hulls, boxes)
        yield price(name, f"{sizes[1]} boxes", f"{sizes[0]} boxes", many, few)
    for name, geometry in (("lemur_tumbling", Geometry.LINES), ("lemur_tumbling", Geometry.SHAPES)):
        given = replace(
            load_scenario(scenarios / f"{name}.yaml"), robot=bench_robot("lemur", geometry)
        )
        of_spheres, of_bodies = _targets(given, settings)
        where = f"{name}, {geometry.value}"
        yield price(where, "target of 20 bodies", "of 20 spheres", of_bodies, of_spheres)


def prices_of_many(settings: PlannerSettings, count: int) -> Iterator[Price]:
    """Yield ratios of planning times among boxes and spheres, over `count` problems of each arm.

    A single problem's ratio is chance: another path is another search. The boxes are inside the
    spheres, so that each problem has a plan.
    """
    for geometry in Geometry:
        spheres = [
            replace(among_spheres(arm, number).problem, robot=bench_robot(arm, geometry))
            for number in range(count)
            for arm in ARMS
        ]
        boxes = [replace(one, obstacles=tuple(map(_box_inside, one.spheres))) for one in spheres]
        (plans, seconds), (plans_beside, seconds_beside) = (
            timed_plans([ones[0], *ones], settings, warm_up=1) for ones in (boxes, spheres)
        )
        rollouts, beside = (
            sum(plan.solver.rollouts for plan in made[1:]) for made in (plans, plans_beside)
        )
        name = f"{len(spheres)} problems, {geometry.value}"
        yield Price(name, "boxes", "spheres", seconds, seconds_beside, rollouts, beside)


def _box_inside(sphere: Sphere) -> ObstacleBody:
    """Return the cube inscribed in a sphere, with an orientation seeded by the sphere's id."""
    turn = eigen_quaternion(random_turn(np.random.default_rng([*sphere.id.encode()])))
    solid = Solid("box", np.full(3, 2.0 * sphere.radius / np.sqrt(3.0)))
    return ObstacleBody(sphere.id, solid, sphere.center, turn, sphere.velocity)


def _box(sphere: Sphere) -> ObstacleBody:
    """Return a cube of a sphere's volume in its place."""
    edge = _EDGE * sphere.radius
    return ObstacleBody(sphere.id, Solid("box", np.full(3, edge)), sphere.center)


def _hull(box: ObstacleBody) -> ObstacleBody:
    """Return a convex hull of 200 corners that nearly is a box: its faces are slightly curved."""
    ways = np.random.default_rng(0).normal(size=(_CORNERS, 3))
    ways /= (np.abs(ways) ** _NEARLY_A_BOX).sum(axis=1, keepdims=True) ** (1 / _NEARLY_A_BOX)
    return replace(box, shape=hull_of_vertices("mesh", ways * box.solid.sizes / 2))


def _scattered(
    problem: PlanningProblem, settings: PlannerSettings, count: int
) -> tuple[ObstacleBody, ...]:
    """Return a problem's obstacle bodies, and random boxes clear of its plan, `count` in all."""
    plan = perform(PlanningTask(problem, settings))
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    way, rng = Swept(with_bodies(problem.robot), q), np.random.default_rng(0)
    found = list[ObstacleBody]()
    while len(found) < count - len(problem.obstacles):
        turn = eigen_quaternion(random_turn(rng))
        solid = Solid("box", rng.uniform(0.1, 0.4, 3))
        center = rng.uniform(-_CUBE / 2, _CUBE / 2, 3)
        box = ObstacleBody(f"box{len(found)}", solid, center, turn)
        if gap_of(way, plan.trajectory.time, box) > _APART:
            found.append(box)
    return (*problem.obstacle_bodies, *found)


def _targets(
    problem: PlanningProblem, settings: PlannerSettings
) -> tuple[PlanningProblem, PlanningProblem]:
    """Return a capture of a target of 20 spheres, and one with boxes of equal volume instead."""
    body, rng = problem.target_body, np.random.default_rng(0)
    if body is None:
        raise ValueError("there is no target body")
    plan = perform(PlanningTask(problem, settings))
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    way, times = Swept(with_bodies(problem.robot), q), plan.trajectory.time
    spheres, boxes = list[AttachedSphere](), list[AttachedBody]()
    while len(spheres) < _PARTS:
        name, center, radius = f"p{len(spheres)}", rng.normal(0.0, 0.5, 3), rng.uniform(0.05, 0.15)
        sphere = AttachedSphere(name, center, radius)
        box = AttachedBody(name, Solid("box", np.full(3, _EDGE * radius)), center)
        ball = replace(box, shape=Solid("capsule", np.array([radius, 1e-3])))
        bodies = bodies_in(tuple(attached(replace(body, obstacles=(replace(ball, id="b"), box)))))
        if min(gap_of(way, times, one) for one in bodies) > _APART:
            spheres.append(sphere)
            boxes.append(box)
    return (
        with_capture_target(replace(body, obstacles=tuple(spheres)), problem),
        with_capture_target(replace(body, obstacles=tuple(boxes)), problem),
    )


def with_spheres(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield planning times as spheres clear of the plan are added, up to each size."""
    shortest = perform(PlanningTask(problem, settings))
    q, _ = from_trajectory(problem.robot, shortest.trajectory)
    positions = arm_points(problem.robot, q)
    rng = np.random.default_rng(0)
    spheres = list(problem.obstacles)
    for size in sizes:
        while len(spheres) < size:
            center, radius = rng.uniform(-_CUBE / 2, _CUBE / 2, 3), rng.uniform(0.05, 0.2)
            sphere = Sphere(f"s{len(spheres)}", center, radius)
            times = shortest.trajectory.time
            distance = clearances(positions, times, segments(positions), [sphere]).distance
            if distance.min() > _APART:
                spheres.append(sphere)
        crowded = replace(problem, obstacles=tuple(spheres))
        yield _growth("spheres", size, [crowded] * (1 + runs), settings, warm_up=1)


def with_points(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield planning times for numbers of trajectory points."""
    for size in sizes:
        finer = replace(problem, points=size)
        yield _growth("points", size, [finer] * (1 + runs), settings, warm_up=1)


def with_joints(settings: PlannerSettings, sizes: Sequence[int], count: int) -> Iterator[Growth]:
    """Yield planning times for numbers of joints, each on `count` ordinary scenarios."""
    for size in sizes:
        drawn = [scenario("ordinary", f"arm{size}", n, turned=False) for n in range(count)]
        yield _growth("joints", size, [each.problem for each in drawn], settings)


def _growth(
    of: str,
    size: int,
    problems: Iterable[PlanningProblem],
    settings: PlannerSettings,
    warm_up: int = 0,
) -> Growth:
    try:
        plans, seconds = timed_plans(problems, settings, warm_up)
    except NoPlanFound:
        return Growth(of, size, None, None)
    return Growth(of, size, seconds, statistics.median(plan.solver.rollouts for plan in plans))
