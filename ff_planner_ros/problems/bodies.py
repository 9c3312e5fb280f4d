"""Problems of robots with collision bodies among spheres, each with a path that solves it.

That path, the witness, is drawn as in `scenarios`: the robot's bodies keep away from each other and
from the spheres, while the straight path (xi = 0) collides. All distances are Coal's; nothing here
knows how the planner measures or searches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.paths.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.problems.drawn import Drawn, first_sound
from ff_planner_ros.problems.paths import STRAIGHT, roll_out, within_limits
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import (
    SINGULAR_VALUE_BOUND,
    draw_motion,
    draw_near,
    stretched_length,
)
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot

ROBOTS = ("lemur", "arm6", "canadarm2")

# What the witness keeps [m]: its bodies from each other, and from the spheres.
APART, CLEAR = 0.01, 0.02
# Between two looks at the witness a distance falls by no more than this [m], nearly always.
_ALLOWANCE = 2e-3
# Spread of the witness's coefficients, in lengths of the stretched arm and [rad].
_WINDING, _TURNING = 0.06, 0.2
_FEWEST, _MOST = 3, 6  # spheres
_SMALLEST = 0.025  # of them, in lengths of the stretched arm
_SCREENING_POINTS, _POINTS = 13, 100
# Joints of this rate are quick enough for the durations that are drawn [rad/s].
_QUICK = 0.2


@cache
def problem(robot: str, number: int) -> Drawn[Array]:
    """Return a problem of one of `ROBOTS`, by the number that seeds the draw.

    Its witness is the coefficients xi of the path's free terms. Shape (6, 3).
    """
    return drawn_problem(bench_robot(robot, Geometry.SHAPES), f"bodies {robot}", number)


def drawn_problem(robot: Robot, name: str, number: int) -> Drawn[Array]:
    """Return a problem of any robot with bodies; name and number seed the draw."""
    rng = np.random.default_rng([*name.encode(), number])
    return first_sound("bodies", name, lambda: _draw(robot, rng))


def _draw(robot: Robot, rng: np.random.Generator) -> Drawn[Array] | None:
    """Draw a problem; None if what was drawn is not sound."""
    reach = stretched_length(robot)
    try:
        asked = _slowed(draw_motion(robot, reach, rng))
    except InvalidInput:  # a singular posture
        return None
    spread = np.repeat([_WINDING * reach, _TURNING], 3)
    witness = rng.normal(size=(COMPONENTS, FREE_TERMS)) * spread[:, None]
    if not within_limits(asked, witness, SINGULAR_VALUE_BOUND, _SCREENING_POINTS):
        return None
    if own_gap(Swept(robot, roll_out(asked, witness, _SCREENING_POINTS).q), APART) < APART:
        return None
    if not within_limits(asked, witness, SINGULAR_VALUE_BOUND):
        return None
    way = Swept(robot, roll_out(asked, witness, _POINTS).q)
    if own_gap(way, APART + _ALLOWANCE) < APART + _ALLOWANCE:
        return None
    try:
        straight = Swept(robot, roll_out(asked, STRAIGHT, _POINTS).q)
    except NoPlanFound:  # it meets a singularity
        return None
    spheres = _draw_spheres(reach, way, straight, rng)
    if spheres is None:
        return None
    return Drawn(replace(asked, obstacles=spheres), witness)


def _slowed(problem: PlanningProblem) -> PlanningProblem:
    """Return the problem slowed down for slow joints: longer, with smaller initial velocities."""
    times, start = max(1.0, _QUICK / problem.robot.velocity_limits.min()), problem.start
    return replace(
        problem,
        duration=times * problem.duration,
        start=replace(
            start,
            linear_velocity_chaser_in_inertial=start.linear_velocity_chaser_in_inertial / times,
            angular_velocity_chaser_in_inertial=start.angular_velocity_chaser_in_inertial / times,
            joint_velocities=start.joint_velocities / times,
        ),
    )


class Swept:
    """The poses of a robot's bodies in many configurations."""

    def __init__(self, robot: Robot, way: Array) -> None:
        """Compute the poses of all bodies.

        Args:
            way: Configurations. Shape (points, 7 + joints).
        """
        self.robot = robot
        self.way = way
        data = robot.model.createData()
        self.places: list[list[coal.Transform3s]] = []  # of the bodies, at each configuration
        centers = []
        for q in way:
            pin.forwardKinematics(robot.model, data, q)
            placed = [data.oMi[one.joint] * one.placement_in_joint for one in robot.bodies]
            self.places.append([coal.Transform3s(at.rotation, at.translation) for at in placed])
            centers.append([data.oMi[one.joint].act(one.center_in_joint) for one in robot.bodies])
        self.centers = np.array(centers)  # of the spheres around them; shape (points, bodies, 3)


