"""A box in place of the chaser's shape, which a URDF may omit, from its mass and inertia."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot


class Box(NamedTuple):
    """A box about the chaser's centre of mass."""

    edges: Array  # lengths along its own axes; shape (3,) [m]
    rotation_box_to_chaser: Array  # shape (3, 3)


def uniform_box(robot: Robot) -> Box:
    """Return the uniform box with the chaser's mass and inertia."""
    chaser = robot.model.inertias[1]
    inertia = robot.rotation_chaser_to_base.T @ chaser.inertia @ robot.rotation_chaser_to_base
    moments, axes = np.linalg.eigh(inertia)
    # About axis i: I_i = m (a_j^2 + a_k^2) / 12 with edges a.
    edges = np.sqrt(np.maximum(moments.sum() / 2 - moments, 0.0) * 12 / chaser.mass)
    # The axes have either sign; a rotation is right-handed.
    return Box(edges, axes * np.sign(np.linalg.det(axes)))
