"""How many of a target's conditions the geometry of an arm allows it to meet at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import generalised_jacobian

# Postures that are tested: one of them is regular, if any is.
_POSTURES = 8
# Smallest singular value, relative to the largest, of a direction in which the arm can steer the
# end effector. Arms drawn at random have 0.02 and more; those whose last axis is the end effector's
# free axis have 0.001: they rotate the chaser a little.
_LEAST_PART = 0.003


def steered(robot: Robot, target: Target) -> int:
    """Return how many of a target's conditions the joint velocities can meet at once: a rank."""
    axis = target.free_axis_in_ee
    return _rank(robot, target.orientation, None if axis is None else tuple(axis.tolist()))


@lru_cache(maxsize=8)
def _rank(robot: Robot, orientation: Orientation, axis: tuple[float, ...] | None) -> int:
    data, most = robot.model.createData(), 0
    free_axis = None if axis is None else np.array(axis)
    for number in range(_POSTURES):
        q, of_rates = _posture(robot, number)
        asked = twist_conditions(robot, data, orientation, free_axis, q) @ of_rates
        values = np.linalg.svd(asked, compute_uv=False)
        most = max(most, int((values > _LEAST_PART * values[0]).sum()))
        if most == len(values):  # no posture has more
            break
    return most


@lru_cache(maxsize=8 * _POSTURES)
def _posture(robot: Robot, number: int) -> tuple[Array, Array]:
    """Return a configuration and its generalised Jacobian, both parts scaled to unit norm."""
    lowest = np.maximum(robot.lower_position_limits, -np.pi)
    highest = np.minimum(robot.upper_position_limits, np.pi)
    drawn = np.random.default_rng(0).uniform(size=(_POSTURES, robot.joints))[number]
    joints = lowest + drawn * (np.maximum(lowest, highest) - lowest)
    q = np.concatenate([pin.neutral(robot.model)[:7], joints])
    of_rates = generalised_jacobian(robot, robot.model.createData(), q)
    linear = sum(row < 3 for row in robot.base.tip_rows)
    for rows in (of_rates[:linear], of_rates[linear:]):
        rows /= max(float(np.linalg.norm(rows)), np.finfo(float).tiny)
    return q, of_rates


def twist_conditions(
    robot: Robot, data: pin.Data, orientation: Orientation, free_axis: Array | None, q: Array
) -> Array:
    """Return the matrix that selects from an inertial twist what a target specifies.

    Shape (conditions, rows), where the rows are the base's `tip_rows`.
    """
    rows = robot.base.tip_rows
    every = np.eye(len(rows))
    linear = every[[row < 3 for row in rows]]
    if orientation is Orientation.FREE:
        return linear
    if free_axis is None:
        return every
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    _, _, across = np.linalg.svd((tip.rotation @ free_axis)[None])
    return np.concatenate([linear, np.hstack([np.zeros((2, 3)), across[1:]])])