def own_gap(swept: Swept, below: float) -> float:
    """Return the smallest self distance [m]; exact if it is under `below`, else possibly more."""
    robot, centers = swept.robot, swept.centers
    first, second = np.array(robot.pairs).T
    radii = np.array([body.radius for body in robot.bodies])
    apart = np.linalg.norm(centers[:, first] - centers[:, second], axis=-1)
    near = np.argwhere(apart - radii[first] - radii[second] < below)
    return min(
        (_own_distance(swept, point, *robot.pairs[pair]) for point, pair in near), default=np.inf
    )


def sphere_gap(swept: Swept, sphere: Obstacle, below: float, centers: Array | None = None) -> float:
    """Return the smallest distance of bodies to a sphere [m]; exact if under `below`.

    Args:
        centers: The sphere's centre at each configuration, shape (points, 3) [m]; None: it rests.
    """
    radii = np.array([body.radius for body in swept.robot.bodies])
    if centers is None:
        centers = np.tile(sphere.center, (len(swept.way), 1))
    apart = np.linalg.norm(swept.centers - centers[:, None], axis=-1)
    ball, places = coal.Sphere(sphere.radius), [coal.Transform3s(np.eye(3), c) for c in centers]
    return min(
        (
            distance(swept.robot.bodies[body].solid, swept.places[point][body], ball, places[point])
            for point, body in np.argwhere(apart - radii - sphere.radius < below)
        ),
        default=np.inf,
    )


def _own_distance(swept: Swept, point: int, first: int, second: int) -> float:
    one, other = swept.robot.bodies[first].solid, swept.robot.bodies[second].solid
    return distance(one, swept.places[point][first], other, swept.places[point][second])


def distance(
    one: coal.CollisionGeometry,
    at_one: coal.Transform3s,
    other: coal.CollisionGeometry,
    at_other: coal.Transform3s,
) -> float:
    """Return the distance of two solids, negative where they penetrate [m]."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(coal.distance(one, at_one, other, at_other, request, result))


def _draw_spheres(
    reach: float, way: Swept, straight: Swept, rng: np.random.Generator
) -> tuple[Obstacle, ...] | None:
    """Draw spheres that the witness clears; the straight path hits the first one, or itself."""
    wanted = int(rng.integers(_FEWEST, _MOST, endpoint=True))
    chosen: list[Obstacle] = []
    blocked = own_gap(straight, 0.0) < 0.0
    for near, needed in ((straight, 0 if blocked else 1), (way, wanted)):
        if len(chosen) == needed:
            continue
        for one in draw_near(arm_points(near.robot, near.way), reach, rng):
            room = sphere_gap(way, one, CLEAR + _ALLOWANCE) - CLEAR - _ALLOWANCE
            radius = one.radius + min(0.0, room)
            if radius < _SMALLEST * reach:
                continue
            sphere = Obstacle.sphere(f"s{len(chosen) + 1}", one.center, radius)
            hit = near is way or sphere_gap(straight, sphere, 0.0) < 0.0
            if hit and not _overlaps(sphere, chosen):
                chosen.append(sphere)
            if len(chosen) == needed:
                break
        else:
            return None
    return tuple(chosen)


def _overlaps(sphere: Obstacle, others: Sequence[Obstacle]) -> bool:
    return any(
        np.linalg.norm(sphere.center - other.center) <= max(sphere.radius, other.radius)
        for other in others
    )
