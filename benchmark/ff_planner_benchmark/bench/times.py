"""Planning time over numbers of spheres, points, joints and cores, and its price of shapes."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from ff_planner_benchmark.bench.experiment import (
    Experiment,
    Row,
    count,
    quantile_90,
    timed_plans,
    value,
)
from ff_planner_benchmark.bench.least_attitude import BEST_KNOWN, least_attitude
from ff_planner_benchmark.problems.classes import ALL_FEATURES, BODIES
from ff_planner_benchmark.problems.placing import gap_of, random_turn
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.share import share_directory
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
from ff_planner_ros.problems.bodies import Swept, sphere_gap
from ff_planner_ros.problems.drawn import first_sound
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.configuration import eigen_quaternion

_CORES = os.sched_getaffinity(0)  # of the machine: a run is pinned to one of them
# Added spheres fill a cube of this size around the chaser [m], this far from the arm on its way.
_CUBE, _APART = 8.0, 0.05
# A cube of a sphere's volume has this edge, in radii. A hull of so many corners is nearly a box: of
# points whose coordinates' powers sum to one. A target has so many parts.
_EDGE = (4 * np.pi / 3) ** (1 / 3)
_CORNERS, _NEARLY_A_BOX, _PARTS = 200, 8, 20


def shipped(name: str) -> PlanningProblem:
    """Return the problem of a scenario file of the package."""
    return load_scenario(share_directory() / "config" / "scenarios" / f"{name}.yaml")


def _growth(
    of: str,
    sized: Iterable[tuple[int, Sequence[PlanningProblem]]],
    settings: PlannerSettings,
    warm_up: int = 1,
) -> Iterator[Row]:
    """Yield the median time of each size's problems, and its ratio to that of the first size."""
    first = None
    for place, (size, problems) in enumerate(sized):
        row: Row = {"of": of, "size": size, "seconds": None, "rollouts": None, "ratio": None}
        with suppress(NoPlanFound):
            plans, seconds = timed_plans(problems, settings, warm_up)
            first = first if place else seconds
            row |= {"seconds": seconds, "ratio": seconds / first if first else None}
            row["rollouts"] = statistics.median(one.solver.rollouts for one in plans)
        yield row


def _repeated(problem: PlanningProblem, count: int) -> list[PlanningProblem]:
    """Return a problem once to warm up, and for each timed run."""
    return [problem] * (1 + _runs(count))


def _runs(count: int) -> int:
    return 1 if count == 1 else 5


