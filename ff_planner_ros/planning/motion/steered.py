"""How many of a target's conditions the geometry of an arm allows it to meet at once."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.configuration import turns_of
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import arm_jacobian, generalised_jacobian

# Postures that are tested: one of them is regular, if any is.
_POSTURES = 8
# Smallest singular value, relative to the largest, of a direction in which the arm can steer the
# end effector. Arms drawn at random have 0.02 and more; those whose last axis is the end effector's
# free axis have 0.001: they rotate the chaser a little.
_LEAST_PART = 0.003


def steered(robot: Robot, target: Target, chaser_moves: bool = True) -> int:
    """Return how many of a target's conditions the joint velocities can meet at once: a rank.

    Args:
        chaser_moves: Else the rank is that of the arm on a base that stands still.
    """
    axis = target.free_axis_in_ee
    told = None if axis is None else tuple(axis.tolist())
    return _rank(robot, target.orientation, told, chaser_moves)


def why_not_steered(robot: Robot, target: Target) -> str:
    """Return words on why an arm steers no more of a target: masses, joint limits, or its axes.

    It is the masses if the arm steers more on a base that stands still, and the limits if it does
    in postures beyond them.
    """
    met, alone = steered(robot, target), "on a base that stands still the arm could meet more"
    turns = ~robot.joint_slides.any(axis=1)
    lower = np.where(turns, -np.pi, robot.lower_position_limits)
    upper = np.where(turns, np.pi, robot.upper_position_limits)
    anywhere = replace(robot, lower_position_limits=lower, upper_position_limits=upper)
    first, *links = robot.model.inertias[1:]
    least, arm = np.linalg.eigvalsh(first.inertia)[0], sum(link.mass for link in links)
    chaser = f"the chaser, {first.mass:g} kg and {least:.4g} kg m2"
    if steered(robot, target, chaser_moves=False) > met:
        held = replace(robot, base=Base.ATTITUDE_HELD)
        turns_away = robot.base is Base.FREE_FLYER and steered(held, target) > met
        light = "turns away under" if turns_away and first.mass > arm else "is too light for"
        why = f"{chaser}, {light} the arm, {arm:.4g} kg: {alone}"
    elif steered(anywhere, target) > met:
        why = "the joints' position limits are too narrow: beyond them the arm could meet more"
    elif steered(anywhere, target, chaser_moves=False) > met:
        why = f"the joints' position limits are narrow and {chaser}, is light"
    else:
        return f"and as its axes lie the arm meets no more than {met} of them at once"
    return f"and the arm meets no more than {met} of them at once, for {why}"


@lru_cache(maxsize=8)
def _rank(
    robot: Robot, orientation: Orientation, axis: tuple[float, ...] | None, chaser_moves: bool
) -> int:
    data, most = robot.model.createData(), 0
    free_axis = None if axis is None else np.array(axis)
    for number in range(_POSTURES):
        q, of_rates = _posture(robot, number, chaser_moves)
        asked = twist_conditions(robot, data, orientation, free_axis, q) @ of_rates
        values = np.linalg.svd(asked, compute_uv=False)
        most = max(most, int((values > _LEAST_PART * values[0]).sum()))
        if most == len(values):  # no posture has more
            break
    return most


@lru_cache(maxsize=8 * _POSTURES)
def _posture(robot: Robot, number: int, chaser_moves: bool) -> tuple[Array, Array]:
    """Return a configuration and its Jacobian, both parts scaled to unit norm."""
    middle = 2.0 * np.pi * turns_of(robot)
    lowest = np.maximum(robot.lower_position_limits, middle - np.pi)
    highest = np.minimum(robot.upper_position_limits, middle + np.pi)
    drawn = np.random.default_rng(0).uniform(size=(_POSTURES, robot.joints))[number]
    joints = lowest + drawn * (np.maximum(lowest, highest) - lowest)
    q = np.concatenate([pin.neutral(robot.model)[:7], joints])
    jacobian = generalised_jacobian if chaser_moves else arm_jacobian
    of_rates = jacobian(robot, robot.model.createData(), q)
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
