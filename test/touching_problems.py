"""Problems in which the robot may touch what is around it, and itself, at its start and goal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
from bodied_robots import body_placements, collision, random_robot, with_solids

from ff_planner_benchmark.problems import witnessed
from ff_planner_ros.planning.distance.allowed_contact import split_pairs
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    Orientation,
    PlanningProblem,
    RigidMotion,
    attached,
)
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.problems.robots import bench_robot, planar_urdf
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text

NEAR = 0.2  # within which the end effector may touch [m]


def planar_robot() -> Robot:
    """Return three links on a table, a box on each."""
    box = collision("box", 'size="0.3 0.1 0.1"', "0.15 0 0")
    solids = dict.fromkeys(("chaser", "link_1", "link_2", "link_3"), box)
    urdf = with_solids(planar_urdf(3), solids)
    return robot_from_urdf_text(urdf, "chaser", "end_effector", Base.PLANAR)


# By name, with the seed of the draw.
ROBOTS: dict[str, tuple[int, Callable[[], Robot]]] = {
    "lemur": (0, lambda: bench_robot("lemur", Geometry.SHAPES)),
    "arm7": (1, lambda: bench_robot("arm7", Geometry.SHAPES)),
    "with slides": (2, lambda: random_robot(20)),
    "on a table": (3, planar_robot),
}


@cache
def drawn(name: str) -> PlanningProblem:
    """Draw the problem with contacts of one of `ROBOTS`."""
    seed, robot = ROBOTS[name]
    return touching(robot(), seed)


def to_a_posture() -> PlanningProblem:
    """Return one that ends at positions of the joints."""
    problem = drawn("arm7")
    return replace(problem, posture=Posture(positions=problem.start.joint_positions + 0.3))


DRAWINGS: dict[str, Callable[[], PlanningProblem]] = {
    **{f"touching, {name}": partial(drawn, name) for name in ROBOTS},
    "touching, arm7 to a posture": to_a_posture,
}


def touching(robot: Robot, seed: int) -> PlanningProblem:
    """Draw a problem that begins folded, in a ball, in a box that turns, and in a tumbling body.

    Links may touch the obstacles and, of an arm that can be folded so, each other.
    """
    rng = np.random.default_rng([seed, 7])
    while True:
        posture = rng.uniform(-2.5, 2.5, robot.joints)
        posture = np.clip(posture, robot.lower_position_limits, robot.upper_position_limits)
        drawn = witnessed.drawn_problem(robot, posture, Orientation.FIXED, 1, rng)
        if drawn is None:
            continue
        found = with_contacts(replace(drawn.problem, posture=None), rng)
        if split_pairs(found).at_start:
            return found


def with_contacts(problem: PlanningProblem, rng: np.random.Generator) -> PlanningProblem:
    """Add obstacles where links begin and where the end effector ends; every second may touch."""
    robot = problem.robot
    bodies, (q, _) = robot.bodies, configuration(robot, problem.start)
    places = [place.translation for place in body_placements(robot, q)]
    first, second, third = (places[k] for k in (-1, -2, len(bodies) // 2))
    up = np.array([0.0, 0.0, 1.0])
    tumbling = TargetBody(
        position=third + 0.2 * np.array([1.0, 1.0, 0.0]),
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.diag([2.0, 3.0, 4.0]),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        linear_velocity=[0.01, 0.0, 0.0],
        angular_velocity=0.1 * up,
        obstacles=(
            AttachedObstacle.sphere("knob", [-0.2, -0.2, 0.0], 0.06),
            AttachedObstacle("bar", Solid("box", [0.1, 0.1, 0.3]), [-0.2, -0.2, 0.1]),
        ),
    )
    obstacles = (
        Obstacle.sphere("ball", first, 0.08, 0.01 * rng.normal(size=3) * (1.0 - up)),
        Obstacle.sphere("fixture", problem.target.position, 0.1),
        Obstacle(
            "box", Solid("box", [0.2, 0.2, 0.1]), RigidMotion(second, angular_velocity=0.05 * up)
        ),
        Obstacle(
            "wall", Solid("cylinder", [0.1, 0.2]), RigidMotion(problem.target.position + 0.05)
        ),
        *attached(tumbling),
    )
    links = [body.link for body in bodies]
    allowed = [f"{link}/{one.id}" for link in links[1:] for one in obstacles]
    allowed += [f"{links[a]}/{links[b]}" for a, b in robot.pairs if (a + b) % 2]
    return replace(
        problem,
        obstacles=(*problem.obstacles, *obstacles),
        allowed_collisions=tuple(allowed),
        contact_distance=NEAR,
    )