def _with_spheres(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time the paper's capture as spheres clear of the plan are added."""
    problem, rng = shipped("lemur_capture"), np.random.default_rng(0)
    q, times = _flown(problem, settings)
    positions, spheres = arm_points(problem.robot, q), list(problem.spheres)

    def draw() -> Sphere | None:
        center, radius = rng.uniform(-_CUBE / 2, _CUBE / 2, 3), rng.uniform(0.05, 0.2)
        sphere = Sphere(f"s{len(spheres)}", center, radius)
        away = clearances(positions, times, segments(positions), [sphere]).distance.min()
        return sphere if away > _APART else None

    def sized() -> Iterator[tuple[int, Sequence[PlanningProblem]]]:
        for size in (3, 30) if count == 1 else (3, 30, 100, 1000):
            while len(spheres) < size:
                spheres.append(first_sound("sphere", problem.robot.model.name, draw))
            yield size, _repeated(replace(problem, obstacles=tuple(spheres)), count)

    yield from _growth("spheres", sized(), settings)


def _with_points(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time the paper's capture over numbers of points."""
    problem, sizes = shipped("lemur_capture"), (50, 100) if count == 1 else (50, 100, 200, 500)
    sized = ((size, _repeated(replace(problem, points=size), count)) for size in sizes)
    yield from _growth("points", sized, settings)


def _with_joints(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time arms with numbers of joints, each on so many ordinary scenarios."""
    sized = (
        (size, [scenario("ordinary", f"arm{size}", n, turned=False).problem for n in range(count)])
        for size in ((7, 6) if count == 1 else (7, 6, 9))
    )
    yield from _growth("joints", sized, settings, warm_up=0)


SCALING = tuple(
    Experiment(
        "scaling",
        f"Time grows with {title}",
        rows,
        {title.partition(":")[0]: "size"},
        {
            f"time / {first}": value("ratio", max, ".2f"),
            "time [s]": value("seconds", max),
            "rollouts": value("rollouts", max, "g"),
        },
        most=20,
    )
    for title, rows, first in (
        ("spheres: the paper's capture, more that leave the plan as it is", _with_spheres, 3),
        ("points: the paper's capture", _with_points, 50),
        ("joints: arms on ordinary scenarios, medians", _with_joints, 7),
    )
)


def _flown(problem: PlanningProblem, settings: PlannerSettings) -> tuple[Array, Array]:
    """Return configurations and times of a plan."""
    motion = perform(PlanningTask(problem, settings)).trajectory
    return from_trajectory(problem.robot, motion)[0], motion.time


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
        q, _ = _flown(problem, settings)
        sizes = (3, 30) if count == 1 else (3, 200)
        spheres = _more_spheres(problem, Swept(problem.robot, q), max(sizes))
        for size in sizes:
            of_shapes = replace(problem, obstacles=spheres[:size])
            lines = replace(problem.robot, geometry=Geometry.LINES, bodies=(), pairs=())
            of_lines = replace(of_shapes, robot=lines)
            both = _repeated(of_shapes, count), _repeated(of_lines, count)
            yield {"problem": name, "spheres": size} | _beside(*both, settings)


def _more_spheres(problem: PlanningProblem, way: Swept, count: int) -> tuple[Sphere, ...]:
    """Return a problem's spheres and others around the robot, clear of its bodies on the way."""
    rng, spheres = np.random.default_rng(0), list(problem.spheres)
    middle, reach = way.centers.mean(axis=(0, 1)), np.ptp(way.centers, axis=(0, 1)).max()

    def draw() -> Sphere | None:
        center = middle + rng.uniform(-1.5 * reach, 1.5 * reach, 3)
        sphere = Sphere(f"far{len(spheres)}", center, reach * rng.uniform(0.02, 0.08))
        return sphere if sphere_gap(way, sphere, _APART) > _APART else None

    while len(spheres) < count:
        spheres.append(first_sound("sphere", problem.robot.model.name, draw))
    return tuple(spheres)


CROWDS = Experiment(
    "crowds",
    "Processor time with lines and with shapes, min(L)",
    crowds,
    {"problem": "problem", "spheres": "spheres"},
    {
        "lines [s]": value("seconds_beside"),
        "shapes [s]": value("seconds"),
        "shapes / lines": value("ratio", form=".2f"),
        "lines: rollouts": value("rollouts_beside", max, "d"),
        "shapes: rollouts": value("rollouts", max, "d"),
    },
    most=5,
)


def prices(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Compare times among boxes with those among spheres, and among hulls with boxes."""
    few, many = (3, 30) if count == 1 else (3, 300)

    def price(
        capture: str, of: str, beside: str, asked: PlanningProblem, other: PlanningProblem
    ) -> Row:
        both = _repeated(asked, count), _repeated(other, count)
        return {"capture": capture, "of": of, "beside": beside} | _beside(*both, settings)

    for name in ("lemur_capture", "lemur_capture_bodies"):
        spheres = shipped(name)
        boxes = replace(spheres, obstacles=tuple(map(_box, spheres.spheres)))
        hulls = replace(spheres, obstacles=tuple(map(_hull, boxes.obstacle_bodies)))
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
            replace(one, obstacles=tuple(map(_box_inside, one.spheres))) for one in among_spheres
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
        "time / time": value("ratio", form=".2f"),
        "time [s]": value("seconds"),
        "beside [s]": value("seconds_beside"),
        "rollouts": value("rollouts", max, "d"),
        "rollouts beside": value("rollouts_beside", max, "d"),
    },
    most=20,
)


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
    q, times = _flown(problem, settings)
    way, rng = Swept(with_bodies(problem.robot), q), np.random.default_rng(0)
    found = list[ObstacleBody]()

    def draw() -> ObstacleBody | None:
        turn = eigen_quaternion(random_turn(rng))
        solid = Solid("box", rng.uniform(0.1, 0.4, 3))
        center = rng.uniform(-_CUBE / 2, _CUBE / 2, 3)
        box = ObstacleBody(f"box{len(found)}", solid, center, turn)
        return box if gap_of(way, times, box) > _APART else None

    while len(found) < count - len(problem.obstacles):
        found.append(first_sound("box", problem.robot.model.name, draw))
    return (*problem.obstacle_bodies, *found)


def _targets(
    problem: PlanningProblem, settings: PlannerSettings
) -> tuple[PlanningProblem, PlanningProblem]:
    """Return a capture of a target of 20 spheres, and one with boxes of equal volume instead."""
    body, rng = problem.target_body, np.random.default_rng(0)
    if body is None:
        raise ValueError("there is no target body")
    q, times = _flown(problem, settings)
    way, spheres = Swept(with_bodies(problem.robot), q), list[AttachedSphere]()

    def draw() -> tuple[AttachedSphere, AttachedBody] | None:
        name, center, radius = f"p{len(spheres)}", rng.normal(0.0, 0.5, 3), rng.uniform(0.05, 0.15)
        box = AttachedBody(name, Solid("box", np.full(3, _EDGE * radius)), center)
        ball = replace(box, id="b", shape=Solid("capsule", np.array([radius, 1e-3])))
        both = bodies_in(tuple(attached(replace(body, obstacles=(ball, box)))))
        if min(gap_of(way, times, one) for one in both) <= _APART:
            return None
        return AttachedSphere(name, center, radius), box

    boxes = list[AttachedBody]()
    while len(spheres) < _PARTS:
        sphere, box = first_sound("part of a target", problem.robot.model.name, draw)
        spheres.append(sphere)
        boxes.append(box)
    return (
        with_capture_target(replace(body, obstacles=tuple(spheres)), problem),
        with_capture_target(replace(body, obstacles=tuple(boxes)), problem),
    )


def _on_cores(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan in one, two and four processes, if the machine has as many cores."""
    kinds = {
        "least attitude": [least_attitude(*key) for key in islice(BEST_KNOWN, count)],
        # Not the first one, which takes twenty times the median.
        "all features": [ALL_FEATURES.draw(one).problem for one in range(1, 1 + count)],
    }
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, _CORES)
    try:
        for search, problems in kinds.items():
            for processes in (one for one in (1, 2, 4) if one <= len(_CORES)):
                for problem in problems:
                    task = PlanningTask(problem, replace(settings, threads=processes))
                    begun = time.perf_counter()
                    with suppress(NoPlanFound):
                        perform(task)
                    seconds = time.perf_counter() - begun
                    yield {"search": search, "processes": processes, "seconds": seconds}
    finally:
        os.sched_setaffinity(0, own)


SEVERAL_CORES = Experiment(
    "several cores",
    "Searches on several cores",
    _on_cores,
    {"search": "search", "processes": "processes"},
    {
        "scenarios": count,
        "wall clock, median [s]": value("seconds", form=".2f"),
        "90 % [s]": value("seconds", quantile_90, ".2f"),
        "worst [s]": value("seconds", max, ".2f"),
    },
    most=len(BEST_KNOWN),
)
