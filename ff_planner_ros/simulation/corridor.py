"""Margin of an execution to the approach corridor, relative to the target's motion in MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Base
from ff_planner_ros.simulation.capture import moved_in_engine
from ff_planner_ros.simulation.engine import Engine


@dataclass(frozen=True)
class Corridor:
    """How far an execution stays inside the approach corridor."""

    margin: float  # smallest distance to the corridor's side; negative: outside [m]
    time: float  # of this margin, from the start of the plan [s]
    inside_from: float  # from then on the end effector stays within the approach's distance [s]


def corridor(
    scene: Scene, base: Base, engine: Engine, states: Sequence[Array], times: Array
) -> Corridor | None:
    """Return how far a motion stays inside the corridor until the capture; None: there is none.

    Args:
        states: States of the engine, in the scene's inertial frame.
        times: From the start of the plan, at least as many as states. Shape (times,) [s].
    """
    captured, approach = scene.capture_time, scene.approach
    if approach is None or captured is None:
        return None
    # The last one is that at the capture, but for rounding.
    count = int(np.searchsorted(times[: len(states)], captured + np.diff(times).min() / 2))
    grasps = _grasps(scene, times[:count], captured)
    if grasps is None:
        return None
    positions, turns = grasps
    points = np.array([engine.observe(state).ee_position for state in states[:count]])
    # With a planar base the height does not count.
    way = np.isin(range(3), base.rows) * (points - positions)
    places = turns.inv().apply(way)
    margins, away = approach.margins(places).values, np.linalg.norm(places, axis=1)
    least, outside = int(margins.argmin()), np.flatnonzero(away > approach.distance)
    inside = min(int(outside[-1]) + 1, count - 1) if outside.size else 0
    return Corridor(float(margins[least]), float(times[least]), float(times[inside]))


def _grasps(scene: Scene, times: Array, captured: float) -> tuple[Array, Rotation] | None:
    """Return positions and orientations of the grasp at times; of a body, by the engine.

    None: the goal is not known.
    """
    body, target = scene.target_body, scene.target
    if body is not None:
        positions, attitudes, _ = moved_in_engine(body, times)
        turns = attitudes * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
        return positions + attitudes.apply(body.grasp_position.copy()), turns
    if target is None:
        return None
    later = times - captured
    turned = Rotation.from_rotvec(np.outer(later, target.angular_velocity))
    positions = target.position + np.outer(later, target.linear_velocity)
    return positions, turned * Rotation.from_quat(target.quaternion_xyzw.copy())
