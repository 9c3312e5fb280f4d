"""The smallest distance of a robot's bodies to each other or to obstacles, at a plan's points."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.solids_apart import nearest_points
from ff_planner_ros.planning.distance.surroundings import (
    obstacle_poses,
    surroundings,
)
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Nearest:
    """The smallest distance between two bodies, or a body and an obstacle."""

    pair: str  # "body/body" or "body/obstacle", by their names
    time: float  # from the start of the plan [s]
    distance: float  # negative where they penetrate [m]
    ends: Array  # the nearest point of each, inertial; shape (2, 3) [m]

    @property
    def words(self) -> str:
        """Return pair, distance and time."""
        return f"{self.pair}, {self.distance * 1e3:.1f} mm at {self.time:.2f} s"


def nearest(
    robot: Robot,
    motion: Trajectory,
    obstacles: Sequence[Obstacle],
    may_touch: Collection[str] = (),
) -> Nearest | None:
    """Return the smallest distance at the points of a plan; see `nearest_of`."""
    q, _ = from_trajectory(robot, motion)
    return nearest_of(robot, q, motion.time - motion.time[0], obstacles, may_touch)


def nearest_of(
    robot: Robot,
    q: Array,
    times: Array,
    obstacles: Sequence[Obstacle],
    may_touch: Collection[str] = (),
) -> Nearest | None:
    """Return the smallest distance at some configurations; None without bodies or pairs.

    Args:
        q: Configurations. Shape (points, 7 + joints).
        times: Their times, from the instant of the obstacles' states on. Shape (points,) [s].
        may_touch: Pairs that are left out, named as in `allowed_collisions`.
    """
    if not robot.bodies:
        return None
    data, placed, balls = robot.model.createData(), [], []
    others = [
        [pin.SE3(*at) for at in zip(*obstacle_poses(one, times), strict=True)] for one in obstacles
    ]
    around = surroundings(tuple(obstacles))
    centers = around.centers(times)
    for row, q_i in enumerate(q):
        pin.forwardKinematics(robot.model, data, q_i)
        places = [data.oMi[body.joint] * body.placement_in_joint for body in robot.bodies]
        placed.append([*places, *(each[row] for each in others)])
        own = [data.oMi[body.joint].act(body.center_in_joint) for body in robot.bodies]
        balls.append([*own, *centers[row]])
    count = len(robot.bodies)
    links = [body.link for body in robot.bodies] + [one.id for one in obstacles]
    every = [*robot.pairs, *((a, count + b) for a in range(count) for b in range(len(obstacles)))]
    pairs = [
        (a, b)
        for a, b in every
        if not {f"{links[a]}/{links[b]}", f"{links[b]}/{links[a]}"}.intersection(may_touch)
    ]
    if not pairs:
        return None
    solids = [body.solid for body in robot.bodies]
    names = [body.name for body in robot.bodies] + [one.id for one in obstacles]
    radii = np.append([body.radius for body in robot.bodies], around.radii)
    solids += (one.solid.geometry for one in obstacles)
    first, second = np.array(pairs).T
    middle = np.array(balls)
    apart = np.linalg.norm(middle[:, first] - middle[:, second], axis=-1)
    bounds = apart - radii[first] - radii[second]
    found: Nearest | None = None
    # The promising first: most need not be measured then.
    for flat in np.argsort(bounds, axis=None, kind="stable"):
        row, pair = divmod(int(flat), len(pairs))
        if found is not None and bounds[row, pair] >= found.distance:
            break
        a, b = pairs[pair]
        distance, ends = nearest_points(solids[a], placed[row][a], solids[b], placed[row][b])
        if found is None or distance < found.distance:
            found = Nearest(f"{names[a]}/{names[b]}", float(times[row]), distance, ends)
    return found
