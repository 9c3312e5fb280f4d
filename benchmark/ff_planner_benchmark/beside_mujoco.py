"""Drake as an engine of `ff-planner verify`, beside MuJoCo."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from ff_planner_benchmark.parts import parts_of
from ff_planner_benchmark.second_engine import Miss, flown_in_drake
from ff_planner_benchmark.second_shapes import Shapes
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.deviation import Deviation, is_allowed
from ff_planner_ros.simulation.other_engines import Flown

# It warns that joint limits stop nothing: a plan keeps them, or the check refuses it.
logging.getLogger("drake").setLevel(logging.ERROR)
# Factors by which the samples of the torques are refined while deviations exceed their tolerances:
# an arm with a heavy payload diverges from its plan faster than it moves.
_FINER = (1, 2, 4)


def flown(robot: Robot, trajectory: Trajectory, scene: Scene, parts: int) -> Flown:
    """Execute a plan in Drake, in parts that each begin on the plan.

    As in `verify`, the sum of the parts' deviations is multiplied by the number of parts.

    Args:
        scene: In the plan's inertial frame, at the plan's first point.

    Raises:
        FfPlannerError: Drake refuses the robot or a shape, or cannot integrate the motion.
    """
    try:
        for finer in _FINER:
            found = _flown(robot, trajectory, scene, parts, finer)
            if is_allowed(found.deviation):
                break
    except RuntimeError as error:
        words = f"Drake cannot execute the plan: {error}"
        raise FfPlannerError(Status.UNSUPPORTED, words) from error
    return found


def _flown(robot: Robot, trajectory: Trajectory, scene: Scene, parts: int, finer: int) -> Flown:
    solids = Shapes(robot, scene.obstacles, scene.allowed_collisions)
    seen, misses = [(math.inf, "", 0.0)], list[Miss]()
    for begin, part in parts_of(trajectory, parts):
        look = partial(_look, solids, seen, begin)
        misses.append(flown_in_drake(robot, part, look, finer))
    total = Miss(*(parts * np.sum(misses, axis=0)))
    off = Deviation(total.position, total.orientation, total.chaser, total.chaser_orientation)
    distance, pair, time = min(seen)
    return Flown(f"Drake {version('drake')}", off, pair, time, distance)


def _look(
    solids: Shapes,
    seen: list[tuple[float, str, float]],
    begin: float,
    links: Sequence[Any],
    time: float,
) -> None:
    """Add the nearest pair at a point of a part that begins at `begin`: distance, names, time."""
    distances = solids.distances(links, begin + time)
    if distances:
        pair = min(distances, key=distances.__getitem__)
        seen.append((distances[pair], pair, begin + time))
